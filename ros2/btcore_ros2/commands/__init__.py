"""The command group `btcore ros2`. A command is imported when it is used."""

from importlib import import_module

import click

COMMANDS: dict[str, str] = {
    "doctor": "doctor",
    "messages": "messages",
    "navigation": "navigation",
    "serve": "serve",
    "navigator": "navigator",
    "sim": "sim",
}
"""The module of each command, relative to this package; it contains a click command of the same name."""


class RosGroup(click.Group):
    """A group whose commands are imported when they are used."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the commands."""
        return sorted(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return the command *cmd_name*, or None."""
        module = COMMANDS.get(cmd_name)
        if module is None:
            return None
        command: click.Command = getattr(import_module(f"{__name__}.{module}"), module)
        return command


@click.group("ros2", cls=RosGroup)
def ros2() -> None:
    """Use ROS 2: serve trees, simulate a robot, replace parts of Nav2."""
