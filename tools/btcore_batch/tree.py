"""A tree that is ticked for many agents at once."""

import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from os import PathLike
from typing import Any, Final

import numpy as np

from btcore.blackboard.blackboard import Blackboard
from btcore.clock import NS_PER_S, Clock
from btcore.diagnostics import Diagnostic
from btcore.engine.leaf import StatefulAction
from btcore.engine.node import TreeNode
from btcore.errors import BtcoreError, ConversionError, NodeExecutionError, TreeError
from btcore.loading.load import load, loads, registry_or_standard
from btcore.nodes.builtin_nodes import BUILTIN_NODES
from btcore.registry.registry import Registry
from btcore.status import RUNNING
from btcore.suggestions import did_you_mean, nearest_name, suggestion
from btcore.tree.tree import Tree
from btcore_batch.agent_sets import AgentSet, AgentSets, Indices, Mask
from btcore_batch.blackboard import BatchBlackboard
from btcore_batch.columns import ColumnTable
from btcore_batch.context import BatchContext
from btcore_batch.conversion import array_of
from btcore_batch.leaf_declaration import LeafDeclaration, Statuses, read_declarations
from btcore_batch.leaf_nodes import FunctionNode, StatefulNode
from btcore_batch.node import BatchNode, status_array, unsupported
from btcore_batch.node_classes import BATCH_CLASSES

_MAX_SHOWN_AGENTS: Final = 5  # in the message of an error


class BatchCompiler:
    """Compiles an ordinary tree to the nodes of a batch.

    Args:
        context: The shared state of the batch.
        leaves: The declarations of the leaves, by registration ID.

    Attributes:
        nodes: All nodes, in pre-order after `compile`.
    """

    def __init__(self, context: BatchContext, leaves: Mapping[str, LeafDeclaration]) -> None:
        self.context = context
        self.leaves = leaves
        self.nodes: list[BatchNode] = []
        self._diagnostics: list[Diagnostic] = []

    def compile(self, tree: Tree) -> BatchNode:
        """Return the root of the batch for *tree*.

        Raises:
            TreeError: The batch engine cannot run *tree*; the error lists all nodes that it cannot run.
        """
        if tree.format != 4:
            message = f"the batch engine runs trees of format 4, and '{tree.id}' is of format {tree.format}"
            raise unsupported(tree.root.config, message, "convert it to format 4 with btcore convert")
        root = self._node(tree.root)
        if self._diagnostics:
            raise TreeError(self._diagnostics)
        self.nodes.sort(key=lambda node: node.uid)
        return root

    def _node(self, node: TreeNode) -> BatchNode:
        children = [self._node(child) for child in node.children]
        try:
            batch_node = self._create(node, children)
        except TreeError as error:
            # Continue with a placeholder, to report the errors of all nodes.
            self._diagnostics += error.diagnostics
            batch_node = BatchNode(node, self.context, children)
        self.nodes.append(batch_node)
        return batch_node

    def _create(self, node: TreeNode, children: list[BatchNode]) -> BatchNode:
        cls = BATCH_CLASSES.get(type(node))
        if cls is not None:
            return cls(node, self.context, children)
        leaf = self.leaves.get(node.config.id)
        if leaf is None or children:
            message = f"the batch engine does not run <{node.config.id}>"
            raise unsupported(node.config, message, self._hint(node, children))
        leaf_class = StatefulNode if issubclass(leaf.base_class, StatefulAction) else FunctionNode
        return leaf_class(node, self.context, leaf)

    def _hint(self, node: TreeNode, children: list[BatchNode]) -> str:
        if children:
            supported = [id for id, cls in BUILTIN_NODES[4].items() if cls in BATCH_CLASSES]
            return f"it runs {', '.join(sorted(supported))}"
        nearest = nearest_name(node.config.id, self.leaves)
        question = suggestion(f"<{nearest}>") + " " if nearest else ""
        declared = f"@batch.action(ID='{node.config.id}')"
        advice = f"write it for all agents at once, {declared}, and pass it in leaves=[…]"
        return question + advice


class BatchNodeError(NodeExecutionError):
    """A node raised for some agents. These agents are halted; the tick of all others is complete.

    Args:
        error: The error of the first node that raised.

    Attributes:
        agents: The indices of the agents.
        statuses: The array that the tick would have returned; IDLE for agents for which a node has raised.
        later_errors: The other errors of the tick and of the halt after it, each a BatchNodeError: errors of
            other nodes, or another error of the same node for other agents.
    """

    def __init__(self, error: NodeExecutionError, agents: Indices, statuses: Statuses) -> None:
        super().__init__(error.path, error.node_id, error.cause, error.doing, error.where)
        self.backtrace = list(error.backtrace)
        self.__cause__ = error.cause
        self.agents = agents
        self.statuses = statuses

    def __str__(self) -> str:
        shown = ", ".join(map(str, self.agents[:_MAX_SHOWN_AGENTS]))
        hidden = len(self.agents) - _MAX_SHOWN_AGENTS
        more = f" and {hidden} more" if hidden > 0 else ""
        return f"for agent{'s' * (len(self.agents) > 1)} {shown}{more}: {super().__str__()}"


class BatchTree:
    """A behavior tree that is ticked for many agents at once; each agent behaves as if it had its own tree.

    Args:
        tree: The ordinary tree from which the batch is made. It is not modified.
        agents: The number of agents.
        leaves: Functions (`@batch.action`, `@batch.condition`) and classes (`batch.StatefulAction`)
            that work on numpy arrays.
        resources: The objects that leaves can get by type.
        clock: The clock; by default the tree's clock.

    Attributes:
        nodes: All nodes in depth-first pre-order.
        blackboards: The scope of each subtree, by path; the path of the main tree is "".
        ticks: The number of ticks.
        status: The result of each agent's last tick, shape (agents,); IDLE after a halt.
        agent_sets: The sets of agents: conversions between masks and indices.
        id: The ID of the main tree.
        columns: The arrays of all entries.
        context: The objects that the nodes share.
        root: The root node.

    Raises:
        TreeError: The batch engine cannot run a node.
        RegistrationError: A leaf is invalid.

    Examples:
        >>> import btcore_batch as batch
        >>> from btcore import In, Registry
        >>> @batch.condition
        ... def battery_ok(level: In[batch.Floats]) -> batch.Bools:
        ...     return level > 0.2
        >>> xml = '''<root BTCPP_format="4"><BehaviorTree ID="Main">
        ...   <BatteryOk level="{level}"/></BehaviorTree></root>'''
        >>> levels = {"level": [0.1, 0.5, 0.9]}
        >>> swarm = batch.BatchTree.loads(xml, agents=3, leaves=[battery_ok], blackboard=levels)
        >>> swarm.tick()
        array([3, 2, 2], dtype=uint8)
    """

    def __init__(
        self,
        tree: Tree,
        agents: int,
        leaves: Sequence[Any] = (),
        resources: Sequence[object] = (),
        clock: Clock | None = None,
    ) -> None:
        if not isinstance(tree, Tree):
            raise BtcoreError(f"a batch is made of a tree, not {tree!r}; BatchTree.load takes a file")
        self.agent_sets = AgentSets(agents)
        self.id = tree.id
        clock = clock if clock is not None else tree.clock
        self.columns = ColumnTable(tree, self.agent_sets, clock)
        self.context = BatchContext(self.columns, clock, resources)
        declarations = {leaf.id: leaf for leaf in read_declarations(leaves, tree.registry.types)}
        compiler = BatchCompiler(self.context, declarations)
        self.root = compiler.compile(tree)
        self.nodes: list[BatchNode] = compiler.nodes
        self.blackboards: dict[str, BatchBlackboard] = {
            subtree.path: BatchBlackboard(self.columns, self.columns.scopes[id(subtree.blackboard)])
            for subtree in tree.subtrees
        }
        self.ticks = 0
        self.status: Statuses = np.zeros(self.agents, dtype=np.uint8)

    @classmethod
    def load(
        cls,
        path: str | PathLike[str],
        agents: int,
        leaves: Sequence[Any] = (),
        *,
        nodes: Registry | None = None,
        resources: Sequence[object] = (),
        tree: str | None = None,
        blackboard: Mapping[str, Any] | None = None,
        clock: Clock | None = None,
    ) -> "BatchTree":
        """Load a tree from an XML file.

        Args:
            path: The file.
            agents: The number of agents.
            leaves: The leaves of the batch that the tree can use.
            nodes: The registry, for your own types and enums. A leaf in *leaves* replaces an ordinary leaf.
            resources: The objects that leaves can get by type.
            tree: The ID of the tree; by default the main tree, as in `btcore.load`.
            blackboard: The first values of the main tree's entries: arrays of shape (agents,) or (agents, …),
                or single values for all agents.
            clock: The clock; by default the system's clock.

        Returns:
            The tree.

        Raises:
            TreeError: The file has errors, or the batch engine cannot run a node. It contains all errors.
            RegistrationError: A leaf is invalid.
            BlackboardError: A value of *blackboard* has another shape, or does not fit the type of its entry.
            BtcoreError: *agents* is not a positive integer.
        """
        leaves, registry, board = _prepare(leaves, nodes, blackboard, clock)
        loaded = load(path, nodes=registry, tree=tree, blackboard=board, clock=clock)
        return cls(loaded, agents, leaves, resources)._initialise(blackboard)

    @classmethod
    def loads(
        cls,
        text: str,
        agents: int,
        leaves: Sequence[Any] = (),
        *,
        nodes: Registry | None = None,
        resources: Sequence[object] = (),
        tree: str | None = None,
        blackboard: Mapping[str, Any] | None = None,
        clock: Clock | None = None,
    ) -> "BatchTree":
        """Load a tree from an XML text.

        Args:
            text: The XML. Paths of includes are relative to the working directory.
            agents: The number of agents.
            leaves: As in `load`, like all following arguments.
            nodes: As in `load`.
            resources: As in `load`.
            tree: As in `load`.
            blackboard: As in `load`.
            clock: As in `load`.

        Returns:
            The tree.

        Raises:
            TreeError: The document has errors, or the batch engine cannot run a node. It contains all errors.
            RegistrationError: A leaf is invalid.
            BlackboardError: A value of *blackboard* has another shape, or does not fit the type of its entry.
            BtcoreError: *agents* is not a positive integer.
        """
        leaves, registry, board = _prepare(leaves, nodes, blackboard, clock)
        loaded = loads(text, nodes=registry, tree=tree, blackboard=board, clock=clock)
        return cls(loaded, agents, leaves, resources)._initialise(blackboard)

    def _initialise(self, values: Mapping[str, Any] | None) -> "BatchTree":
        for key, value in (values or {}).items():
            self.blackboard.initialise(key, value)
        return self

    # --- ticking

    def tick(self, mask: Mask | None = None) -> Statuses:
        """Tick the root once.

        Args:
            mask: The agents to tick, an array of shape (agents,); None = all agents.

        Returns:
            The status of each agent, as the integer value of its `Status`; 0 (IDLE) for agents that
            were not ticked.

        Raises:
            BatchNodeError: A node has raised for some agents. The tick of the other agents is complete.
            BtcoreError: *mask* is not an array of bools of shape (agents,).
        """
        return self._tick(self.agent_sets.from_user_mask(mask))

    def tick_once(self, mask: Mask | None = None) -> Statuses:
        """Call `tick`, then tick RUNNING agents again while a wake-up is pending for them.

        Nodes such as AsyncSequence and Delay request wake-ups. The parameter, the result and the errors are
        those of `tick`.

        Returns:
            The statuses of all agents.
        """
        agents = self.agent_sets.from_user_mask(mask)
        statuses = self._tick(agents)
        while True:
            running = self.agent_sets.from_mask(statuses == RUNNING)
            woken = self.context.take_wake_ups(running) if running else 0
            if not woken:
                return statuses
            np.copyto(statuses, self._tick(woken), where=self.agent_sets.mask(woken))

    def _tick(self, agents: AgentSet) -> Statuses:
        self.ticks += 1
        self.columns.refresh()
        context = self.context
        context.tick_start = context.clock.now()
        context.raised = 0
        context.errors = {}
        success, failure, running, skipped = self.root.execute(agents)
        self.root.reset(success | failure)
        statuses = status_array(context, success, failure, running, skipped)
        if agents == self.agent_sets.all_agents:
            self.status = statuses.copy()
        else:
            np.copyto(self.status, statuses, where=self.agent_sets.mask(agents))
        if context.errors:
            errors = self._errors(statuses)
            self._halt_all(context.raised)
            self._raise([*errors, *self._errors(statuses)])
        return statuses

    def _errors(self, statuses: Statuses) -> list[BatchNodeError]:
        """Return the errors since the start of the tick or halt."""
        errors = self.context.errors.values()
        return [BatchNodeError(error, self.agent_sets.indices(agents), statuses) for error, agents in errors]

    def _raise(self, errors: list[BatchNodeError]) -> None:
        if errors:
            errors[0].later_errors += errors[1:]
            raise errors[0]

    def halt(self, mask: Mask | None = None) -> None:
        """Halt every node: the root, then all nodes in pre-order.

        Args:
            mask: The agents for which nodes are halted; None = all agents.

        Raises:
            BatchNodeError: A node has raised. All other nodes were halted.
            BtcoreError: *mask* is not an array of bools of shape (agents,).
        """
        agents = self.agent_sets.from_user_mask(mask)
        np.copyto(self.status, 0, where=self.agent_sets.mask(agents))
        self._halt_all(agents)
        self._raise(self._errors(self.status))

    def _halt_all(self, agents: AgentSet) -> None:
        context = self.context
        context.raised = 0
        context.errors = {}
        # The root is halted twice, as in the ordinary engine: as the root, and as the first of all nodes.
        for node in [self.root, *self.nodes]:
            node.halt_node(agents)
        for node in self.nodes:
            node.reset(agents)
        context.raised = 0
        for timer in context.timers:
            timer.wake_ups ^= timer.wake_ups & agents

    def sleep(self, seconds: float) -> None:
        """Wait for *seconds* (s) on the batch's clock."""
        clock = self.clock
        clock.wait_until(clock.now() + round(seconds * NS_PER_S), threading.Event())

    # --- access

    @property
    def agents(self) -> int:
        """The number of agents."""
        return self.agent_sets.count

    @property
    def clock(self) -> Clock:
        """The clock of all agents."""
        return self.context.clock

    @property
    def blackboard(self) -> BatchBlackboard:
        """The blackboard of the main tree."""
        return self.blackboards[""]

    def node(self, path: str) -> BatchNode:
        """Return the node with the full path *path*, or the only node with the name *path*.

        Raises:
            BtcoreError: There is no such node, or several nodes have this name.
        """
        found = [node for node in self.nodes if node.path == path]
        found = found or [node for node in self.nodes if node.name == path]
        if len(found) == 1:
            return found[0]
        if found:
            raise BtcoreError(
                f"'{path}' is the name of {len(found)} nodes: {', '.join(node.path for node in found)}"
            )
        hint = did_you_mean(path, [name for node in self.nodes for name in (node.path, node.name)])
        raise BtcoreError(f"the tree has no node '{path}'{hint}")

    def __iter__(self) -> Iterator[BatchNode]:
        return iter(self.nodes)

    def __repr__(self) -> str:
        return f"<BatchTree '{self.id}' of {len(self.nodes)} nodes for {self.agents} agents>"


def _prepare(
    leaves: Sequence[Any], nodes: Registry | None, values: Mapping[str, Any] | None, clock: Clock | None
) -> tuple[list[LeafDeclaration], Registry, Blackboard]:
    """Return the arguments for loading the tree: declarations of the leaves, a registry and a blackboard.

    The registry contains an ordinary class for each leaf. The blackboard contains the values of the first
    agent.
    """
    registry = registry_or_standard(nodes).copy()
    declarations = read_declarations(leaves, registry.types)
    for leaf in declarations:
        if leaf.id in registry:
            registry.replace(**{leaf.id: leaf.create_node_class()})
        else:
            registry.add(leaf.create_node_class(), ID=leaf.id)
    board = Blackboard(clock=clock)
    for key, value in (values or {}).items():
        # BatchBlackboard.initialise() reports invalid values.
        with suppress(ConversionError, IndexError):
            single = value if array_of(value).ndim == 0 else value[0]
            is_scalar = isinstance(single, (np.generic, np.ndarray)) and single.ndim == 0
            board[key] = single.item() if is_scalar else single
    return declarations, registry, board
