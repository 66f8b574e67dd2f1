"""One tree ticked for many agents at once."""

import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from os import PathLike
from typing import Any

import numpy as np

from btcore.batch.agent_sets import AgentSets, Indices, Mask
from btcore.batch.blackboard import BatchBlackboard
from btcore.batch.column import Values
from btcore.batch.column_table import ColumnTable, copied_scopes
from btcore.batch.compile import BatchCompiler
from btcore.batch.context import BatchContext
from btcore.batch.conversion import array_of, normalise_values
from btcore.batch.leaf_declaration import LeafDeclaration, Statuses, read_declarations
from btcore.batch.node import BatchNode, status_array
from btcore.blackboard.blackboard import Blackboard
from btcore.clock import NS_PER_S, Clock
from btcore.errors import BtcoreError, ConversionError, NodeExecutionError
from btcore.loading.load import load, loads
from btcore.registry.registry import Registry
from btcore.suggestions import nearest_name
from btcore.tree.tree import Tree


class BatchNodeError(NodeExecutionError):
    """A node raised for some agents, *agents*, who are halted; the tick of all others is done.

    *statuses* is what the tick would have returned, IDLE for those who raised. *also* holds the errors of
    agents for whom another node raised, or the same in another way.
    """

    def __init__(self, first: NodeExecutionError, agents: Indices, found: Statuses) -> None:
        super().__init__(first.path, first.node_id, first.cause, first.doing, first.where)
        self.backtrace = list(first.backtrace)
        self.__cause__ = first.cause
        self.agents = agents
        self.statuses = found

    def __str__(self) -> str:
        shown = ", ".join(map(str, self.agents[:5]))
        more = f" and {len(self.agents) - 5} more" if len(self.agents) > 5 else ""
        return f"for agent{'s' * (len(self.agents) > 1)} {shown}{more}: {super().__str__()}"


class BatchTree:
    """A behavior tree that is ticked for *agents* agents at once, each as if it had the tree for itself.

    *leaves* are functions (``@batch.action``, ``@batch.condition``) and classes (``batch.StatefulAction``)
    that work on numpy's columns, *resources* what they ask for by type. The built-in nodes are the batch's
    own. *nodes* are all nodes in depth-first pre-order, *ticks* counts the ticks.
    """

    def __init__(
        self,
        plan: Tree,
        agents: int,
        leaves: Sequence[Any] = (),
        resources: Sequence[object] = (),
        clock: Clock | None = None,
    ) -> None:
        """From an ordinary tree, which stays as it is. Raises TreeError for what a batch doesn't run."""
        if not isinstance(plan, Tree):
            raise BtcoreError(f"a batch is made of a tree, not {plan!r}; BatchTree.load takes a file")
        self.crowd = AgentSets(agents)
        self.id = plan.id
        self.context = BatchContext(self.crowd, clock if clock is not None else plan.clock)
        self.schema = ColumnTable(self.crowd)
        scopes = copied_scopes(plan, self.context.clock)
        for scope in scopes.values():
            self.schema.adopt(scope, self.crowd.all_agents)
        known = {leaf.id: leaf for leaf in read_declarations(leaves, plan.registry.types)}
        planter = BatchCompiler(self.context, self.schema, scopes, known, resources)
        self.root = planter.compile(plan)
        self.nodes: list[BatchNode] = planter.nodes
        self.blackboards: dict[str, BatchBlackboard] = {}
        """The scope of each subtree by its path; that of the main tree is ``""``."""
        for subtree in plan.subtrees:
            scope = scopes[id(subtree.blackboard)]
            self.blackboards[subtree.path] = BatchBlackboard(self.schema, scope)
        self._take_values(plan, scopes)
        self.ticks = 0
        self.status: Statuses = np.zeros(agents, dtype=np.uint8)
        """What the last tick of each agent came to."""

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
        """The tree in the XML file *path*, for *agents* agents.

        - *leaves*: the leaves of the batch that the tree may use.
        - *nodes*: the registry, for types and enums of your own. A leaf in *leaves* replaces an ordinary one.
        - *blackboard*: what the main tree's entries hold at the beginning: an array of shape (agents,) or
          (agents, …), or one value for all.
        - *clock*: default the system's. *tree*, *resources* as :func:`btcore.load`.

        Raises TreeError with every fault, each with file and line.
        """
        leaves, known, board = _prepared(leaves, nodes, blackboard, clock)
        plan = load(path, nodes=known, tree=tree, blackboard=board, clock=clock)
        return cls(plan, agents, leaves, resources)._filled(blackboard)

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
        """The tree in the XML *text*; as :meth:`load`."""
        leaves, known, board = _prepared(leaves, nodes, blackboard, clock)
        plan = loads(text, nodes=known, tree=tree, blackboard=board, clock=clock)
        return cls(plan, agents, leaves, resources)._filled(blackboard)

    def _take_values(self, plan: Tree, scopes: Mapping[int, Blackboard]) -> None:
        """Begin with what the plan's blackboards hold, the same for all agents."""
        for subtree in plan.subtrees:
            scope = scopes[id(subtree.blackboard)]
            for key, entry in subtree.blackboard.local_entries().items():
                column = self.schema.column(scope, key)
                if entry.value is None or column is None or column.written:
                    continue
                if isinstance(entry.value, (int, float, str)):
                    column.put(self.crowd.all_agents, *normalise_values(entry.value, self.crowd))
                else:
                    held: Values = np.empty(self.crowd.count, dtype=object)
                    for at in range(self.crowd.count):
                        held[at] = entry.value
                    column.put_objects(self.crowd.all_agents, held)

    def _filled(self, values: Mapping[str, Any] | None) -> "BatchTree":
        for key, value in (values or {}).items():
            self.blackboard.initialise(key, value)
        return self

    # --- ticking

    def tick(self, mask: Mask | None = None) -> Statuses:
        """Tick the root once for the agents of *mask*, of shape (agents,) (None: all).

        Returns one status an agent, numbered as Status is, 0 for those who were not ticked. Raises
        BatchNodeError after the tick if a node has raised for some.
        """
        return self._tick(self.crowd.from_user_mask(mask))

    def tick_once(self, mask: Mask | None = None) -> Statuses:
        """As :meth:`tick`, and again for those who are RUNNING and were woken."""
        agents = self.crowd.from_user_mask(mask)
        found = self._tick(agents)
        while True:
            running = self.crowd.from_mask(found == 1)
            again = self.context.take_wake_up(running) if running else 0
            if not again:
                return found
            more = self._tick(again)
            np.copyto(found, more, where=self.crowd.mask(again))

    def _tick(self, agents: int) -> Statuses:
        self.ticks += 1
        self.schema.refresh()
        context = self.context
        context.raised = 0
        context.errors = {}
        success, failure, running, skipped = self.root.execute(agents)
        self.root.reset(success | failure)
        found = status_array(context, success, failure, running, skipped)
        if agents == self.crowd.all_agents:
            self.status = found.copy()
        else:
            np.copyto(self.status, found, where=self.crowd.mask(agents))
        if context.errors:
            self._end_raised(found)
        return found

    def _end_raised(self, found: Statuses) -> None:
        """Halt those for whom a node has raised, and tell of it."""
        raised = self._raised(found)
        self._halt_everything(self.context.raised)
        self._tell([*raised, *self._raised(found)])

    def _raised(self, found: Statuses) -> list[BatchNodeError]:
        """What the nodes have raised since the tick, or the halt, began."""
        errors = self.context.errors.values()
        return [BatchNodeError(one, self.crowd.indices(some), found) for one, some in errors]

    def _tell(self, raised: list[BatchNodeError]) -> None:
        if raised:
            raised[0].later_errors += raised[1:]
            raise raised[0]

    def halt(self, mask: Mask | None = None) -> None:
        """Halt every node for the agents of *mask* (None: all): the root, then all in pre-order.

        Raises BatchNodeError, after everything is halted.
        """
        agents = self.crowd.from_user_mask(mask)
        np.copyto(self.status, 0, where=self.crowd.mask(agents))
        self._halt_everything(agents)
        self._tell(self._raised(self.status))

    def _halt_everything(self, agents: int) -> None:
        context = self.context
        context.raised = 0
        context.errors = {}
        for node in [self.root, *self.nodes]:
            node.halt_node(agents)
        for node in self.nodes:
            node.reset(agents)
        context.raised = 0
        for timer in context.timers:
            timer.wake_ups ^= timer.wake_ups & agents

    def sleep(self, seconds: float) -> None:
        """Let *seconds* (s) of the clock pass, for all agents."""
        clock = self.clock
        clock.wait_until(clock.now() + round(seconds * NS_PER_S), threading.Event())

    # --- looking

    @property
    def agents(self) -> int:
        """How many agents there are."""
        return self.crowd.count

    @property
    def clock(self) -> Clock:
        """The clock of all agents."""
        return self.context.clock

    @property
    def blackboard(self) -> BatchBlackboard:
        """The blackboard of the main tree."""
        return self.blackboards[""]

    def node(self, path: str) -> BatchNode:
        """The node of that full path or, if there is only one, of that name. Raises BtcoreError."""
        found = [node for node in self.nodes if node.path == path]
        found = found or [node for node in self.nodes if node.name == path]
        if len(found) == 1:
            return found[0]
        if found:
            raise BtcoreError(f"'{path}' means {len(found)} nodes: {', '.join(node.path for node in found)}")
        guess = nearest_name(path, [node.path for node in self.nodes] + [node.name for node in self.nodes])
        hint = f"; did you mean '{guess}'?" if guess else ""
        raise BtcoreError(f"the tree has no node '{path}'{hint}")

    def __iter__(self) -> Iterator[BatchNode]:
        return iter(self.nodes)

    def __repr__(self) -> str:
        return f"<BatchTree '{self.id}' of {len(self.nodes)} nodes for {self.agents} agents>"


def _prepared(
    things: Sequence[Any], registry: Registry | None, values: Mapping[str, Any] | None, clock: Clock | None
) -> tuple[list[LeafDeclaration], Registry, Blackboard]:
    """The leaves, a registry with stand-ins for them, and a blackboard with one agent's values."""
    known = registry.copy() if registry is not None else Registry.standard()
    leaves = read_declarations(things, known.types)
    for leaf in leaves:
        if leaf.id in known:
            known.replace(**{leaf.id: leaf.stand_in()})
        else:
            known.add(leaf.stand_in(), ID=leaf.id)
    board = Blackboard(clock=clock)
    for key, value in (values or {}).items():
        with suppress(ConversionError, IndexError):  # BatchBlackboard.begin tells of it
            one = value if array_of(value).ndim == 0 else value[0]
            board[key] = one.item() if isinstance(one, (np.generic, np.ndarray)) and one.ndim == 0 else one
    return leaves, known, board
