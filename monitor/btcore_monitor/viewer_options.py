"""The options for what is shown and written of a tree: `DrawingOptions`, `OutputOptions` and `ViewerOptions`.

Each adds options to the previous. Those of `btcore run` are based on `OutputOptions`. Large packages are
imported only when they are needed, so that `--help` is fast and works without rerun.
"""

import contextlib
import functools
import os
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal, get_args

from btcore.errors import SettingsError
from btcore.field_options import create_options
from btcore.options import Options, option
from btcore_monitor.console import print_message
from btcore_monitor.environment_checks import check_folder, check_is_recording

if TYPE_CHECKING:
    from btcore_monitor.screen.robot_layouts import RobotLayout
    from btcore_monitor.screen.robot_view import RobotView
    from btcore_monitor.screen.sinks import RecordingSinks, WebView

_PALETTE_VARIABLE: Final = "BTCORE_PALETTE"

PaletteName = Literal["groot", "colour-blind"]
PALETTE_NAMES: Final = get_args(PaletteName)
LogLevel = Literal["trace", "debug", "info", "warn", "error"]
LOG_LEVELS: Final = get_args(LogLevel)

one_run_option: Final = functools.partial(option, one_run_only=True)
"""An option that simultaneous runs cannot share."""


class DrawingOptions(Options, kw_only=True):
    """A palette, patterns of nodes to highlight, and the lowest level in the log.

    Raises:
        SettingsError: The environment variable names no palette.
    """

    palette: (
        Annotated[
            PaletteName,
            one_run_option(
                "Colours of statuses: Groot's, or colours for red-green colour blindness; also set by the "
                f"environment variable {_PALETTE_VARIABLE}.  [default: {PALETTE_NAMES[0]}]"
            ),
        ]
        | None
    ) = None
    find: Annotated[
        tuple[str, ...],
        one_run_option(
            "Highlight nodes whose name or path matches, such as 'Dock*', and show them in the lanes; may be "
            "given several times.",
            metavar="PATTERN",
        ),
    ] = ()
    log_level: Annotated[
        LogLevel,
        one_run_option(
            "Lowest level in the list of transitions: trace, all; debug, without IDLE; info, results; warn, "
            "FAILURE and missing data; error, exceptions of nodes. It can be changed in the viewer."
        ),
    ] = "trace"

    def __post_init__(self) -> None:
        choose_palette(self.palette)

    def create_view(self, robot_layout: "RobotLayout") -> "RobotView":
        """Return a view of a robot in *robot_layout* with these options."""
        from btcore_monitor.screen.robot_view import RobotView
        from btcore_monitor.screen.style import PALETTES

        palette = PALETTES[choose_palette(self.palette)]
        return RobotView(robot_layout, palette, self.find, self.log_level.upper())


DRAWING_OPTION_NAMES: Final = tuple(item.opts[0] for item in create_options(DrawingOptions))


def choose_palette(option: str | None) -> str:
    """Return the palette *option*, or that of the environment variable, or the default.

    Raises:
        SettingsError: The environment variable names no palette.
    """
    name = option or os.environ.get(_PALETTE_VARIABLE) or PALETTE_NAMES[0]
    if name not in PALETTE_NAMES:
        known = ", ".join(map(repr, PALETTE_NAMES))
        raise SettingsError(
            f"invalid value for '--palette' (env var: '{_PALETTE_VARIABLE}'): {name!r} is not one of {known}."
        )
    return name


class OutputOptions(DrawingOptions):
    """Where the drawing of a tree is written and shown."""

    save: (
        Annotated[Path, one_run_option("Write a recording for the viewer (rerun).", metavar="FILE.rrd")]
        | None
    ) = None
    screenshot: (
        Annotated[
            Path,
            one_run_option(
                "Write a picture of the monitor at the last tick; needs no display.", metavar="FILE.png"
            ),
        ]
        | None
    ) = None
    serve_web: (
        Annotated[
            int,
            one_run_option(
                "Serve the viewer to browsers until Ctrl-C, without opening a window.  [port: 9090]",
                metavar="[PORT]",
                ge=1,
                le=65535,
                bare_value=9090,
            ),
        ]
        | None
    ) = None
    verbose: Annotated[
        bool,
        one_run_option("Print the log of the viewer (rerun); a run also prints when its monitors connect."),
    ] = False

    @property
    def output_files(self) -> dict[str, Path]:
        """The given options that name a file to write, with their files."""
        files = {"--save": self.save, "--screenshot": self.screenshot}
        return {name: file for name, file in files.items() if file is not None}

    @property
    def outputs(self) -> list[str]:
        """The given options that show or write something, such as `--save`."""
        return [*self.output_files, *([] if self.serve_web is None else ["--serve-web"])]


class ViewerOptions(OutputOptions):
    """The options of `btcore monitor` and `btcore replay`.

    Raises:
        SettingsError: The size is invalid, or the environment variable names no palette.
    """

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

    def __post_init__(self) -> None:
        super().__post_init__()
        _parse_size(self.size)

    def quiet_viewer(self) -> None:
        """Suppress the log of the viewer, unless it is verbose. Call it before rerun is imported."""
        if not self.verbose:
            os.environ.setdefault("RUST_LOG", "off")

    @contextlib.contextmanager
    def open_sinks(self, opens_viewer: bool) -> "Iterator[RecordingSinks]":
        """Open the destinations, and also a viewer if *opens_viewer* is true and the view is not served.

        A screenshot is made from a recording file. Without `--save` this file is temporary, and exists
        until the end of the `with` block.

        Raises:
            SettingsError: There is no destination, a file has the wrong suffix, or its folder does not
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
                raise SettingsError(
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
        print_message(f"look at {web.page}")
        return web

    def take_screenshot(self, recordings: Sequence[Path]) -> None:
        """Write the picture of the last of *recordings* to the file of `--screenshot`, if it is given.

        Raises:
            ScreenError: The viewer or a driver is not available, or the file cannot be written.
        """
        if self.screenshot is not None and recordings:
            from btcore_monitor.screen.rerun_process import ScreenError
            from btcore_monitor.screen.screenshot import write_screenshot

            try:
                write_screenshot(recordings[-1], self.screenshot, self.at, _parse_size(self.size))
            except OSError as error:
                reason = error.strerror or error
                raise ScreenError(f"cannot write the picture {self.screenshot}: {reason}") from error
            print_message(f"the picture is {self.screenshot}")


def _parse_size(text: str) -> tuple[int, int]:
    """Return width and height (pixels), at least 320x240, from the value of the option `--size`."""
    width, _, height = text.partition("x")
    if not (width.isdigit() and height.isdigit() and int(width) >= 320 and int(height) >= 240):
        raise SettingsError(
            f"invalid value for '--size': '{text}' is not a size: use WIDTHxHEIGHT in pixels, such as "
            "1920x1080"
        )
    return int(width), int(height)
