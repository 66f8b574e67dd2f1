"""A reader for YAML files that reports each error with the file and the line."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import yaml

from btcore_robot.field_reader import FieldReader, did_you_mean, read_text
from btcore_robot.yaml_errors import yaml_errors
from btcore_ros2.errors import RosError

Value = TypeVar("Value")


class YamlMap(FieldReader):
    """A map of a YAML file. Every error that it raises is a `RosError` with the file and the line.

    Args:
        path: The file, for messages.
        node: The map.
        name: The keys that lead to the map, with a dot after each; empty for the whole file.
    """

    def __init__(self, path: Path, node: yaml.MappingNode, name: str = "") -> None:
        self._path = path
        self._name = name
        self._nodes: dict[str, yaml.Node] = {}
        self._lines: dict[str, int] = {}
        self._line = node.start_mark.line + 1
        values: dict[str, Any] = {}
        # `safe_load` would return the values without the lines of their keys.
        constructor = yaml.SafeLoader("")
        for key_node, value_node in node.value:
            key = str(constructor.construct_object(key_node, deep=True))
            line = key_node.start_mark.line + 1
            if key in values:
                raise RosError(f"{path}:{line}: '{name}{key}' occurs twice")
            values[key] = constructor.construct_object(value_node, deep=True)
            self._nodes[key], self._lines[key] = value_node, line
        super().__init__(values)

    def mistake(self, key: str, problem: str) -> RosError:
        """Return an error with *problem* at *key*, with file and line."""
        line = self._lines.get(key, self._line)
        return RosError(f"{self._path}:{line}: '{self._name}{key}' {problem}")

    def parse_number(self, value: object) -> float | None:
        """Return *value* as a float, or None. PyYAML (YAML 1.1) reads 1e-2 as a text."""
        if isinstance(value, str):
            with suppress(ValueError):
                value = float(value)
        return super().parse_number(value)

    def flag(self, key: str) -> bool | None:
        """Return a truth value, or None if the key is missing.

        Raises:
            RosError: The value is neither true nor false.
        """
        if not self.has(key):
            return None
        value = self._fields[key]
        if not isinstance(value, bool):
            raise self._unexpected(key, value, "true or false")
        return value

    def texts(self, key: str, counts: Sequence[int] = ()) -> list[str]:
        """Return a list of strings, whose length is in *counts* if that is given.

        Raises:
            RosError: The value is not such a list.
        """
        value = self._field(key, None)
        valid = isinstance(value, list) and all(isinstance(item, str) for item in value)
        if not valid or (counts and len(value) not in counts):
            number = " or ".join(str(count) for count in counts)
            raise self._unexpected(key, value, f"a list of {number + ' ' if number else ''}texts")
        return list(value)

    def names(self) -> list[str]:
        """Return all keys, and count them as read."""
        self._requested += self._fields
        return list(self._fields)

    def nested(self, key: str, parse: "Callable[[YamlMap], Value]") -> Value:
        """Return the result of *parse* for a nested map.

        Args:
            key: The key of the map.
            parse: Converts the map to the result. It must read all keys.

        Raises:
            RosError: The key is missing, its value is not a map, or *parse* does not read a key.
        """
        value = self._field(key, None)
        node = self._nodes[key]
        if not isinstance(node, yaml.MappingNode):
            raise self._unexpected(key, value, "a map of keys and values")
        return YamlMap(self._path, node, f"{self._name}{key}.").read_whole(parse)

    def read_whole(self, parse: "Callable[[YamlMap], Value]") -> Value:
        """Return the result of *parse* for this map. Raise a `RosError` for a key that is not read."""
        result = parse(self)
        for key in self._fields:
            if key not in self._requested:
                known = list(dict.fromkeys(self._requested))
                hint = did_you_mean(key, known)
                raise self.mistake(key, f"is unknown: {hint}known are {', '.join(known)}")
        return result


def read_yaml_map(path: Path, content: str) -> YamlMap:
    """Read a YAML file.

    Args:
        path: The file.
        content: What the file contains, as error messages name it: `a ROS 2 robot`.

    Raises:
        RosError: The file can't be read, or is not a YAML file of keys and values.
    """
    text = read_text(path, f"a YAML file of {content}", RosError)
    with yaml_errors(path, RosError):
        node = yaml.compose(text, Loader=yaml.SafeLoader)
        if not isinstance(node, yaml.MappingNode):
            raise RosError(f"{path}: expected 'key: value' lines of {content}")
        return YamlMap(path, node)
