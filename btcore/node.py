"""What every node of a tree is: the tick wrapper, halting, and its ports.

``execute_tick`` is what a parent calls; ``tick`` is what a kind of node does. The order within a
tick is BehaviorTree.CPP's (nodes.md §2.1): pre-conditions, tick, post-conditions, stored status.
"""

from collections.abc import Callable
from typing import Any, ClassVar, Final

from mypy_extensions import mypyc_attr

from btcore.blackboard import Blackboard
from btcore.conditions import Conditions
from btcore.config import NodeConfig
from btcore.context import TreeContext
from btcore.errors import NodeFault, NodeRaised
from btcore.guard import Guard, Tally
from btcore.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, NodeType, Status

NO_CHILDREN: Final[list["TreeNode"]] = []
_UNPLACED: Final = NodeConfig("", "")


@mypyc_attr(allow_interpreted_subclasses=True)
class TreeNode:
    """A node of a behavior tree.

    Subclass one of the leaf classes, :class:`ControlNode` or :class:`DecoratorNode` instead. The
    engine's attributes are set before ``__init__`` runs, which needs no call of ``super()``.
    """

    node_type: ClassVar[NodeType] = NodeType.UNDEFINED

    config: NodeConfig = _UNPLACED
    _status: Status = IDLE
    _guard: Guard | None = None
    _context: TreeContext
    _blackboard: Blackboard

    def place(self, config: NodeConfig, context: TreeContext, blackboard: Blackboard) -> None:
        """Put the node into a tree. Called by the builder, before ``__init__``."""
        self.config = config
        self._status = IDLE
        self._guard = None
        self._context = context
        self._blackboard = blackboard
        if config.scripts:
            guard = Guard()
            guard.conditions = Conditions(config.scripts, config.enums, blackboard)
            self._guard = guard

    def prepare(self) -> None:
        """Look once at what the tree says, after ``__init__`` and the children. Raises NodeFault."""

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
    def tally(self) -> Tally | None:
        """How often it was ticked, if its tree counts (:meth:`Tree.count`)."""
        return None if self._guard is None else self._guard.tally

    def count(self) -> Tally:
        """Count the ticks of this node from now on."""
        with self._context.lock:
            self._guard = guard = self._guard or Guard()
            guard.tally = tally = guard.tally or Tally()
        return tally

    def set_pre_tick_function(self, callback: "Callable[[Any], Status] | None") -> None:
        """Ask *callback* (None: nobody) before each tick, with the node; any thread may set it.

        SUCCESS or FAILURE from it takes the place of the tick. It isn't asked where a pre-condition
        decides, nor of a node that has completed and was not reset.
        """
        with self._context.lock:
            guard = self._guard or Guard()
            guard.pre_tick = callback
            self._guard = None if guard.is_empty else guard

    def set_post_tick_function(self, callback: "Callable[[Any, Status], Status] | None") -> None:
        """Ask *callback* (None: nobody) after each tick and its post-conditions, with node and status.

        SUCCESS or FAILURE from it takes the place of that status, whoever decided it.
        """
        with self._context.lock:
            guard = self._guard or Guard()
            guard.post_tick = callback
            self._guard = None if guard.is_empty else guard

    def __repr__(self) -> str:
        return f"<{self.config.id} '{self.config.path}' {self._status.name}>"

    # --- ticking

    def tick(self) -> object:
        """Do what the node is for, and return how it stands: a Status, or True or False. Override this."""
        raise NodeFault(f"<{self.config.id}> has no tick()")

    def execute_tick(self) -> Status:
        """Tick the node as its parent does: with conditions, and with the result stored."""
        guard = self._guard
        if guard is not None:
            return self._execute_guarded(guard)
        try:
            status = self.tick()
        except NodeRaised as error:
            self.trace(error)
            raise
        except KeyboardInterrupt:
            raise
        except BaseException as fault:
            raise self.blame(fault, "ticking") from fault
        stored = self._status
        if status is stored and stored is not IDLE:
            return stored
        return self._store(status)

    def _execute_guarded(self, guard: Guard) -> Status:
        conditions = guard.conditions
        tally = guard.tally
        if tally is not None:
            tally.ticks += 1
        try:
            status = IDLE
            if conditions is not None:
                status = conditions.before(self._status)
                if status is SKIPPED and self._status is RUNNING:
                    self.halt_node()
            if status is IDLE and guard.pre_tick is not None:
                status = guard.instead(self, self._status)
            if status is IDLE:
                status = self._verdict(self.tick())
            if conditions is not None and (status is SUCCESS or status is FAILURE):
                conditions.after(status)
            if guard.post_tick is not None:
                status = guard.overridden(self, status)
        except NodeRaised as error:
            self.trace(error)
            raise
        except KeyboardInterrupt:
            raise
        except BaseException as fault:
            raise self.blame(fault, "ticking") from fault
        if tally is not None:
            tally.count(status)
        if status is self._status:
            return status
        return self._store(status)

    def _store(self, result: object) -> Status:
        status = self._verdict(result)
        if status is not SKIPPED:
            self.set_status(status)
        return status

    def _verdict(self, result: object) -> Status:
        """*result*, or what a bool stands for. Raises NodeRaised for anything else, IDLE too."""
        if result is SUCCESS or result is True:
            return SUCCESS
        if result is FAILURE or result is False:
            return FAILURE
        if result is RUNNING:
            return RUNNING
        if result is SKIPPED:
            return SKIPPED
        said = "IDLE" if result is IDLE else repr(result)
        fault = NodeFault(f"a tick ends RUNNING, SUCCESS (True), FAILURE (False) or SKIPPED, not {said}")
        raise self.blame(fault, "ticking") from fault

    def set_status(self, status: Status) -> None:
        """Store *status* and, if it is another, tell the observers."""
        previous = self._status
        if previous is not status:
            self._status = status
            observers = self._context.observers
            if observers is not None:
                observers.changed(self.config.uid, previous, status)

    def reset_status(self) -> None:
        """Go back to IDLE."""
        previous = self._status
        if previous is not IDLE:
            self._status = IDLE
            observers = self._context.observers
            if observers is not None:
                observers.changed(self.config.uid, previous, IDLE)

    # --- halting

    def halt(self) -> None:
        """Stop what runs, and be IDLE afterwards. Override it to clean up, and call ``super().halt()``."""
        self.reset_status()

    def halt_node(self) -> None:
        """Halt as a parent does: with ``_onHalted``, and named if it raises (being IDLE all the same)."""
        guard = self._guard
        try:
            if guard is not None and guard.tally is not None and self._status is RUNNING:
                guard.tally.halted += 1
            self.halt()
            if guard is not None and guard.conditions is not None:
                guard.conditions.halted()
        except NodeRaised as error:
            self.reset_status()
            self.trace(error)
            raise
        except KeyboardInterrupt:
            raise
        except BaseException as fault:
            self.reset_status()
            raise self.blame(fault, "being halted") from fault

    def blame(self, fault: BaseException, doing: str) -> NodeRaised:
        """*fault* as an error that names this node."""
        error = NodeRaised(self.config.path, self.config.id, fault, doing, self.config.where)
        # Compiled code does not set it by `raise … from`.
        error.__cause__ = fault
        error.backtrace.append(self.config.path)
        return error

    def trace(self, error: NodeRaised) -> None:
        """Put this node into the path down to the node that raised."""
        if error.backtrace[0] != self.config.path:
            error.backtrace.insert(0, self.config.path)

    # --- what a node may ask of its tree

    def get_input(self, name: str) -> object:
        """The value of input port *name*.

        Raises NodeFault when the tree doesn't give the port, BlackboardFault or ConversionFault when
        it can't be read.
        """
        port = self.config.inputs.get(name)
        if port is None:
            raise NodeFault(f"<{self.config.id}> needs port [{name}], which the tree does not give")
        return port.read()

    def set_output(self, name: str, value: object) -> None:
        """Write *value* to output port *name*. Raises as :meth:`get_input`."""
        port = self.config.outputs.get(name)
        if port is None:
            raise NodeFault(f"<{self.config.id}> writes port [{name}], which the tree does not give")
        port.write(value)

    def now(self) -> int:
        """The time (ns) of the tree's clock."""
        return self._context.clock.now()

    def wake_up(self) -> None:
        """Ask for another tick of the tree as soon as possible."""
        self._context.wake_up()

    def wake_at(self, moment: int) -> None:
        """Ask for a tick at *moment* (ns of the tree's clock); one such wish a node."""
        self._context.deadlines[self.config.uid] = moment

    def forget_wake_up(self) -> None:
        """Take the wish of :meth:`wake_at` back."""
        self._context.deadlines.pop(self.config.uid, None)


@mypyc_attr(allow_interpreted_subclasses=True)
class ControlNode(TreeNode):
    """A node that decides which of its children is ticked, and when."""

    node_type: ClassVar[NodeType] = NodeType.CONTROL
    _children: list[TreeNode]

    def adopt(self, children: list[TreeNode]) -> None:
        """Take *children*. Called by the builder, once."""
        self._children = children

    @property
    def children(self) -> list[TreeNode]:
        """The children, in order."""
        return self._children

    def halt_child(self, index: int) -> None:
        """Halt child *index* if it runs, and reset it."""
        child = self._children[index]
        if child._status is RUNNING:
            child.halt_node()
        child.reset_status()

    def reset_children(self) -> None:
        """Halt the children that run, and reset all. If one raises, the others are halted first."""
        first: NodeRaised | None = None
        for child in self._children:
            if child._status is not IDLE:
                if child._status is RUNNING:
                    try:
                        child.halt_node()
                    except NodeRaised as error:
                        if first is None:
                            first = error
                        else:
                            first.also.append(error)
                child.reset_status()
        if first is not None:
            raise first

    def halt(self) -> None:
        """Halt the children, and be IDLE afterwards."""
        self.reset_children()
        self.reset_status()

    def idle_child(self, index: int) -> NodeFault:
        """The fault of a child that returned IDLE."""
        return NodeFault(f"child {index + 1} returned IDLE")


@mypyc_attr(allow_interpreted_subclasses=True)
class DecoratorNode(TreeNode):
    """A node with one child, whose result or whose ticks it changes."""

    node_type: ClassVar[NodeType] = NodeType.DECORATOR
    child: TreeNode

    def adopt(self, children: list[TreeNode]) -> None:
        """Take the one child. Called by the builder, once."""
        self.child = children[0]

    @property
    def children(self) -> list[TreeNode]:
        """The child, as a list."""
        return [self.child]

    def execute_tick(self) -> Status:
        """Tick as any node; a child that has completed is reset."""
        status = super().execute_tick()
        child = self.child._status
        if child is SUCCESS or child is FAILURE:
            self.child.reset_status()
        return status

    def halt_child(self) -> None:
        """Halt the child if it runs, and reset it."""
        child = self.child
        if child._status is RUNNING:
            try:
                child.halt_node()
            finally:
                child.reset_status()
        else:
            child.reset_status()

    def reset_child(self) -> None:
        """The same as :meth:`halt_child`, by BehaviorTree.CPP's other name."""
        self.halt_child()

    def halt(self) -> None:
        """Halt the child, and be IDLE afterwards."""
        self.halt_child()
        self.reset_status()
