"""Values of a recording: data of JSON, from which a program without the robot's libraries makes equal values.

Enums and dataclasses are recorded by name and members, so that stand-ins replace their classes. Any other
value is recorded as text, and is not replayable.
"""

import base64
import json
import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass, make_dataclass
from enum import Enum, IntEnum, StrEnum
from itertools import islice
from typing import Any, Final, NamedTuple

from btcore.status import NodeType, Status
from btcore.suggestions import shortened
from btcore.values import PortDirection

MAX_ITEMS: Final = 100_000
"""Maximum length of a text, list or dictionary that is replayable."""
MAX_TEXT: Final = 1_000
"""Maximum length of the text of a value that is not replayable."""
MAX_SHOWN: Final = 200
"""Maximum number of characters of a value that is shown."""
_ITEMS_SHOWN: Final = 30
_DEPTH_SHOWN: Final = 8
_SIZED: Final = (str, bytes, list, tuple, dict, deque, set)
EXCLUDED: Final = {"__text": "excluded"}
"""Stands for the value of an entry that is not recorded."""
_BUILTIN_ENUMS: Final[dict[str, type[Enum]]] = {
    cls.__qualname__: cls for cls in (Status, PortDirection, NodeType)
}
_ENUM_BASES: Final[dict[str, type[Enum]]] = {"IntEnum": IntEnum, "StrEnum": StrEnum, "Enum": Enum}


class NotReplayable(NamedTuple):
    """Stands for a value that was recorded as text."""

    text: str


class Encoder:
    """Encodes values, and describes their types.

    Attributes:
        found: Called with the name and the description of each type that was not encountered before.
        count: The number of values so far, those in lists and others included.
    """

    def __init__(self, found: Callable[[str, Any], object]) -> None:
        self.found = found
        self.count = 0
        self._names: dict[type, str] = {}
        self._taken: set[str] = set(_BUILTIN_ENUMS)

    def encode(self, value: object) -> Any:
        """Return *value* as data of JSON; later changes of *value* have no effect on it."""
        try:
            return self._encode(value)
        except Exception:  # code of the user's classes, or a list that contains itself
            return {"__text": f"a {type(value).__qualname__} that cannot be recorded"}

    def _encode(self, value: Any) -> Any:
        cls = type(value)
        self.count += 1
        # By the class only: a value may raise if it is used.
        if issubclass(cls, _SIZED) and len(value) > MAX_ITEMS:
            return {"__text": f"{cls.__qualname__} of {len(value):,} items"}
        if cls is int or cls is str or cls is bool or value is None:
            return value
        if cls is float:
            return value if math.isfinite(value) else {"__float": repr(value)}
        if issubclass(cls, Enum):
            return {"__enum": self.name(cls), "name": value.name}
        if cls is list:
            return [self._encode(item) for item in value]
        if cls is NotReplayable:
            return {"__text": value.text}
        if cls is tuple:
            return {"__tuple": [self._encode(item) for item in value]}
        if cls is dict:
            return {"__dict": [[self._encode(key), self._encode(item)] for key, item in value.items()]}
        if cls is deque:
            return {"__deque": [self._encode(item) for item in value]}
        if cls is set:
            items = [self._encode(item) for item in value]
            return {"__set": sorted(items, key=repr)}  # equal sets have equal forms
        if cls is bytes:
            return {"__bytes": base64.b64encode(value).decode()}
        if is_dataclass(cls):
            encoded = {field.name: self._encode(getattr(value, field.name)) for field in fields(cls)}
            return {"__type": self.name(cls), **encoded}
        return {"__text": repr(value)[:MAX_TEXT]}

    def name(self, cls: type) -> str:
        """Return the name of *cls* in the recording."""
        name = self._names.get(cls)
        if name is not None:
            return name
        name = cls.__qualname__
        if _BUILTIN_ENUMS.get(name) is not cls:
            number = 2
            while name in self._taken:
                name, number = f"{cls.__qualname__}#{number}", number + 1
            self._taken.add(name)
            self.found(name, self._description(cls))
        self._names[cls] = name
        return name

    def _description(self, cls: type) -> Any:
        if issubclass(cls, Enum):
            base = next(name for name, known in _ENUM_BASES.items() if issubclass(cls, known))
            members = {name: self.encode(member.value) for name, member in cls.__members__.items()}
            return {"enum": base, "members": members}
        if is_dataclass(cls):
            return {"fields": [field.name for field in fields(cls)]}
        return {}


class Decoder:
    """Decodes values; stand-ins replace the classes that *types* describes.

    Args:
        types: The descriptions by name.
    """

    def __init__(self, types: Mapping[str, Any]) -> None:
        self._types = types
        self._classes: dict[str, type] = dict(_BUILTIN_ENUMS)

    def decode(self, data: Any) -> object:
        """Return the value that *data* describes.

        Raises:
            ValueError: *data* is not the form of a value.
        """
        if isinstance(data, list):
            return [self.decode(item) for item in data]
        if not isinstance(data, dict):
            return data
        match data:
            case {"__float": str(text)}:
                return float(text)
            case {"__enum": str(name), "name": str(member)}:
                try:
                    return self.stand_in(name)[member]  # type: ignore[index]
                except (KeyError, TypeError):
                    raise ValueError(f"the enum {name} has no member {member}") from None
            case {"__tuple": list(items)}:
                return tuple(self.decode(item) for item in items)
            case {"__deque": list(items)}:
                return deque(self.decode(item) for item in items)
            case {"__set": list(items)}:
                return {self.decode(item) for item in items}
            case {"__dict": list(pairs)}:
                return {self.decode(key): self.decode(item) for key, item in pairs}
            case {"__bytes": str(text)}:
                return base64.b64decode(text, validate=True)
            case {"__text": str(text)}:
                return NotReplayable(text)
            case {"__type": str(name), **values}:
                try:
                    return self.stand_in(name)(**{key: self.decode(item) for key, item in values.items()})
                except TypeError as error:
                    raise ValueError(f"the type {name} does not fit its description: {error}") from None
        raise ValueError(f"{json.dumps(data)[:80]} is not a recorded value")

    def stand_in(self, name: str) -> type:
        """Return the class that stands for the recorded class *name*."""
        cls = self._classes.get(name)
        if cls is None:
            self._classes[name] = type(name, (), {})  # a description may name itself
            self._classes[name] = cls = self._make(name, self._types.get(name, {}))
        return cls

    def _make(self, name: str, description: Any) -> type:
        match description:
            case {"enum": str(base), "members": dict(members)} if base in _ENUM_BASES:
                values = {key: self.decode(value) for key, value in members.items()}
                return _ENUM_BASES[base](name, values)  # type: ignore[call-arg, return-value]
            case {"fields": list(names)}:
                return make_dataclass(name, [(str(field), object) for field in names])
        return type(name, (), {})


def value_text(value: object, most: int = MAX_SHOWN) -> str:
    """Return *value* as a text of at most *most* characters; "–" if there is none.

    Examples:
        >>> from btcore_recorder.values import value_text
        >>> value_text({"door": [1.5, True, "open"]})
        '{"door": [1.5, true, "open"]}'
    """
    return shortened("–" if value is None else _text(value, 0), most)


def _text(value: object, depth: int) -> str:
    if isinstance(value, NotReplayable):
        return f"{value.text[:MAX_SHOWN]} (not replayable)"
    if isinstance(value, Enum):
        return value.name
    if value is None or isinstance(value, bool):
        return json.dumps(value)
    if isinstance(value, str):
        return json.dumps(value[:MAX_SHOWN], ensure_ascii=False)
    if isinstance(value, float):
        return f"{value:.6g}"
    if depth == _DEPTH_SHOWN:
        return "…"
    if isinstance(value, Mapping):
        pairs = (
            f"{_text(key, depth + 1)}: {_text(item, depth + 1)}"
            for key, item in islice(value.items(), _ITEMS_SHOWN)
        )
        return f"{{{', '.join(pairs)}{_rest(len(value))}}}"
    if is_dataclass(value) and not isinstance(value, type):
        members = (f"{field.name}={_text(getattr(value, field.name), depth + 1)}" for field in fields(value))
        return f"{type(value).__name__}({', '.join(islice(members, _ITEMS_SHOWN))})"
    if isinstance(value, bytes):
        return f"{len(value):,} bytes"
    try:
        items = list(islice(iter(value), _ITEMS_SHOWN))  # type: ignore[call-overload]
        count = len(value)  # type: ignore[arg-type]
    except TypeError:
        return str(value)[:MAX_SHOWN] if isinstance(value, int) else type(value).__name__
    return f"[{', '.join(_text(item, depth + 1) for item in items)}{_rest(count)}]"


def _rest(count: int) -> str:
    return f", … {count} items" if count > _ITEMS_SHOWN else ""
