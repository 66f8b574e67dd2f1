"""Launch files in ROS 2's YAML format: the programs to start, with their names and parameters.

An example:

    launch:
    - include:
        file: others.launch.yaml
    - node:
        exec: localization
        name: localization_node
        remap:
        - {from: input_scan, to: /scan_raw}
        param:
        - from: params.yaml
        - {name: number_particles, value: 300}

The key `pkg` is allowed and ignored: all programs are in this package. Paths are relative to the file.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from btcore_robot.data_files import read_text, yaml_errors
from btcore_robot.errors import RobotError
from btcore_robot.process.parameters import ParameterValue, load_process_parameters
from btcore_robot.process.process import Process, ProcessContext, ProcessOptions
from btcore_robot.process.programs import UnknownProgramError, create_processes

_LINE = "__line__"
_NODE_KEYS = {"exec", "name", "pkg", "remap", "param", "output"}
_OTHER_FORMATS = {".py": "Python", ".xml": "XML"}  # the other formats of ROS 2's launch files, by suffix
_MAX_DEPTH = 16  # levels of includes; a deeper level means that a file includes itself


class LaunchError(RobotError):
    """A launch file cannot be used; the message gives the place and the reason."""


@dataclass(frozen=True, slots=True)
class LaunchEntry:
    """A program to start.

    Attributes:
        program: The name of the program.
        name: The name of the process; None = the program's default.
        remap: The replaced topic names.
        parameters: The parameters, later values override earlier values.
        file: The launch file.
        line: The line in the launch file.
    """

    program: str
    name: str | None
    remap: Mapping[str, str]
    parameters: tuple[Mapping[str, Any], ...]
    file: Path
    line: int

    def options(self, own_name: str) -> ProcessOptions:
        """Return the options of the program's processes.

        Args:
            own_name: The default name of the program's process. Without a name in the launch file, it
                selects the parameters in a parameter file.

        Raises:
            ParameterError: A parameter file cannot be used.
        """
        values: dict[str, ParameterValue] = {}
        for parameter in self.parameters:
            if "from" in parameter:
                file = self.file.parent / str(parameter["from"])
                values |= load_process_parameters(file, self.name or own_name)
            else:
                values[str(parameter["name"])] = parameter["value"]
        return ProcessOptions(self.name, self.remap, values)


def read_launch(path: Path, depth: int = 0) -> list[LaunchEntry]:
    """Return the programs of the launch file *path* and of the files that it includes, in order.

    Args:
        path: The launch file.
        depth: The number of launch files between the first file and this file, to detect endless includes.

    Raises:
        LaunchError: The file cannot be read or is not a valid launch file.
    """
    if depth > _MAX_DEPTH:
        raise LaunchError(f"{path} includes itself, directly or through other files")
    if path.suffix in _OTHER_FORMATS:
        raise LaunchError(
            f"{path} is a launch file in {_OTHER_FORMATS[path.suffix]}, but only launch files in YAML are "
            "supported: write its nodes to a .launch.yaml file as 'launch:' and a list of '- node: {exec: "
            "PROGRAM}'; a launch file for other ROS nodes is started by `ros2 launch`"
        )
    text = read_text(path, "a launch file in YAML", LaunchError)
    with yaml_errors(path, LaunchError):
        content = yaml.load(text, Loader=_LineLoader)
    steps = content.get("launch") if isinstance(content, dict) else None
    if not isinstance(steps, list):
        raise LaunchError(f"{path}:1: a launch file is 'launch:', and below it a list of nodes")
    return [entry for step in steps for entry in _entries(path, step, depth)]


def launch_processes(entries: list[LaunchEntry], context: ProcessContext) -> list[Process]:
    """Return the processes of *entries*; add them to an executor to run them.

    Args:
        entries: The programs to start.
        context: The resources that the processes share.

    Raises:
        LaunchError: A program does not exist.
        ParameterError: A parameter has an invalid value.
    """
    processes: list[Process] = []
    for entry in entries:
        try:
            # Without a name in the launch file, a parameter file addresses the process by its default name.
            own = "" if entry.name or not entry.parameters else _own_name(entry.program, context)
            processes += create_processes(entry.program, context, entry.options(own))
        except UnknownProgramError as error:
            raise LaunchError(f"{entry.file}:{entry.line}: {error}") from None
    return processes


def _own_name(program: str, context: ProcessContext) -> str:
    quiet = ProcessContext(context.clock, context.schedule, lambda line: None, robot=context.robot)
    return create_processes(program, quiet)[0].name


def _entries(path: Path, step: object, depth: int) -> Iterator[LaunchEntry]:
    if not isinstance(step, dict):
        raise LaunchError(f"{path}: {step!r} is not a step of a launch file: a step is a node or an include")
    line = step[_LINE]
    keys = [key for key in step if key != _LINE]
    match keys:
        case ["include"] if isinstance(step["include"], dict) and "file" in step["include"]:
            yield from read_launch(path.parent / str(step["include"]["file"]), depth + 1)
        case ["node"] if isinstance(step["node"], dict):
            yield _entry(path, step["node"])
        case _:
            raise LaunchError(
                f"{path}:{line}: '{', '.join(map(str, keys))}' is not a step; a step is "
                "'node:' with 'exec' below it, or 'include:' with 'file' below it"
            )


def _entry(path: Path, node: dict[str, Any]) -> LaunchEntry:
    line = node[_LINE]
    unknown = sorted(node.keys() - _NODE_KEYS - {_LINE})
    if unknown:
        raise LaunchError(
            f"{path}:{line}: a node has no key '{unknown[0]}'; it has {', '.join(sorted(_NODE_KEYS))}"
        )
    if "exec" not in node:
        raise LaunchError(f"{path}:{line}: a node needs 'exec', the program's name")
    remap = {
        str(rule["from"]): str(rule["to"])
        for rule in _maps(path, node, "remap", lambda keys: {"from", "to"} <= keys)
    }
    parameters = _maps(path, node, "param", lambda keys: "from" in keys or {"name", "value"} <= keys)
    name = node.get("name")
    return LaunchEntry(
        str(node["exec"]), None if name is None else str(name), remap, tuple(parameters), path, line
    )


def _maps(path: Path, node: dict[str, Any], key: str, fits: Any) -> list[dict[str, Any]]:
    maps = node.get(key) or []
    if not isinstance(maps, list) or not all(isinstance(item, dict) and fits(item.keys()) for item in maps):
        form = "{from: NAME, to: NAME}" if key == "remap" else "{name: NAME, value: VALUE} or {from: FILE}"
        raise LaunchError(f"{path}:{node[_LINE]}: '{key}' must be a list of {form}")
    return maps


class _LineLoader(yaml.SafeLoader):
    """A YAML loader that adds to each map the line at which it begins."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Return the map with its line."""
        content: dict[Any, Any] = super().construct_mapping(node, deep)
        content[_LINE] = node.start_mark.line + 1
        return content
