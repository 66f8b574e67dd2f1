"""Reading of data files in JSON and YAML: each error has the file and the line."""

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from btcore.input_files import read_file
from btcore.json_text import MAX_DEPTH, load_json
from btcore.typed_data import DataError, Keys


def read_text(path: Path, expected: str, error_type: type[Exception]) -> str:
    """Return the text of a file in UTF-8.

    Args:
        expected: The expected content, for messages: `a YAML file of a map`.
        error_type: The class of the exception for a file that cannot be read.
    """
    try:
        return read_file(path).decode()
    except FileNotFoundError:
        raise error_type(f"{path}: no such file") from None
    except OSError as error:
        raise error_type(f"{path}: cannot read the file: {error.strerror}") from None
    except UnicodeDecodeError:
        raise error_type(f"{path}: not a text file; expected {expected}") from None


@contextmanager
def json_data(path: Path, content: str, error_type: type[Exception]) -> Iterator[dict[str, Any]]:
    """Read a JSON file with an object, and add the file and the line to each `DataError` in the `with` block.

    Args:
        content: The content of the file, for messages: `a world`.
        error_type: The class of all exceptions.
    """
    text = read_text(path, f"a JSON file of {content}", error_type)
    try:
        data = load_json(text)
    except json.JSONDecodeError as error:
        raise error_type(f"{path}:{error.lineno}:{error.colno}: not valid JSON: {error.msg}") from None
    if not isinstance(data, dict):
        raise error_type(f"{path}:1: {content} is a JSON object {{…}}, but this file contains another type")
    try:
        yield data
    except DataError as error:
        # YAML is a superset of JSON, except for tabs.
        root = yaml.compose(text.replace("\t", " "), Loader=YamlLoader)
        raise error_type(f"{path}:{line_of(root, error.keys)}: {error}") from None


@contextmanager
def yaml_data(path: Path, content: str, error_type: type[Exception]) -> Iterator[dict[str, Any]]:
    """Read a YAML file of keys and values, and add the file and the line to each `DataError` in the block.

    Args:
        content: The content of the file, for messages: `a map`.
        error_type: The class of all exceptions.
    """
    text = read_text(path, f"a YAML file of {content}", error_type)
    with yaml_errors(path, error_type):
        root = yaml.compose(text, Loader=YamlLoader)
        if not isinstance(root, yaml.MappingNode):
            raise error_type(f"{path}:1: expected 'key: value' lines of {content}")
        data = YamlLoader("").construct_object(root, deep=True)
    try:
        yield data
    except DataError as error:
        raise error_type(f"{path}:{line_of(root, error.keys)}: {error}") from None


class YamlLoader(yaml.SafeLoader):
    """A loader whose keys are texts and unique, and that reads 1e-2 as a number, as YAML 1.2 does.

    The time that PyYAML needs for deeply nested data grows with the square of the depth. The limit is that of
    JSON, because `json_data` finds the lines of JSON files by this loader.
    """

    _depth = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """Return the next node; at most `MAX_DEPTH` lists and maps are around a value."""
        if self._depth == MAX_DEPTH and self.check_event(yaml.SequenceStartEvent, yaml.MappingStartEvent):
            mark = parent.start_mark if parent is not None else None
            raise yaml.composer.ComposerError(None, None, "nested too deeply", mark)
        self._depth += 1
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Return the map of *node*."""
        values: dict[Any, Any] = {}
        for key_node, value_node in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                mark = key_node.start_mark
                raise yaml.constructor.ConstructorError(None, None, "a key must be a single value", mark)
            key = str(self.construct_object(key_node))
            if key in values:
                raise yaml.constructor.ConstructorError(
                    None, None, f"'{key}' occurs twice", key_node.start_mark
                )
            values[key] = self.construct_object(value_node, deep=deep)
        return values


YamlLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"), list("-+.0123456789")
)


@contextmanager
def yaml_errors(path: Path, error_type: type[Exception]) -> Iterator[None]:
    """Convert PyYAML's errors in the `with` block to errors with the file, the line and the column.

    Args:
        path: The file that the block reads.
        error_type: The class of the new errors.
    """
    try:
        yield
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        place = f"{path}:{mark.line + 1}:{mark.column + 1}" if mark else str(path)
        raise error_type(f"{place}: not valid YAML: {error.problem}") from None
    except yaml.reader.ReaderError as error:
        raise error_type(f"{path}: not valid YAML: {error.reason}") from None


def line_of(node: Any, keys: Keys) -> int:
    """Return the line of the key to which *keys* lead from *node*; of its parent if there is no such key."""
    line: int = node.start_mark.line + 1
    for key in keys:
        if isinstance(node, yaml.MappingNode):
            entries = {entry.value: (entry.start_mark.line + 1, child) for entry, child in node.value}
        else:
            entries = {index: (child.start_mark.line + 1, child) for index, child in enumerate(node.value)}
        if key not in entries:
            break
        line, node = entries[key]
    return line
