"""Conversion between messages and values: dictionaries, lists, numbers and texts, as in JSON.

The rules for a value by the type of its field:

- **Messages:** a dictionary of fields, or a message of this type. Missing fields keep their defaults.
- **Numbers:** a number in the range of the type. An integer field also takes the name of a constant of its
  message, and a real field the texts `nan`, `inf` and `-inf`.
- **Booleans:** `true` or `false`, or the numbers 1 and 0.
- **Times and durations** (`builtin_interfaces`): a dictionary, or a number of seconds. A time also takes the
  text `now`, which is the time when the message is created.
- **Arrays:** a list. Arrays of numbers also take a numpy array, and arrays of bytes take `bytes`.
"""

import array
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from itertools import islice
from typing import Any, Final, NamedTuple

from btcore import ConversionError
from btcore.json_text import MAX_DEPTH, too_deep_at
from btcore.suggestions import did_you_mean, join_names
from btcore.values import number_of
from btcore.values.known_types import to_builtin_number
from btcore_ros2.errors import RosError
from btcore_ros2.interfaces import interface_name

__all__ = ["FieldProblem", "MessageValueError", "from_message", "read_field", "to_message"]

PREFIX: Final = "json:"
"""The beginning of a text that is a value in JSON, as in BehaviorTree.CPP."""

MAX_TEXT: Final = 4_000_000
"""The maximum number of characters of a text in JSON."""

MAX_ITEMS: Final = 100_000_000
"""The maximum number of items of an array."""

MAX_PROBLEMS: Final = 20
"""The maximum number of problems that are reported for a value."""

_CODES: Final = {
    "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "int64": "q",
    "uint64": "Q", "float": "f", "double": "d",
}  # fmt: skip
_SHORT_NAMES: Final = {"boolean": "bool", "octet": "byte", "float": "float32", "double": "float64"}
_REALS: Final = ("float", "double")
_MAX_FLOAT32: Final = 3.4028235677973366e38  # larger numbers are rounded to infinity
_NS: Final = 1_000_000_000
_TIMES: Final = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
_ZEROS: Final = {"string": "", "wstring": "", "boolean": False, "octet": b"\0", "float": 0.0, "double": 0.0}


class FieldProblem(NamedTuple):
    """A part of a value that does not fit the definition of its message.

    Attributes:
        path: The names of fields and the indices of items that lead to the part.
        message: What is wrong.
        hint: How to correct the problem, or "".
        is_name: Whether the problem is the name at the end of *path*, and not the value.
    """

    path: tuple[str | int, ...]
    message: str
    hint: str = ""
    is_name: bool = False

    @property
    def text(self) -> str:
        """The path, the message and the hint in a line."""
        place = path_text(self.path)
        return (f"{place}: " if place else "") + self.message + (f"; {self.hint}" if self.hint else "")


class MessageValueError(RosError):
    """Raised when a value does not fit the definition of a message.

    Args:
        problems: The problems, at most `MAX_PROBLEMS`.
        name: The name of the value, with which the places of the problems begin; may be "".
    """

    def __init__(self, problems: Sequence[FieldProblem], name: str) -> None:
        named = [
            problem._replace(path=(name, *problem.path) if name else problem.path) for problem in problems
        ]
        super().__init__("\n".join(problem.text for problem in named))
        self.problems = tuple(problems)


@dataclass(frozen=True, slots=True)
class FieldType:
    """The type of a field.

    Attributes:
        name: The name as in a `.msg` file, for example `float64`, `geometry_msgs/Pose` or `string<=20[]`.
        basic: The name of a basic type in IDL, `string` or `wstring`; "" for other types.
        max_length: The maximum length of a string; None = no limit.
        message: The class of a message; None for other types.
        item: The type of the items of an array; None for other types.
        size: The number of items of an array of fixed size; None for other types.
        max_items: The maximum number of items of an array; None = no limit.
    """

    name: str
    basic: str = ""
    max_length: int | None = None
    message: Any = None
    item: "FieldType | None" = None
    size: int | None = None
    max_items: int | None = None


@lru_cache(maxsize=1000)
def message_fields(message_type: Any) -> Mapping[str, FieldType]:
    """Return the types of the fields of a message class, by name."""
    names = message_type.get_fields_and_field_types()
    return {name: _field_type(slot) for name, slot in zip(names, message_type.SLOT_TYPES, strict=True)}


def _field_type(slot: Any) -> FieldType:
    """Return the type that *slot*, an object of rosidl_parser.definition, describes."""
    class_name = type(slot).__name__  # instead of the classes, which cannot be imported without ROS
    if class_name == "BasicType":
        return FieldType(_SHORT_NAMES.get(slot.typename, slot.typename), slot.typename)
    if class_name.endswith("String"):
        basic = "wstring" if "W" in class_name else "string"
        limit = getattr(slot, "maximum_size", None)
        return FieldType(basic if limit is None else f"{basic}<={limit}", basic, max_length=limit)
    if class_name == "NamespacedType":
        message = getattr(import_module(".".join(slot.namespaces)), slot.name)
        return FieldType(f"{slot.namespaces[0]}/{slot.name}", message=message)
    item = _field_type(slot.value_type)
    if class_name == "Array":
        return FieldType(f"{item.name}[{slot.size}]", item=item, size=slot.size)
    limit = getattr(slot, "maximum_size", None)
    name = f"{item.name}[]" if limit is None else f"{item.name}[<={limit}]"
    return FieldType(name, item=item, max_items=limit)


@lru_cache(maxsize=1000)
def message_constants(message_type: Any) -> Mapping[str, object]:
    """Return the constants of a message class, by name."""
    return {
        name: getattr(message_type, name)
        for name, value in vars(type(message_type)).items()
        # A property NAME__DEFAULT is the default of a field.
        if isinstance(value, property) and not name.endswith("__DEFAULT")
    }


def path_text(path: Sequence[str | int]) -> str:
    """Return *path* as text.

    Examples:
        >>> from btcore_ros2.message_values import path_text
        >>> path_text(["path", "poses", 2, "header"])
        'path.poses[2].header'
    """
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


class MissingItemError(RosError):
    """Raised when a list does not have the item that a path names."""


class JsonTextError(ConversionError):
    """Raised when a text is not JSON.

    Attributes:
        at: The index of the first invalid character in the text, or -1.
    """

    def __init__(self, message: str, at: int = -1) -> None:
        super().__init__(message)
        self.at = at


def parse_json(text: str) -> object:
    """Return the value of a text `json:…`.

    Raises:
        JsonTextError: The text does not begin with `json:`, is not JSON, or is too long.
    """
    if not text.startswith(PREFIX):
        raise JsonTextError(f"'{text[:60]}' is not a message: write json:{{…}}, or the entry in braces")
    if len(text) > MAX_TEXT:
        raise JsonTextError(f"the text has {len(text):,} characters; the maximum is {MAX_TEXT:,}")
    body = text[len(PREFIX) :]
    if too_deep_at(body) is not None:
        raise JsonTextError(f"the JSON is nested more than {MAX_DEPTH} levels deep")
    try:
        return json.loads(body, parse_constant=_refuse, parse_float=_finite)
    except json.JSONDecodeError as error:
        raise JsonTextError(f"not JSON: {error.msg}", len(PREFIX) + error.pos) from None
    except ValueError as error:
        raise JsonTextError(f"not JSON: {str(error)[:60]}") from None


def _refuse(constant: str) -> object:
    raise ValueError(f'{constant} is not a number in JSON; write "{constant.lower().replace("inity", "")}"')


def _finite(text: str) -> float:
    number = float(text)
    if math.isinf(number):
        raise ValueError(f"{text[:20]} is too large")
    return number


def referenced_key(value: object) -> str | None:
    """Return the blackboard key if *value* is a text `{key}`, else None.

    Examples:
        >>> from btcore_ros2.message_values import referenced_key
        >>> referenced_key("{target}"), referenced_key("target")
        ('target', None)
    """
    if isinstance(value, str) and len(value) > 2 and value[0] == "{" and value[-1] == "}":
        key = value[1:-1]
        return key if "{" not in key and "}" not in key else None
    return None


def find_problems(message_type: Any, value: object) -> list[FieldProblem]:
    """Return the parts of *value* that do not fit *message_type*.

    A text `{key}` stands for a blackboard entry, whose value is unknown: it fits every field.
    """
    reader = _Reader(lambda key: _UNKNOWN)
    reader.message(message_type, value, ())
    return reader.problems


def to_message(
    message_type: Any,
    value: object,
    *,
    name: str = "",
    resolve: Callable[[str], object] | None = None,
    now: Callable[[], Any] | None = None,
) -> Any:
    """Return a message with the content of *value*; the docstring of this module has the rules.

    Args:
        message_type: The class of the message.
        value: A dictionary of fields, a text `json:{…}`, or a message of this class, which is returned.
        name: What the message is, as the first part of paths in errors, for example "goal".
        resolve: Returns the value of a blackboard entry. If it is given, a text `{key}` in *value* stands for
            the value of the entry.
        now: Returns the current time as a `builtin_interfaces/Time`, for the text `now`.

    Raises:
        ConversionError: A text is not JSON.
        MessageValueError: The value does not fit the definition of the message.
    """
    reader = _Reader(resolve, now)
    message = reader.message(message_type, value, ())
    if reader.problems:
        raise MessageValueError(reader.problems, name)
    return message


class _Unknown:
    """The value of a blackboard entry that is not known before the tree runs."""


_UNKNOWN: Final = _Unknown()


class _Reader:
    """Creates a message from a value, and collects the problems."""

    def __init__(self, resolve: Callable[[str], object] | None, now: Callable[[], Any] | None = None) -> None:
        self.problems: list[FieldProblem] = []
        self._resolve = resolve
        self._now = now

    def _report(
        self, path: tuple[str | int, ...], message: str, hint: str = "", is_name: bool = False
    ) -> None:
        if len(self.problems) < MAX_PROBLEMS:
            self.problems.append(FieldProblem(path, message, hint, is_name))

    def message(self, message_class: Any, value: object, path: tuple[str | int, ...]) -> Any:
        value = self._resolved(value)
        if isinstance(value, message_class):
            return value
        message = message_class()
        if value is _UNKNOWN:
            return message
        if isinstance(value, str) and value.startswith(PREFIX):
            try:
                value = parse_json(value)
            except ConversionError as error:
                self._report(path, str(error))
                return message
        if interface_name(message_class) in _TIMES:
            converted = self._time_or_duration(message_class, value, path)
            if converted is not None:
                return converted
        if not isinstance(value, Mapping):
            self._report(
                path, f"{_shown(value)} is not a {_short_name(message_class)}", _message_hint(message_class)
            )
            return message
        fields = message_fields(message_class)
        for key, member in value.items():
            place = (*path, str(key))
            field = fields.get(key)
            if field is None:
                self._report(place, *_unknown_field(message_class, str(key)), is_name=True)
                continue
            read = self._field(field, member, place, message_class)
            if len(self.problems) >= MAX_PROBLEMS:
                break
            if read is not _UNKNOWN:
                setattr(message, key, read)
        return message

    def _resolved(self, value: object) -> object:
        key = referenced_key(value) if self._resolve is not None else None
        return value if key is None or self._resolve is None else self._resolve(key)

    def _time_or_duration(self, message_class: Any, value: object, path: tuple[str | int, ...]) -> Any:
        """Return a Time or Duration from a number of seconds or the text `now`; None for other values."""
        if value == "now" and message_class.__name__ == "Time":
            return self._now() if self._now is not None else message_class()
        number = None if isinstance(value, bool) else number_of(to_builtin_number(value))
        if number is None:
            return None
        if not math.isfinite(number) or not -(2**31) <= number < 2**31:
            self._report(path, f"{number!r} s is out of range for a {_short_name(message_class)}")
            return message_class()
        sec, nanosec = divmod(round(number * _NS), _NS)
        return message_class(sec=sec, nanosec=nanosec)

    def _field(self, field: FieldType, value: object, path: tuple[str | int, ...], owner: Any) -> object:
        """Return *value* as the field of a message of class *owner* stores it, or _UNKNOWN."""
        value = self._resolved(value)
        if value is _UNKNOWN:
            return value
        if field.message is not None:
            return self.message(field.message, value, path)
        if field.item is not None:
            return self._array(field, field.item, value, path, owner)
        try:
            return _basic_value(field, value, owner)
        except _BasicValueError as error:
            self._report(path, error.message, error.hint)
            return _UNKNOWN

    def _array(
        self, field: FieldType, item: FieldType, value: object, path: tuple[str | int, ...], owner: Any
    ) -> object:
        if isinstance(value, str) or not (isinstance(value, Sequence) or hasattr(value, "__array__")):
            self._report(path, f"{_shown(value)} is not a list", f"the type is {field.name}")
            return _UNKNOWN
        data: Any = _one_dimensional(value) if hasattr(value, "__array__") else value
        if data is None:
            self._report(path, "the array has more than one dimension", "pass array.ravel()")
            return _UNKNOWN
        count = len(data)
        if field.size is not None and count != field.size:
            self._report(path, f"the list has {count} items", f"the type is {field.name}")
            return _UNKNOWN
        limit = MAX_ITEMS if field.max_items is None else field.max_items
        if count > limit:
            self._report(path, f"the list has {count} items; the maximum is {limit}")
            return _UNKNOWN
        packed = _packed(item, data)
        if packed is not None:
            return packed
        items: list[Any] = []
        for index, element in enumerate(data.tolist() if hasattr(data, "dtype") else data):
            read = self._field(item, element, (*path, index), owner)
            if read is _UNKNOWN:
                read = item.message() if item.message is not None else _ZEROS.get(item.basic, 0)
            items.append(read)
            if len(self.problems) >= MAX_PROBLEMS:
                break
        code = _CODES.get(item.basic)
        if code is None or field.size is not None:
            return items
        return array.array(code, items)


def _one_dimensional(value: Any) -> Any:
    """Return an array of numpy or of a similar library, or None if it has several dimensions."""
    import numpy as np

    data = np.asarray(value)
    return data if data.ndim == 1 else None


def _packed(item: FieldType, data: Any) -> object:
    """Return numbers that lie in one piece of memory as the field stores them; None for other values.

    Raises nothing: numbers that do not fit are converted item by item, which finds them.
    """
    if item.basic == "octet" and isinstance(data, bytes | bytearray | memoryview):
        return [bytes([byte]) for byte in data]
    code = _CODES.get(item.basic)
    if code is None:
        return None
    if isinstance(data, array.array) and data.typecode == code:
        return data
    if isinstance(data, bytes | bytearray | memoryview):
        return array.array(code, data) if code == "B" else None
    item_kind = getattr(getattr(data, "dtype", None), "kind", "")
    if item_kind not in ("i", "u", "f") or (item_kind == "f" and item.basic not in _REALS):
        return None
    import numpy as np

    if item.basic not in _REALS and len(data):
        limits = np.iinfo(np.dtype(code))
        if int(data.min()) < limits.min or int(data.max()) > limits.max:
            return None
    with np.errstate(over="ignore"):
        converted = np.ascontiguousarray(data, dtype=np.dtype(code))
    if item.basic == "float" and not (np.isfinite(converted) == np.isfinite(data)).all():
        return None
    packed = array.array(code)
    packed.frombytes(converted.tobytes())
    return packed


class _BasicValueError(Exception):
    """Raised for a value that does not fit a field of a basic type or a string."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint


def _basic_value(field: FieldType, value: object, owner: Any) -> object:
    """Return *value* as a field of a basic type or a string stores it."""
    basic = field.basic
    if basic in ("string", "wstring"):
        if not isinstance(value, str):
            hint = f'write "{value}"' if isinstance(value, int | float) else ""
            raise _BasicValueError(f"{_shown(value)} is not a string", hint)
        if field.max_length is not None and len(value) > field.max_length:
            raise _BasicValueError(f"the text has {len(value)} characters; the maximum is {field.max_length}")
        if "\0" in value:
            raise _BasicValueError("the text contains a null character")
        try:
            value.encode()
        except UnicodeEncodeError:
            raise _BasicValueError("the text contains half of a surrogate pair") from None
        return value
    value = to_builtin_number(value)
    if basic == "boolean":
        if isinstance(value, bool) or (isinstance(value, int | float) and value in (0, 1)):
            return bool(value)
        raise _BasicValueError(f"{_shown(value)} is not a bool", "write true or false")
    if basic == "octet" and isinstance(value, bytes) and len(value) == 1:
        return value
    if isinstance(value, str):
        return _named_value(field, value, owner)
    number = None if isinstance(value, bool) else number_of(value)
    if number is None:
        raise _BasicValueError(f"{_shown(value)} is not a number", f"the type is {field.name}")
    if basic in _REALS:
        return _real(field, number)
    return _integer(field, number)


def _integer(field: FieldType, number: int | float) -> object:
    if isinstance(number, float) and not number.is_integer():  # True for nan and inf
        raise _BasicValueError(f"{number!r} is not an integer", f"the type is {field.name}")
    whole = int(number)
    if field.basic == "octet":
        low, high = 0, 255
    else:
        bits = int(field.basic.lstrip("uint"))
        low, high = (0, 2**bits - 1) if field.basic[0] == "u" else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    if not low <= whole <= high:
        raise _BasicValueError(f"{_shown(whole)} is out of range for {field.name}: {low} to {high}")
    return bytes([whole]) if field.basic == "octet" else whole


def _real(field: FieldType, number: int | float) -> float:
    try:
        real = float(number)
    except OverflowError:
        real = math.inf
    if (math.isinf(real) and isinstance(number, int)) or (
        field.basic == "float" and _MAX_FLOAT32 <= abs(real) < math.inf
    ):
        raise _BasicValueError(f"{_shown(number)} is out of range for {field.name}")
    return real


def _named_value(field: FieldType, text: str, owner: Any) -> object:
    """Return the constant of the message that *text* names, or a real that JSON does not have."""
    if field.basic in _REALS and text in ("nan", "inf", "-inf"):
        return float(text)
    constants = {
        name: value for name, value in message_constants(owner).items() if not isinstance(value, str)
    }
    if text in constants:
        return _basic_value(field, constants[text], owner)
    if constants:
        hint = did_you_mean(text, constants).removeprefix("; ") or f"constants: {join_names(constants)}"
        raise _BasicValueError(
            f"'{text[:60]}' is neither a number nor a constant of {_short_name(owner)}", hint
        )
    raise _BasicValueError(f"'{text[:60]}' is not a number", f"the type is {field.name}")


def _unknown_field(message_class: Any, name: str) -> tuple[str, str]:
    """Return the message about a field that a message does not have, and a hint."""
    fields = message_fields(message_class)
    hint = did_you_mean(name, fields).removeprefix("; ") or f"fields: {join_names(fields) or 'none'}"
    return f"{_short_name(message_class)} has no field '{name}'", hint


def _short_name(message_class: Any) -> str:
    package, _, name = interface_name(message_class).split("/")
    return f"{package}/{name}"


def _message_hint(message_class: Any) -> str:
    if interface_name(message_class) in _TIMES:
        return "write a number of seconds" + (', or "now"' if message_class.__name__ == "Time" else "")
    fields = message_fields(message_class)
    return f'write {{"{next(iter(fields))}": …}}' if fields else "write {}"


def _shown(value: object) -> str:
    if isinstance(value, Mapping):
        return "a dictionary"
    if isinstance(value, int) and not isinstance(value, bool) and value.bit_length() > 128:
        return "a number of more than 128 bits"
    if hasattr(value, "get_fields_and_field_types"):
        return f"a {_short_name(type(value))}"
    if isinstance(value, bool) or value is None:
        return {True: "true", False: "false", None: "null"}[value]
    text = repr(value) if not isinstance(value, list | tuple | bytes) or len(value) < 20 else "the list"
    return text if len(text) <= 60 else text[:57] + "…"


def from_message(message: Any) -> dict[str, object]:
    """Return a message as a dictionary, which `to_message` reads.

    Messages become dictionaries and arrays become lists. Arrays of numbers become numpy arrays, except for
    arrays of `byte`, which become `bytes`.
    """
    return {
        name: field_value(field, getattr(message, name), deep=True)
        for name, field in message_fields(message.__class__).items()
    }


def field_value(field: FieldType, value: Any, deep: bool = False) -> object:
    """Return the value of a field as an entry of the blackboard holds it.

    Args:
        value: The value in the message.
        deep: Whether messages become dictionaries.
    """
    if field.message is not None:
        return from_message(value) if deep else value
    if field.item is not None:
        if field.item.basic in _CODES:
            import numpy as np

            return np.asarray(value)
        if field.item.basic == "octet":
            return b"".join(value)
        return [field_value(field.item, item, deep) for item in value]
    return value[0] if field.basic == "octet" else value


def field_type(message_type: Any, path: str) -> FieldType:
    """Return the type of the field at *path*.

    Args:
        message_type: The class of the message.
        path: Names of fields separated by dots, with indices: `poses[0].pose.position.x`.

    Raises:
        RosError: There is no such field.
    """
    field = FieldType(_short_name(message_type), message=message_type)
    for part, before in _steps(path):
        field = _next_type(field, part, before)
    return field


def read_field(message: Any, path: str) -> object:
    """Return the value of a field: a message, a list, a numpy array, a number or a text.

    Args:
        message: The message.
        path: The path of the field as in `field_type`; "" = the message itself.

    Raises:
        MissingItemError: A list has no such item.
        RosError: There is no such field.
    """
    value: Any = message
    field = FieldType("", message=type(message))
    for part, before in _steps(path):
        field = _next_type(field, part, before)
        if isinstance(part, str):
            value = getattr(value, part)
        elif part < len(value):
            value = value[part]
        else:
            count = f"{len(value)} items" if len(value) != 1 else "1 item"
            raise MissingItemError(f"'{path}': the list '{before}' has {count}")
    read: Any = field_value(field, value)
    return read.item() if field.basic and hasattr(read, "item") else read  # a number of numpy


def _next_type(field: FieldType, part: str | int, before: str) -> FieldType:
    owner = f"'{before}'" if before else field.name
    if isinstance(part, int):
        if field.item is None:
            raise RosError(f"{owner} is not a list, but has the type {field.name}")
        return field.item
    if field.message is None:
        raise RosError(f"{owner} has no fields: its type is {field.name}")
    fields = message_fields(field.message)
    if part not in fields:
        raise RosError("; ".join(_unknown_field(field.message, part)))
    return fields[part]


def _steps(path: str) -> Iterator[tuple[str | int, str]]:
    """Yield each name or index of *path*, with the path before it."""
    invalid = RosError(f"'{path}' is not the path of a field: write names and indices, as poses[0].x")
    before = ""
    for part in path.split(".") if path else ():
        name, *indices = part.split("[")
        if not name:
            raise invalid
        yield name, before
        before = f"{before}.{name}" if before else name
        for text in islice(indices, 10):
            digits = text.removesuffix("]")
            if not digits.isascii() or not digits.isdigit() or len(digits) > 9 or text == digits:
                raise invalid
            yield int(digits), before
            before += f"[{digits}]"
