"""YAML files of maps, read key by key, so that each mistake is told with its file and line."""

import math
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import yaml

from btcore_robot.errors import RobotError


class MapError(RobotError):
    """A map can't be read, written or made; the text says where, why and what to do."""


class Entries:
    """The keys and values of one YAML file, each with its line."""

    def __init__(self, path: Path, values: dict[str, Any], lines: dict[str, int]) -> None:
        self._path = path
        self._values = values
        self._lines = lines

    def has(self, key: str) -> bool:
        """Whether the key is there."""
        return key in self._values

    def known(self, keys: Sequence[str]) -> None:
        """Refuse a key that is a slip of one of *keys*; map_server ignores keys that it doesn't know."""
        for key in self._values:
            if key not in keys and (meant := self.near(key, [one for one in keys if not self.has(one)])):
                raise self.mistake(key, f"is no key of a map: {meant}keys are {', '.join(keys)}")

    def number(self, key: str, default: float | None = None) -> float:
        """A finite number."""
        value = self._value(key, default)
        number = _number(value)
        if number is None:
            raise self.mistake(key, f"is {value!r}, and a number is expected")
        return number

    def numbers(self, key: str, counts: Sequence[int]) -> list[float]:
        """A list of finite numbers, whose length is one of *counts*."""
        value = self._value(key, None)
        numbers = _numbers(value)
        if numbers is None or len(numbers) not in counts:
            wanted = " or ".join(str(count) for count in counts)
            raise self.mistake(key, f"is {value!r}, and a list of {wanted} numbers is expected")
        return numbers

    def rows(self, key: str, count: int) -> list[list[float]]:
        """A list of lists of *count* finite numbers each; none at all is fine."""
        value = self._value(key, None)
        found = [_numbers(one) for one in value] if isinstance(value, list) else [None]
        rows = [row for row in found if row is not None and len(row) == count]
        if len(rows) < len(found):
            raise self.mistake(key, f"is {value!r}, and a list of lists of {count} numbers is expected")
        return rows

    def flag(self, key: str, default: bool) -> bool:
        """A truth: 0, 1, true or false."""
        value = self._value(key, default)
        if value not in (0, 1):
            raise self.mistake(key, f"is {value!r}, and 0 or 1 is expected")
        return bool(value)

    def text(self, key: str, default: str | None = None) -> str:
        """A text."""
        value = self._value(key, default)
        if not isinstance(value, str) or not value:
            raise self.mistake(key, f"is {value!r}, and a text is expected")
        return value

    def near(self, word: str, names: Sequence[str]) -> str:
        """``did you mean 'origin'? `` when one of *names* is near to *word*, else nothing."""
        found = get_close_matches(word, names, n=1, cutoff=0.6)
        return f"did you mean '{found[0]}'? " if found else ""

    def mistake(self, key: str, what: str) -> MapError:
        """A mistake at *key*, with its address."""
        line = self._lines.get(key)
        return MapError(f"{self._path}{f':{line}' if line else ''}: '{key}' {what}")

    def _value(self, key: str, default: Any) -> Any:
        value = self._values.get(key, default)
        if value is None:
            hint = self.near(key, list(self._values))
            raise self.mistake(key, f"is missing{': ' + hint.strip() if hint else ''}")
        return value


def read_entries(path: Path, what: str) -> Entries:
    """The keys and values of the YAML file at *path*, which holds *what* (``a map``); raises `MapError`."""
    try:
        loader = yaml.SafeLoader(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise MapError(f"{path}: there is no such file") from None
    except OSError as fault:
        raise MapError(f"{path}: the file can't be read: {fault.strerror}") from None
    except UnicodeDecodeError:
        raise MapError(f"{path}: this is no text; {what} is a YAML file, which names its image") from None
    except yaml.reader.ReaderError as fault:
        raise MapError(f"{path}: this is not YAML: {fault.reason}") from None
    values: dict[str, Any] = {}
    lines: dict[str, int] = {}
    try:
        node = loader.get_single_node()
        if not isinstance(node, yaml.MappingNode):
            raise MapError(f"{path}: {what} is a list of 'key: value' lines, and this is something else")
        for key_node, value_node in node.value:
            key = str(loader.construct_object(key_node, deep=True))
            values[key] = loader.construct_object(value_node, deep=True)
            lines[key] = key_node.start_mark.line + 1
    except yaml.MarkedYAMLError as fault:
        mark = fault.problem_mark
        where = f"{path}:{mark.line + 1}:{mark.column + 1}" if mark else str(path)
        raise MapError(f"{where}: this is not YAML: {fault.problem}") from None
    except yaml.reader.ReaderError as fault:
        raise MapError(f"{path}: this is not YAML: {fault.reason}") from None
    finally:
        loader.dispose()
    return Entries(path, values, lines)


def _number(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        return None
    try:
        number = float(value)  # YAML 1.1 takes 1e-2 for a text
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def _numbers(value: object) -> list[float] | None:
    if not isinstance(value, list):
        return None
    numbers = [_number(one) for one in value]
    return None if None in numbers else [one for one in numbers if one is not None]
