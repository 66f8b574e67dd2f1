"""The common parts of the `btcore book` commands: options, the robot, and the executor of processes."""

import functools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import click
import numpy as np
from numpy.typing import NDArray

from btcore.escaping import escape_controls
from btcore.program_runner import (
    FiniteRange,
    GatheredResources,
    RunCommand,
    print_json,
    print_result,
    require_resources,
    run_program,
)
from btcore_robot.book.top_view import is_image_format_supported, save_picture
from btcore_robot.errors import RobotError
from btcore_robot.process.process import Executor, LogMessage, Process, ProcessContext
from btcore_robot.robot import Phase, Robot
from btcore_robot.schedule import RealTimeSchedule, SimulatedSchedule
from btcore_robot.transforms import FrameBroadcaster

Image = NDArray[np.uint8]
Settings = Mapping[str, Any]


_WORLD_OPTIONS = [
    click.option("--duration", type=FiniteRange(0, min_open=True), metavar="S", help="Stop after this time."),
    click.option(
        "--seed", type=click.IntRange(0), default=0, show_default=True, metavar="N", help="Random seed."
    ),
    click.option("--fast", is_flag=True, help="Run as fast as possible instead of in real time."),
    click.option(
        "--picture",
        type=click.Path(dir_okay=False, path_type=Path),
        metavar="FILE.png",
        help="Draw the result at the end.",
    ),
    click.option("--json", "as_json", is_flag=True, help="Print a JSON object as the last line."),
    click.option("--quiet", is_flag=True, help="Omit the log of the programs."),
]


def world_command(
    group: click.Group, name: str, help_line: str, options: Sequence[Callable[[Any], Any]] = ()
) -> Callable[[Callable[..., int]], click.Command]:
    """Return a decorator that adds a function to a group, as a command that runs in a robot's world.

    Args:
        group: The group to which the command is added.
        name: The name of the command.
        help_line: The line that describes the command in the group's help.
        options: Decorators that add further options to the command, besides the options for all worlds.
    """

    def decorate(function: Callable[..., int]) -> click.Command:
        for option in (*reversed(options), *reversed(_WORLD_OPTIONS)):
            function = option(function)
        command = click.pass_context(report_usage_errors(function))
        return group.command(name, cls=RunCommand, short_help=help_line)(command)

    return decorate


def report_usage_errors(function: Callable[..., int]) -> Callable[..., int]:
    """Wrap *function* so that it raises click.UsageError in place of a `RobotError`."""

    @functools.wraps(function)
    def call(*arguments: Any, **settings: Any) -> int:
        try:
            return function(*arguments, **settings)
        except RobotError as error:
            raise click.UsageError(str(error)) from error

    return call


class BookRunner:
    """A run of processes with a robot, or with a clock alone.

    An executor runs all processes. The robot's frames are written to the transform tree 50 times a second.

    Args:
        ctx: The context of the command.
        settings: The values of the command's options.
        embodied: Whether the run needs a robot.
    """

    def __init__(self, ctx: click.Context, settings: Settings, *, embodied: bool = True) -> None:
        self.settings = settings
        self.clock: RealTimeSchedule | SimulatedSchedule | None = None
        log_sink = (lambda line: None) if settings.get("quiet") else _print
        if embodied:
            self.gathered = require_resources(ctx, settings, (Robot,))
            robot = next(resource for resource in self.gathered.resources if isinstance(resource, Robot))
            self.context = ProcessContext(robot.clock, robot.schedule, log_sink, robot=robot)
            broadcaster = FrameBroadcaster(robot, self.context.transforms)
            # Once before the start, so that the first callbacks find the frames.
            broadcaster.step(robot.clock.now())
            robot.schedule.add_task(FrameBroadcaster.RATE, Phase.TRANSFORMS, broadcaster.step)
        else:
            self.gathered = GatheredResources([], [], [])
            self.clock = SimulatedSchedule() if settings["fast"] else RealTimeSchedule()
            self.context = ProcessContext(self.clock, self.clock, _since(self.clock, log_sink))
        self.executor = Executor(self.context.schedule, self.context.clock)

    @property
    def robot(self) -> Robot:
        """The robot. Do not use this property in a run without a robot."""
        return cast(Robot, self.context.robot)

    def add(self, *processes: Process) -> None:
        """Add *processes* to the run. Print a warning for each parameter that a process does not declare."""
        for process in processes:
            for warning in process.unused_warnings():
                click.echo(f"warning: {escape_controls(warning)}", err=True)
            self.executor.add(process)

    def run(
        self,
        name: str,
        get_results: Callable[[], Mapping[str, object]] = dict,
        draw: Callable[[], Image] | None = None,
        shown: Sequence[object] = (),
    ) -> int:
        """Run the processes, then draw the picture and print the results.

        Args:
            name: The name of the run.
            get_results: A function that returns the results at the end.
            draw: A function that returns the picture (RGB) at the end.
            shown: Objects with `static_scene()` and `moving_scene()` that a viewer shows during the run.

        Returns:
            The exit code.

        Raises:
            click.UsageError: The picture cannot be written.
        """
        path: Path | None = self.settings.get("picture")
        if path is not None and not path.resolve().parent.is_dir():
            raise click.UsageError(f"--picture {path}: there is no folder {path.resolve().parent}")
        if path is not None and not is_image_format_supported(path):
            raise click.UsageError(
                f"--picture {path}: format '{path.suffix}' is not supported; use .png or .jpg"
            )
        results: dict[str, object] = {}

        def end() -> None:
            results.update(get_results())
            if path is not None and draw is not None:
                try:
                    save_picture(draw(), path)
                except OSError as error:
                    raise click.UsageError(
                        f"--picture {path}: cannot be written: {error.strerror}"
                    ) from error

        done = run_program(name, self.gathered, self.settings, end, clock=self.clock, extra_resources=shown)
        command = click.get_current_context().info_name
        print_result(command or name, done, results)
        if self.settings["as_json"]:
            output = {"time_s": round(done.seconds, 3), **results, **done.report}
            print_json(output)
        return done.code


def _print(line: LogMessage) -> None:
    click.echo(escape_controls(str(line)))


def _since(
    clock: RealTimeSchedule | SimulatedSchedule, log_sink: Callable[[LogMessage], None]
) -> Callable[[LogMessage], None]:
    """Return a log sink that makes stamps relative to the present time.

    The start of the monotonic clock has no meaning.
    """
    start = clock.now()
    return lambda line: log_sink(LogMessage(line.level, line.stamp - start, line.name, line.text))
