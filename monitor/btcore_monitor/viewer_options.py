"""The options for the viewer: the destinations of a tree's view, and how they are opened.

Large packages are imported only when they are needed, so that `--help` is fast and works without rerun.
"""

import contextlib
import functools
import os
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from btcore_monitor.console import print_line
from btcore_monitor.drawing_options import drawing_options
from btcore_monitor.output_files import check_folder, check_is_recording

if TYPE_CHECKING:
    from btcore_monitor.screen.sinks import RecordingSinks, WebView

_FILE: Final = click.Path(dir_okay=False, path_type=Path)

DESTINATIONS: Final[Mapping[str, Mapping[str, Any]]] = {
    "--save": {"type": _FILE, "metavar": "FILE.rrd"},
    "--serve-web": {
        "type": click.IntRange(1, 65535),
        "is_flag": False,
        "flag_value": 9090,
        "metavar": "[PORT]",
    },
    "--screenshot": {"type": _FILE, "metavar": "FILE.png"},
}
"""The options that name a destination of a view, with their attributes except the help text.

The help text depends on the command."""


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

    def list_given(self) -> list[str]:
        """Return the options that name a destination and are present on the command line."""
        return [
            option
            for option in DESTINATIONS
            if getattr(self, option.removeprefix("--").replace("-", "_")) is not None
        ]

    @contextlib.contextmanager
    def open_sinks(self, opens_viewer: bool) -> "Iterator[RecordingSinks]":
        """Open the destinations, and also a viewer if *opens_viewer* is true and the view is not served.

        A screenshot is made from a recording file. Without `--save` this file is temporary, and exists
        until the end of the `with` block.

        Raises:
            click.UsageError: There is no destination, a file has the wrong suffix, or its folder does not
                exist.
            ScreenError: The viewer or a display is not available.
        """
        from btcore_monitor.screen.sinks import RecordingSinks, open_viewer

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
            elif opens_viewer:
                viewer = open_viewer(self.memory_limit, verbose=self.verbose)
                yield RecordingSinks(save=save, viewer=viewer)
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
            from btcore_monitor.screen.screenshot import write_screenshot

            try:
                write_screenshot(recordings[-1], self.screenshot, self.at, self.size)
            except OSError as error:
                reason = error.strerror or error
                raise click.ClickException(f"cannot write the picture {self.screenshot}: {reason}") from error
            print_line(f"monitor: the picture is {self.screenshot}", err=True)


def parse_size(context: click.Context, option: click.Parameter, value: str) -> tuple[int, int]:
    """Return width and height (pixels) from the text of the option `--size`; a click callback.

    Raises:
        click.BadParameter: *value* is not a size, or less than 320x240.
    """
    width, _, height = value.partition("x")
    if not (width.isdigit() and height.isdigit() and int(width) >= 320 and int(height) >= 240):
        raise click.BadParameter(f"'{value}' is not a size: use WIDTHxHEIGHT in pixels, such as 1920x1080")
    return int(width), int(height)


def viewer_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options for the viewer to *command*.

    The parameters are `options`, a `ViewerOptions`, and `drawing`, a `DrawingOptions`.
    """
    # The drawing options first, so that they follow the options of the viewer in the help text.
    command = drawing_options(command)

    @functools.wraps(command)
    def with_viewer(*arguments: Any, **settings: Any) -> Any:
        if not settings["verbose"]:
            # rerun reads the variable when it is imported, so this precedes the imports of the command.
            os.environ.setdefault("RUST_LOG", "off")
        options = ViewerOptions(**{field.name: settings.pop(field.name) for field in fields(ViewerOptions)})
        return command(*arguments, options=options, **settings)

    for option in reversed(_create_options()):
        with_viewer = option(with_viewer)
    return with_viewer


def _create_options() -> list[Callable[[Callable[..., Any]], Callable[..., Any]]]:
    return [
        click.option("--save", **DESTINATIONS["--save"], help="Write a recording."),
        click.option(
            "--serve-web",
            **DESTINATIONS["--serve-web"],
            help="Serve the viewer to browsers instead of opening a window.  [port: 9090]",
        ),
        click.option(
            "--screenshot",
            **DESTINATIONS["--screenshot"],
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
            callback=parse_size,
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
