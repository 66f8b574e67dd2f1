"""YAML files of maps, read key by key, so that each mistake is told with its file and line."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import yaml

from btcore_robot.errors import RobotError
from btcore_robot.field_reader import FieldReader, did_you_mean


class MapError(RobotError):
    """A map can't be read, written or made; the text says where, why and what to do."""


class Entries(FieldReader):
    """The keys and values of one YAML file, each with its line."""

    def __init__(self, path: Path, values: dict[str, Any], lines: dict[str, int]) -> None:
        super().__init__(values)
        self._path = path
        self._lines = lines

    def known(self, keys: Sequence[str]) -> None:
        """Refuse a key that is a slip of one of *keys*; map_server ignores keys that it doesn't know."""
        for key in self._fields:
            if key not in keys and (meant := did_you_mean(key, [one for one in keys if not self.has(one)])):
                raise self.mistake(key, f"is no key of a map: {meant}keys are {', '.join(keys)}")

    def flag(self, key: str, default: bool) -> bool:
        """A truth: 0, 1, true or false."""
        value = self._field(key, default)
        if value not in (0, 1):
            raise self._unexpected(key, value, "0 or 1")
        return bool(value)

    def mistake(self, key: str, what: str) -> MapError:
        """A mistake at *key*, with its address."""
        line = self._lines.get(key)
        return MapError(f"{self._path}{f':{line}' if line else ''}: '{key}' {what}")

    def parse_number(self, value: object) -> float | None:
        """Return *value* as a float; YAML 1.1 takes 1e-2 for a text."""
        if isinstance(value, str):
            with suppress(ValueError):
                value = float(value)
        return super().parse_number(value)


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
