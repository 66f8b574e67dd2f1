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

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
from msgspec import UNSET, UnsetType

from btcore.suggestions import did_you_mean
from btcore.typed_data import FieldError, Record, convert
from btcore_robot.components.component import Component, ComponentContext, ComponentOptions
from btcore_robot.components.parameters import ParameterValue, load_component_parameters
from btcore_robot.components.programs import PROGRAMS, create_components
from btcore_robot.data_files import yaml_data
from btcore_robot.errors import RobotError

_OTHER_FORMATS = {".py": "Python", ".xml": "XML"}  # the other formats of ROS 2's launch files, by suffix
_MAX_DEPTH = 16  # levels of includes; a deeper level means that a file includes itself


class LaunchError(RobotError):
    """A launch file cannot be used; the message gives the place and the reason."""


class _Rule(Record, rename={"source": "from"}):
    source: str
    to: str


class _Parameter(Record, rename={"file": "from"}):
    file: str | UnsetType = UNSET
    name: str | UnsetType = UNSET
    value: Any = UNSET

    def __post_init__(self) -> None:
        if (self.file is UNSET) is (self.name is UNSET or self.value is UNSET):
            raise ValueError("needs either 'from', or 'name' and 'value'")


class _Node(Record, rename={"program": "exec"}):
    program: str
    name: str | None = None
    pkg: str = ""
    output: str = ""
    remap: tuple[_Rule, ...] = ()
    param: tuple[_Parameter, ...] = ()

    def __post_init__(self) -> None:
        if self.program not in PROGRAMS:
            hint = did_you_mean(self.program, PROGRAMS) or f": there are {', '.join(PROGRAMS)}"
            raise FieldError("exec", f"is '{self.program}', which is no program{hint}")


class _Include(msgspec.Struct):
    file: str


class _Step(Record):
    node: _Node | UnsetType = UNSET
    include: _Include | UnsetType = UNSET

    def __post_init__(self) -> None:
        if (self.node is UNSET) is (self.include is UNSET):
            raise ValueError("needs either 'node' or 'include'")


class _LaunchFile(msgspec.Struct):
    launch: tuple[_Step, ...]


@dataclass(frozen=True, slots=True)
class LaunchEntry:
    """A program to start: the *node* of a launch *file*."""

    node: _Node
    file: Path

    def options(self, own_name: str) -> ComponentOptions:
        """Return the options of the program's components.

        Args:
            own_name: The default name of the program's component. Without a name in the launch file, it
                selects the parameters in a parameter file.

        Raises:
            ParameterError: A parameter file cannot be used.
        """
        values: dict[str, ParameterValue] = {}
        for parameter in self.node.param:
            if parameter.file is not UNSET:
                file = self.file.parent / parameter.file
                values |= load_component_parameters(file, self.node.name or own_name)
            elif parameter.name is not UNSET:
                values[parameter.name] = parameter.value
        return ComponentOptions(self.node.name, {rule.source: rule.to for rule in self.node.remap}, values)


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
    with yaml_data(path, "a launch file", LaunchError) as data:
        steps = convert(data, _LaunchFile).launch
    return [entry for step in steps for entry in _entries(path, step, depth)]


def _entries(path: Path, step: _Step, depth: int) -> Iterator[LaunchEntry]:
    if step.include is not UNSET:
        yield from read_launch(path.parent / step.include.file, depth + 1)
    elif step.node is not UNSET:
        yield LaunchEntry(step.node, path)


def launch_components(entries: list[LaunchEntry], context: ComponentContext) -> list[Component]:
    """Return the components of *entries*; add them to an executor to run them.

    Args:
        entries: The programs to start.
        context: The resources that the components share.

    Raises:
        ParameterError: A parameter has an invalid value.
    """
    components: list[Component] = []
    for entry in entries:
        # Without a name in the launch file, a parameter file addresses the component by its default name.
        own = "" if entry.node.name or not entry.node.param else _own_name(entry.node.program, context)
        components += create_components(entry.node.program, context, entry.options(own))
    return components


def _own_name(program: str, context: ComponentContext) -> str:
    quiet = ComponentContext(context.clock, context.schedule, lambda line: None, robot=context.robot)
    return create_components(program, quiet)[0].name
