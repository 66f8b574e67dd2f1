"""The destinations of a tree's view, with their options, and further options that commands share.

Large packages are imported only when they are needed, so that `--help` is fast and works without rerun.
"""

import contextlib
import functools
import importlib.util
import os
import signal
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, Final, NoReturn

import click

from btcore.extras import install_command
from btcore_monitor.console import print_line
from btcore_monitor.display_options import display_options
from btcore_monitor.errors import RecordingError

if TYPE_CHECKING:
    from btcore_monitor.keys import ClientKeys
    from btcore_monitor.screen.sinks import RecordingSinks, WebView

INCOMPLETE_OUTPUT: Final = 4
"""The exit code, as of `btcore run`, if a recording is incomplete."""

END_WITHIN: Final = 30.0
"""Seconds after a time limit within which a command completes its data; after that its process ends."""

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


key_file_option = click.option(
    "--key-file",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Your secret key (see btcore keys), for a robot that was started with --allow-key.",
)
robot_key_option = click.option(
    "--robot-key",
    "robot_keys",
    multiple=True,
    metavar="KEY",
    help="With --key-file: the robot's public key, or the file with it.",
)


def client_keys(
    key_file: Path | None, robot_keys: Sequence[str], robots: int = 1
) -> "Sequence[ClientKeys | None]":
    """Return the keys for the connection to each robot, from the options `--key-file` and `--robot-key`.

    Args:
        key_file: The value of `--key-file`.
        robot_keys: The values of `--robot-key`: one for all robots, or one per robot.
        robots: The number of robots.

    Raises:
        click.UsageError: An option is missing, or a key cannot be used.
    """
    if key_file is None:
        if robot_keys:
            raise click.UsageError("--robot-key needs --key-file with your secret key (see btcore keys)")
        return [None] * robots
    if not robot_keys:
        raise click.UsageError("--key-file needs --robot-key with the robot's public key")
    if len(robot_keys) not in (1, robots):
        raise click.UsageError(
            f"--robot-key is given {len(robot_keys)} times for {robots} robot{'s' * (robots > 1)}: give it "
            "once, or once per ADDRESS in their order"
        )
    from btcore_monitor.keys import ClientKeys, KeyFileError

    try:
        keys = [ClientKeys(key_file, key) for key in robot_keys]
    except KeyFileError as error:
        raise click.UsageError(str(error)) from None
    return keys if len(keys) == robots else keys * robots


def check_installed(*modules: str) -> None:
    """Raise click.ClickException if one of *modules* is not installed."""
    missing = [name for name in modules if importlib.util.find_spec(name) is None]
    if missing:
        command = install_command(missing[0], "monitor")
        raise click.ClickException(f"the monitor needs {missing[0]}, which is not installed: {command}")


def pixels(context: click.Context, option: click.Parameter, value: str) -> tuple[int, int]:
    """Return width and height (pixels) from the text of the option `--size`; a click callback.

    Raises:
        click.BadParameter: *value* is not a size, or less than 320x240.
    """
    width, _, height = value.partition("x")
    if not (width.isdigit() and height.isdigit() and int(width) >= 320 and int(height) >= 240):
        raise click.BadParameter(f"'{value}' is not a size: use WIDTHxHEIGHT in pixels, such as 1920x1080")
    return int(width), int(height)


def check_is_recording(save: Path) -> None:
    """Raise click.UsageError if the file of `--save` does not have the suffix `.rrd`."""
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
    except OSError as error:
        raise click.UsageError(f"{option} {path}: it can't be written: {error.strerror or error}") from None


@contextlib.contextmanager
def exit_on_sigterm() -> Iterator[Callable[[], contextlib.AbstractContextManager[None]]]:
    """Let SIGTERM raise SystemExit, so that the processes that were started are ended.

    Yield a function whose context delays the exception until its end: raised while a process is being
    started, it would leave the process behind.
    """
    delayed = False
    received: list[int] = []

    def handle(number: int, frame: FrameType | None) -> None:
        received.append(number)
        if not delayed:
            raise SystemExit(128 + number)

    @contextlib.contextmanager
    def delay() -> Iterator[None]:
        nonlocal delayed
        delayed = True
        try:
            yield
        finally:
            delayed = False
        if received:
            raise SystemExit(128 + received[0])

    if threading.current_thread() is not threading.main_thread():
        yield delay  # only the main thread may set handlers
        return
    before = signal.signal(signal.SIGTERM, handle)
    try:
        yield delay
    finally:
        signal.signal(signal.SIGTERM, before)


@contextlib.contextmanager
def stop_on_signals(stop: threading.Event) -> Iterator[None]:
    """Set *stop* on SIGINT (Ctrl-C) and SIGTERM, so that files are completed."""

    def handle(number: int, frame: FrameType | None) -> None:
        stop.set()

    # Only the main thread may set handlers, so commands call this function there.
    before = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def wait_for_stop(duration: float | None = None) -> None:
    """Return on SIGINT or SIGTERM, or after *duration* s, while a view is served to browsers."""
    print_line("monitor: Ctrl-C ends it", err=True)
    stop = threading.Event()
    with stop_on_signals(stop):
        stop.wait(duration)


@contextlib.contextmanager
def time_limit(duration: float | None) -> Iterator[None]:
    """End the process if the `with` block lasts much longer than *duration* s.

    The block itself should end in time. But drawing the tree of a hostile robot may take minutes.
    """
    if duration is None:
        yield
        return
    error = RecordingError(
        f"the time limit of {duration:g} s is over, and the recording could not be completed within another "
        f"{END_WITHIN:g} s: the tree may be too big to be drawn"
    )
    watchdog = threading.Timer(duration + END_WITHIN, abandon, [error])
    watchdog.daemon = True
    watchdog.start()
    try:
        yield
    finally:
        watchdog.cancel()


def abandon(error: RecordingError) -> NoReturn:
    """Print *error*, and end the process with the exit code 4, without closing the recording."""
    print_line(f"error: {error}", err=True)
    sys.stdout.flush()
    os._exit(INCOMPLETE_OUTPUT)


@dataclass(frozen=True, slots=True)
class ViewerOptions:
    """The destinations of a view, as chosen by the options of `viewer_options`.

    *at* is the displayed time (s) of the screenshot (None: the last tick), and *size* is its width
    and height in pixels. *verbose* is true if rerun prints its log lines.
    """

    save: Path | None
    serve_web: int | None
    screenshot: Path | None
    at: float | None
    size: tuple[int, int]
    memory_limit: str
    verbose: bool

    def given(self) -> list[str]:
        """Return the options that name a destination and are present on the command line."""
        names = ("save", "serve_web", "screenshot")
        return [f"--{name.replace('_', '-')}" for name in names if getattr(self, name) is not None]

    @contextlib.contextmanager
    def open(self, window: bool) -> "Iterator[RecordingSinks]":
        """Open the destinations, and also a window if *window* is true and the view is not served.

        A screenshot is made from a recording file. Without `--save` this file is temporary, and exists
        until the end of the `with` block.

        Raises:
            click.UsageError: There is no destination, a file has the wrong suffix, or its folder does not
                exist.
            ScreenError: The viewer or a display is not available.
        """
        from btcore_monitor.screen.sinks import RecordingSinks, open_window

        with contextlib.ExitStack() as stack:
            save = self.save
            if self.screenshot is not None:
                check_folder("--screenshot", self.screenshot)
                if save is None:
                    folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="btcore-"))
                    save = Path(folder) / "screenshot.rrd"
            if save is not None:
                check_is_recording(save)
                check_folder("--save", save)
            if self.serve_web is not None:
                web = self.open_web(self.serve_web)  # served as long as this object exists
                yield RecordingSinks(save=save, relay=web.address)
            elif window:
                opened = open_window(self.memory_limit, verbose=self.verbose)
                yield RecordingSinks(save=save, window=opened)
            elif save is not None:
                yield RecordingSinks(save=save)
            else:
                raise click.UsageError(
                    "--no-view leaves nothing to do: add --save FILE.rrd, --serve-web or "
                    "--screenshot FILE.png"
                )

    def open_web(self, port: int) -> "WebView":
        """Serve the web viewer on *port*, and print its address.

        Raises:
            ScreenError: The page cannot be served on *port*.
        """
        from btcore_monitor.screen.sinks import serve_web

        web = serve_web(port, memory_limit=self.memory_limit)
        print_line(f"monitor: look at {web.page}", err=True)
        return web

    def take_screenshot(self, recordings: Sequence[Path]) -> None:
        """Write the picture of the last of *recordings* to the file of `--screenshot`, if it is given.

        Raises:
            ScreenError: The viewer or a driver is not available.
            click.ClickException: The file cannot be written.
        """
        if self.screenshot is not None and recordings:
            from btcore_monitor.screen.screenshot import screenshot

            try:
                screenshot(recordings[-1], self.screenshot, self.at, self.size)
            except OSError as error:
                reason = error.strerror or error
                raise click.ClickException(f"cannot write the picture {self.screenshot}: {reason}") from error
            print_line(f"monitor: the picture is {self.screenshot}", err=True)


def viewer_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options for the viewer to *command*.

    The parameters are `viewer`, a `ViewerOptions`, and `display`, a
    `DisplayOptions`.
    """
    # The display options first, so that they follow the options of the viewer in the help text.
    command = display_options(command)

    @functools.wraps(command)
    def with_viewer(*arguments: Any, **settings: Any) -> Any:
        if not settings["verbose"]:
            # rerun reads the variable when it is imported, so this precedes the imports of the command.
            os.environ.setdefault("RUST_LOG", "off")
        viewer = ViewerOptions(**{field.name: settings.pop(field.name) for field in fields(ViewerOptions)})
        return command(*arguments, viewer=viewer, **settings)

    for option in reversed(_options()):
        with_viewer = option(with_viewer)
    return with_viewer


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
            help="Picture of the monitor at the last tick; needs no display.",
        ),
        click.option(
            "--at",
            type=float,
            metavar="SECONDS",
            help="Time of the screenshot, as the viewer shows it: since the first data of the robot, or of "
            "the first of several robots.  [default: the last tick]",
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
        click.option("--verbose", is_flag=True, help="Print the log of the viewer (rerun)."),
    ]
