"""The ports and resources that a leaf declares in its annotations.

`In[T]` is `Annotated[T, …]` and `Put[T]` is `Annotated[Callable[[T], None], …]`, so that type
checkers see the types of the values.
"""

import inspect
import typing
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING
from numbers import Number
from types import MemberDescriptorType
from typing import TYPE_CHECKING, Annotated, Any, Final, TypeAlias, TypeVar

from btcore.blackboard.ports import UNSET, Direction, Port
from btcore.engine.leaf import port_getter, port_setter
from btcore.engine.node import TreeNode
from btcore.errors import ConversionError, RegistrationError
from btcore.values import ValueType, to_text

T = TypeVar("T")

ValueTypeOf: TypeAlias = Callable[[Any], ValueType]
"""Returns the type of a port for the type in its annotation, which may be a ValueType itself."""


class PortMark:
    """A mark in an annotation, which declares a port; *put* is true for `Put[…]`."""

    def __init__(self, direction: Direction, put: bool = False) -> None:
        self.direction = direction
        self.put = put


class _Form:
    """`In`, `Out`, `InOut` and `Put` at run time, with an error message for an invalid type."""

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
                f"{self.name}[{of!r}] is not a type: write for example {self.name}[float]; a default follows "
                f"the annotation, = {of!r}"
            ) from None


if TYPE_CHECKING:
    In = Annotated[T, PortMark(Direction.IN)]
    """The annotation of an input port: `In[float]`.

    The value is the blackboard entry if the XML contains `{key}`, or else the literal, converted to the type.
    The attribute of a class returns the value whenever it is read; the parameter of a function is the value.
    A port without a default is mandatory in the XML.

    Examples:
        >>> import btcore
        >>> @btcore.condition
        ... def battery_ok(level: btcore.In[float], minimum: btcore.In[float] = 0.2) -> bool:
        ...     return level > minimum
        >>> nodes = btcore.Registry.standard()
        >>> nodes.add(battery_ok)
        >>> b = btcore.Builder(nodes)
        >>> board = btcore.Blackboard()
        >>> board["battery"] = 0.8
        >>> b.build(b.BatteryOk(level="{battery}"), blackboard=board).tick_once()
        <Status.SUCCESS: 2>
    """
    Out = Annotated[T, PortMark(Direction.OUT)]
    """The annotation of an output port of a class: `Out[float]`. Assigning it writes the blackboard entry.

    Examples:
        >>> import btcore
        >>> class Measure(btcore.SyncAction):
        ...     distance: btcore.Out[float]
        ...     def tick(self):
        ...         self.distance = 1.5
        ...         return btcore.SUCCESS
        >>> nodes = btcore.Registry.standard()
        >>> nodes.add(Measure)
        >>> b = btcore.Builder(nodes)
        >>> tree = b.build(b.Measure(distance="{ahead}"))
        >>> tree.tick_once(), tree.blackboard["ahead"]
        (<Status.SUCCESS: 2>, 1.5)
    """
    InOut = Annotated[T, PortMark(Direction.INOUT)]
    """The annotation of a port of a class that is both read and assigned: `InOut[int]`.

    Examples:
        >>> import btcore
        >>> class Count(btcore.SyncAction):
        ...     n: btcore.InOut[int]
        ...     def tick(self):
        ...         self.n += 1
        ...         return btcore.SUCCESS
        >>> nodes = btcore.Registry.standard()
        >>> nodes.add(Count)
        >>> b = btcore.Builder(nodes)
        >>> board = btcore.Blackboard()
        >>> board["rounds"] = 1
        >>> b.build(b.Count(n="{rounds}"), blackboard=board).tick_once(), board["rounds"]
        (<Status.SUCCESS: 2>, 2)
    """
    Put = Annotated[Callable[[T], None], PortMark(Direction.OUT, put=True)]
    """The annotation of an output port of a function: `Put[float]`. Calling it writes the entry.

    Examples:
        >>> import btcore
        >>> @btcore.action
        ... def measure(distance: btcore.Put[float]) -> bool:
        ...     distance(1.5)
        ...     return True
        >>> nodes = btcore.Registry.standard()
        >>> nodes.add(measure)
        >>> b = btcore.Builder(nodes)
        >>> tree = b.build(b.Measure(distance="{ahead}"))
        >>> tree.tick_once(), tree.blackboard["ahead"]
        (<Status.SUCCESS: 2>, 1.5)
    """
else:
    In = _Form("In", Annotated[T, PortMark(Direction.IN)])
    Out = _Form("Out", Annotated[T, PortMark(Direction.OUT)])
    InOut = _Form("InOut", Annotated[T, PortMark(Direction.INOUT)])
    Put = _Form("Put", Annotated[Callable[[T], None], PortMark(Direction.OUT, put=True)])

_ENGINE: Final = frozenset(
    {"btcore.engine.node", "btcore.engine.control", "btcore.engine.leaf", "btcore.engine.coroutine"}
)

_MAY_BE_HIDDEN: Final = frozenset({"blackboard", "id", "now", "path", "status", "type", "uid"})
"""The attributes of TreeNode that a port may hide. The engine, its nodes and all tools use others instead."""

_ANNOTATE: Final = "annotate a port with In[…] or Put[…], or a resource with its type"


class Parameter:
    """One parameter of a leaf, or one attribute that is a resource.

    A parameter is a *port*, or a resource of type *resource_type*. A *default* of UNSET means that it has no
    default.
    """

    def __init__(
        self,
        name: str,
        keyword: bool,
        port: Port | None,
        resource_type: Any,
        default: object,
        is_attribute: bool = False,
    ) -> None:
        self.name = name
        self.keyword = keyword
        self.port = port
        self.resource_type = resource_type
        self.default = default
        self.is_attribute = is_attribute

    @property
    def type_name(self) -> str:
        """The name of the resource's type, for messages."""
        return getattr(self.resource_type, "__name__", str(self.resource_type))

    @property
    def own_state_hint(self) -> str:
        """What messages add for an attribute, which may be the leaf's own state instead of a resource."""
        if not self.is_attribute:
            return ""
        value = f"{self.name}: {self.type_name} | None = None"
        return f"; if it is the leaf's own state, give it a value in the class, such as {value}"

    @property
    def looks_like_port(self) -> bool:
        """Whether the resource has the type of a plain value, so that a port was probably meant."""
        return self.port is None and self.resource_type in (int, float, str, bool)


def _port_from_annotation(
    name: str, annotation: object, value_type_of: ValueTypeOf, default: object
) -> Port | None:
    """Return the port that *annotation* declares, or None if it does not declare a port.

    Args:
        annotation: The annotation of an attribute or a parameter.
        value_type_of: Returns the ValueType for the type in In[…].
        default: The default value; UNSET = the port is mandatory.
    """
    inner, *marks = _type_and_marks(annotation)
    mark = _port_mark(marks)
    if mark is None:
        return None
    annotated_type = next((item for item in marks if isinstance(item, ValueType)), inner)
    if mark.put:
        annotated_type = typing.get_args(inner)[0][0]
    description = next((item for item in marks if isinstance(item, str)), "")
    value = UNSET if isinstance(default, str) else default
    text = _default_text(default)
    return Port(name, mark.direction, value_type_of(annotated_type), text, description, value)


def _default_text(default: object) -> str | None:
    if default is UNSET:
        return None
    if default is None or isinstance(default, str):
        return default or ""
    try:
        return to_text(default)
    except ConversionError:
        return repr(default)


def _check_parameter_writable(name: str, function_name: str, annotation: object) -> None:
    """Check that a parameter is not annotated with Out or InOut, which work for attributes only."""
    mark = _port_mark(_type_and_marks(annotation))
    if mark is not None and mark.direction is not Direction.IN and not mark.put:
        raise RegistrationError(
            f"parameter '{name}' of {function_name} can't be assigned: annotate an output with Put[…], which "
            "is called with the value to write, and an input with In[…]"
        )


def _type_and_marks(annotation: object) -> tuple[Any, ...]:
    """Return the type and the marks of *annotation*; In without a type means In[Any]."""
    if isinstance(annotation, _Form):
        annotation = annotation[Any]
    return typing.get_args(annotation) if typing.get_origin(annotation) is Annotated else (annotation,)


def _port_mark(marks: Iterable[object]) -> PortMark | None:
    return next((mark for mark in marks if isinstance(mark, PortMark)), None)


def function_parameters(
    function: Callable[..., object],
    value_type_of: ValueTypeOf,
    names: Mapping[str, Any],
    skip_first: bool = False,
) -> list[Parameter]:
    """Return the parameters of *function*, ports and resources, in order.

    Args:
        function: The function or `__init__` method.
        value_type_of: Returns the ValueType for the type in In[…].
        names: Local names, for resolving annotations that are strings.
        skip_first: Whether to leave out the first parameter, `self`.
    """
    function_name = getattr(function, "__qualname__", repr(function))
    hints = _resolve(function, function_name, names)
    parameters = []
    for parameter in list(inspect.signature(function).parameters.values())[1 if skip_first else 0 :]:
        if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
            raise RegistrationError(
                f"{function_name} has the variadic parameter *{parameter.name}, for which a tree has no "
                "arguments; name its parameters"
            )
        if parameter.name not in hints:
            raise RegistrationError(
                f"parameter '{parameter.name}' of {function_name} has no annotation: "
                + ((skip_first and name_or_config_hint(parameter.name)) or _ANNOTATE)
            )
        annotation = hints[parameter.name]
        default = UNSET if parameter.default is parameter.empty else parameter.default
        if skip_first and hides_attribute(parameter.name, default):  # a dataclass takes it for the default
            default = UNSET
        port = _port_from_annotation(parameter.name, annotation, value_type_of, default)
        if not skip_first:  # a dataclass sets its ports in __init__
            _check_parameter_writable(parameter.name, function_name, annotation)
        keyword = parameter.kind is parameter.KEYWORD_ONLY
        parameters.append(Parameter(parameter.name, keyword, port, annotation, default))
    return parameters


def name_or_config_hint(name: str) -> str:
    """Return a hint for a parameter of `__init__` that BehaviorTree.CPP or py_trees requires, or ""."""
    if name not in ("name", "config"):
        return ""
    return (
        "remove 'name' and 'config', also from super().__init__(): a node has self.name and self.config "
        "before __init__ is called"
    )


def class_ports(cls: type, value_type_of: ValueTypeOf, names: Mapping[str, Any]) -> list[Port]:
    """Return the ports of a node class, inherited ports first.

    Args:
        value_type_of: Returns the ValueType for the type in In[…].
        names: Local names, for resolving annotations that are strings.
    """
    listed: dict[str, Port] = {}
    provided = getattr(cls, "provided_ports", None)
    if provided is not None:
        for port in provided():
            listed[port.name] = port
    for name, annotation in class_annotations(cls, names).items():
        port = _port_from_annotation(name, annotation, value_type_of, _default_in(cls, name))
        if port is not None:
            _check_not_hidden(cls, name)
            if name in listed:  # also in provided_ports()
                port.description = port.description or listed[name].description
                port.role, port.optional = listed[name].role, listed[name].optional
            listed[name] = port
    return list(listed.values())


def class_annotations(cls: type, names: Mapping[str, Any]) -> dict[str, Any]:
    """Return the annotations of a class and its base classes, by the names of the attributes.

    Args:
        names: Local names, for resolving annotations that are strings.
    """
    return _resolve(cls, cls.__qualname__, names)


def _default_in(cls: type, name: str) -> object:
    attribute = getattr(cls, name, UNSET)
    if hides_attribute(name, attribute):
        return UNSET
    if isinstance(attribute, PortAttribute):
        return attribute.default
    if isinstance(attribute, MemberDescriptorType):  # a slot: a dataclass keeps the default in its fields
        field = getattr(cls, "__dataclass_fields__", {}).get(name)
        return UNSET if field is None or field.default is MISSING else field.default
    return attribute


def hides_attribute(name: str, value: object) -> bool:
    """Return whether *value*, found in a class, is an attribute of TreeNode that *name* may hide."""
    return name in _MAY_BE_HIDDEN and value is getattr(TreeNode, name)


def _check_not_hidden(cls: type, name: str) -> None:
    for parent in cls.__mro__:
        if parent is TreeNode and name in _MAY_BE_HIDDEN:
            continue
        if parent.__module__ in _ENGINE and (name in vars(parent) or name in inspect.get_annotations(parent)):
            raise RegistrationError(
                f"port '{name}' of {cls.__qualname__} would hide the attribute '{name}' of "
                f"{parent.__name__}: list it in provided_ports(), and call get_input('{name}') or "
                f"set_output('{name}', …)"
            )


def bind_class(cls: type, ports: list[Port]) -> None:
    """Make the annotated ports of *cls* attributes that read and write the blackboard."""
    annotated = {name for parent in cls.__mro__ for name in inspect.get_annotations(parent)}
    for port in ports:
        known = getattr(cls, port.name, None)
        if port.name in annotated and not (isinstance(known, PortAttribute) and known.is_of(port)):
            setattr(cls, port.name, PortAttribute(port, port_getter(port), port_setter(port)))


class PortAttribute(property):
    """A port as an attribute: reading it reads the blackboard, assigning it writes the blackboard."""

    def __init__(self, port: Port, getter: Callable[[Any], Any], setter: Callable[[Any, Any], None]) -> None:
        self.default = UNSET if port.default is None else port.default
        if port.default_value is not UNSET:
            self.default = port.default_value

        super().__init__(getter, setter, doc=port.description)
        self.direction = port.direction

    def is_of(self, port: Port) -> bool:
        """Return whether *port* has the same direction. A subclass with *port* can then keep the property."""
        return self.direction is port.direction


def _resolve(owner: Any, name: str, names: Mapping[str, Any]) -> dict[str, Any]:
    try:
        return typing.get_type_hints(owner, localns=dict(names), include_extras=True)
    except NameError as unknown:
        raise RegistrationError(
            f"{name} is annotated with '{unknown.name}', which can't be found: define or import it "
            "where the leaf is defined (not under TYPE_CHECKING)"
        ) from unknown
    except TypeError as error:
        raise RegistrationError(f"the annotations of {name} can't be read: {error}") from error
