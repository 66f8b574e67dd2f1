"""The questions that are asked about every tree, and how single ticks answer them."""

from collections.abc import Callable, Hashable, Sequence
from itertools import combinations
from typing import Final

from btcore.engine.control import ControlNode
from btcore.engine.node import TreeNode
from btcore.errors import BlackboardError
from btcore.nodes.repeat import RepeatedNode
from btcore.nodes.result_decorators import KeepRunningUntilFailure
from btcore.proof.model_leaves import LeafEvent, model_leaf_model
from btcore.proof.tick_runner import Check, Tick
from btcore.status import RUNNING
from btcore.tree.tree import Tree

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
    if isinstance(node, KeepRunningUntilFailure):
        return True
    if not isinstance(node, RepeatedNode):
        return False
    limit = node.config.inputs.get(node.limit)
    return limit is not None and limit.key is None and limit.literal == -1


def _resource_check(tree: Tree) -> Check:
    shared: dict[tuple[int, int], str] = {}
    users = [(node, model) for node in tree.nodes if (model := model_leaf_model(node)) is not None]
    for (first, its), (second, other) in combinations(users, 2):
        common = sorted(its.uses & other.uses)
        if common:
            shared[first.uid, second.uid] = shared[second.uid, first.uid] = common[0]
    if not shared:
        return Check(lambda tick: None)
    sharing = {uid for pair in shared for uid in pair}
    of_one_tick = {node.uid for node, model in users if not model.lasts}

    def find(tick: Tick) -> str | None:
        if tick.error is not None:
            return None
        # An action that lasts uses its resources while it is RUNNING, an action of one tick in its tick.
        running = {leaf.uid: (leaf, -1) for leaf in tick.kept if leaf.uid in sharing}
        brief: list[tuple[TreeNode, int]] = []
        for number, (leaf, _, result, _) in enumerate(tick.events):
            uid = leaf.uid
            if uid in sharing:
                if uid in of_one_tick:
                    brief.append((leaf, number))
                elif result is RUNNING and leaf._status is RUNNING:
                    running.setdefault(uid, (leaf, number))
        for first, start in running.values():
            others = [*running.values(), *(other for other in brief if other[1] > start)]
            for second, _ in others:
                common = shared.get((first.uid, second.uid))
                if common:
                    return f"'{first.path}' and '{second.path}' both use {common}"
        return None

    def remember(events: Sequence[LeafEvent]) -> Hashable:
        # The actions of one tick that were ticked, and those after the start of each action that lasts.
        ticked: set[int] = set()
        after: dict[int, set[int]] = {}
        for leaf, _, result, _ in events:
            uid = leaf.uid
            if uid in sharing and uid in of_one_tick:
                ticked.add(uid)
                for later in after.values():
                    later.add(uid)
            elif uid in sharing and result is RUNNING:
                after.setdefault(uid, set())
        return frozenset(ticked), frozenset((uid, frozenset(later)) for uid, later in after.items())

    return Check(find, remember if of_one_tick & sharing else None)


def _halt_check(tree: Tree) -> Callable[[Tick], str | None]:
    pairs = [(parent, child) for parent in tree.nodes for child in parent.children]

    def check(tick: Tick) -> str | None:
        if tick.error is not None:
            return None
        for parent, child in pairs:
            if child._status is RUNNING and parent._status is not RUNNING:
                return f"'{child.path}' is still RUNNING although its parent '{parent.path}' has ended"
        return None

    return check


def _reactive_check(tree: Tree) -> Callable[[Tick], str | None]:
    reactive = [node for node in tree.nodes if isinstance(node, ControlNode) and node.runs_one_child]

    def check(tick: Tick) -> str | None:
        for node in reactive:
            running = [child for child in node.children if child._status is RUNNING]
            if len(running) > 1:
                return f"'{node.path}' keeps '{running[0].path}' and '{running[1].path}' RUNNING"
        return None

    return check


def _unwritten_input(tick: Tick) -> str | None:
    key = _unwritten_key(tick)
    return (
        None
        if key is None or tick.error is None
        else f"'{tick.error.path}' reads {{{key}}}, which is not written"
    )


def _exception(tick: Tick) -> str | None:
    if tick.error is None or _unwritten_key(tick) is not None:
        return None
    return f"'{tick.error.path}' raises {type(tick.error.cause).__name__}: {tick.error.cause}"


def _unwritten_key(tick: Tick) -> str | None:
    """Return the key of the entry that a node has read before it was written, or None."""
    if tick.error is None or not isinstance(tick.error.cause, BlackboardError):
        return None
    path = tick.error.path
    node = next((node for node in tick.tree.nodes if node.path == path), None)
    for port in node.config.inputs.values() if node is not None else ():
        if port.key is not None:
            entry = port.blackboard.find(port.key)
            if entry is None or entry.value is None:
                return port.key
    return None
