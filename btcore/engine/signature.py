"""Reads what a leaf declares in its annotations: ports and resources.

``In[T]`` is ``Annotated[T, …]`` and ``Put[T]`` is ``Annotated[Callable[[T], None], …]``, so that a
type checker sees the true types.
"""

import inspect
import typing
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING
from numbers import Number
from types import MemberDescriptorType
from typing import TYPE_CHECKING, Annotated, Any, Final, TypeVar

from btcore.blackboard.ports import UNSET, Direction, Port
from btcore.engine.port_attributes import port_getter, port_setter
from btcore.errors import ConversionError, RegistrationError
from btcore.values import TypeRegistry, ValueType, to_text

T = TypeVar("T")


class PortMark:
    """Marks an annotation as a port."""

    def __init__(self, direction: Direction, put: bool = False) -> None:
        self.direction = direction
        self.put = put


class _Form:
    """``In`` and the like at run time, with a sentence for what is no type."""

    def __init__(self, name: str, annotated: Any) -> None:
        self.name = name
        self.annotated = annotated

    def __getitem__(self, of: Any) -> Any:
        try:
            if isinstance(of, (Number, bytes, tuple, list, dict, set)):
                raise TypeError
            return self.annotated[of]
        except (TypeError, AttributeError):
            raise TypeError(
                f"{self.name}[{of!r}] names no type: write {self.name}[float], say; a default stands behind "
                f"it, = {of!r}"
            ) from None


if TYPE_CHECKING:
    In = Annotated[T, PortMark(Direction.IN)]
    """An input port: reading it reads the blackboard, or what the XML says."""
    Out = Annotated[T, PortMark(Direction.OUT)]
    """An output port of a class: assigning it writes the blackboard."""
    InOut = Annotated[T, PortMark(Direction.INOUT)]
    """A port that is read and written."""
    Put = Annotated[Callable[[T], None], PortMark(Direction.OUT, put=True)]
    """An output port of a function: a callable that writes the blackboard."""
else:
    In = _Form("In", Annotated[T, PortMark(Direction.IN)])
    Out = _Form("Out", Annotated[T, PortMark(Direction.OUT)])
    InOut = _Form("InOut", Annotated[T, PortMark(Direction.INOUT)])
    Put = _Form("Put", Annotated[Callable[[T], None], PortMark(Direction.OUT, put=True)])

_ENGINE: Final = frozenset(
    {"btcore.engine.node", "btcore.engine.control", "btcore.engine.leaf", "btcore.engine.coroutine"}
)


class Parameter:
    """One parameter of a leaf: a *port*, or a resource of type *wanted*; *default* may be UNSET."""

    def __init__(self, name: str, keyword: bool, port: Port | None, wanted: object, default: object) -> None:
        self.name = name
        self.keyword = keyword
        self.port = port
        self.resource_type = wanted
        self.default = default

    @property
    def type_name(self) -> str:
        """The type as people say it."""
        return getattr(self.resource_type, "__name__", str(self.resource_type))

    @property
    def looks_like_port(self) -> bool:
        """Whether it is a resource of a type that values have, and was probably meant as a port."""
        return self.port is None and self.resource_type in (int, float, str, bool)


def port_from_annotation(
    name: str, annotation: object, kind_of: Callable[[Any], ValueType], default: object = UNSET
) -> Port | None:
    """The port that *annotation* declares, or None if it isn't one.

    *kind_of* gives the type of values for what stands in In[…] and the like: a type, or a ValueType.
    """
    inner, *marks = _taken_apart(annotation)
    mark = _mark_in(marks)
    if mark is None:
        return None
    held = next((one for one in marks if isinstance(one, ValueType)), inner)
    if mark.put:
        held = typing.get_args(inner)[0][0]
    description = next((one for one in marks if isinstance(one, str)), "")
    text = None
    if default is not UNSET:
        text = _text_of(default)
    value = UNSET if isinstance(default, str) else default
    return Port(name, mark.direction, kind_of(held), text, description, value)


def check_parameter_writable(name: str, called: str, annotation: object) -> None:
    """Raise RegistrationError for a port that the parameter *name* of the function *called* can't write."""
    mark = _mark_in(_taken_apart(annotation))
    if mark is not None and mark.direction is not Direction.IN and not mark.put:
        raise RegistrationError(
            f"parameter '{name}' of {called} can't be assigned: mark it Put[…], which is called with what it "
            "writes, and what it reads In[…]"
        )


def _taken_apart(annotation: object) -> tuple[Any, ...]:
    """The type and the marks of *annotation*; In alone is In[Any]."""
    if isinstance(annotation, _Form):
        annotation = annotation[Any]
    return typing.get_args(annotation) if typing.get_origin(annotation) is Annotated else (annotation,)


def _mark_in(marks: Iterable[object]) -> PortMark | None:
    return next((one for one in marks if isinstance(one, PortMark)), None)


def _text_of(default: object) -> str:
    if default is None or isinstance(default, str):
        return default or ""
    try:
        return to_text(default)
    except ConversionError:
        return repr(default)


def function_parameters(
    function: Callable[..., object], types: TypeRegistry, names: Mapping[str, Any], skip_first: bool = False
) -> list[Parameter]:
    """The parameters of *function*, ports and resources, in order.

    *names* helps to resolve annotations that are texts. Raises RegistrationError.
    """
    called = getattr(function, "__qualname__", repr(function))
    hints = _resolve(function, called, names)
    found = []
    for parameter in list(inspect.signature(function).parameters.values())[1 if skip_first else 0 :]:
        if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
            raise RegistrationError(
                f"{called} takes *{parameter.name}, which nothing in a tree can fill; name its parameters"
            )
        if parameter.name not in hints:
            raise RegistrationError(
                f"parameter '{parameter.name}' of {called} has no annotation: "
                "mark a port with In[…] or Put[…], or name the type of the resource it wants"
            )
        annotation = hints[parameter.name]
        default = UNSET if parameter.default is parameter.empty else parameter.default
        port = port_from_annotation(parameter.name, annotation, types.of, default)
        if not skip_first:  # a dataclass sets its ports in __init__
            check_parameter_writable(parameter.name, called, annotation)
        keyword = parameter.kind is parameter.KEYWORD_ONLY
        found.append(Parameter(parameter.name, keyword, port, annotation, default))
    return found


def class_ports(cls: type, types: TypeRegistry, names: Mapping[str, Any]) -> list[Port]:
    """The ports of a leaf class, inherited ones first. Raises RegistrationError."""
    listed: dict[str, Port] = {}
    provided = getattr(cls, "provided_ports", None)
    if provided is not None:
        for port in provided():
            listed[port.name] = port
    for name, annotation in _resolve(cls, cls.__qualname__, names).items():
        port = port_from_annotation(name, annotation, types.of, _default_in(cls, name))
        if port is not None:
            _refuse_hiding(cls, name)
            listed[name] = port
    return list(listed.values())


def _default_in(cls: type, name: str) -> object:
    found = getattr(cls, name, UNSET)
    if isinstance(found, PortAttribute):
        return found.default
    if isinstance(found, MemberDescriptorType):  # a slot; a dataclass keeps the default elsewhere
        field = getattr(cls, "__dataclass_fields__", {}).get(name)
        return UNSET if field is None or field.default is MISSING else field.default
    return found


def _refuse_hiding(cls: type, name: str) -> None:
    for parent in cls.__mro__:
        if parent.__module__ in _ENGINE and (name in vars(parent) or name in inspect.get_annotations(parent)):
            raise RegistrationError(
                f"port '{name}' of {cls.__qualname__} would hide what {parent.__name__} has under that name: "
                f"list it in provided_ports(), and call get_input('{name}') or set_output('{name}', …)"
            )


def bind_class(cls: type, ports: list[Port]) -> None:
    """Make the annotated ports of *cls* attributes that read and write the blackboard."""
    annotated: set[str] = set()
    for parent in cls.__mro__:
        annotated |= set(inspect.get_annotations(parent))
    for port in ports:
        known = getattr(cls, port.name, None)
        if port.name in annotated and not (isinstance(known, PortAttribute) and known.is_of(port)):
            setattr(cls, port.name, PortAttribute(port))


class PortAttribute(property):
    """A port as an attribute: reading reads the blackboard, assigning writes it."""

    def __init__(self, port: Port) -> None:
        self.default = UNSET if port.default is None else port.default
        if port.value is not UNSET:
            self.default = port.value

        super().__init__(port_getter(port), port_setter(port), doc=port.description)
        self.direction = port.direction

    def is_of(self, port: Port) -> bool:
        """Whether it goes the way that *port* does, and so serves a subclass that declares that port."""
        return self.direction is port.direction


def _resolve(thing: Any, called: str, names: Mapping[str, Any]) -> dict[str, Any]:
    try:
        return typing.get_type_hints(thing, localns=dict(names), include_extras=True)
    except NameError as unknown:
        raise RegistrationError(
            f"{called} is annotated with '{unknown.name}', which can't be found: define or import it "
            "where the leaf is defined (not under TYPE_CHECKING)"
        ) from unknown
    except TypeError as fault:
        raise RegistrationError(f"the annotations of {called} can't be read: {fault}") from fault
