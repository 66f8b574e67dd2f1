"""Loops: they tick the child for each element of a queue."""

from collections import deque
from typing import ClassVar, cast

from mypy_extensions import mypyc_attr

from btcore.blackboard.ports import Direction, Input, Port, PortRole, braced_key
from btcore.engine.control import DecoratorNode
from btcore.engine.node import execute_tick, reset_status, set_status
from btcore.engine.node_spec import NodeSpec
from btcore.errors import BlackboardError, NodeError
from btcore.status import FAILURE, IDLE, RUNNING, SUCCESS, Status
from btcore.values import ANY, BOOL, DOUBLE, INT, NODE_STATUS, STRING, ValueType


@mypyc_attr(allow_interpreted_subclasses=True)
class LoopNode(DecoratorNode):
    """Takes an element from `queue`, writes it to `value`, and ticks the child: at most one element per tick.

    A RUNNING child is ticked again with the same element. The node is RUNNING until the queue is empty and
    then returns `if_empty` (default SUCCESS); it fails as soon as the child fails. A skipped child counts as
    a success. `queue` is a literal list (`1;2;3`), which starts from the beginning whenever the node starts,
    or an entry that holds a deque (its elements are removed), a list, or a text like the literal. An entry
    that was never written, or was removed by the child, is an error.

    Derive a class for elements of another type, and declare the type in the annotation of the port.

    Attributes:
        element_type: The type of the elements.

    Examples:
        >>> from dataclasses import dataclass
        >>> import btcore
        >>> @dataclass
        ... class Pose:
        ...     x: float
        >>> class LoopPose(btcore.LoopNode):
        ...     value: btcore.Out[Pose]
        >>> nodes = btcore.Registry.standard()
        >>> nodes.add(LoopPose)
        >>> b = btcore.Builder(nodes)
        >>> board = btcore.Blackboard()
        >>> board["poses"] = [Pose(1.0), Pose(2.0)]
        >>> tree = b.build(b.LoopPose(b.AlwaysSuccess(), queue="{poses}", value="{pose}"), blackboard=board)
        >>> tree.tick_while_running(), board["pose"]
        (<Status.SUCCESS: 2>, Pose(x=2.0))
    """

    spec: ClassVar[NodeSpec] = NodeSpec(symbol="↺", state_fields=("_remaining", "_child_running"))
    element_type: ClassVar[ValueType] = ANY
    _element_type: ValueType = ANY
    _queue: Input | None = None
    _literal_elements: "list[object] | None" = None  # None = the queue is an entry
    _remaining: "deque[object] | None" = None  # None = not read since the start
    _child_running: bool = False  # whether the last tick of the child returned RUNNING

    @classmethod
    def provided_ports(cls) -> list[Port]:
        """Return the ports."""
        return [
            Port(
                "queue",
                Direction.INOUT,
                description="the elements, as a list or an entry",
                role=PortRole.QUEUE,
            ),
            Port("if_empty", type=NODE_STATUS, default="SUCCESS", description="the result of an empty queue"),
            Port(
                "value",
                Direction.OUT,
                type=cls.element_type,
                description="the current element",
                optional=True,
            ),
        ]

    def prepare(self) -> None:
        """Look up the queue, and convert it if it is a literal."""
        self._queue = self.config.inputs.get("queue")
        if self._queue is None:
            raise NodeError(f"<{self.config.id}> needs port [queue]")
        output = self.config.outputs.get("value")
        # A derived class may have declared the port anew, with its own type.
        self._element_type = self.element_type if output is None else output.type
        if braced_key(self._queue.text) is None:
            self._literal_elements = self.elements(self._queue.text)

    def elements(self, text: str) -> list[object]:
        """Return the elements of *text*, separated by semicolons. Raise ConversionError."""
        parts = text.removesuffix(";").split(";") if text else []
        return [self._element_type.from_text(part, self.config.format) for part in parts]

    def tick(self) -> Status:
        """Take the next element, unless the child is RUNNING, and tick the child."""
        # IDLE also after a halt: a literal queue starts from the beginning, but a deque keeps what is left.
        if self._status is IDLE:
            self._child_running = False
            self._remaining = None if self._literal_elements is None else deque(self._literal_elements)
        if not self._child_running:
            if self._literal_elements is None:
                self._fetch_queue()
            if not self._remaining:
                return cast(Status, self.get_input("if_empty"))
            value = self._remaining.popleft()
            output = self.config.outputs.get("value")
            # BehaviorTree.CPP ignores a text that is not a reference to an entry.
            if output is not None and output.key is not None:
                output.write(value)
        if self._status is IDLE:
            set_status(self, RUNNING)
        status = execute_tick(self.child)
        self._child_running = status is RUNNING
        if status is SUCCESS or status is FAILURE:
            reset_status(self.child)
        return FAILURE if status is FAILURE else RUNNING

    def _fetch_queue(self) -> None:
        queue = self._queue
        if queue is None or queue.key is None:
            return
        # An entry that was removed is created again, as in BehaviorTree.CPP; it has no value then.
        value = (self._blackboard.find(queue.key) or self._blackboard.declare(queue.key)).value
        if value is None:
            raise BlackboardError(
                f"port [queue] reads {{{queue.key}}}, which has no value: write a list or a text, such as "
                "1;2;3, before the loop starts, and keep the entry until the loop ends"
            )
        if isinstance(value, deque):
            # Shared with the entry: the loop removes the elements, and other nodes may append more meanwhile.
            self._remaining = value
        elif self._remaining is None:
            # A copy, made once per start: later writes to the entry have no effect on this start.
            if isinstance(value, str):
                self._remaining = deque(self.elements(value))
            elif isinstance(value, (list, tuple)):
                self._remaining = deque(value)
            else:
                raise NodeError(
                    f"port [queue] reads {{{queue.key}}}, which holds {value!r}, not a list, deque or text"
                )


@mypyc_attr(allow_interpreted_subclasses=True)
class LoopInt(LoopNode):
    """Ticks its child for each integer in `queue`, which it writes to `value`; one integer per tick.

    The node is RUNNING until the queue is empty, and then returns `if_empty` (default SUCCESS). It fails as
    soon as the child fails. A skipped child counts as a success.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(formats=(4,))
    element_type: ClassVar[ValueType] = INT


@mypyc_attr(allow_interpreted_subclasses=True)
class LoopBool(LoopNode):
    """Ticks its child for each bool in `queue`, which it writes to `value`; one bool per tick.

    The node is RUNNING until the queue is empty, and then returns `if_empty` (default SUCCESS). It fails as
    soon as the child fails. A skipped child counts as a success.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(formats=(4,))
    element_type: ClassVar[ValueType] = BOOL


@mypyc_attr(allow_interpreted_subclasses=True)
class LoopDouble(LoopNode):
    """Ticks its child for each real number in `queue`, which it writes to `value`; one number per tick.

    The node is RUNNING until the queue is empty, and then returns `if_empty` (default SUCCESS). It fails as
    soon as the child fails. A skipped child counts as a success.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(formats=(4,))
    element_type: ClassVar[ValueType] = DOUBLE


@mypyc_attr(allow_interpreted_subclasses=True)
class LoopString(LoopNode):
    """Ticks its child for each string in `queue`, which it writes to `value`; one string per tick.

    The node is RUNNING until the queue is empty, and then returns `if_empty` (default SUCCESS). It fails as
    soon as the child fails. A skipped child counts as a success.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(formats=(4,))
    element_type: ClassVar[ValueType] = STRING
