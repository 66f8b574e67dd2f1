"""Running programs of the book in a robot's world: what all commands of ``btcore book`` share."""

import functools
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import click
import numpy as np
from numpy.typing import NDArray

from btcore.program_runner import (
    FiniteRange,
    GatheredResources,
    RunCommand,
    print_result,
    require_resources,
    run_program,
)
from btcore_robot.book.top_view import save_picture, writable
from btcore_robot.process.launch import LaunchError
from btcore_robot.process.parameters import ParameterError
from btcore_robot.process.process import Executor, LogMessage, MessageLoopError, Process, ProcessContext
from btcore_robot.process.programs import UnknownProgramError
from btcore_robot.process.topics import TopicError
from btcore_robot.robot import Phase, Robot
from btcore_robot.schedule import RealTime, SimulatedTime
from btcore_robot.transforms import FrameBroadcaster

Image = NDArray[np.uint8]
Settings = Mapping[str, Any]

FAULTS = (LaunchError, ParameterError, UnknownProgramError, TopicError, MessageLoopError)


def world_command(name: str, help_line: str) -> Callable[[Callable[..., int]], click.Command]:
    """A command called *name* that runs in a robot's world, with the options for that."""

    def made(function: Callable[..., int]) -> click.Command:
        options = [
            click.option(
                "--duration", type=FiniteRange(0, min_open=True), metavar="S", help="End after so long."
            ),
            click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="For chance."),
            click.option("--fast", is_flag=True, help="As fast as it goes, instead of real time."),
            click.option(
                "--picture",
                type=click.Path(dir_okay=False, path_type=Path),
                metavar="FILE.png",
                help="Draw how it stands at the end.",
            ),
            click.option("--json", "as_json", is_flag=True, help="One JSON object as the last line."),
            click.option("--quiet", is_flag=True, help="Leave out what the programs log."),
        ]
        for option in reversed(options):
            function = option(function)
        return click.command(name, cls=RunCommand, short_help=help_line)(
            click.pass_context(guarded(function))
        )

    return made


def guarded(function: Callable[..., int]) -> Callable[..., int]:
    """*function*, whose user's mistakes are told as such."""

    @functools.wraps(function)
    def call(*arguments: Any, **settings: Any) -> int:
        try:
            return function(*arguments, **settings)
        except FAULTS as fault:
            raise click.UsageError(str(fault)) from fault

    return call


class BookRunner:
    """A robot in its world, or time alone, for processes of which one executor runs all.

    The robot's frames are in the transforms 50 times a second.
    """

    def __init__(self, ctx: click.Context, settings: Settings, *, embodied: bool = True) -> None:
        self.settings = settings
        self.clock: RealTime | SimulatedTime | None = None
        say = (lambda line: None) if settings.get("quiet") else _say
        if embodied:
            self.gathered = require_resources(ctx, settings, (Robot,))
            robot = next(one for one in self.gathered.resources if isinstance(one, Robot))
            self.context = ProcessContext(robot.clock, robot.schedule, say, robot=robot)
            broadcaster = FrameBroadcaster(robot, self.context.transforms)
            broadcaster.step(robot.clock.now())
            robot.schedule.every(FrameBroadcaster.RATE, Phase.TRANSFORMS, broadcaster.step)
        else:
            self.gathered = GatheredResources([], [], [])
            self.clock = SimulatedTime() if settings["fast"] else RealTime()
            self.context = ProcessContext(self.clock, self.clock, _since(self.clock, say))
        self.executor = Executor(self.context.schedule, self.context.clock)

    @property
    def robot(self) -> Robot:
        """The robot; a stage without one has none to ask for."""
        return cast(Robot, self.context.robot)

    def add(self, *processes: Process) -> None:
        """Run *processes*, and tell of parameters that none of them knows."""
        for process in processes:
            for sentence in process.unused_warnings():
                click.echo(f"warning: {sentence}", err=True)
            self.executor.add(process)

    def perform(
        self,
        name: str,
        figures: Callable[[], Mapping[str, object]] = dict,
        picture: Callable[[], Image] | None = None,
        shown: Sequence[object] = (),
    ) -> int:
        """Run it all as *name*; then draw, and report *figures*. The exit code."""
        path: Path | None = self.settings.get("picture")
        if path is not None and not path.resolve().parent.is_dir():
            raise click.UsageError(f"--picture {path}: there is no folder {path.resolve().parent}")
        if path is not None and not writable(path):
            raise click.UsageError(f"--picture {path}: pictures can't be '{path.suffix}'; .png and .jpg work")
        told: dict[str, object] = {}

        def end() -> None:
            told.update(figures())
            if path is not None and picture is not None:
                try:
                    save_picture(picture(), path)
                except OSError as fault:
                    raise click.UsageError(
                        f"--picture {path}: it can't be written: {fault.strerror}"
                    ) from fault

        done = run_program(name, self.gathered, self.settings, end, clock=self.clock, shown=shown)
        command = click.get_current_context().info_name
        print_result(command or name, done, told)
        if self.settings["as_json"]:
            figures_of_all = {"time_s": round(done.seconds, 3), **told, **done.report}
            click.echo(json.dumps(figures_of_all, ensure_ascii=False))
        return done.code


def _say(line: LogMessage) -> None:
    click.echo(str(line))


def _since(
    clock: RealTime | SimulatedTime, say: Callable[[LogMessage], None]
) -> Callable[[LogMessage], None]:
    """Lines whose stamps count from now on: the machine's clock says nothing to a reader."""
    start = clock.now()
    return lambda line: say(LogMessage(line.level, line.stamp - start, line.name, line.text))
