"""Leaves of a batch as their authors write them: a function, or a class, for all agents at once.

Ports are declared as in the ordinary engine, with the arrays that they hold: ``In[Floats]`` is a column of
doubles, ``Put[Floats]`` a callable that takes one.
"""

import inspect
import typing
from collections.abc import Callable, Iterable, Sequence
from typing import Annotated, Any, ClassVar, Final, TypeAlias, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from btcore.batch.agent_sets import Mask
from btcore.blackboard.ports import UNSET, Port
from btcore.engine.functions import MARK, camel_case
from btcore.engine.leaf import Condition, SyncAction
from btcore.engine.leaf import StatefulAction as OrdinaryAction
from btcore.engine.node import TreeNode
from btcore.engine.signature import check_parameter_writable, port_from_annotation
from btcore.errors import NodeError, RegistrationError
from btcore.registry.registry import Registry
from btcore.status import Status
from btcore.values import ANY, BOOL, DOUBLE, FLOAT, INT, INT64, TypeRegistry, ValueType

F = TypeVar("F", bound=Callable[..., object])

Floats: TypeAlias = NDArray[np.float64]
"""A column of C++'s doubles."""
Ints: TypeAlias = NDArray[np.int64]
"""A column of integers of 64 bits."""
Bools: TypeAlias = NDArray[np.bool_]
"""A column of bools."""
Texts: TypeAlias = NDArray[np.object_]
"""A column of texts, or of any other objects."""
Rows: TypeAlias = Annotated[NDArray[np.float64], ANY]
"""A column with a row of numbers for each agent, of shape (agents, …)."""
Statuses: TypeAlias = NDArray[np.uint8]
"""One status for each agent, numbered as Status is."""

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
    """Asked for as a parameter's type, it is the name of the node."""


class LeafParameter:
    """One parameter of a leaf: its *port*, or else the type *wanted*; *default* may be UNSET."""

    def __init__(self, name: str, port: Port | None, wanted: Any, default: object, keyword: bool) -> None:
        self.name = name
        self.port = port
        self.annotation = wanted
        self.default = default
        self.keyword = keyword


class LeafDeclaration:
    """A leaf that a tree of a batch may have.

    *function* is what it calls, or *cls* the class of which each node gets an instance; *plan* is the kind
    of ordinary leaf that stands for it while the tree is made.
    """

    def __init__(
        self,
        id: str,
        plan: type[TreeNode],
        ports: Sequence[Port],
        wishes: Sequence[LeafParameter],
        function: Callable[..., Any] | None,
        cls: "type[StatefulAction] | None",
    ) -> None:
        self.id = id
        self.base_class = plan
        self.ports = list(ports)
        self.parameters = list(wishes)
        self.function = function
        self.cls = cls

    def stand_in(self) -> type[TreeNode]:
        """An ordinary leaf class with the same ports."""
        ports = self.ports

        def tick(_: TreeNode, *__: object) -> Status:
            raise RegistrationError(f"<{self.id}> is a leaf of a batch; BatchTree runs it")

        made: dict[str, Any] = {"provided_ports": staticmethod(lambda: list(ports)), "tick": tick}
        made |= {"on_start": tick, "on_running": tick, "__module__": self._author.__module__}
        made["__doc__"] = self._author.__doc__
        return type(self.id, (self.base_class,), made)

    @property
    def origin(self) -> str:
        """``module.name`` of what was given."""
        return f"{self._author.__module__}.{self._author.__qualname__}"

    @property
    def _author(self) -> Any:
        return self.function if self.function is not None else self.cls


class StatefulAction:
    """An action that lasts several ticks, for all agents at once.

    Ports are annotated attributes: reading one gives the column, assigning one writes it for the agents who
    are meant just now. Each method is given their *mask*, and is not called when there are none. What an
    ``__init__`` asks for is handed in by type.
    """

    ports: ClassVar[dict[str, Port]] = {}
    _port: Callable[[str], Any]
    name: str
    """The name of the node."""
    agents: int
    """How many agents there are."""
    now: Callable[[], int]
    """The time (ns) of the batch's clock."""

    def on_start(self, mask: Mask) -> object:
        """Begin, for those who are IDLE. Returns what :func:`action` describes."""
        raise NotImplementedError(f"{type(self).__qualname__} has no on_start()")

    def on_running(self, mask: Mask) -> object:
        """Go on, for those who are RUNNING."""
        raise NotImplementedError(f"{type(self).__qualname__} has no on_running()")

    def on_halted(self, mask: Mask) -> None:
        """Clean up, for those who were halted while RUNNING."""


@overload
def action(function: F, /) -> F: ...
@overload
def action(*, ID: str | None = None) -> Callable[[F], F]: ...
def action(function: F | None = None, /, *, ID: str | None = None) -> F | Callable[[F], F]:
    """Make a function an action for all agents at once, that ends within the tick.

    Its tag is its name in CamelCase, or *ID*. A parameter marked In or Put is a port; one of type Mask gets
    the mask of those who are ticked, one of type Indices their numbers; any other is a resource. It returns
    an array of bools (True is SUCCESS) or of statuses (uint8), of shape (agents,), in which those who are not
    ticked don't count; or one bool or Status for all. For whom the status is 0 (IDLE) the leaf has raised.
    """
    return _marked(function, SyncAction, ID)


@overload
def condition(function: F, /) -> F: ...
@overload
def condition(*, ID: str | None = None) -> Callable[[F], F]: ...
def condition(function: F | None = None, /, *, ID: str | None = None) -> F | Callable[[F], F]:
    """Make a function a condition for all agents at once; see :func:`action`."""
    return _marked(function, Condition, ID)


def _marked(function: F | None, plan: type[TreeNode], ID: str | None) -> F | Callable[[F], F]:
    def note(marked: F) -> F:
        setattr(marked, _MARK, (plan, ID))
        return marked

    return note if function is None else note(function)


def read_declarations(things: Any, types: TypeRegistry) -> list[LeafDeclaration]:
    """What each of *things* declares. Raises RegistrationError, also for two of one ID."""
    if isinstance(things, Registry):
        raise RegistrationError("leaves=[…] are the leaves of the batch; a Registry is given as nodes=…")
    if inspect.isclass(things) or not isinstance(things, Iterable):
        raise RegistrationError(f"leaves=[…] is a list of leaves, not {things!r}")
    found: dict[str, LeafDeclaration] = {}
    for thing in things:
        leaf = read_declaration(thing, types)
        known = found.setdefault(leaf.id, leaf)
        if known is not leaf:
            raise RegistrationError(
                f"leaves=[…] has two leaves <{leaf.id}>: {known.origin} and {leaf.origin}"
            )
    return list(found.values())


def read_declaration(thing: Any, types: TypeRegistry) -> LeafDeclaration:
    """What *thing*, a function or a class, declares. Raises RegistrationError."""
    if isinstance(thing, LeafDeclaration):
        return thing
    if inspect.isclass(thing) and issubclass(thing, StatefulAction):
        return _class_leaf(thing, types)
    if inspect.isclass(thing) or not callable(thing):
        raise RegistrationError(
            f"{thing!r} is no leaf of a batch: give a function, or a class derived from batch.StatefulAction"
        )
    if hasattr(thing, MARK):
        raise RegistrationError(
            f"{thing.__qualname__} is a leaf for one agent: a batch gives it arrays; mark one that works on "
            "arrays with batch.action or batch.condition"
        )
    if inspect.isgeneratorfunction(thing) or inspect.iscoroutinefunction(thing):
        raise RegistrationError(
            f"{thing.__qualname__} would last for each agent in its own way: a batch runs no generator and "
            "no async def; derive a class from batch.StatefulAction"
        )
    plan, ID = getattr(thing, _MARK, (SyncAction, None))
    wishes = _wishes(thing, types)
    ports = [one.port for one in wishes if one.port is not None]
    return LeafDeclaration(ID or camel_case(thing.__name__), plan, ports, wishes, thing, None)


def _class_leaf(cls: type[StatefulAction], types: TypeRegistry) -> LeafDeclaration:
    ports = []
    for name, annotation in _hints(cls).items():
        default = inspect.getattr_static(cls, name, UNSET)
        port = default.port if isinstance(default, PortAttribute) else _port(name, annotation, types, default)
        if port is not None:
            ports.append(port)
            setattr(cls, name, PortAttribute(port))
    own_init = cls.__init__ is not object.__init__
    wishes = _wishes(cls.__init__, types, skip_first=True) if own_init else []
    return LeafDeclaration(cls.__name__, OrdinaryAction, ports, wishes, None, cls)


class PortAttribute(property):
    """A port as an attribute: reading gives the column, assigning writes it."""

    def __init__(self, port: Port) -> None:
        self.port = port
        name = port.name

        def read(leaf: StatefulAction) -> Any:
            if not port.reads:
                raise NodeError(f"the port '{name}' is an output: it can be assigned, not read")
            return leaf._port(name).current()

        def write(leaf: StatefulAction, values: Any) -> None:
            if not port.writes:
                raise NodeError(f"the port '{name}' is an input: it can be read, not assigned")
            leaf._port(name + "=")(values)

        super().__init__(read, write, doc=port.description)


def _hints(thing: Any) -> dict[str, Any]:
    try:
        return typing.get_type_hints(thing, include_extras=True)
    except (NameError, TypeError) as fault:
        raise RegistrationError(f"the annotations of {thing.__qualname__} can't be read: {fault}") from fault


def _wishes(
    function: Callable[..., Any], types: TypeRegistry, skip_first: bool = False
) -> list[LeafParameter]:
    hints = _hints(function)
    found = []
    for one in list(inspect.signature(function).parameters.values())[skip_first:]:
        if one.name not in hints or one.kind in (one.VAR_POSITIONAL, one.VAR_KEYWORD):
            raise RegistrationError(
                f"parameter '{one.name}' of {function.__qualname__} has no annotation that tells what it is: "
                "In[Floats], Put[Floats], Mask, or the type of a resource"
            )
        default = UNSET if one.default is one.empty else one.default
        port = _port(one.name, hints[one.name], types, default)
        check_parameter_writable(one.name, function.__qualname__, hints[one.name])
        found.append(LeafParameter(one.name, port, hints[one.name], default, one.kind is one.KEYWORD_ONLY))
    return found


def _port(name: str, annotation: Any, types: TypeRegistry, default: object) -> Port | None:
    """The port that *annotation* declares, or None if it isn't one."""
    return port_from_annotation(name, annotation, lambda column: _kind(column, types), default)


def _kind(annotation: Any, types: TypeRegistry) -> ValueType:
    """The type of one agent's value in what *annotation* says of the column."""
    if isinstance(annotation, ValueType):
        return annotation
    if typing.get_origin(annotation) is Annotated:
        inner, *marks = typing.get_args(annotation)
        return next((one for one in marks if isinstance(one, ValueType)), None) or _kind(inner, types)
    if typing.get_origin(annotation) is np.ndarray:
        dtype = typing.get_args(typing.get_args(annotation)[1])
        return _OF_DTYPE.get(dtype[0] if dtype else None, ANY)
    return ANY if annotation is np.ndarray else types.of(annotation)
