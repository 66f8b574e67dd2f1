"""The base class of all nodes: ticking, halting and access to ports.

A parent calls `execute_tick`. A class of nodes implements `tick`. The order within a tick is that of
BehaviorTree.CPP (src/tree_node.cpp): pre-conditions, tick, post-conditions, stored status. A node with
conditions, callbacks or counters, or whose ticks are recorded, has a `TickWrapper`.

`execute_tick`, `halt_node`, `set_status` and `reset_status` are functions, and methods that call them.
Built-in nodes call the functions: mypyc looks up by name every method that an interpreted class may override,
which takes longer.

Reading what a class declares takes longer, too (compiled). What each tick needs is copied to the node: by
`attach_to_tree` for every node, by `prepare` for the nodes of a class. The copy of a class variable `x` or of
the field `x` of a spec is `_x`.
"""

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, Final, NoReturn, SupportsIndex

from mypy_extensions import mypyc_attr

from btcore.blackboard.blackboard import Blackboard
from btcore.diagnostics import LiteralProblem
from btcore.engine.conditions import UNDECIDED, NodeConditions
from btcore.engine.context import TreeContext
from btcore.engine.node_config import NodeConfig
from btcore.engine.node_spec import NodeSpec
from btcore.errors import BlackboardError, ConversionError, NodeError, NodeExecutionError, TickInterrupt
from btcore.status import (
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

if TYPE_CHECKING:
    from btcore.engine.journal import Journal  # imported when a recording begins

NO_CHILDREN: Final[list["TreeNode"]] = []
_NO_CONFIG: Final = NodeConfig("", "")
_STILL_RUNNING: Final = (
    "a synchronous action must complete within its tick, but it returned RUNNING; "
    "for an action of several ticks use StatefulAction, a generator or async def"
)


@mypyc_attr(allow_interpreted_subclasses=True)
class TreeNode:
    """A node of a behavior tree.

    Do not subclass this class, but one of the leaf classes, `ControlNode` or `DecoratorNode`.
    The engine sets its attributes before `__init__` runs, so `__init__` need not call `super()`.

    Attributes:
        spec: What the class declares about its nodes for tools and static checks, in addition to its ports.
        config: The place of the node in the tree, its ports and its conditions.

    Examples:
        >>> import btcore
        >>> b = btcore.Builder()
        >>> tree = b.build(b.Sequence(b.AlwaysSuccess(name="door"), name="round"))
        >>> [(node.name, node.path, node.type.name) for node in tree]
        [('round', 'round', 'CONTROL'), ('door', 'door', 'ACTION')]
    """

    spec: ClassVar[NodeSpec] = NodeSpec()

    config: NodeConfig = _NO_CONFIG
    # What every tick reads comes first, so that it is close together in memory (compiled).
    _status: Status = IDLE
    _wrapper: "TickWrapper | None" = None
    """Calls `tick` and `halt` of a node that has conditions, or has had callbacks, counters or a journal."""
    _overrides_execute_tick: bool = False
    _must_complete: bool = False
    _decorated_child: "TreeNode | None" = None
    """The child of a decorator, which `execute_tick` resets when it has completed; None for other nodes."""
    _context: TreeContext
    _blackboard: Blackboard
    _status_before_reset: Status = IDLE
    """The last result, for drawings of a tree whose parents have reset it."""

    def prepare(self) -> None:
        """Prepare the node for ticks, for example by compiling the script in a port.

        Called once, after `__init__` ran and the children were set. A subclass of a built-in node
        that overrides it calls `super().prepare()`.

        Raises:
            NodeError: The node cannot be used as declared, for example without a mandatory port.
        """

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """Return the possible results of a node of this class, for static checks.

        Args:
            children: The possible results of the node's children, in order.
            literals: The values of the input ports that are given as literals, by name.
        """
        return UNKNOWN_RESULTS

    @classmethod
    def check_literals(cls, literals: Mapping[str, str]) -> Iterable[LiteralProblem]:
        """Return the problems of literals beyond the types of the ports, for `btcore validate`.

        A class overrides this method if the texts of a port must fit something else, such as the text of
        another port or a file. Each problem must be certain: such a node raises when it is created or ticked.

        Args:
            literals: The texts of the ports that are literals, by name; also defaults. The texts convert to
                the types of the ports.
        """
        return ()

    # --- identity and state

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
        """The number of the node within the tree, from 1, in depth-first pre-order."""
        return self.config.uid

    @property
    def path(self) -> str:
        """The full path, in BehaviorTree.CPP 4's notation."""
        return self.config.path

    @property
    def type(self) -> NodeType:
        """The node type: ACTION, CONDITION, CONTROL, DECORATOR or SUBTREE."""
        return self.spec.node_type

    @property
    def children(self) -> list["TreeNode"]:
        """The children, in order."""
        return NO_CHILDREN

    @property
    def status(self) -> Status:
        """The stored status: what the last tick set or returned, except SKIPPED; IDLE after a reset."""
        return self._status

    @property
    def blackboard(self) -> Blackboard:
        """The blackboard scope that the node reads and writes."""
        return self._blackboard

    def set_pre_tick_function(self, callback: "Callable[[Any], Status] | None") -> None:
        """Set the function that is called before each tick, with the node as argument; thread-safe.

        If the function returns SUCCESS or FAILURE, the node is not ticked and has this result. The function
        is not called if a pre-condition determines the result, nor for a completed node before its reset.

        Args:
            callback: The function; None removes it.
        """
        tick_wrapper(self).pre_tick = callback

    def set_post_tick_function(self, callback: "Callable[[Any, Status], Status] | None") -> None:
        """Set the function that is called after each tick and its post-conditions; thread-safe.

        The arguments of the function are the node and its result. If the function returns SUCCESS or FAILURE,
        this is the result, even if a pre-condition or the pre-tick function had determined it.

        Args:
            callback: The function; None removes it.
        """
        tick_wrapper(self).post_tick = callback

    def __repr__(self) -> str:
        return f"<{self.config.id} '{self.config.path}' {self._status.name}>"

    def __reduce_ex__(self, protocol: SupportsIndex) -> NoReturn:
        raise TypeError("a node cannot be copied or pickled: load the tree again for another node")

    # --- ticking

    def tick(self) -> object:
        """Do the node's work. Override this method.

        Returns:
            A Status other than IDLE, or True (SUCCESS) or False (FAILURE).

        Raises:
            NodeError: The class does not override this method.
        """
        raise NodeError(f"<{self.config.id}> has no tick()")

    def execute_tick(self) -> Status:
        """Tick the node as its parent does: run its conditions and store the result.

        A class that overrides this method must define it before the tree is loaded: an override that is added
        to the class later has no effect.

        Returns:
            The result; it is stored unless it is SKIPPED.
        """
        return execute_tick(self, ignore_override=True)

    def set_status(self, status: Status) -> None:
        """Store *status*. Notify the observers if it differs from the previous status."""
        set_status(self, status)

    def reset_status(self) -> None:
        """Set the status to IDLE."""
        reset_status(self)

    # --- halting

    def halt(self) -> None:
        """Stop the node and set it to IDLE. To clean up, override this method and call `super().halt()`."""
        self.reset_status()

    def halt_node(self) -> None:
        """Halt the node as its parent does, and run its `_onHalted` script.

        Raises:
            NodeExecutionError: The node or the script raised; the node is IDLE nevertheless.
        """
        halt_node(self)

    # --- ports, clock and wake-ups, for subclasses

    def get_input(self, name: str) -> object:
        """Return the value of input port *name*.

        Raises:
            NodeError: The port has neither a text in the XML nor a default.
            BlackboardError: The blackboard entry is missing or was never written.
            ConversionError: The value does not convert to the type of the port.
        """
        return self.config.input(name).read()

    def set_output(self, name: str, value: object) -> None:
        """Write a value to an output port.

        Args:
            name: The name of the port.
            value: A value of the type of the port, or a text that fits the type of the entry.

        Raises:
            NodeError: The port has neither a text in the XML nor a default.
            BlackboardError: The port is not bound to an entry, or the entry has another type.
            ConversionError: The value is not of the type of the port.
        """
        self.config.output(name).write(value)

    def now(self) -> int:
        """Return the time (ns) of the tree's clock. To check a deadline, use `has_passed`."""
        return read_clock(self)

    def has_passed(self, deadline: int) -> bool:
        """Return whether *deadline* (ns, tree's clock) had passed when the present tick began.

        All nodes of a tick judge their deadlines by the same time, however long the tick takes. Set a
        deadline by `now`, so that no duration is shorter than requested. Until a node has read the clock,
        ticks have no such time: there is no deadline yet.
        """
        start = self._context.tick_start
        return (start if start >= 0 else read_clock(self)) >= deadline

    def wake_up(self) -> None:
        """Request another tick of the tree as soon as possible. Thread-safe."""
        self._context.wake_up(self.config.uid)

    def wake_at(self, deadline: int) -> None:
        """Request a tick at *deadline* (ns, tree's clock). This replaces an earlier request of the node."""
        self._context.deadlines[self.config.uid] = deadline

    def cancel_wake_up(self) -> None:
        """Cancel the request of `wake_at`."""
        self._context.deadlines.pop(self.config.uid, None)


def attach_to_tree(node: TreeNode, config: NodeConfig, context: TreeContext, blackboard: Blackboard) -> None:
    """Put *node* into a tree. Called by `Manifest.create_node`, before `__init__`.

    Args:
        config: The configuration of the node: its name, path, ports and conditions.
        context: The state that all nodes of the tree share, for example the clock and the observers.
        blackboard: The scope that the node reads and writes.
    """
    node.config = config
    node._status = IDLE
    node._status_before_reset = IDLE
    node._wrapper = None
    node._decorated_child = None
    node._must_complete = node.spec.must_complete
    node._overrides_execute_tick = type(node).execute_tick is not TreeNode.execute_tick
    node._context = context
    node._blackboard = blackboard
    if config.conditions:
        node._wrapper = TickWrapper(NodeConditions(config.conditions, config.enums, blackboard))


def execution_error(node: TreeNode, cause: BaseException, doing: str) -> NodeExecutionError:
    """Return an error that names *node*.

    Args:
        cause: The exception that was raised.
        doing: When it was raised: "ticking" or "being halted".
    """
    config = node.config
    error = NodeExecutionError(config.path, config.id, cause, doing, config.where)
    # Code compiled by mypyc does not set __cause__ by `raise … from`.
    error.__cause__ = cause
    error.backtrace.append(config.path)
    return error


def add_to_backtrace(node: TreeNode, error: NodeExecutionError) -> None:
    """Prepend *node* to the backtrace of *error*, unless it comes first already."""
    if error.backtrace[0] != node.config.path:
        error.backtrace.insert(0, node.config.path)


# --- the functions that parents call


def execute_tick(node: TreeNode, ignore_override: bool = False) -> Status:
    """Tick *node* as its parent does, and return the result.

    The child of a decorator is reset here if it has completed, as in BehaviorTree.CPP
    (DecoratorNode::executeTick). Many built-in decorators reset it in `tick` already, so that observers are
    notified of the reset before the result of the decorator, as in BehaviorTree.CPP.

    Args:
        ignore_override: Whether an override of execute_tick() is not called, because it is the caller.
    """
    if node._overrides_execute_tick and not ignore_override:
        return node.execute_tick()
    wrapper = node._wrapper
    status: Status
    try:
        result = node.tick() if wrapper is None else wrapper.tick(node)
        # Without calls of `_as_status` and `set_status`: with them, a tick of the benchmark's tree `deep`
        # executes 7 % more instructions of the engine (compiled).
        if result is SUCCESS:
            status = SUCCESS
        elif result is RUNNING:
            status = RUNNING
        else:
            status = _as_status(node, result)
        before = node._status
        # SKIPPED is returned to the parent but not stored, as in BehaviorTree.CPP.
        if status is not before and status is not SKIPPED:
            node._status = status
            observers = node._context.observers
            if observers is not None:
                observers.record_transition(node.config, before, status)
        if status is RUNNING and node._must_complete:
            raise NodeError(_STILL_RUNNING)
    except NodeExecutionError as error:
        add_to_backtrace(node, error)
        raise
    except (KeyboardInterrupt, TickInterrupt):
        raise
    except BaseException as error:  # also SystemExit: a leaf must not end the program without being named
        raise execution_error(node, error, "ticking") from error
    if node._decorated_child is not None:
        child = node._decorated_child
        if child._status is SUCCESS or child._status is FAILURE:
            reset_status(child)
    return status


def _as_status(node: TreeNode, result: object) -> Status:
    """Return *result*, the result of *node*, as a Status. A numpy.bool_ counts as a bool.

    In format 3 a node with children may return IDLE, as in BehaviorTree.CPP 3.8.
    """
    if result is SUCCESS or result is True:
        return SUCCESS
    if result is FAILURE or result is False:
        return FAILURE
    if result is RUNNING:
        return RUNNING
    if result is SKIPPED:
        return SKIPPED
    cls = type(result)
    # The type of numpy's comparisons is named bool_ in numpy 1 and bool in numpy 2.
    if cls.__module__ == "numpy" and cls.__name__ in ("bool", "bool_"):
        return SUCCESS if result else FAILURE
    if result is IDLE and node.config.format == 3 and node.children:
        return IDLE
    text = "IDLE" if result is IDLE else repr(result)
    # The name of a status, or the status of another library, such as py_trees.
    name = result if isinstance(result, str) else getattr(result, "name", None)
    if isinstance(name, str) and name.upper() in ("RUNNING", "SUCCESS", "FAILURE", "SKIPPED"):
        text += f"; write btcore.Status.{name.upper()}"
    if result is None:
        text += _forgotten_return(node)
    raise NodeError(f"a tick must return RUNNING, SUCCESS (True), FAILURE (False) or SKIPPED, not {text}")


def _forgotten_return(node: TreeNode) -> str:
    """Return a question that names the function that returned None, or "" for a node of the engine."""
    call = getattr(node, "call", None)
    functions: list[Any] = [getattr(call, "function", None)]
    for name in ("tick", "on_start" if node._status is IDLE else "on_running", "work"):
        functions.append(getattr(type(node), name, None))
    for function in functions:
        code = getattr(function, "__code__", None)
        if code is not None and not function.__module__.startswith("btcore."):
            written = function.__qualname__.rpartition("<locals>.")[2]
            return f": did {written}() in {code.co_filename}:{code.co_firstlineno} forget `return`?"
    return ""


def read_clock(node: TreeNode) -> int:
    """Return the time (ns) of the tree's clock; see `TreeNode.now`."""
    context = node._context
    context.uses_time = True
    now: int = context.clock.now()
    if context.journal is not None:
        context.journal.add_time(now)
    return now


def input_or(node: TreeNode, name: str, default: object) -> object:
    """Return the value of input port *name*, or *default* if it cannot be read."""
    try:
        return node.get_input(name)
    except (NodeError, BlackboardError, ConversionError):
        return default


# `execute_tick` contains a copy of `set_status`, and `ControlNode.reset_children` copies of `reset_status`.


def set_status(node: TreeNode, status: Status) -> None:
    """Store *status*, and notify the observers if it differs from the previous status."""
    previous = node._status
    if previous is not status:
        node._status = status
        observers = node._context.observers
        if observers is not None:
            observers.record_transition(node.config, previous, status)


def reset_status(node: TreeNode) -> None:
    """Set *node* back to IDLE."""
    previous = node._status
    if previous is not IDLE:
        node._status = IDLE
        node._status_before_reset = previous
        observers = node._context.observers
        if observers is not None:
            observers.record_transition(node.config, previous, IDLE)


def halt_node(node: TreeNode) -> None:
    """Halt *node*, whatever its status; see `TreeNode.halt_node`."""
    wrapper = node._wrapper
    try:
        if wrapper is None:
            node.halt()
        else:
            wrapper.halt(node)
    except NodeExecutionError as error:
        reset_status(node)
        add_to_backtrace(node, error)
        raise
    except (KeyboardInterrupt, TickInterrupt):
        raise
    except BaseException as error:
        reset_status(node)
        raise execution_error(node, error, "being halted") from error


# --- nodes with conditions or callbacks, or that are watched


class TickCounts:
    """The counters of one node: ticks, results, and halts while it was RUNNING."""

    def __init__(self) -> None:
        self.ticks = 0
        self.success = 0
        self.failure = 0
        self.skipped = 0
        self.halted = 0

    def by_name(self) -> dict[str, int]:
        """Return the counters by their names."""
        return {
            "ticks": self.ticks,
            "success": self.success,
            "failure": self.failure,
            "skipped": self.skipped,
            "halted": self.halted,
        }

    def add_result(self, status: Status) -> None:
        """Count the result *status* of a tick."""
        if status is SUCCESS:
            self.success += 1
        elif status is FAILURE:
            self.failure += 1
        elif status is SKIPPED:
            self.skipped += 1


class TickWrapper:
    """Calls the tick and the halt of a node, with what comes before and after them.

    In a recorded tree, external code runs outside of the journal: see `btcore.engine.journal`.

    Attributes:
        conditions: The pre- and post-conditions, or None.
        pre_tick: As in `TreeNode.set_pre_tick_function`.
        post_tick: As in `TreeNode.set_post_tick_function`.
        counts: The counters of the ticks, or None.
        on_tick_start: Called at the start of each tick, before the pre-conditions; or None.
        journal: The journal of a recorded tree, if the node or its parent is external; else None.
        is_external: Whether the node is external. If not, and there is a journal, its parent is.
    """

    def __init__(self, conditions: NodeConditions | None = None) -> None:
        self.conditions = conditions
        self.pre_tick: Callable[[Any], Status] | None = None
        self.post_tick: Callable[[Any, Status], Status] | None = None
        self.counts: TickCounts | None = None
        self.on_tick_start: Callable[[], object] | None = None
        self.journal: Journal | None = None
        self.is_external = False

    def tick(self, node: TreeNode) -> Status:
        """Tick *node* unless a pre-condition or callback decides, run what follows, and return the result."""
        counts, conditions, journal = self.counts, self.conditions, self.journal
        if journal is not None and not journal.is_inside:  # called by an external parent
            return _tick_child_inside(node, self, journal)
        if counts is not None:
            counts.ticks += 1
        if self.on_tick_start is not None:
            self.on_tick_start()
        status = UNDECIDED
        if conditions is not None:
            status = conditions.check_preconditions(node._status)
            if status is SKIPPED and node._status is RUNNING:
                halt_node(node)
        # The callbacks are read once each, because another thread may remove them at any time.
        pre_tick = self.pre_tick
        if pre_tick is not None and status is UNDECIDED and node._status not in (SUCCESS, FAILURE):
            status = _forced_status(node, True, partial(pre_tick, node))
        if status is UNDECIDED:
            if journal is None or not self.is_external:
                status = _as_status(node, node.tick())
            else:
                status = _tick_external(node, journal)
        if conditions is not None and (status is SUCCESS or status is FAILURE):
            conditions.run_postconditions(status)
        post_tick = self.post_tick
        if post_tick is not None:
            forced = _forced_status(node, False, partial(post_tick, node, status))
            if forced is not UNDECIDED:
                status = forced
        if counts is not None:
            counts.add_result(status)
        return status

    def halt(self, node: TreeNode) -> None:
        """Halt *node*, and run its `_onHalted`. Count the halt if *node* is RUNNING."""
        journal = self.journal
        if journal is not None and not journal.is_inside:  # called by an external parent
            _halt_child_inside(node, journal)
            return
        if self.counts is not None and node._status is RUNNING:
            self.counts.halted += 1
        if journal is None or not self.is_external:
            node.halt()
        else:
            _halt_external(node, journal)
        if self.conditions is not None:
            self.conditions.run_on_halted()


def tick_wrapper(node: TreeNode) -> TickWrapper:
    """Return the wrapper of *node*, which gets one if it has none. Thread-safe."""
    with node._context.lock:
        wrapper = node._wrapper
        if wrapper is None:
            node._wrapper = wrapper = TickWrapper()
        return wrapper


def _tick_child_inside(node: TreeNode, wrapper: TickWrapper, journal: "Journal") -> Status:
    """Tick *node* inside, because its external parent ticks it, and record the tick."""
    journal.enter_child_tick(node.config.uid)
    try:
        return wrapper.tick(node)
    finally:
        journal.leave()


def _halt_child_inside(node: TreeNode, journal: "Journal") -> None:
    """Halt *node* inside, because its external parent halts it, and record the halt."""
    journal.enter_child_halt(node.config.uid)
    try:
        halt_node(node)  # from inside now, so that what follows an exception is inside, too
    finally:
        journal.leave()


def _tick_external(node: TreeNode, journal: "Journal") -> Status:
    """Call `tick` of an external node outside, and record its result."""
    journal.leave()
    try:
        status = _as_status(node, node.tick())
    except BaseException as error:
        journal.enter_with_error(node.config.uid, error)
        raise
    journal.enter_with_result(node.config, status)
    return status


def _halt_external(node: TreeNode, journal: "Journal") -> None:
    """Call `halt` of an external node outside, and record what it does, unless it only resets itself."""
    start = journal.record_count
    journal.leave()
    raised: BaseException | None = None
    try:
        node.halt()
    except BaseException as error:
        raised = error
        raise
    finally:
        journal.enter()
        journal.add_halt(node.config.uid, start, raised, node._status is IDLE)


def _forced_status(node: TreeNode, is_pre_tick: bool, callback: Callable[[], Status]) -> Status:
    """Return the result that a callback of *node* forces, or UNDECIDED."""
    journal = node._context.journal
    forced = callback() if journal is None else journal.call_back(node.config.uid, is_pre_tick, callback)
    return forced if forced is SUCCESS or forced is FAILURE else UNDECIDED


def start_tick_counts(node: TreeNode) -> TickCounts:
    """Count the ticks of *node* from now on. Return the counters."""
    wrapper = tick_wrapper(node)
    wrapper.counts = counts = wrapper.counts or TickCounts()
    return counts


def tick_counts_of(node: TreeNode) -> TickCounts | None:
    """Return the tick counters of *node*; None before `start_tick_counts` was called."""
    return None if node._wrapper is None else node._wrapper.counts
