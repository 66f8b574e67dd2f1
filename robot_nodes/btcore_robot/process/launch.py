"""Launch files: which programs to start, by which names, with which parameters; ROS 2's YAML form.

::

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

A ``pkg`` may be there and is not needed: all programs are ours. Paths are relative to the file.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from btcore_robot.errors import RobotError
from btcore_robot.process.parameters import Value, parameters_of
from btcore_robot.process.process import Process, ProcessContext, ProcessOptions
from btcore_robot.process.programs import UnknownProgramError, create_processes

_LINE = "__line__"
_NODE_KEYS = {"exec", "name", "pkg", "remap", "param", "output"}
_DEEPEST = 16  # includes within includes; deeper is a file that includes itself


class LaunchError(RobotError):
    """A launch file can't be used; the text says where and why."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One program to start; *file* and *line* tell where that stands."""

    program: str
    name: str | None
    remap: Mapping[str, str]
    given: tuple[Mapping[str, Any], ...]
    file: Path
    line: int

    def start(self, own_name: str) -> ProcessOptions:
        """How it is started, when its process would be called *own_name* by itself."""
        values: dict[str, Value] = {}
        for one in self.given:
            if "from" in one:
                values |= parameters_of(self.file.parent / str(one["from"]), self.name or own_name)
            else:
                values[str(one["name"])] = one["value"]
        return ProcessOptions(self.name, self.remap, values)


def read_launch(path: Path, depth: int = 0) -> list[Entry]:
    """What the file at *path* starts, in order, with what it includes. Raises LaunchError."""
    if depth > _DEEPEST:
        raise LaunchError(f"{path} is included by itself, directly or by others")
    try:
        content = yaml.load(path.read_text(encoding="utf-8"), Loader=_Reader)
    except OSError as fault:
        raise LaunchError(f"{path} can't be read: {fault.strerror}") from None
    except yaml.MarkedYAMLError as fault:
        line = fault.problem_mark.line + 1 if fault.problem_mark else 1
        raise LaunchError(f"{path}, line {line}: this is no YAML: {fault.problem}") from None
    steps = content.get("launch") if isinstance(content, dict) else None
    if not isinstance(steps, list):
        raise LaunchError(f"{path}, line 1: a launch file is 'launch:', and below it a list of nodes")
    return [entry for step in steps for entry in _entries(path, step, depth)]


def start_all(entries: list[Entry], context: ProcessContext) -> list[Process]:
    """The processes of *entries*, ready for an executor.

    Raises LaunchError for a program that there is not, and ParameterError for parameters that don't fit.
    """
    made: list[Process] = []
    for entry in entries:
        try:
            # The name that a program has by itself decides what of a parameter file is meant for it.
            own = "" if entry.name or not entry.given else _own_name(entry.program, context)
            made += create_processes(entry.program, context, entry.start(own))
        except UnknownProgramError as fault:
            raise LaunchError(f"{entry.file}, line {entry.line}: {fault}") from None
    return made


def _own_name(program: str, context: ProcessContext) -> str:
    silent = ProcessContext(context.clock, context.schedule, lambda line: None, robot=context.robot)
    return create_processes(program, silent)[0].name


def _entries(path: Path, step: object, depth: int) -> Iterator[Entry]:
    if not isinstance(step, dict):
        raise LaunchError(f"{path}: {step!r} is no step of a launch file: each is a node or an include")
    line = step[_LINE]
    kinds = [key for key in step if key != _LINE]
    match kinds:
        case ["include"] if isinstance(step["include"], dict) and "file" in step["include"]:
            yield from read_launch(path.parent / str(step["include"]["file"]), depth + 1)
        case ["node"] if isinstance(step["node"], dict):
            yield _entry(path, step["node"])
        case _:
            raise LaunchError(
                f"{path}, line {line}: '{', '.join(map(str, kinds))}' is no step here; a step is "
                "'node:' with 'exec' below it, or 'include:' with 'file' below it"
            )


def _entry(path: Path, node: dict[str, Any]) -> Entry:
    line = node[_LINE]
    strange = sorted(node.keys() - _NODE_KEYS - {_LINE})
    if strange:
        raise LaunchError(
            f"{path}, line {line}: a node has no '{strange[0]}'; it has {', '.join(sorted(_NODE_KEYS))}"
        )
    if "exec" not in node:
        raise LaunchError(f"{path}, line {line}: a node needs 'exec', the program's name")
    remap = {
        str(one["from"]): str(one["to"])
        for one in _maps(path, node, "remap", lambda one: {"from", "to"} <= one)
    }
    given = _maps(path, node, "param", lambda one: "from" in one or {"name", "value"} <= one)
    name = node.get("name")
    return Entry(str(node["exec"]), None if name is None else str(name), remap, tuple(given), path, line)


def _maps(path: Path, node: dict[str, Any], key: str, fits: Any) -> list[dict[str, Any]]:
    found = node.get(key) or []
    if not isinstance(found, list) or not all(isinstance(one, dict) and fits(one.keys()) for one in found):
        form = "{from: NAME, to: NAME}" if key == "remap" else "{name: NAME, value: VALUE} or {from: FILE}"
        raise LaunchError(f"{path}, line {node[_LINE]}: '{key}' is a list of {form}")
    return found


class _Reader(yaml.SafeLoader):
    """Reads YAML, and notes in each map the line it begins on."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """The map, with its line."""
        made: dict[Any, Any] = super().construct_mapping(node, deep)
        made[_LINE] = node.start_mark.line + 1
        return made
