"""The options for the viewer: the destinations of a tree's view, and how they are opened.

Large packages are imported only when they are needed, so that `--help` is fast and works without rerun.
"""

import contextlib
import functools
import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click

from btcore.runs.settings import Settings, option, option_names, pass_settings
from btcore_monitor.console import print_line
from btcore_monitor.drawing_options import DrawingSettings
from btcore_monitor.output_files import check_folder, check_is_recording

if TYPE_CHECKING:
    from btcore_monitor.screen.sinks import RecordingSinks, WebView


class ViewerSettings(Settings):
    """The destinations of a view, and how they are opened.

    Raises:
        click.BadParameter: The size is invalid.
    """

    save: Annotated[Path, option("Write a recording.", metavar="FILE.rrd")] | None = None
    serve_web: (
        Annotated[
            int,
            option(
                "Serve the viewer to browsers instead of opening a window.  [port: 9090]",
                metavar="[PORT]",
                ge=1,
                le=65535,
                bare_value=9090,
            ),
        ]
        | None
    ) = None
    screenshot: (
        Annotated[
            Path,
            option("Picture of the monitor at the last tick; needs no display.", metavar="FILE.png"),
        ]
        | None
    ) = None
    at: (
        Annotated[
            float,
            option(
                "Time of the screenshot, as the viewer shows it: since the first data of the robot, or of "
                "the first of several robots.  [default: the last tick]",
                metavar="SECONDS",
            ),
        ]
        | None
    ) = None
    size: Annotated[str, option("Of the screenshot.", metavar="WxH")] = "1920x1080"
    memory_limit: Annotated[
        str,
        option(
            "What the viewer may use before it drops its oldest data: 2GB, or a share of the memory.",
            metavar="SIZE",
        ),
    ] = "25%"
    verbose: Annotated[bool, option("Print the log of the viewer (rerun).")] = False

    def __post_init__(self) -> None:
        _parse_size(self.size)

    def list_given(self) -> list[str]:
        """Return the options that name a destination and are present on the command line."""
        return [name for name in option_names(self) if name in ("--save", "--serve-web", "--screenshot")]

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
                write_screenshot(recordings[-1], self.screenshot, self.at, _parse_size(self.size))
            except OSError as error:
                reason = error.strerror or error
                raise click.ClickException(f"cannot write the picture {self.screenshot}: {reason}") from error
            print_line(f"monitor: the picture is {self.screenshot}", err=True)


def _parse_size(text: str) -> tuple[int, int]:
    """Return width and height (pixels) from the value of the option `--size`.

    Raises:
        click.BadParameter: *text* is not a size, or less than 320x240.
    """
    width, _, height = text.partition("x")
    if not (width.isdigit() and height.isdigit() and int(width) >= 320 and int(height) >= 240):
        raise click.BadParameter(
            f"'{text}' is not a size: use WIDTHxHEIGHT in pixels, such as 1920x1080", param_hint="'--size'"
        )
    return int(width), int(height)


def viewer_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options for the viewer to *command*.

    The parameters are `options`, `ViewerSettings`, and `drawing`, `DrawingSettings`.
    """

    @functools.wraps(command)
    def with_viewer(*arguments: Any, options: ViewerSettings, **others: Any) -> Any:
        if not options.verbose:
            # rerun reads the variable when it is imported, so this precedes the imports of the command.
            os.environ.setdefault("RUST_LOG", "off")
        return command(*arguments, options=options, **others)

    # The drawing options first, so that they follow the options of the viewer in the help text.
    return pass_settings(ViewerSettings, "options")(pass_settings(DrawingSettings, "drawing")(with_viewer))
