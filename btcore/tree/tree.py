"""The class Tree: a loaded behavior tree, with methods to tick, halt and observe it."""

import threading
from collections.abc import Callable, Iterator, Sequence
from math import inf
from typing import TYPE_CHECKING, NamedTuple, NoReturn, SupportsIndex, TextIO, TypeVar

from mypy_extensions import mypyc_attr

from btcore.blackboard.blackboard import Blackboard, copy_scopes
from btcore.blackboard.ports import PortRole
from btcore.clock import NS_PER_S, Clock, SystemClock, TickSchedule
from btcore.engine.context import TreeContext
from btcore.engine.node import (
    TickCounts,
    TreeNode,
    add_to_backtrace,
    execute_tick,
    execution_error,
    halt_node,
    input_or,
    reset_status,
    start_tick_counts,
)
from btcore.engine.observers import Observer, Observers
from btcore.errors import BtcoreError, NodeError, NodeExecutionError
from btcore.names import unique_paths
from btcore.registry.registry import Registry
from btcore.status import FAILURE, IDLE, RUNNING, SUCCESS, Status
from btcore.suggestions import counted, did_you_mean

if TYPE_CHECKING:
    from btcore.tree.hooks import Hooks

N = TypeVar("N", bound=TreeNode)


class Subtree:
    """One instance of a tree definition: the main tree, or the content of a SubTree node.

    Attributes:
        id: The ID of the tree definition.
        path: The path of the SubTree node; "" for the main tree.
        blackboard: The scope of the instance.
        nodes: The nodes of the instance in pre-order, with its SubTree nodes but without their content.

    Examples:
        >>> import btcore
        >>> b = btcore.Builder()
        >>> tree = b.build(b.SubTree(ID="Charge"), Charge=b.AlwaysSuccess())
        >>> [(subtree.id, subtree.path) for subtree in tree.subtrees]
        [('Main', ''), ('Charge', 'Charge::1')]
    """

    def __init__(self, id: str, path: str, blackboard: Blackboard, nodes: list[TreeNode]) -> None:
        self.id = id
        self.path = path
        self.blackboard = blackboard
        self.nodes = nodes

    @property
    def root(self) -> TreeNode:
        """The root node of the instance."""
        return self.nodes[0]


class TreeDocument(NamedTuple):
    """A document from which a tree was loaded.

    Attributes:
        file: The file, or "".
        text: The XML.
        is_shared: Whether trees of later documents replace its trees.
    """

    file: str
    text: str
    is_shared: bool


@mypyc_attr(allow_interpreted_subclasses=True)
class Tree:
    """A behavior tree that can be ticked, with its blackboards and clock.

    `btcore.load` creates it. Call all methods on the thread that ticks, except `wake`, `interrupt` and the
    methods of `hooks`, which are thread-safe.

    Attributes:
        id: The ID of the main tree.
        format: The XML format, 3 or 4.
        subtrees: The instances of tree definitions in order of creation; the first is the main tree.
        nodes: All nodes in depth-first pre-order; the content of a SubTree node follows it.
        root: The root node.
        registry: The registry with which the tree was loaded.
        ticks: The number of ticks of the root.
        status: The result of the last tick; IDLE before the first tick and after a halt.
        tick_limit: The longest time (s, real time even with another clock) for which a tick may repeat nodes;
            None = no limit. A tick that repeats nodes for longer raises NodeExecutionError. The time at a
            breakpoint does not count. A single node that takes too long is not interrupted.
        context: The objects that the tree's nodes share.
        documents: The documents from which the tree was loaded, the main document last.

    Examples:
        >>> import btcore
        >>> b = btcore.Builder()
        >>> tree = b.build(b.Sequence(b.AlwaysSuccess(name="door"), b.AlwaysFailure(name="window")))
        >>> tree.tick_once(), tree.ticks, tree.node("window").id
        (<Status.FAILURE: 3>, 1, 'AlwaysFailure')
        >>> tree.draw()
        Main  1 tick
        └── → Sequence  (✘ FAILURE)
            ├── ⊤ door  AlwaysSuccess  (✔ SUCCESS)
            └── ⊥ window  AlwaysFailure  (✘ FAILURE)
    """

    def __init__(
        self,
        id: str,
        format: int,
        subtrees: Sequence[Subtree],
        nodes: Sequence[TreeNode],
        context: TreeContext,
        registry: Registry,
        tick_limit: float | None = None,
        documents: Sequence[TreeDocument] = (),
    ) -> None:
        self.id = id
        self.format = format
        self.subtrees = list(subtrees)
        self.nodes = list(nodes)
        self.root = self.nodes[0]
        self.context = context
        self.registry = registry
        if tick_limit is not None and not 0 < tick_limit < inf:  # also raises for NaN
            raise ValueError(f"invalid tick_limit {tick_limit!r}: use a number of seconds above 0, or None")
        self.tick_limit = tick_limit
        self.documents = tuple(documents)
        self.ticks = 0
        self.status: Status = IDLE
        self._hooks: Hooks | None = None
        self._is_in_tick = False
        self._is_in_loop = False  # within tick_while_running() or run(), also between two ticks

    @property
    def blackboard(self) -> Blackboard:
        """The blackboard of the main tree."""
        return self.subtrees[0].blackboard

    @property
    def clock(self) -> Clock:
        """The clock that the tree and its nodes use."""
        return self.context.clock

    # --- ticking

    def tick_exactly_once(self) -> Status:
        """Tick the root exactly once. Return its result.

        Raises:
            BtcoreError: The tree is being ticked already, by another call.
            NodeExecutionError: A node raised, or the tick exceeded `tick_limit`; the tree was halted.
        """
        return _tick(self, repeat=False)

    def tick_once(self) -> Status:
        """Tick the root, and again while it is RUNNING and a wake-up is pending. Return its result.

        Raises:
            BtcoreError: The tree is being ticked already, by another call.
            NodeExecutionError: A node raised, or the tick exceeded `tick_limit`; the tree was halted.
        """
        return _tick(self, repeat=True)

    def tick_while_running(self, period: float = 0.01) -> Status:
        """Tick until the root is no longer RUNNING, and wait between the ticks. Return its result.

        Ticks are due at multiples of the period after the start, or earlier when the tree is woken. If a tick
        ends after the next tick is due, the next tick follows at once and all later ticks are delayed by the
        same time; missed ticks are not made up for.

        Args:
            period: The time between ticks (s, tree's clock); 0 = do not wait, except that a clock that stands
                still, such as a SimClock, advances to the next time for which a node has requested a tick.

        Raises:
            ValueError: *period* is negative, infinite or NaN.
            BtcoreError: The tree is being ticked already, by another call.
            NodeExecutionError: A node raised, or a tick exceeded `tick_limit`; the tree was halted.
        """
        clock = self.context.clock
        schedule = TickSchedule(period, clock.now())
        waits = period > 0 or not isinstance(clock, SystemClock)
        self._begin_loop()
        try:
            while True:
                status = self.tick_once()
                if status is not RUNNING:
                    return status
                if waits:
                    self.context.wait_until(self.context.next_tick_time(schedule))
        finally:
            self._is_in_loop = False

    async def run(self, period: float = 0.01) -> Status:
        """Tick until the root is no longer RUNNING, and let the event loop run between the ticks.

        Leaves may await asyncio's functions. Cancelling the task halts the tree. The event loop also runs
        while a tick is stopped at a breakpoint: if a breakpoint is set, ticks run on a separate thread, which
        alternates with the thread of the event loop.

        Args:
            period: The time between ticks (s, tree's clock), as in `tick_while_running`.

        Returns:
            The result of the root.

        Raises:
            ValueError: *period* is negative, infinite or NaN.
            BtcoreError: The tree is being ticked already, by another call.
            NodeExecutionError: A node raised, or a tick exceeded `tick_limit`; the tree was halted.
        """
        # Imported here, because importing asyncio takes as long as importing the engine.
        from asyncio import CancelledError

        from btcore.tree.event_loop import EventLoopWait

        schedule = TickSchedule(period, self.context.clock.now())
        self._begin_loop()
        wait = EventLoopWait(self.context, schedule)
        try:
            while True:
                hooks = self._hooks
                if hooks is not None and hooks.has_active_breakpoint:
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
            self._is_in_loop = False
            wait.close()
            if self._hooks is not None:
                self._hooks.close_tick_thread()

    def _timeout_error(self) -> NodeExecutionError:
        node = self._repeating_node()
        cause = NodeError(
            f"the tick was stopped after {self.tick_limit:g} s (tick limit): the node repeats without a "
            "pause; add a pause, such as a <Delay>, or limit the number of repetitions"
        )
        error = execution_error(node, cause, "ticking")
        parents = parents_of(self)
        while uid := parents.get(node.config.uid):
            node = self.nodes[uid - 1]
            add_to_backtrace(node, error)
        return error

    def _repeating_node(self) -> TreeNode:
        """Return the first node that repeats without a limit, else the last node that requested a tick."""
        for node in self.nodes:
            for name, input in node.config.inputs.items():
                forever = input.port.role is PortRole.REPETITIONS and input_or(node, name, 0) == -1
                if forever and node._status is RUNNING:
                    return node
        uid = self.context.woken_by
        return self.nodes[uid - 1] if uid > 0 else self.root

    def _begin_loop(self) -> None:
        if self._is_in_loop:
            raise BtcoreError(
                f"tree '{self.id}' is being ticked already by run() or tick_while_running(): wait until this "
                "call returns, or load a second tree"
            )
        self._is_in_loop = True

    # --- halting, waiting

    def halt(self) -> None:
        """Halt every node, as BehaviorTree.CPP's haltTree(): the root, then all nodes in pre-order.

        Raises:
            NodeExecutionError: A node raised while it was halted. All nodes are halted before the exception
                is raised. It is the first exception of a node; *later_errors* holds those of other nodes.
        """
        errors = self._halt_everything()
        self.status = IDLE
        if errors:
            first = errors[0]
            first.later_errors += errors[1:]
            self._notify_error(first)
            raise first

    def _notify_error(self, error: NodeExecutionError) -> None:
        # Read here, not before the tick: a node may have subscribed the first observer within the tick.
        if self.context.observers is not None:
            self.context.observers.notify_error(error)

    def _halt_after(self, error: NodeExecutionError) -> None:
        """Halt the tree after *error* in a tick. Add the errors of the halt to *error*."""
        self.status = IDLE
        self._notify_error(error)
        error.later_errors += self._halt_everything()

    def _halt_everything(self) -> list[NodeExecutionError]:
        journal = self.context.journal
        if journal is None:
            return self._halt_nodes()
        journal.begin_halt()
        try:
            return self._halt_nodes()
        finally:
            journal.end_step(IDLE)

    def _halt_nodes(self) -> list[NodeExecutionError]:
        errors: list[NodeExecutionError] = []
        # The root first, because halting it halts the tree in its own order. Then every node, because a node
        # may fail to halt its children.
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
        """Wait for *seconds* (tree's clock) or until a wake-up. Return whether a wake-up ended the wait."""
        return self.context.wait_until(self.context.clock.now() + round(seconds * NS_PER_S))

    def wake(self) -> None:
        """End the wait between two ticks, so that the tree is ticked as soon as possible. Thread-safe."""
        self.context.wake_up()

    def interrupt(self) -> None:
        """End the tick in progress and the wait for the next as soon as possible.

        From now on, ticks do not repeat nodes, and ignore breakpoints. A signal handler may call this method.
        """
        self.context.limit.is_interrupted = True
        # In a thread, since the handler may have interrupted code that holds the locks that this needs.
        threading.Thread(target=self._end_waits, daemon=True).start()

    def _end_waits(self) -> None:
        self.wake()
        self.hooks.ignore_breakpoints()

    # --- backups of the blackboards

    def backup_blackboards(self) -> list[Blackboard]:
        """Return copies of the blackboards of the main tree and its subtrees, with copies of the values.

        A value that cannot be copied, such as a lock or a connection, is shared with the backup.
        """
        return copy_scopes(self._scopes())

    def restore_blackboards(self, backup: Sequence[Blackboard]) -> None:
        """Restore the entries of the blackboards, with their types; later entries are removed.

        Restoring an entry is a write: its sequence ID increases. A backup can be restored several times.

        Args:
            backup: The result of `backup_blackboards` of this tree, or of a tree of the same XML.

        Raises:
            BtcoreError: The backup is of a tree with other subtrees.
        """
        scopes = self._scopes()
        if len(backup) != len(scopes):
            raise BtcoreError(
                f"the backup has {len(backup)} blackboards, but the tree '{self.id}' has {len(scopes)}: "
                "it is of another tree"
            )
        for copy, scope in zip(copy_scopes(backup), scopes, strict=True):
            copy.clone_into(scope)

    def _scopes(self) -> list[Blackboard]:
        """Return the scopes of the main tree and its subtrees, without those around them (`scopes_of`)."""
        return list(dict.fromkeys(subtree.blackboard for subtree in self.subtrees))

    # --- breakpoints, observers, nodes

    @property
    def hooks(self) -> "Hooks":
        """The breakpoints and injected statuses of the tree. Thread-safe."""
        from btcore.tree.hooks import Hooks

        with self.context.lock:
            if self._hooks is None:
                self._hooks = Hooks(self.nodes, self.context)
            return self._hooks

    def subscribe(self, observer: Observer) -> Callable[[], None]:
        """Subscribe *observer*. Return a function that unsubscribes it.

        Call both on the thread that ticks, or while no tick is in progress.
        """
        observers = self.context.observers
        if observers is None:
            observers = Observers(self.context.clock)
            observers.tick = self.ticks
            self.context.observers = observers
        return observers.add(observer)

    def flush_observers(self) -> None:
        """Notify observers of the transitions so far now, instead of at the end of the tick.

        See `Observer.transitions`.
        """
        if self.context.observers is not None:
            self.context.observers.flush()

    def start_tick_counts(self) -> dict[str, TickCounts]:
        """Count the ticks of every node from now on. Return the counters by path (`nodes_by_path`)."""
        return {key: start_tick_counts(node) for key, node in self.nodes_by_path().items()}

    def nodes_by_path(self) -> dict[str, TreeNode]:
        """Return the nodes by full path, in pre-order. `#1`, `#2` … are appended to equal paths."""
        return dict(zip(unique_paths([node.config.path for node in self.nodes]), self.nodes, strict=True))

    def node(self, path: str) -> TreeNode:
        """Return the node with the full path *path*, or the only node with the name *path*.

        Raises:
            BtcoreError: There is no such node, or several nodes have this name.
        """
        keys = self.nodes_by_path()
        if path in keys:
            return keys[path]
        named = [key for key, node in keys.items() if path in (node.name, node.config.path)]
        if len(named) == 1:
            return keys[named[0]]
        if named:
            raise BtcoreError(f"'{path}' is the name of {len(named)} nodes: {', '.join(named)}")
        # The name of a subtree instance in a path ends in a number that is easily forgotten: Dock::7/undock.
        _, slash, name = path.rpartition("/")
        same_name = [key for key, node in keys.items() if slash and node.name == name]
        hint = did_you_mean(path, same_name or [*keys, *(node.name for node in self.nodes)])
        if not hint and same_name:
            hint = did_you_mean(same_name[0], same_name)
        raise BtcoreError(f"the tree has no node '{path}'{hint}")

    def find(self, node_class: type[N]) -> list[N]:
        """Return the nodes of class *node_class*, in pre-order."""
        return [node for node in self.nodes if isinstance(node, node_class)]

    def draw(self, file: TextIO | None = None) -> None:
        """Print a drawing of the tree with the status of each node. `print(tree)` does so without colours.

        A node that has been reset shows its last result in parentheses. If *file* is a terminal, the drawing
        has colours. If *file* cannot write Unicode, the drawing consists of ASCII characters.

        Args:
            file: The file; None = standard output.
        """
        from btcore.tree.drawing import print_results

        print_results(self.id, self.ticks, self.root, file)

    def __str__(self) -> str:
        from btcore.tree.drawing import results_text

        return results_text(self.id, self.ticks, self.root)

    def __iter__(self) -> Iterator[TreeNode]:
        return iter(self.nodes)

    def __reduce_ex__(self, protocol: SupportsIndex) -> NoReturn:
        raise TypeError(
            "a tree cannot be copied or pickled, because of its clock and resources: load it again"
        )

    def __repr__(self) -> str:
        count = len(self.nodes)
        return f"<Tree '{self.id}' of {counted(count, 'node')}, {self.status.name}>"


def with_parents(board: Blackboard | None) -> Iterator[Blackboard]:
    """Yield *board* and the scopes around it."""
    while board is not None:
        yield board
        board = board.parent


def scopes_of(tree: Tree) -> list[Blackboard]:
    """Return the scopes of *tree*: that of the main tree and those around it, then those of subtrees."""
    return list(dict.fromkeys([*with_parents(tree.blackboard), *tree._scopes()]))


def parents_of(tree: Tree) -> dict[int, int]:
    """Return the UID of the parent of each node but the root, by UID."""
    return {child.config.uid: node.config.uid for node in tree.nodes for child in node.children}


# Functions, because calls of methods of `Tree` take longer (compiled).


def _tick(tree: Tree, repeat: bool) -> Status:
    """Tick the root of *tree*, and if *repeat*, again while it is RUNNING and a wake-up is pending."""
    if tree._is_in_tick:
        raise BtcoreError(
            f"tree '{tree.id}' is being ticked already: neither a second thread nor a leaf of the tree "
            "can tick it during a tick; to request another tick, call wake()"
        )
    context = tree.context
    limit_s = tree.tick_limit
    if limit_s is not None:
        context.limit.start(limit_s)
    tree._is_in_tick = True
    try:
        while True:
            tree.ticks += 1
            if context.uses_time:
                context.tick_start = context.clock.now()
            observers = context.observers
            status = _tick_root(tree) if observers is None else _tick_observed_root(tree, observers)
            if status is not RUNNING or not repeat or not context.consume_wake_up():
                break
            if context.limit.check():
                break
        if limit_s is not None and context.limit.has_timed_out:
            error = tree._timeout_error()
            tree._halt_after(error)
            raise error
    finally:
        tree._is_in_tick = False
        context.tick_start = -1
        if limit_s is not None:
            context.limit.stop()
    tree.status = status
    return status


def _tick_root(tree: Tree) -> Status:
    """Tick the root of *tree*, and reset it if it has completed. If a node raises, halt the tree."""
    root = tree.root
    try:
        status = execute_tick(root)
    except NodeExecutionError as error:
        tree._halt_after(error)
        raise
    if status is SUCCESS or status is FAILURE:
        reset_status(root)
    return status


def _tick_observed_root(tree: Tree, observers: Observers) -> Status:
    """Tick the root like `_tick_root`. Notify *observers*, and record the tick if the tree has a journal."""
    context = tree.context
    observers.begin_tick(tree.ticks)
    journal = observers.journal
    if journal is None:
        status = _tick_root(tree)
    else:
        journal.begin_tick(tree.ticks, context.tick_start, context.take_woken_by())
        status = IDLE
        try:
            status = _tick_root(tree)
        finally:
            journal.end_step(status)
    observers.end_tick(status)
    return status
