"""A tree that can be ticked."""

import time
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Final, NoReturn, SupportsIndex, TypeVar

from mypy_extensions import mypyc_attr

from btcore.blackboard.blackboard import Blackboard
from btcore.clock import (
    NS_PER_S,
    Clock,
    TickSchedule,
)
from btcore.engine.context import TreeContext
from btcore.engine.instrumentation import TickCounts
from btcore.engine.node import (
    TreeNode,
    execute_tick,
    halt_node,
    reset_status,
)
from btcore.engine.observers import Observer, Observers
from btcore.errors import BtcoreError, NodeExecutionError
from btcore.registry.registry import Registry
from btcore.status import (
    FAILURE,
    IDLE,
    RUNNING,
    SUCCESS,
    Status,
)
from btcore.suggestions import nearest_name

if TYPE_CHECKING:
    from btcore.tree.hooks import Hooks

N = TypeVar("N", bound=TreeNode)

MAX_NODES: Final = 65_535
"""The maximum number of nodes of a tree: a uid has 16 bits in Groot's protocols, and 0 is not a uid."""


class Subtree:
    """One instance of a tree within another: the main tree, and each SubTree's content.

    *id* is the tree's ID, *path* the instance's ("" for the main tree); *nodes* are its own, in
    pre-order, with its SubTree nodes but without what is in them.
    """

    def __init__(self, id: str, path: str, blackboard: Blackboard) -> None:
        self.id = id
        self.path = path
        self.blackboard = blackboard
        self.nodes: list[TreeNode] = []

    @property
    def root(self) -> TreeNode:
        """The node on top."""
        return self.nodes[0]


@mypyc_attr(allow_interpreted_subclasses=True)
class Tree:
    """A behavior tree with its blackboard and clock.

    *nodes* are all nodes in depth-first pre-order, a SubTree's content right after it; *subtrees* the
    instances in order of creation, the main one first; *ticks* counts the ticks of the root; *registry*
    is what it was made with.
    """

    def __init__(
        self,
        id: str,
        format: int,
        subtrees: Sequence[Subtree],
        nodes: Sequence[TreeNode],
        context: TreeContext,
        registry: Registry,
    ) -> None:
        self.id = id
        self.format = format
        self.subtrees = list(subtrees)
        self.nodes = list(nodes)
        self.root = self.nodes[0]
        self.context = context
        self.registry = registry
        self.ticks = 0
        self.status: Status = IDLE
        self._hooks: Hooks | None = None

    @property
    def blackboard(self) -> Blackboard:
        """The blackboard of the main tree."""
        return self.subtrees[0].blackboard

    @property
    def clock(self) -> Clock:
        """The tree's clock."""
        return self.context.clock

    # --- ticking

    def tick_exactly_once(self) -> Status:
        """Tick the root once. Raises NodeExecutionError, after halting the tree."""
        status = self._tick_root()
        self.status = status
        return status

    def tick_once(self) -> Status:
        """Tick the root, and again while it is RUNNING and a wake-up is due. Raises as above."""
        status = self._tick_root()
        while status is RUNNING and self.context.take_wake_up():
            status = self._tick_root()
        self.status = status
        return status

    def tick_while_running(self, period: float = 0.01) -> Status:
        """Tick until the root isn't RUNNING, every *period* seconds, or earlier when woken.

        Ticks are due at multiples of the period after the start; one that comes late moves the next
        ones, and none is made up for. A period of 0 doesn't wait. Raises as above.
        """
        clock = self.context.clock
        metronome = TickSchedule(period, clock.now())
        while True:
            status = self.tick_once()
            if status is not RUNNING:
                return status
            if period > 0:
                self.context.wait_until(metronome.next(clock.now()))

    async def run(self, period: float = 0.01) -> Status:
        """As :meth:`tick_while_running`, in an event loop, which goes on while the tree waits.

        Leaves may then await whatever asyncio offers. Cancelling it halts the tree. A breakpoint is
        awaited: where one is set, ticks run on a thread of their own, in turns with the loop's. Raises as
        above.
        """
        # asyncio takes as long to import as the engine, and is needed here only.
        from asyncio import CancelledError

        from btcore.tree.event_loop import EventLoopWait

        wait = EventLoopWait(self.context, period)
        try:
            while True:
                hooks = self._hooks
                if hooks is not None and hooks.may_pause:
                    status = await hooks.tick_in_thread(self.tick_once)
                else:
                    status = self.tick_once()
                if status is not RUNNING:
                    return status
                await wait.until_next_tick()
        except CancelledError:
            self.halt()
            raise
        finally:
            wait.close()
            if self._hooks is not None:
                self._hooks.close_tick_thread()

    def _tick_root(self) -> Status:
        self.ticks += 1
        observers = self.context.observers
        root = self.root
        try:
            if observers is None:
                status = execute_tick(root)
                if status is SUCCESS or status is FAILURE:
                    reset_status(root)
            else:
                observers.begin(self.ticks)
                start = time.perf_counter_ns()
                status = execute_tick(root)
                if status is SUCCESS or status is FAILURE:
                    reset_status(root)
                observers.notify_tick(time.perf_counter_ns() - start, status)
        except NodeExecutionError as error:
            self.status = IDLE
            self._tell_of(error)
            error.later_errors += self._halt_everything()
            raise
        return status

    # --- halting, waiting

    def halt(self) -> None:
        """Halt every node, as BehaviorTree.CPP's haltTree: the root, then all in pre-order.

        All nodes are halted even if one raises; then NodeExecutionError says which was the first, and
        which *also*.
        """
        errors = self._halt_everything()
        self.status = IDLE
        if errors:
            first = errors[0]
            first.later_errors += errors[1:]
            self._tell_of(first)
            raise first

    def _tell_of(self, error: NodeExecutionError) -> None:
        # Who came within the tick hears it too.
        if self.context.observers is not None:
            self.context.observers.notify_error(error)

    def _halt_everything(self) -> list[NodeExecutionError]:
        errors: list[NodeExecutionError] = []
        for node in [self.root, *self.nodes]:
            try:
                halt_node(node)
            except NodeExecutionError as error:
                errors.append(error)
        for node in self.nodes:
            reset_status(node)
        self.flush_observers()
        self.context.deadlines.clear()
        return errors

    def __enter__(self) -> "Tree":
        return self

    def __exit__(self, *_: object) -> None:
        self.halt()

    def sleep(self, seconds: float) -> bool:
        """Let *seconds* (s) of the tree's clock pass, less if the tree is woken; returns whether it was."""
        return self.context.wait_until(self.context.clock.now() + round(seconds * NS_PER_S))

    def wake(self) -> None:
        """End a sleep early, and tick. Any thread may call it."""
        self.context.wake_up()

    # --- breakpoints, looking

    @property
    def hooks(self) -> "Hooks":
        """Breakpoints and injected statuses; any thread may set them."""
        from btcore.tree.hooks import Hooks

        with self.context.lock:
            if self._hooks is None:
                self._hooks = Hooks(self.nodes, self.context)
            return self._hooks

    def subscribe(self, observer: Observer) -> Callable[[], None]:
        """Let *observer* hear what happens; the callable returned ends that.

        Call both on the thread that ticks, or while nothing ticks.
        """
        observers = self.context.observers
        if observers is None:
            observers = Observers(self.context.clock)
            observers.tick = self.ticks
            self.context.observers = observers
        return observers.add(observer)

    def flush_observers(self) -> None:
        """Tell observers now what they would hear at the end of the tick (:meth:`Observer.transitions`)."""
        if self.context.observers is not None:
            self.context.observers.flush()

    def count_ticks(self) -> dict[str, TickCounts]:
        """Count the ticks of every node from now on, by path (see :meth:`nodes_by_path`)."""
        return {key: node.count_ticks() for key, node in self.nodes_by_path().items()}

    def nodes_by_path(self) -> dict[str, TreeNode]:
        """The nodes by full path, in pre-order; where paths are equal ``#<uid>`` is appended."""
        times: dict[str, int] = {}
        for node in self.nodes:
            times[node.path] = times.get(node.path, 0) + 1
        return {
            node.path if times[node.path] == 1 else f"{node.path}#{node.uid}": node for node in self.nodes
        }

    def node(self, path: str) -> TreeNode:
        """The node of that full path or, if there is only one, of that name. Raises BtcoreError."""
        keys = self.nodes_by_path()
        if path in keys:
            return keys[path]
        named = [node for node in self.nodes if node.name == path or node.path == path]
        if len(named) == 1:
            return named[0]
        if named:
            raise BtcoreError(
                f"'{path}' is the name of {len(named)} nodes: {', '.join(node.path for node in named)}"
            )
        guess = nearest_name(path, [*keys, *(node.name for node in self.nodes)])
        hint = f"; did you mean '{guess}'?" if guess else ""
        raise BtcoreError(f"the tree has no node '{path}'{hint}")

    def find(self, kind: type[N]) -> list[N]:
        """The nodes of class *kind*, in pre-order."""
        return [node for node in self.nodes if isinstance(node, kind)]

    def __iter__(self) -> Iterator[TreeNode]:
        return iter(self.nodes)

    def __reduce_ex__(self, protocol: SupportsIndex) -> NoReturn:
        raise TypeError(
            "a tree is tied to its clock, its leaves and what they hold: load it again for another"
        )

    def __repr__(self) -> str:
        count = len(self.nodes)
        return f"<Tree '{self.id}' of {count} node{'' if count == 1 else 's'}, {self.status.name}>"
