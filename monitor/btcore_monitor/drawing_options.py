"""The drawing options of all commands that show a tree."""

import os
from typing import TYPE_CHECKING, Annotated, Final, Literal, get_args

import click

from btcore.runs.settings import Settings, option

if TYPE_CHECKING:
    from btcore_monitor.screen.robot_layouts import RobotLayout
    from btcore_monitor.screen.robot_view import RobotView

_PALETTE_VARIABLE: Final = "BTCORE_PALETTE"

PaletteName = Literal["groot", "colour-blind"]
PALETTE_NAMES: Final = get_args(PaletteName)
LogLevel = Literal["trace", "debug", "info", "warn", "error"]
LOG_LEVELS: Final = get_args(LogLevel)

# The types of the fields, which the settings of `btcore run` have, too.
PaletteOption = Annotated[
    PaletteName,
    option(
        "Colours of statuses: Groot's, or colours for red-green colour blindness; also set by the "
        f"environment variable {_PALETTE_VARIABLE}.  [default: {PALETTE_NAMES[0]}]",
        one_run_only=True,
    ),
]
FindOption = Annotated[
    tuple[str, ...],
    option(
        "Highlight nodes whose name or path matches, such as 'Dock*', and show them in the lanes; may be "
        "given several times.",
        metavar="PATTERN",
        one_run_only=True,
    ),
]
LogLevelOption = Annotated[
    LogLevel,
    option(
        "Lowest level in the list of transitions: trace, all; debug, without IDLE; info, results; warn, "
        "FAILURE and missing data; error, exceptions of nodes. It can be changed in the viewer.",
        one_run_only=True,
    ),
]


class DrawingSettings(Settings):
    """A palette, patterns of nodes to highlight, and the lowest level in the log.

    Raises:
        click.BadParameter: The environment variable names no palette.
    """

    palette: PaletteOption | None = None
    find: FindOption = ()
    log_level: LogLevelOption = "trace"

    def __post_init__(self) -> None:
        choose_palette(self.palette)

    def create_view(self, robot_layout: "RobotLayout") -> "RobotView":
        """Return a view of a robot in *robot_layout* with these settings."""
        from btcore_monitor.screen.robot_view import RobotView
        from btcore_monitor.screen.style import PALETTES

        palette = PALETTES[choose_palette(self.palette)]
        return RobotView(robot_layout, palette, self.find, self.log_level.upper())


def choose_palette(given: str | None) -> str:
    """Return the palette *given*, or that of the environment variable, or the default.

    Raises:
        click.BadParameter: The environment variable names no palette.
    """
    name = given or os.environ.get(_PALETTE_VARIABLE) or PALETTE_NAMES[0]
    if name not in PALETTE_NAMES:
        known = ", ".join(map(repr, PALETTE_NAMES))
        raise click.BadParameter(
            f"{name!r} is not one of {known}.", param_hint=f"'--palette' (env var: '{_PALETTE_VARIABLE}')"
        )
    return name
