"""The destinations of a tree's view, with their options, for all commands that show a tree.

Large packages are imported only when they are needed, so that ``--help`` is fast and works without rerun.
"""

import contextlib
import importlib.util
import signal
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

import click

from btcore_monitor.display_options import display_options

if TYPE_CHECKING:
    from btcore_monitor.screen.sinks import RecordingSinks


def viewer_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options for the viewer to *command*.

    The parameters are save, serve_web, screenshot, at, size and memory_limit, and display, a
    :class:`~btcore_monitor.display_options.DisplayOptions`.
    """
    command = display_options(command)
    for option in reversed(_options()):
        command = option(command)
    return command


duration_option = click.option(
    "--duration", type=click.FloatRange(min=0), metavar="SECONDS", help="Stop after this time."
)


def robot_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options for requests to a robot to *command*: no_record and blackboard_rate."""
    for option in reversed(
        [
            click.option(
                "--no-record",
                is_flag=True,
                help="Do not read a C++ robot's recording of transitions: the first client to read it "
                "consumes it.",
            ),
            click.option(
                "--blackboard-rate",
                type=click.FloatRange(min=0, max=100),
                default=2.0,
                show_default=True,
                metavar="HZ",
                help="How often to request a C++ robot's blackboards; 0: never.",
            ),
        ]
    ):
        command = option(command)
    return command


def check_installed(*modules: str) -> None:
    """Raise click.ClickException if one of *modules* is not installed."""
    missing = [name for name in modules if importlib.util.find_spec(name) is None]
    if missing:
        raise click.ClickException(
            f"the monitor needs {missing[0]}, which isn't installed: pip install 'btcore[monitor]'"
        )


def pixels(context: click.Context, option: click.Parameter, value: str) -> tuple[int, int]:
    """Return width and height (pixels) of the option ``--size`` (a click callback)."""
    width, _, height = value.partition("x")
    if not (width.isdigit() and height.isdigit() and int(width) >= 320 and int(height) >= 240):
        raise click.BadParameter(f"'{value}' is not a size: use WIDTHxHEIGHT in pixels, such as 1920x1080")
    return int(width), int(height)


def _options() -> list[Callable[[Callable[..., Any]], Callable[..., Any]]]:
    file = click.Path(dir_okay=False, path_type=Path)
    return [
        click.option("--save", type=file, metavar="FILE.rrd", help="Write a recording."),
        click.option(
            "--serve-web",
            type=click.IntRange(1, 65535),
            is_flag=False,
            flag_value=9090,
            metavar="[PORT]",
            help="Serve the viewer to browsers instead of opening a window.  [port: 9090]",
        ),
        click.option(
            "--screenshot",
            type=file,
            metavar="FILE.png",
            help="Picture of the monitor at the end; needs no display.",
        ),
        click.option(
            "--at",
            type=float,
            metavar="SECONDS",
            help="Tree time of the screenshot; of several robots, time since the first was seen.  "
            "[default: the end]",
        ),
        click.option(
            "--size",
            default="1920x1080",
            callback=pixels,
            show_default=True,
            metavar="WxH",
            help="Of the screenshot.",
        ),
        click.option(
            "--memory-limit",
            default="25%",
            show_default=True,
            metavar="SIZE",
            help="What the viewer may use before it drops its oldest data: 2GB, or a share of the memory.",
        ),
    ]


def check_is_recording(save: Path) -> None:
    """Raise click.UsageError if the file of ``--save`` has not the suffix ``.rrd``."""
    if save.suffix.lower() != ".rrd":
        raise click.UsageError(
            f"--save {save}: a recording is an .rrd file: --save {save.with_suffix('.rrd')}"
        )


def check_folder(option: str, path: Path) -> None:
    """Raise click.UsageError if the folder of *option*'s file does not exist."""
    if not path.resolve().parent.is_dir():
        raise click.UsageError(f"{option} {path}: there is no folder {path.resolve().parent}")


def check_writable(option: str, path: Path) -> None:
    """Raise click.UsageError if *option*'s file cannot be written; an existing file is not changed."""
    check_folder(option, path)
    is_new = not path.exists()
    try:
        with path.open("ab"):
            pass
        if is_new:
            path.unlink()
    except OSError as fault:
        raise click.UsageError(f"{option} {path}: it can't be written: {fault.strerror or fault}") from None


def open_sinks(save: Path | None, web_port: int | None, window: bool, memory_limit: str) -> "RecordingSinks":
    """Open the destinations of a view.

    Args:
        save: The file of the recording, or None.
        web_port: The port of the web viewer, or None.
        window: Whether to open a window.
        memory_limit: The viewer's memory, such as ``2GB`` or ``25%``.

    Raises:
        click.UsageError: There is no destination.
        ScreenError: The viewer or a display is not available.
    """
    from btcore_monitor.screen.sinks import RecordingSinks, open_window, serve_web

    if save is not None:
        check_is_recording(save)
        check_folder("--save", save)
    if web_port is not None:
        web = serve_web(web_port, memory_limit=memory_limit)
        click.echo(f"monitor: look at {web.page}", err=True)
        return RecordingSinks(save=save, viewer=web.address, keep=web)
    if window:
        return RecordingSinks(save=save, viewer=open_window(memory_limit))
    if save is None:
        raise click.UsageError(
            "--no-view leaves nothing to do: add --save FILE.rrd, --serve-web or --screenshot FILE.png"
        )
    return RecordingSinks(save=save)


@contextlib.contextmanager
def stop_on_signals(stop: threading.Event) -> Iterator[None]:
    """Set *stop* on SIGINT (Ctrl-C) and SIGTERM, so that files are completed."""

    def handle(number: int, frame: FrameType | None) -> None:
        stop.set()

    before = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def save_screenshot(recording: Path, picture: Path, at: float | None, size: tuple[int, int]) -> None:
    """Write a screenshot.

    Args:
        recording: The recording.
        picture: The PNG file to write.
        at: Tree time (s), or None for the recording's end.
        size: Width and height (pixels).

    Raises:
        ScreenError: The viewer or a driver is not available.
    """
    from btcore_monitor.screen.screenshot import screenshot

    screenshot(recording, picture, at, size)
    click.echo(f"monitor: the picture is {picture}", err=True)
