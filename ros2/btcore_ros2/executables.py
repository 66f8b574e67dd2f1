"""The programs of `ros2 run btcore NAME` and of launch files, with the arguments of ROS programs."""

import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from btcore.__main__ import main as run_command_line
from btcore.exit_codes import ExitCode

ARGUMENTS = "--arguments="
"""The prefix of several arguments in a single text, as launch files pass the value of a launch argument."""


def main() -> None:
    """Run the command `btcore ros2 NAME` for the executable NAME, or `btcore` for the executable btcore."""
    name = Path(sys.argv[0]).name
    command = [] if name == "btcore" else ["ros2", name]
    try:
        sys.argv[1:] = [*command, *command_arguments(sys.argv[1:])]
    except ValueError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(ExitCode.USER_ERROR)
    try:
        run_command_line()
    except SystemExit as end:
        # launch stops a server by SIGINT, and reports every other exit code than 0 as an error.
        sys.exit(0 if command and end.code == ExitCode.INTERRUPTED else end.code)


def command_arguments(arguments: Sequence[str]) -> list[str]:
    """Return *arguments* of a ROS program in the form of the command line.

    Like rcl, take everything from `--ros-args` to `--` or to the end as arguments of the ROS node. The option
    `--ros-args` of the command line takes them as a single text, which is accepted here, too. It is left out
    if there are none: launch files always append `--ros-args`.

    Args:
        arguments: Arguments such as `["trees", "--ros-args", "-p", "tick_frequency:=50"]`. An argument that
            begins with `--arguments=` contains any number of arguments, quoted as in a shell. They take
            precedence over the others.

    Raises:
        ValueError: A quotation mark is missing.
    """
    texts = [argument for argument in arguments if argument.startswith(ARGUMENTS)]
    own: list[str] = []
    of_node: list[str] = []
    for part in (
        [argument for argument in arguments if argument not in texts],
        *(_split(text.removeprefix(ARGUMENTS)) for text in texts),
    ):
        target = own
        for argument in part:
            if argument == "--ros-args":
                target = of_node
            elif argument == "--" and target is of_node:
                target = own
            elif target is of_node and argument.startswith("-") and " " in argument:
                target.extend(_split(argument))
            else:
                target.append(argument)
    return [*own, "--ros-args", shlex.join(of_node)] if of_node else own


def _split(text: str) -> list[str]:
    try:
        return shlex.split(text)
    except ValueError as error:
        raise ValueError(f"{error} in the arguments {text}") from None
