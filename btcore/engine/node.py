"""What every node of a tree is: the tick wrapper, halting, and its ports.

``execute_tick`` is what a parent calls; ``tick`` is what a kind of node does. The order within a
tick is BehaviorTree.CPP's (nodes.md §2.1): pre-conditions, tick, post-conditions, stored status.
"""

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Final, NoReturn, SupportsIndex

from mypy_extensions import mypyc_attr

from btcore.blackboard.blackboard import Blackboard
from btcore.engine.conditions import ConditionScripts
from btcore.engine.context import TreeContext
from btcore.engine.instrumentation import Instrumentation, TickCounts
from btcore.engine.node_config import NodeConfig
from btcore.errors import NodeError, NodeExecutionError
from btcore.status import (
    ANY_RESULT,
    FAILURE,
    IDLE,
    RUNNING,
    SKIPPED,
    SUCCESS,
    UNKNOWN_RESULTS,
    NodeType,
    PossibleResults,
    Status,
)

# What follows a tick, by family of nodes.
PLAIN: Final = 0
SYNCHRONOUS: Final = 1  # RUNNING is an error
DECORATING: Final = 2  # a child that has completed is reset
OVERRIDDEN: Final = 4  # and the class has an execute_tick of its own

NO_CHILDREN: Final[list["TreeNode"]] = []
_UNPLACED: Final = NodeConfig("", "")
_STILL_RUNNING: Final = (
    "a synchronous action ends within its tick, but it returned RUNNING; "
    "use StatefulAction, a generator or async def for one that lasts"
)


@mypyc_attr(allow_interpreted_subclasses=True)
class TreeNode:
    """A node of a behavior tree.

    Subclass one of the leaf classes, :class:`ControlNode` or :class:`DecoratorNode` instead. The
    engine's attributes are set before ``__init__`` runs, which needs no call of ``super()``.
    """

    node_type: ClassVar[NodeType] = NodeType.UNDEFINED
    _family: ClassVar[int] = PLAIN

    # --- what a class declares about its nodes, beside its ports. No tick reads it.

    node_symbol: ClassVar[str] = ""
    """The sign of the node in listings and pictures; "" = that of its type.

    Of two characters, listings show the first, and pictures draw the second in a ring.
    """
    may_return: ClassVar[frozenset[Status]] = ANY_RESULT
    """The results that a tick may give, apart from RUNNING. Static checks and tree coverage use it."""
    state_fields: ClassVar[tuple[str, ...] | None] = ()
    """The attributes that the node remembers between ticks, in addition to those of its base classes.

    Saved and restored, together with statuses, blackboard and clock, they determine the tree's future. None =
    the node cannot be saved while it is RUNNING.
    """
    skips_alone: ClassVar[bool] = True
    """Whether a tick may give SKIPPED although no child did."""
    child_count: ClassVar[tuple[int, int | None]] = (0, 0)
    """The least and the greatest number of children that the node can be ticked with; None = no limit."""
    child_count_at_load: ClassVar[tuple[int, int | None]] = (0, 0)
    """The same for loading a tree: BehaviorTree.CPP loads some trees whose ticks raise."""
    child_roles: ClassVar[str] = ""
    """What the children are for, as messages about their number explain it."""
    builtin_formats: ClassVar[tuple[int, ...]] = ()
    """The XML formats that have this class built in; () = a base class. Not inherited."""
    builtin_id: ClassVar[str] = ""
    """The ID of the built-in node; "" = the class's name. Not inherited."""
    batch_class: ClassVar[str] = ""
    """``module:class`` of the counterpart in the batch engine; "" = there is none. Not inherited."""

    config: NodeConfig = _UNPLACED
    _status: Status = IDLE
    _guard: Instrumentation | None = None
    _follows: int = PLAIN
    _decorated: "TreeNode | None" = None
    _context: TreeContext
    _blackboard: Blackboard

    def attach_to_tree(self, config: NodeConfig, context: TreeContext, blackboard: Blackboard) -> None:
        """Put the node into a tree. Called by the builder, before ``__init__``."""
        self.config = config
        self._status = IDLE
        self._guard = None
        self._decorated = None
        self._follows = self._family
        if type(self).execute_tick is not TreeNode.execute_tick:
            self._follows += OVERRIDDEN
        self._context = context
        self._blackboard = blackboard
        if config.scripts:
            guard = Instrumentation()
            guard.conditions = ConditionScripts(config.scripts, config.enums, blackboard)
            self._guard = guard

    def prepare(self) -> None:
        """Look once at what the tree says, after ``__init__`` and the children. Raises NodeError."""

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """Return what a node of this class may result in, for static checks.

        Args:
            children: What its children may result in, in order.
            literals: The values of the input ports that are given as literals, by name.
        """
        return UNKNOWN_RESULTS

    # --- who it is

    @property
    def name(self) -> str:
        """The instance name."""
        return self.config.name

    @property
    def id(self) -> str:
        """The registration ID."""
        return self.config.id

    @property
    def uid(self) -> int:
        """The number within the tree, from 1, in depth-first pre-order."""
        return self.config.uid

    @property
    def path(self) -> str:
        """The full path, as BehaviorTree.CPP 4 writes it."""
        return self.config.path

    @property
    def type(self) -> NodeType:
        """The family that the node belongs to."""
        return self.node_type

    @property
    def children(self) -> list["TreeNode"]:
        """The children, in order."""
        return NO_CHILDREN

    @property
    def status(self) -> Status:
        """The stored status: what the last tick left, or IDLE after a reset."""
        return self._status

    @property
    def blackboard(self) -> Blackboard:
        """The scope that the node reads and writes."""
        return self._blackboard

    @property
    def tick_counts(self) -> TickCounts | None:
        """How often it was ticked, if its tree counts (:meth:`Tree.count_ticks`)."""
        return None if self._guard is None else self._guard.tick_counts

    def count_ticks(self) -> TickCounts:
        """Count the ticks of this node from now on."""
        with self._context.lock:
            self._guard = guard = self._guard or Instrumentation()
            guard.tick_counts = tally = guard.tick_counts or TickCounts()
        return tally

    def set_pre_tick_function(self, callback: "Callable[[Any], Status] | None") -> None:
        """Ask *callback* (None: nobody) before each tick, with the node; any thread may set it.

        SUCCESS or FAILURE from it takes the place of the tick. It isn't asked where a pre-condition
        decides, nor of a node that has completed and was not reset.
        """
        with self._context.lock:
            guard = self._guard or Instrumentation()
            guard.pre_tick = callback
            self._guard = None if guard.is_empty else guard

    def set_post_tick_function(self, callback: "Callable[[Any, Status], Status] | None") -> None:
        """Ask *callback* (None: nobody) after each tick and its post-conditions, with node and status.

        SUCCESS or FAILURE from it takes the place of that status, whoever decided it.
        """
        with self._context.lock:
            guard = self._guard or Instrumentation()
            guard.post_tick = callback
            self._guard = None if guard.is_empty else guard

    def __repr__(self) -> str:
        return f"<{self.config.id} '{self.config.path}' {self._status.name}>"

    def __reduce_ex__(self, protocol: SupportsIndex) -> NoReturn:
        raise TypeError("a node is part of its tree: load the tree again for another one")

    # --- ticking

    def tick(self) -> object:
        """Do what the node is for, and return how it stands: a Status, or True or False. Override this."""
        raise NodeError(f"<{self.config.id}> has no tick()")

    def execute_tick(self) -> Status:
        """Tick the node as its parent does: with conditions, and with the result stored.

        A class that overrides it does so before a tree is made of it.
        """
        return execute_tick(self, True)

    def set_status(self, status: Status) -> None:
        """Store *status* and, if it is another, tell the observers."""
        previous = self._status
        if previous is not status:
            self._status = status
            observers = self._context.observers
            if observers is not None:
                observers.record_transition(observers.now(), self.config, previous, status)

    def reset_status(self) -> None:
        """Go back to IDLE."""
        reset_status(self)

    # --- halting

    def halt(self) -> None:
        """Stop what runs, and be IDLE afterwards. Override it to clean up, and call ``super().halt()``."""
        self.reset_status()

    def halt_node(self) -> None:
        """Halt as a parent does: with ``_onHalted``, and named if it raises (being IDLE all the same)."""
        halt_node(self)

    def execution_error(self, fault: BaseException, doing: str) -> NodeExecutionError:
        """*fault* as an error that names this node."""
        error = NodeExecutionError(self.config.path, self.config.id, fault, doing, self.config.where)
        # Compiled code does not set it by `raise … from`.
        error.__cause__ = fault
        error.backtrace.append(self.config.path)
        return error

    def trace(self, error: NodeExecutionError) -> None:
        """Put this node into the path down to the node that raised."""
        if error.backtrace[0] != self.config.path:
            error.backtrace.insert(0, self.config.path)

    # --- what a node may ask of its tree

    def get_input(self, name: str) -> object:
        """The value of input port *name*.

        Raises NodeError when the tree doesn't give the port, BlackboardError or ConversionError when
        it can't be read.
        """
        return self.config.input(name).read()

    def set_output(self, name: str, value: object) -> None:
        """Write *value* to output port *name*. Raises as :meth:`get_input`."""
        self.config.output(name).write(value)

    def now(self) -> int:
        """The time (ns) of the tree's clock."""
        return self._context.clock.now()

    def wake_up(self) -> None:
        """Ask for another tick of the tree as soon as possible."""
        self._context.wake_up()

    def wake_at(self, moment: int) -> None:
        """Ask for a tick at *moment* (ns of the tree's clock); one such wish a node."""
        self._context.deadlines[self.config.uid] = moment

    def cancel_wake_up(self) -> None:
        """Take the wish of :meth:`wake_at` back."""
        self._context.deadlines.pop(self.config.uid, None)


# --- What the methods above do. Parents call these: a method that a class in Python may override is
# looked up by name, in compiled code, where a function is not.


def execute_tick(node: TreeNode, itself: bool = False) -> Status:
    """Tick *node* as its parent does, by an execute_tick of its own class unless it asks *itself*."""
    follows = node._follows
    if follows >= OVERRIDDEN and not itself:
        return node.execute_tick()
    guard = node._guard
    status: Status
    try:
        result = node.tick() if guard is None else _guarded(node, guard)
        previous = node._status
        if result is previous and previous is not IDLE:
            status = previous
        else:
            status = SUCCESS if result is SUCCESS else _verdict(result)
            if status is not previous and status is not SKIPPED:
                node._status = status
                observers = node._context.observers
                if observers is not None:
                    if previous is IDLE and status is SUCCESS:
                        observers.record_success(node.config)
                    else:
                        observers.record_transition(observers.now(), node.config, previous, status)
        if follows & SYNCHRONOUS and status is RUNNING:
            raise NodeError(_STILL_RUNNING)
    except NodeExecutionError as error:
        node.trace(error)
        raise
    except KeyboardInterrupt:
        raise
    except BaseException as fault:
        raise node.execution_error(fault, "ticking") from fault
    if follows & DECORATING:
        child = node._decorated
        if child is not None and (child._status is SUCCESS or child._status is FAILURE):
            reset_status(child)
    return status


def _guarded(node: TreeNode, guard: Instrumentation) -> Status:
    """A tick with what surrounds it."""
    conditions = guard.conditions
    tally = guard.tick_counts
    if tally is not None:
        tally.ticks += 1
    status = IDLE
    if conditions is not None:
        status = conditions.check_preconditions(node._status)
        if status is SKIPPED and node._status is RUNNING:
            halt_node(node)
    if status is IDLE and guard.pre_tick is not None:
        status = guard.call_pre_tick(node, node._status)
    if status is IDLE:
        status = _verdict(node.tick())
    if conditions is not None and (status is SUCCESS or status is FAILURE):
        conditions.run_postconditions(status)
    if guard.post_tick is not None:
        status = guard.call_post_tick(node, status)
    if tally is not None:
        tally.add_result(status)
    return status


def _verdict(result: object) -> Status:
    """*result*, or what a bool stands for. Raises NodeError for anything else, IDLE too."""
    if result is SUCCESS or result is True:
        return SUCCESS
    if result is FAILURE or result is False:
        return FAILURE
    if result is RUNNING:
        return RUNNING
    if result is SKIPPED:
        return SKIPPED
    said = "IDLE" if result is IDLE else repr(result)
    raise NodeError(f"a tick ends RUNNING, SUCCESS (True), FAILURE (False) or SKIPPED, not {said}")


def reset_status(node: TreeNode) -> None:
    """Set *node* back to IDLE."""
    previous = node._status
    if previous is not IDLE:
        node._status = IDLE
        observers = node._context.observers
        if observers is not None:
            observers.record_transition(observers.now(), node.config, previous, IDLE)


def halt_node(node: TreeNode) -> None:
    """Halt *node* as a parent does; see :meth:`TreeNode.halt_node`."""
    guard = node._guard
    try:
        if guard is not None and guard.tick_counts is not None and node._status is RUNNING:
            guard.tick_counts.halted += 1
        node.halt()
        if guard is not None and guard.conditions is not None:
            guard.conditions.run_on_halted()
    except NodeExecutionError as error:
        reset_status(node)
        node.trace(error)
        raise
    except KeyboardInterrupt:
        raise
    except BaseException as fault:
        reset_status(node)
        raise node.execution_error(fault, "being halted") from fault
