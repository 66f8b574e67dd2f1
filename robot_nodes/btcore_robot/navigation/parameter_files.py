"""Parameter files of ROS 2, read key by key: the settings of each server, with their lines."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import yaml

from btcore_robot.errors import RobotError
from btcore_robot.field_reader import read_text
from btcore_robot.yaml_errors import yaml_errors

MARKER = "ros__parameters"
EVERY_SERVER = "**"
"""The wildcard name for all servers."""


class ParameterError(RobotError):
    """A parameter file can't be used; the message has a line with place and reason for each mistake."""


@dataclass(frozen=True, slots=True)
class Setting:
    """A value of a file: the full *name* with the names of outer keys, the *value* and its *line*."""

    name: str
    value: object
    line: int


Settings = dict[str, Setting]
"""The settings of a server by their names within the server; dots join the keys of nested maps."""


def read_settings(path: Path) -> dict[str, Settings]:
    """Return the settings in the file at *path*, by the servers' names without their namespaces.

    Both ``amcl: ros__parameters: …`` and, in files without this marker, ``amcl: …`` are accepted; namespaces
    are nested maps or slashes. Settings of the same server from several places are joined; later settings
    win.

    Raises:
        ParameterError: the file can't be read, or isn't YAML of this form.

    """
    text = read_text(path, "a YAML file of parameters", ParameterError)
    servers: dict[str, Settings] = {}
    with yaml_errors(path, ParameterError):
        root = yaml.compose(text, Loader=yaml.SafeLoader)
        if root is None:
            return servers
        if not isinstance(root, yaml.MappingNode):
            raise ParameterError(f"{path}:1: expected names of servers with parameters below them")
        constructor = yaml.SafeLoader("")
        for name, node in _servers(root, ""):
            line = node.start_mark.line + 1
            if not isinstance(node, yaml.MappingNode):
                raise ParameterError(
                    f"{path}:{line}: {name} must have parameters below it, not a single value"
                )
            settings = servers.setdefault(name, {})
            for setting_name, leaf in _leaves(node, ""):
                value = constructor.construct_object(leaf, deep=True)
                line = leaf.start_mark.line + 1
                settings[setting_name] = Setting(f"{name}.{setting_name}", value, line)
    return servers


def _servers(node: yaml.MappingNode, name: str) -> Iterator[tuple[str, yaml.Node]]:
    """Yield the name of every server below *node*, whose key is *name*, with the node of its parameters."""
    for key, child in node.value:
        word = str(key.value)
        if word == MARKER:
            yield name or EVERY_SERVER, child
            continue
        inner = word.rstrip("/").rsplit("/", 1)[-1]
        if isinstance(child, yaml.MappingNode) and _has_marker(child):
            yield from _servers(child, inner)
        elif not name:
            yield inner, child


def _has_marker(node: yaml.Node) -> bool:
    return isinstance(node, yaml.MappingNode) and any(
        key.value == MARKER or _has_marker(child) for key, child in node.value
    )


def _leaves(node: yaml.MappingNode, prefix: str) -> Iterator[tuple[str, yaml.Node]]:
    for key, child in node.value:
        name = f"{prefix}{key.value}"
        if isinstance(child, yaml.MappingNode) and child.value:
            yield from _leaves(child, f"{name}.")
        else:
            yield name, child
