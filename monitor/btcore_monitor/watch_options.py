"""Options of several commands that watch a robot: `--duration`, `--no-record` and `--blackboard-rate`."""

from collections.abc import Callable
from typing import Any

import click

duration_option = click.option(
    "--duration", type=click.FloatRange(min=0), metavar="SECONDS", help="Stop after this time."
)


def robot_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options `--no-record` and `--blackboard-rate` to *command*."""
    command = click.option(
        "--blackboard-rate",
        type=click.FloatRange(min=0, max=100),
        default=2.0,
        show_default=True,
        metavar="HZ",
        help="How often to request a C++ robot's blackboards; 0: never.",
    )(command)
    return click.option(
        "--no-record",
        is_flag=True,
        help="Do not read a C++ robot's recording of transitions: the first client to read it consumes it.",
    )(command)
