"""The leaves of a batch as their authors write them: a function or a class for all agents at once.

Ports are declared as in the ordinary engine, but with array types. A column is an array with a value for each
agent, shape (agents,). A parameter `In[Floats]` gets a column of doubles; a parameter `Put[Floats]` gets
a function that writes a column of doubles.
"""

import inspect
import typing
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Final, TypeAlias, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from btcore.blackboard.ports import Port
from btcore.engine.functions import MARK, camel_case
from btcore.engine.leaf import Condition, SyncAction
from btcore.engine.leaf import StatefulAction as OrdinaryAction
from btcore.engine.node import TreeNode
from btcore.engine.signature import Parameter, PortAttribute, class_ports, function_parameters
from btcore.errors import NodeError, RegistrationError
from btcore.registry.registry import Registry
from btcore.status import Status
from btcore.values import ANY, BOOL, DOUBLE, FLOAT, INT, INT64, TypeRegistry, ValueType
from btcore_batch.agent_sets import AgentSet, Mask

F = TypeVar("F", bound=Callable[..., object])

Floats: TypeAlias = NDArray[np.float64]
"""A column of doubles."""
Ints: TypeAlias = NDArray[np.int64]
"""A column of 64-bit integers."""
Bools: TypeAlias = NDArray[np.bool_]
"""A column of bools."""
Texts: TypeAlias = NDArray[np.object_]
"""A column of texts or other Python objects."""
Rows: TypeAlias = Annotated[NDArray[np.float64], ANY]
"""A column with a row of numbers for each agent, of shape (agents, …)."""
Statuses: TypeAlias = NDArray[np.uint8]
"""A column of statuses, as the integer values of `Status`."""

_OF_DTYPE: Final[dict[object, ValueType]] = {
    np.float64: DOUBLE,
    np.float32: FLOAT,
    np.int64: INT64,
    np.int32: INT,
    np.bool_: BOOL,
    np.object_: ANY,
}
_MARK: Final = "__btcore_batch_leaf__"


class NodeName(str):
    """The type of a parameter that gets the name of the node."""


@dataclass
class LeafDeclaration:
    """A leaf that a tree of a batch can use.

    Attributes:
        id: The registration ID.
        base_class: The base class of the ordinary leaf that represents it in the ordinary tree.
        ports: The ports.
        parameters: The parameters of the function, or of the class's `__init__`.
        implementation: The function, or the class, of which each node gets an instance.
    """

    id: str
    base_class: type[TreeNode]
    ports: list[Port]
    parameters: list[Parameter]
    implementation: "Callable[..., Any] | type[StatefulAction]"

    def create_node_class(self) -> type[TreeNode]:
        """Return an ordinary leaf class with the same ports, with which the ordinary tree can be loaded."""
        ports = self.ports

        def tick(_: TreeNode, *__: object) -> Status:
            raise RegistrationError(f"<{self.id}> is a leaf of a batch; only a BatchTree can run it")

        members: dict[str, Any] = {"provided_ports": staticmethod(lambda: list(ports)), "tick": tick}
        members |= {"on_start": tick, "on_running": tick}
        members |= {"__module__": self.implementation.__module__, "__doc__": self.implementation.__doc__}
        return type(self.id, (self.base_class,), members)

    @property
    def origin(self) -> str:
        """`module.name` of the function or class."""
        return f"{self.implementation.__module__}.{self.implementation.__qualname__}"


class StatefulAction:
    """An action that may take several ticks, for all agents at once.

    Ports are annotated attributes: reading a port returns the column; assigning a port writes the values of
    the agents for which the method was called. Each method gets the mask of these agents, and is not called
    if there are none. The parameters of `__init__` are resources, found by type.

    Examples:
        >>> import btcore
        >>> import btcore_batch as batch
        >>> from btcore import In, Out
        >>> class Drive(batch.StatefulAction):
        ...     x: In[batch.Floats]
        ...     moved: Out[batch.Floats]
        ...     def on_start(self, mask):
        ...         return btcore.RUNNING
        ...     def on_running(self, mask):
        ...         self.moved = self.x[mask] + 0.5
        ...         return btcore.SUCCESS
        >>> xml = '''<root BTCPP_format="4"><BehaviorTree ID="Main">
        ...   <Drive x="{x}" moved="{x}"/></BehaviorTree></root>'''
        >>> swarm = batch.BatchTree.loads(xml, agents=2, leaves=[Drive], blackboard={"x": [0.0, 1.0]})
        >>> swarm.tick(), swarm.tick()
        (array([1, 1], dtype=uint8), array([2, 2], dtype=uint8))
        >>> swarm.blackboard["x"]
        array([0.5, 1.5])
    """

    _port: Callable[[str], Any]
    name: str
    """The name of the node."""
    agents: AgentSet
    """The number of agents."""
    now: Callable[[], int]
    """Returns the time (ns) of the batch's clock."""

    def on_start(self, mask: Mask) -> object:
        """Start the action for the agents of *mask*, for which it is IDLE.

        Returns:
            The result of each agent, in one of the forms that `action` lists. RUNNING is allowed.
        """
        raise NotImplementedError(f"{type(self).__qualname__} has no on_start()")

    def on_running(self, mask: Mask) -> object:
        """Continue the action for the agents of *mask*, for which it is RUNNING.

        Returns:
            The result of each agent, in one of the forms that `action` lists. RUNNING is allowed.
        """
        raise NotImplementedError(f"{type(self).__qualname__} has no on_running()")

    def on_halted(self, mask: Mask) -> None:
        """Clean up for the agents of *mask*, for which the action was halted while RUNNING."""


@overload
def action(function: F, /) -> F: ...
@overload
def action(*, ID: str | None = None) -> Callable[[F], F]: ...
def action(function: F | None = None, /, *, ID: str | None = None) -> F | Callable[[F], F]:
    """Declare a function as an action for all agents at once, which completes within its tick.

    Parameters with In or Put are ports. A parameter of type Mask gets the mask of the ticked agents, Indices
    their indices. Any other parameter is a resource. The function returns an array of bools (True is SUCCESS)
    or of statuses (uint8), of shape (agents,), or a single bool or Status for all agents. Results for agents
    that are not ticked are ignored. For a ticked agent, the status 0 (IDLE) is an error.

    Args:
        function: The function.
        ID: The registration ID; by default the function's name in CamelCase.

    Examples:
        >>> import btcore_batch as batch
        >>> from btcore import In, Put
        >>> @batch.action
        ... def drive(x: In[batch.Floats], moved: Put[batch.Floats]):
        ...     moved(x + 0.5)
        ...     return True
        >>> xml = '''<root BTCPP_format="4"><BehaviorTree ID="Main">
        ...   <Drive x="{x}" moved="{x}"/></BehaviorTree></root>'''
        >>> swarm = batch.BatchTree.loads(xml, agents=2, leaves=[drive], blackboard={"x": [0.0, 1.0]})
        >>> _ = swarm.tick()
        >>> swarm.blackboard["x"]
        array([0.5, 1.5])
    """
    return _mark_leaf(function, SyncAction, ID)


@overload
def condition(function: F, /) -> F: ...
@overload
def condition(*, ID: str | None = None) -> Callable[[F], F]: ...
def condition(function: F | None = None, /, *, ID: str | None = None) -> F | Callable[[F], F]:
    """Declare a function as a condition for all agents at once.

    Its parameters and its result have the same forms as for `action`.

    Args:
        function: The function.
        ID: The registration ID; by default the function's name in CamelCase.

    Returns:
        The function, or a decorator if *function* is omitted.
    """
    return _mark_leaf(function, Condition, ID)


def _mark_leaf(function: F | None, base_class: type[TreeNode], id: str | None) -> F | Callable[[F], F]:
    def mark(leaf: F) -> F:
        setattr(leaf, _MARK, (base_class, id))
        return leaf

    return mark if function is None else mark(function)


def read_declarations(leaves: Any, types: TypeRegistry) -> list[LeafDeclaration]:
    """Return the declarations of *leaves*.

    Raises:
        RegistrationError: A leaf is invalid, or two leaves have the same ID.
    """
    if isinstance(leaves, Registry):
        raise RegistrationError("leaves=[…] takes the leaves of the batch; pass a Registry as nodes=…")
    if inspect.isclass(leaves) or not isinstance(leaves, Iterable):
        raise RegistrationError(f"leaves=[…] must be a list of leaves, not {leaves!r}")
    declarations: dict[str, LeafDeclaration] = {}
    for leaf in leaves:
        declaration = read_declaration(leaf, types)
        known = declarations.setdefault(declaration.id, declaration)
        if known is not declaration:
            raise RegistrationError(
                f"leaves=[…] has two leaves <{known.id}>: {known.origin} and {declaration.origin}"
            )
    return list(declarations.values())


def read_declaration(leaf: Any, types: TypeRegistry) -> LeafDeclaration:
    """Return the declaration of a function or a class. Raise RegistrationError if it is invalid."""
    if isinstance(leaf, LeafDeclaration):
        return leaf
    if inspect.isclass(leaf) and issubclass(leaf, StatefulAction):
        return _class_declaration(leaf, types)
    if inspect.isclass(leaf) or not callable(leaf):
        raise RegistrationError(
            f"{leaf!r} is not a leaf of a batch: pass a function or a class derived from batch.StatefulAction"
        )
    if hasattr(leaf, MARK):
        raise RegistrationError(
            f"{leaf.__qualname__} is a leaf for a single agent, but a batch calls leaves with arrays; mark a "
            "function that works on arrays with batch.action or batch.condition"
        )
    if inspect.isgeneratorfunction(leaf) or inspect.iscoroutinefunction(leaf):
        raise RegistrationError(
            f"{leaf.__qualname__} is a generator or an async def, which cannot be at a different position "
            "for each agent; derive a class from batch.StatefulAction"
        )
    base_class, id = getattr(leaf, _MARK, (SyncAction, None))
    parameters = function_parameters(leaf, partial(_value_type, types), {})
    ports = [parameter.port for parameter in parameters if parameter.port is not None]
    return LeafDeclaration(id or camel_case(leaf.__name__), base_class, ports, parameters, leaf)


def _class_declaration(cls: type[StatefulAction], types: TypeRegistry) -> LeafDeclaration:
    value_type_of = partial(_value_type, types)
    ports = class_ports(cls, value_type_of, {})
    for port in ports:
        setattr(cls, port.name, _column_attribute(port))
    has_init = cls.__init__ is not object.__init__
    parameters = function_parameters(cls.__init__, value_type_of, {}, skip_first=True) if has_init else []
    return LeafDeclaration(cls.__name__, OrdinaryAction, ports, parameters, cls)


def _column_attribute(port: Port) -> PortAttribute:
    """Return a port as an attribute: reading it returns the column, assigning to it writes the column."""
    name = port.name

    def read(leaf: StatefulAction) -> Any:
        if not port.reads:
            raise NodeError(f"the port '{name}' is an output; it can be assigned, but not read")
        return leaf._port(name).current()

    def write(leaf: StatefulAction, values: Any) -> None:
        if not port.writes:
            raise NodeError(f"the port '{name}' is an input; it can be read, but not assigned")
        leaf._port(name + "=")(values)

    return PortAttribute(port, read, write)


def _value_type(types: TypeRegistry, annotation: Any) -> ValueType:
    """Return the type of a single agent's value in a column that is annotated with *annotation*."""
    if isinstance(annotation, ValueType):
        return annotation
    if typing.get_origin(annotation) is Annotated:
        inner, *metadata = typing.get_args(annotation)
        declared = next((mark for mark in metadata if isinstance(mark, ValueType)), None)
        return declared or _value_type(types, inner)
    if typing.get_origin(annotation) is np.ndarray:
        dtype = typing.get_args(typing.get_args(annotation)[1])
        return _OF_DTYPE.get(dtype[0] if dtype else None, ANY)
    if typing.get_origin(annotation) is NDArray:  # from numpy 2.5 on, NDArray is not replaced by its value
        return _OF_DTYPE.get(typing.get_args(annotation)[0], ANY)
    return ANY if annotation is np.ndarray or annotation is NDArray else types.of(annotation)
