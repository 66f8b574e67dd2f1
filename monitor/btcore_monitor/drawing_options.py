"""The drawing options of all commands that show a tree."""

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Self

import click
from click.core import ParameterSource

if TYPE_CHECKING:
    from btcore_monitor.screen.robot_layouts import RobotLayout
    from btcore_monitor.screen.robot_view import RobotView

PALETTE_NAMES: Final = ("groot", "colour-blind")
LOG_LEVELS: Final = ("trace", "debug", "info", "warn", "error")

_OPTIONS: Final[Mapping[str, Mapping[str, Any]]] = {
    "--palette": {
        "type": click.Choice(PALETTE_NAMES),
        "default": PALETTE_NAMES[0],
        "show_default": True,
        "envvar": "BTCORE_PALETTE",
        "help": "Colours of statuses: Groot's, or colours for red-green colour blindness; also set by the "
        "environment variable BTCORE_PALETTE.",
    },
    "--find": {
        "multiple": True,
        "metavar": "PATTERN",
        "help": "Highlight nodes whose name or path matches, such as 'Dock*', and show them in the lanes; "
        "may be given several times.",
    },
    "--log-level": {
        "type": click.Choice(LOG_LEVELS, case_sensitive=False),
        "default": LOG_LEVELS[0],
        "show_default": True,
        "help": "Lowest level in the list of transitions: trace, all; debug, without IDLE; info, results; "
        "warn, FAILURE and missing data; error, exceptions of nodes. It can be changed in the viewer.",
    },
}


@dataclass(frozen=True, slots=True)
class DrawingOptions:
    """The chosen options: a palette, patterns of nodes to highlight, and the lowest level in the log."""

    palette: str = PALETTE_NAMES[0]
    find: Sequence[str] = ()
    log_level: str = LOG_LEVELS[0]

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Self:
        """Return the drawing options in *settings*, all parameter values of a command by name."""
        return cls(settings["palette"], settings["find"], settings["log_level"])

    def arguments(self) -> list[str]:
        """Return the options as arguments for the command line of another command."""
        patterns = [part for pattern in self.find for part in ("--find", pattern)]
        return ["--palette", self.palette, "--log-level", self.log_level, *patterns]

    def create_view(self, robot_layout: "RobotLayout") -> "RobotView":
        """Return a view of a robot in *robot_layout* with these options."""
        from btcore_monitor.screen.robot_view import RobotView
        from btcore_monitor.screen.style import PALETTES

        return RobotView(robot_layout, PALETTES[self.palette], self.find, self.log_level.upper())


def drawing_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the drawing options to *command*, as its parameter `drawing`, a `DrawingOptions`."""

    @functools.wraps(command)
    def with_drawing(*arguments: Any, **settings: Any) -> Any:
        drawing = DrawingOptions.from_settings(settings)
        rest = {name: value for name, value in settings.items() if name not in _list_parameter_names()}
        return command(*arguments, drawing=drawing, **rest)

    # Reversed: click lists options in the order of decorators, of which the last applied is the first.
    for option, attributes in reversed(list(_OPTIONS.items())):
        with_drawing = click.option(option, **attributes)(with_drawing)
    return with_drawing


def create_drawing_options() -> list[click.Option]:
    """Return the drawing options, for a command that is not defined with click's decorators."""
    return [click.Option([option], **attributes) for option, attributes in _OPTIONS.items()]


def list_given_options() -> list[str]:
    """Return the drawing options that are present on the command line of the current command."""
    context = click.get_current_context(silent=True)
    if context is None:
        return []
    return [
        option
        for option, name in zip(_OPTIONS, _list_parameter_names(), strict=True)
        if context.get_parameter_source(name) is ParameterSource.COMMANDLINE
    ]


def _list_parameter_names() -> list[str]:
    return [option.removeprefix("--").replace("-", "_") for option in _OPTIONS]
