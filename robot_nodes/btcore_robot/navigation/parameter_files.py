"""Parameter files of ROS 2, read key by key: which server is told what, and on which line."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import yaml

from btcore_robot.errors import RobotError

MARKER = "ros__parameters"
EVERY_SERVER = "**"
"""The name of a server that stands for all of them."""


class ParameterError(RobotError):
    """A parameter file can't be used; the text says where and why, a line for each mistake."""


@dataclass(frozen=True, slots=True)
class Setting:
    """One value of a file: its full *name* as the file nests it, the *value*, and the *line* it stands on."""

    name: str
    value: object
    line: int


Settings = dict[str, Setting]
"""Settings of one server by their name within it, with dots between nested maps' keys."""


def read_settings(path: Path) -> dict[str, Settings]:
    """What the file at *path* tells each server, by the server's name without its namespace.

    Both ``amcl: ros__parameters: …`` and, where no such marker is, ``amcl: …`` are read; namespaces are
    nested maps or slashes. A server's settings from several places are joined, the later ones win.

    Raises:
        ParameterError: the file can't be read, or isn't YAML of that form.

    """
    try:
        text = path.read_text(encoding="utf-8")
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except OSError as fault:
        raise ParameterError(f"{path} can't be read: {fault.strerror}") from None
    except UnicodeDecodeError:
        raise ParameterError(f"{path} is not a text file in UTF-8") from None
    except yaml.MarkedYAMLError as fault:
        line = fault.problem_mark.line + 1 if fault.problem_mark else 1
        raise ParameterError(f"{path}, line {line}: this is no YAML: {fault.problem}") from None
    except yaml.YAMLError as fault:
        raise ParameterError(f"{path} is no YAML: {fault}") from None
    servers: dict[str, Settings] = {}
    if root is None:
        return servers
    if not isinstance(root, yaml.MappingNode):
        raise ParameterError(
            f"{path}, line 1: a parameter file has a server's name and below it its parameters"
        )
    reader = yaml.SafeLoader("")
    try:
        for name, node in _servers(root, ""):
            if not isinstance(node, yaml.MappingNode):
                line = node.start_mark.line + 1
                raise ParameterError(f"{path}, line {line}: {name} has no parameters but a bare value")
            settings = servers.setdefault(name, {})
            for setting_name, leaf in _leaves(node, ""):
                value = reader.construct_object(leaf, deep=True)
                line = leaf.start_mark.line + 1
                settings[setting_name] = Setting(f"{name}.{setting_name}", value, line)
    except yaml.MarkedYAMLError as fault:
        line = fault.problem_mark.line + 1 if fault.problem_mark else 1
        raise ParameterError(f"{path}, line {line}: {fault.problem}") from None
    finally:
        reader.dispose()
    return servers


def _servers(node: yaml.MappingNode, name: str) -> Iterator[tuple[str, yaml.Node]]:
    """The name of every server below *node*, which is called *name*, with the node of its parameters."""
    for key, below in node.value:
        word = str(key.value)
        if word == MARKER:
            yield name or EVERY_SERVER, below
            continue
        inner = word.rstrip("/").rsplit("/", 1)[-1]
        if isinstance(below, yaml.MappingNode) and _has_marker(below):
            yield from _servers(below, inner)
        elif not name:
            yield inner, below


def _has_marker(node: yaml.Node) -> bool:
    return isinstance(node, yaml.MappingNode) and any(
        key.value == MARKER or _has_marker(below) for key, below in node.value
    )


def _leaves(node: yaml.MappingNode, before: str) -> Iterator[tuple[str, yaml.Node]]:
    for key, below in node.value:
        name = f"{before}{key.value}"
        if isinstance(below, yaml.MappingNode) and below.value:
            yield from _leaves(below, f"{name}.")
        else:
            yield name, below
