"""YAML files of maps, read key by key, so that each error message has a file and a line."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import yaml

from btcore_robot.errors import RobotError
from btcore_robot.field_reader import FieldReader, did_you_mean, read_text
from btcore_robot.yaml_errors import yaml_errors


class MapError(RobotError):
    """A map can't be read, written or created; the message has the place, the reason and a remedy."""


class YamlEntries(FieldReader):
    """The keys and values of a YAML file, with their lines."""

    def __init__(self, path: Path, values: dict[str, Any], lines: dict[str, int]) -> None:
        super().__init__(values)
        self._path = path
        self._lines = lines

    def check_keys(self, keys: Sequence[str]) -> None:
        """Check for misspelt keys. Other unknown keys are ignored, as in map_server.

        Raises:
            MapError: a key resembles a missing key of *keys*.

        """
        for key in self._fields:
            if key not in keys and (hint := did_you_mean(key, [name for name in keys if not self.has(name)])):
                raise self.mistake(key, f"is not a key of a map: {hint}the keys are {', '.join(keys)}")

    def flag(self, key: str, default: bool) -> bool:
        """Return the truth value (0, 1, true or false) at *key*.

        Raises:
            MapError: the value is another.

        """
        value = self._field(key, default)
        if value not in (0, 1):
            raise self._unexpected(key, value, "0 or 1")
        return bool(value)

    def mistake(self, key: str, what: str) -> MapError:
        """Return the error *what* at *key*, with file and line."""
        line = self._lines.get(key)
        return MapError(f"{self._path}{f':{line}' if line else ''}: '{key}' {what}")

    def parse_number(self, value: object) -> float | None:
        """Return *value* as a float, or None. PyYAML (YAML 1.1) reads 1e-2 as a text."""
        if isinstance(value, str):
            with suppress(ValueError):
                value = float(value)
        return super().parse_number(value)


def read_entries(path: Path, content: str) -> YamlEntries:
    """Read a YAML file.

    Args:
        path: the file.
        content: what the file holds, for error messages (``a map``).

    Raises:
        MapError: the file can't be read, or isn't a YAML file of keys and values.

    """
    text = read_text(path, f"a YAML file of {content}, not an image", MapError)
    values: dict[str, Any] = {}
    lines: dict[str, int] = {}
    with yaml_errors(path, MapError):
        node = yaml.compose(text, Loader=yaml.SafeLoader)
        if not isinstance(node, yaml.MappingNode):
            raise MapError(f"{path}: expected 'key: value' lines of {content}")
        # `safe_load` would return the values without the lines of their keys.
        constructor = yaml.SafeLoader("")
        for key_node, value_node in node.value:
            key = str(constructor.construct_object(key_node, deep=True))
            values[key] = constructor.construct_object(value_node, deep=True)
            lines[key] = key_node.start_mark.line + 1
    return YamlEntries(path, values, lines)
