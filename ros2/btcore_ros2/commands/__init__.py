"""The command group `btcore ros2`. A command is imported when it is used."""

from importlib import import_module

import click

COMMANDS = ("doctor", "messages", "navigation", "navigator", "serve", "sim")
"""The commands; the module of the same name in this package contains the click command."""


class RosGroup(click.Group):
    """A group whose commands are imported when they are used."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the commands."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return the command *cmd_name*, or None."""
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = getattr(import_module(f"{__name__}.{cmd_name}"), cmd_name)
        return command


@click.group("ros2", cls=RosGroup)
def ros2() -> None:
    """Use ROS 2: serve trees, simulate a robot, replace parts of Nav2."""
