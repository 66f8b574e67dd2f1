"""The questions that are asked about every tree, and how single ticks answer them."""

from collections.abc import Callable, Sequence
from itertools import combinations
from typing import Final

from btcore.blackboard.ports import Input, PortRole
from btcore.engine.node import TreeNode
from btcore.errors import BlackboardError
from btcore.nodes.sequences_and_fallbacks import ReactiveNode
from btcore.status import IDLE, RUNNING
from btcore.tree.tree import Tree
from btcore_proof.entry_names import name_in_main_tree
from btcore_proof.model_leaves import LeafEvent, model_leaf_model
from btcore_proof.tick_runner import Check, Tick

ENDS: Final = "the tree ends"
LEAVES: Final = "every leaf is ticked, and can succeed and fail"
RESOURCES: Final = "no two leaves use the same resource at once"
HALTED: Final = "everything that runs is halted when its parent ends"
INPUTS: Final = "every mandatory input is written before it is read"
REACTIVE: Final = "no reactive node keeps two children running"
EXCEPTIONS: Final = "no node raises an exception"
STANDARD_QUESTIONS: Final = (ENDS, LEAVES, RESOURCES, HALTED, INPUTS, REACTIVE, EXCEPTIONS)


def tick_checks(tree: Tree) -> dict[str, Check]:
    """Return the checks of what happens in a tick, by the question that they answer."""
    return {RESOURCES: _resource_check(tree), INPUTS: Check(_unwritten_input), EXCEPTIONS: Check(_exception)}


def state_checks(tree: Tree) -> dict[str, Check]:
    """Return the checks that depend only on the tree after a tick, by the question that they answer."""
    return {HALTED: Check(_halt_check(tree)), REACTIVE: Check(_reactive_check(tree))}


def endless_nodes(tree: Tree) -> list[TreeNode]:
    """Return the nodes that may run forever, as declared: endless leaves, and loops without a limit."""
    return [node for node in tree.nodes if _is_endless_loop(node) or _is_endless_leaf(node)]


def _is_endless_leaf(node: TreeNode) -> bool:
    model = model_leaf_model(node)
    return model is not None and model.endless


def _is_endless_loop(node: TreeNode) -> bool:
    limits = [binding for binding in node.config.inputs.values() if binding.port.role is PortRole.REPETITIONS]
    return node.spec.is_endless or any(limit.key is None and limit.literal == -1 for limit in limits)


def _resource_check(tree: Tree) -> Check:
    shared: dict[tuple[int, int], str] = {}
    models = [(node, model) for node in tree.nodes if (model := model_leaf_model(node)) is not None]
    for (first, first_model), (second, second_model) in combinations(models, 2):
        common = sorted(first_model.uses & second_model.uses)
        if common:
            first_uid, second_uid = first.config.uid, second.config.uid
            shared[first_uid, second_uid] = shared[second_uid, first_uid] = common[0]
    if not shared:
        return Check(lambda tick: None)
    sharing = {uid for pair in shared for uid in pair}
    candidates = [node for node, _ in models if node.config.uid in sharing]
    handing_over = {node.config.uid for node, model in models if model.hands_over}
    of_one_tick = {node.config.uid for node, model in models if not model.lasts}

    def conflict_in(events: Sequence[LeafEvent], has_ended: bool) -> tuple[int, TreeNode] | None:
        """Return the number of the first event that uses a resource of another leaf, with this leaf.

        Args:
            events: The events of a tick, or of the first part of a tick.
            has_ended: Whether the tick has ended, so that no leaf will be halted in it.
        """
        for event in events:
            if event.before is not RUNNING and event.leaf.config.uid in sharing:
                break
        else:
            return None
        befores = {event.leaf.config.uid: event.before for event in reversed(events)}
        # An action that lasts uses its resources until it completes or is halted.
        users = {
            leaf.config.uid: leaf
            for leaf in candidates
            if befores.get(leaf.config.uid, leaf._status) is RUNNING
        }
        for number, event in enumerate(events):
            uid = event.leaf.config.uid
            if uid not in sharing:
                continue
            if event.before is not RUNNING:
                for other in users.values():
                    if (uid, other.config.uid) not in shared:
                        continue
                    if other.config.uid not in handing_over or uid in of_one_tick:
                        return number, other
                    if event.result is RUNNING and not _takes_over(events[number:], other, has_ended):
                        return number, other
            if event.result is RUNNING:
                users[uid] = event.leaf
            else:
                users.pop(uid, None)
        return None

    def find(tick: Tick) -> str | None:
        conflict = conflict_in(tick.events, tick.error is None)
        if conflict is None:
            return None
        number, other = conflict
        leaf = tick.events[number].leaf
        common = shared[leaf.config.uid, other.config.uid]
        for later in tick.events[number:]:
            if later.leaf is other and later.result is not RUNNING:
                end = "is halted" if later.result is IDLE else "completes"
                before = f"'{leaf.config.path}' starts before '{other.config.path}' {end}"
                return f"{before}, and both use {common}"
        return f"'{other.config.path}' and '{leaf.config.path}' both use {common}"

    return Check(find, lambda events: conflict_in(events, False) is not None)


def _takes_over(events: Sequence[LeafEvent], other: TreeNode, has_ended: bool) -> bool:
    """Return whether the leaf that starts in the first event may take over what the leaf *other* uses.

    It may if *other* is halted before it is ticked again.
    """
    leaf = events[0].leaf
    for event in events[1:]:
        if event.leaf is other:
            return event.result is IDLE
        if event.leaf is leaf and event.result is not RUNNING:
            return True
    return not has_ended


def _halt_check(tree: Tree) -> Callable[[Tick], str | None]:
    pairs = [(parent, child) for parent in tree.nodes for child in parent.children]

    def check(tick: Tick) -> str | None:
        if tick.error is not None:
            return None
        for parent, child in pairs:
            if child._status is RUNNING and parent._status is not RUNNING:
                late = f"'{child.config.path}' is still RUNNING"
                return f"{late} although its parent '{parent.config.path}' has ended"
        return None

    return check


def _reactive_check(tree: Tree) -> Callable[[Tick], str | None]:
    reactive = [node for node in tree.nodes if isinstance(node, ReactiveNode)]

    def check(tick: Tick) -> str | None:
        for node in reactive:
            running = [child for child in node.children if child._status is RUNNING]
            if len(running) > 1:
                first, second = running[0].config.path, running[1].config.path
                return f"'{node.config.path}' keeps '{first}' and '{second}' RUNNING"
        return None

    return check


def _unwritten_input(tick: Tick) -> str | None:
    port = _unwritten_port(tick)
    if port is None or port.key is None or tick.error is None:
        return None
    name = name_in_main_tree(port.blackboard, port.key)
    hint = "" if name is None else f"; if the program sets it before the first tick, use --given {name}"
    return f"'{tick.error.path}' reads {{{port.key}}}, which is not written{hint}"


def _exception(tick: Tick) -> str | None:
    if tick.error is None or _unwritten_port(tick) is not None:
        return None
    return f"'{tick.error.path}' raises {type(tick.error.cause).__name__}: {tick.error.cause}"


def _unwritten_port(tick: Tick) -> Input | None:
    """Return the port that has read an entry before it was written, or None."""
    if tick.error is None or not isinstance(tick.error.cause, BlackboardError):
        return None
    path = tick.error.path
    node = next((node for node in tick.tree.nodes if node.config.path == path), None)
    for port in node.config.inputs.values() if node is not None else ():
        if port.key is not None:
            entry = port.blackboard.find(port.key)
            if entry is None or entry.value is None:
                return port
    return None
