"""The types that a registry knows, and the type that belongs to a Python annotation or to a value.

Python's `int` stands for C++'s `int` of 32 bits, as in the ports of BehaviorTree.CPP: a text or an entry
beyond 32 bits fits a port `In[Int64]`, but not a port `In[int]`. If user code writes an integer to a new
entry, the type of the entry is `int` if the integer fits 32 bits, else `long` if it fits, else
`unsigned long`. When a tree is loaded whose port `In[float]` or `In[Int64]` uses such an entry, the
entry gets the type of the port.
"""

import types
from collections import ChainMap
from collections.abc import Callable, Mapping
from enum import Enum
from numbers import Integral, Real
from typing import Annotated, Any, Final, Union, get_args, get_origin

from btcore.errors import BlackboardError, ConversionError, RegistrationError
from btcore.status import NodeType, Status
from btcore.values.numbers import MAX_UINT64, MIN_INT64, whole_float, whole_int
from btcore.values.types import (
    ANY,
    BOOL,
    BUILTIN_TYPES,
    DOUBLE,
    FLOAT,
    INT,
    INT64,
    NODE_STATUS,
    NODE_TYPE,
    PORT_DIRECTION,
    STRING,
    UINT,
    UINT64,
    VECTOR_BOOL,
    VECTOR_DOUBLE,
    VECTOR_INT,
    VECTOR_STRING,
    ConvertibleType,
    EnumType,
    PortDirection,
    UserType,
    ValueType,
    VectorType,
)

Int64 = Annotated[int, INT64]
"""An annotation for integers of 64 bits."""
UInt32 = Annotated[int, UINT]
"""An annotation for C++'s `unsigned`."""
UInt64 = Annotated[int, UINT64]
"""An annotation for C++'s `uint64_t`."""
Float32 = Annotated[float, FLOAT]
"""An annotation for C++'s `float`."""

_OF_CLASS: Final[dict[object, ValueType]] = {
    bool: BOOL,
    int: INT,
    float: DOUBLE,
    str: STRING,
    Status: NODE_STATUS,
    PortDirection: PORT_DIRECTION,
    NodeType: NODE_TYPE,
    object: ANY,
    Any: ANY,
}


class TypeRegistry:
    """The types by Python annotation and by C++ name, including the user's classes and enums.

    Attributes:
        enums: The enum names that scripts and enum ports may use, with their numbers.

    Examples:
        >>> from btcore import values
        >>> types = values.TypeRegistry()
        >>> types.of(int).name, types.of(list[float]).from_text("1;2.5")
        ('int', [1.0, 2.5])
    """

    def __init__(self) -> None:
        self.enums: dict[str, int] = {}
        self._by_class: dict[object, ValueType] = dict(_OF_CLASS)
        # The names of this registry, and below them those of each installed library.
        self._by_name = ChainMap({value_type.name: value_type for value_type in BUILTIN_TYPES})

    def library_layer(self) -> "TypeRegistry":
        """Return a registry for the types of an installed library.

        Both registries share classes and enums. The types of this registry, and of earlier libraries, have
        precedence if several types have the same name.
        """
        layer = TypeRegistry()
        layer.enums, layer._by_class = self.enums, self._by_class
        self._by_name.maps += layer._by_name.maps
        return layer

    def of(self, annotation: object) -> ValueType:
        """Return the type of *annotation*.

        A class without a counterpart in BehaviorTree.CPP is a type of its own, without a text form. Its
        values are stored on the blackboard unchanged.
        """
        if isinstance(annotation, ValueType):
            return annotation
        try:
            known = self._by_class.get(annotation)
        except TypeError:  # not hashable
            known = None
        if known is not None:
            return known
        origin = get_origin(annotation)
        if origin is Annotated:
            explicit = [item for item in get_args(annotation)[1:] if isinstance(item, ValueType)]
            return explicit[0] if explicit else self.of(get_args(annotation)[0])
        if origin in (Union, types.UnionType):
            # T | None is T: None means that the entry has no value. Any other union accepts all values.
            others = [member for member in get_args(annotation) if member is not type(None)]
            return self.of(others[0]) if len(others) == 1 else ANY
        if origin is list and len(get_args(annotation)) == 1:
            item = self.of(get_args(annotation)[0])
            known = self.named(f"std::vector<{item.name}>")
            if not isinstance(known, VectorType) or known.item is not item:  # another class of this name
                known = VectorType(item)
            return self._keep(annotation, known)
        # dict[str, int] is dict, for which BehaviorTree.CPP has no type.
        if isinstance(origin, type):
            return self.of(origin)
        if not isinstance(annotation, type):
            return ANY
        if issubclass(annotation, Enum):
            return self._keep(annotation, EnumType(annotation, annotation.__qualname__, self.enums))
        return self._keep(annotation, UserType(annotation, annotation.__qualname__))

    def add(
        self,
        python_type: type,
        from_text: Callable[[str], object] | None = None,
        to_text: Callable[[Any], str] | None = None,
        name: str | None = None,
    ) -> ValueType:
        """Register a class with its text form (the conversions from and to text). Return the type.

        Args:
            python_type: The class.
            from_text: Converts a text to a value.
            to_text: Converts a value to a text.
            name: The name of the type in monitoring protocols and XML models; by default the class's name.

        Raises:
            RegistrationError: The class has a text form already, or another type has this name.
        """
        known = self._by_class.get(python_type)
        has_text = known is not None and known.has_converters and not self.is_of_library(known)
        if python_type in _OF_CLASS or (has_text and from_text is not None):
            raise RegistrationError(f"{python_type.__qualname__} has a text form already")
        name = name or python_type.__qualname__
        other = self._by_name.maps[0].get(name)
        if other is not None and other is not known:
            owner = next((cls for cls, value_type in self._by_class.items() if value_type is other), None)
            of = f", for {owner.__module__}.{owner.__qualname__}" if isinstance(owner, type) else ""
            raise RegistrationError(
                f"a type called {name} is registered already{of}; give {python_type.__module__}."
                f'{python_type.__qualname__} another name: add_type({python_type.__name__}, …, name="…")'
            )
        if isinstance(known, ConvertibleType) and known.name == name:
            # The same object, because the ports of leaves that are registered already refer to it.
            if from_text is not None or to_text is not None:
                known.set_converters(from_text, to_text)
            return known
        if issubclass(python_type, Enum):
            return self._keep(python_type, EnumType(python_type, name, self.enums, from_text, to_text))
        return self._keep(python_type, UserType(python_type, name, from_text, to_text))

    def add_enum(self, enum: type[Enum] | Mapping[str, int]) -> None:
        """Register an enum, whose names scripts and ports may then use.

        Args:
            enum: The class, or a mapping of names to numbers.

        Raises:
            RegistrationError: A name is registered with another number, or a value is not an integer.
        """
        members: dict[str, object]
        if isinstance(enum, Mapping):
            members = {**enum}
        else:
            members = {name: member.value for name, member in enum.__members__.items()}
            if enum not in self._by_class:
                self._keep(enum, EnumType(enum, enum.__qualname__, self.enums))
        numbers: dict[str, int] = {}
        for name, number in members.items():
            if not isinstance(number, int):
                raise RegistrationError(
                    f"the enum's {name} is {number!r}; BehaviorTree.CPP's enums are integers"
                )
            if self.enums.get(name, number) != number:
                raise RegistrationError(f"the enum name {name} is {self.enums[name]} already, not {number}")
            numbers[name] = int(number)
        self.enums.update(numbers)

    def named(self, cpp_name: str) -> ValueType | None:
        """Return the type with the C++ name *cpp_name*, or None."""
        return self._by_name.get(cpp_name)

    def is_of_library(self, value_type: ValueType) -> bool:
        """Return whether an installed library registered *value_type*, whose name a user may use, too."""
        name = value_type.name
        return name in self._by_name and name not in self._by_name.maps[0]

    @property
    def overridden(self) -> list[tuple[ValueType, ValueType]]:
        """Pairs of types: a type of an installed library, and the user's type that has its name."""
        own, *libraries = self._by_name.maps
        return [
            (value_type, own[name])
            for names in libraries
            for name, value_type in names.items()
            if own.get(name, value_type) is not value_type and not isinstance(value_type, VectorType)
        ]

    def _keep(self, annotation: object, value_type: ValueType) -> ValueType:
        self._by_class[annotation] = value_type
        self._by_name.maps[0].setdefault(value_type.name, value_type)
        return value_type


def type_of(value: object) -> ValueType:
    """Return the type of an entry whose first value is *value*; ANY for an empty list.

    Raises:
        BlackboardError: An integer has more than 64 bits.

    Examples:
        >>> from btcore import values
        >>> values.type_of(3).name, values.type_of("3").name
        ('int', 'std::string')
    """
    cls = type(value)
    if cls is int:
        return _integer_type(value)
    known = _OF_CLASS.get(cls)
    if known is not None:
        return known
    if cls is list:
        assert isinstance(value, list)
        if not value:
            return ANY
        for value_type in (VECTOR_INT, VECTOR_DOUBLE, VECTOR_BOOL, VECTOR_STRING):
            if value_type.accepts(value):
                return value_type
        return UserType(list, "list")
    if isinstance(value, str):
        return STRING
    if isinstance(value, Enum):
        return EnumType(value.__class__, value.__class__.__qualname__)
    if isinstance(value, int):
        return _integer_type(value)
    if isinstance(value, float):
        return DOUBLE
    return UserType(cls, cls.__qualname__)


def to_builtin_number(value: object) -> object:
    """Return *value*, converted to int or float if it is a number of another library, such as numpy.

    Examples:
        >>> import numpy as np
        >>> from btcore import values
        >>> values.to_builtin_number(np.float32(0.5))
        0.5
    """
    # Not one isinstance() with a tuple: mypyc compiles each of these calls to one comparison.
    if isinstance(value, float) or isinstance(value, str) or isinstance(value, int):  # noqa: SIM101
        return value
    if isinstance(value, (list, Enum)):
        return value
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        return float(value)
    return value


def parse_constant(text: str) -> object:
    """Return the constant that *text* stands for in format 4: an int, a float, or else the text itself.

    Examples:
        >>> from btcore import values
        >>> values.parse_constant("3"), values.parse_constant("3.5"), values.parse_constant("door")
        (3, 3.5, 'door')
    """
    number = whole_int(text)
    if number is not None:
        return number
    real = whole_float(text)
    return text if real is None else real


def to_text(value: object) -> str:
    """Return *value* as BehaviorTree.CPP's `toStr` writes it.

    Integers are written with `%d`, floats with `%f`, bools as `true` and `false`, lists as
    `json:[…]`, and enum members by name.

    Raises:
        ConversionError: The value is None, or has no text form.

    Examples:
        >>> from btcore import values
        >>> values.to_text(True), values.to_text(0.5), values.to_text([1, 2])
        ('true', '0.500000', 'json:[1,2]')
    """
    if value is None:
        raise ConversionError("None has no text form")
    return type_of(value).to_text(value)


def _integer_type(value: object) -> ValueType:
    assert isinstance(value, int)
    if INT.low <= value <= INT.high:
        return INT
    if value < MIN_INT64 or value > MAX_UINT64:
        raise BlackboardError(f"{value} can't be written: an entry holds integers of at most 64 bits")
    return INT64 if value <= INT64.high else UINT64
