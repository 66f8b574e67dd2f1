"""The common parts of the `btcore book` commands: options, the robot, and the executor of components."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple, cast

import click
import numpy as np
from numpy.typing import NDArray

from btcore import Run, RunSettings, Settings, option
from btcore.errors import SettingsError
from btcore.escaping import escape_controls
from btcore.field_options import add_options
from btcore.program_runner import (
    GivenSettings,
    ProviderCommand,
    TreelessProgram,
    create_run,
    print_json,
    print_result,
)
from btcore_robot.book.top_view import is_image_format_supported, save_picture
from btcore_robot.components.component import Component, ComponentContext, Executor, LogMessage
from btcore_robot.robot import Phase, Robot
from btcore_robot.schedule import RealTimeSchedule, SimulatedSchedule
from btcore_robot.transforms import FrameBroadcaster

Image = NDArray[np.uint8]


class OutputSettings(Settings):
    """The outputs of a run of components."""

    picture: (
        Annotated[Path, option("Draw the result at the end.", metavar="FILE.png", one_run_only=True)] | None
    ) = None
    as_json: Annotated[bool, option("Print a JSON object as the last line.", name="json")] = False
    quiet: Annotated[bool, option("Omit the log of the programs.")] = False

    def __post_init__(self) -> None:
        path = self.picture
        if path is not None and not path.resolve().parent.is_dir():
            raise SettingsError(f"--picture {path}: there is no folder {path.resolve().parent}")
        if path is not None and not is_image_format_supported(path):
            raise SettingsError(
                f"--picture {path}: format '{path.suffix}' is not supported; use .png or .jpg"
            )


_WORLD_OPTIONS: Sequence[Callable[[Any], Any]] = (
    add_options(RunSettings, "duration", "seed", "fast"),
    add_options(OutputSettings),
)


def world_command(
    group: click.Group, name: str, help_line: str
) -> Callable[[Callable[..., int]], click.Command]:
    """Return a decorator that adds a function to a group, as a command that runs in a robot's world.

    Args:
        group: The group to which the command is added.
        name: The name of the command.
        help_line: The line that describes the command in the group's help.
    """

    def decorate(function: Callable[..., int]) -> click.Command:
        for decorator in reversed(_WORLD_OPTIONS):
            function = decorator(function)
        command = click.pass_context(function)
        return group.command(name, cls=ProviderCommand, short_help=help_line)(command)

    return decorate


class Results(NamedTuple):
    """The results of components.

    Attributes:
        report: A function that returns the results at the end.
        draw: A function that returns the picture (RGB) at the end.
        shown: Objects with `static_scene()` and `moving_scene()` that a viewer shows during the run.
    """

    report: Callable[[], Mapping[str, object]] = dict
    draw: Callable[[], Image] | None = None
    shown: Sequence[object] = ()


class BookRunner:
    """The components of a run with a robot, or with a clock alone.

    An executor runs all components. The robot's frames are written to the transform tree 50 times a second.

    Args:
        context: What the components share.
    """

    def __init__(self, context: ComponentContext) -> None:
        self.context = context
        if context.robot is not None:
            broadcaster = FrameBroadcaster(context.robot, context.transforms)
            # Once before the start, so that the first callbacks find the frames.
            broadcaster.step(context.clock.now())
            context.schedule.add_task(FrameBroadcaster.RATE, Phase.TRANSFORMS, broadcaster.step)
        self.executor = Executor(context.schedule, context.clock)

    @property
    def robot(self) -> Robot:
        """The robot. Do not use this property in a run without a robot."""
        return cast(Robot, self.context.robot)

    def add(self, *components: Component) -> None:
        """Add *components* to the run. Print a warning for each parameter that is not declared."""
        for component in components:
            for warning in component.unused_warnings():
                click.echo(f"warning: {escape_controls(warning)}", err=True)
            self.executor.add(component)


def run_components(
    ctx: click.Context,
    settings: GivenSettings,
    name: str,
    create: Callable[[BookRunner], Results],
    *,
    embodied: bool = True,
) -> int:
    """Run components, then draw the picture and print the results.

    Args:
        ctx: The context of the command.
        settings: The settings of the command, `OutputSettings` among them.
        name: The name of the run.
        create: Adds the components to the run, and returns how to obtain their results.
        embodied: Whether the run needs a robot.

    Returns:
        The exit code.

    Raises:
        SettingsError: The picture cannot be written.
    """
    output = settings.of(OutputSettings)
    log_sink = (lambda line: None) if output.quiet else _print
    clock: RealTimeSchedule | SimulatedSchedule | None = None
    if not embodied:
        clock = SimulatedSchedule() if settings.of(RunSettings).fast else RealTimeSchedule()
    results = Results()

    def prepare(run: Run) -> None:
        nonlocal results
        if clock is None:
            robot = run.find(Robot)
            assert robot is not None
            context = ComponentContext(robot.clock, robot.schedule, log_sink, robot=robot)
        else:
            context = ComponentContext(clock, clock, _since(clock, log_sink))
        results = create(BookRunner(context))
        run.resources.extend(results.shown)

    run = create_run(ctx, TreelessProgram(name), settings, prepare, clock=clock)
    with run.want(*([Robot] if embodied else [])):
        run.tick_to_end()
        report = dict(results.report())
        if output.picture is not None and results.draw is not None:
            _save_picture(results.draw(), output.picture)
    print_result(ctx.info_name or name, run, report)
    if output.as_json:
        print_json({"time_s": round(run.elapsed_s, 3), **report, **run.report})
    return run.exit_code


def _save_picture(image: Image, path: Path) -> None:
    try:
        save_picture(image, path)
    except OSError as error:
        raise SettingsError(f"--picture {path}: cannot be written: {error.strerror}") from error


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
