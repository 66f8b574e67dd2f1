"""What commands of other packages need to run a tree or a program with the providers of a run.

A command of class `ProviderCommand` has the options of all providers. `create_run` opens the providers of the
types that the program wants, such as a robot, and advances the time of the robot's world until the program
ends:

    @click.command("patrol", cls=ProviderCommand)
    @click.pass_context
    def patrol(ctx: click.Context, /, settings: GivenSettings) -> int:
        program = TreelessProgram("Patrol")
        with create_run(ctx, program, settings, prepare).want(Robot) as run:
            run.tick_to_end()
        return run.exit_code
"""

from collections.abc import Mapping, Sequence

import click
from rich.text import Text

from btcore.cli import terminal
from btcore.cli.node_libraries import NodeLibraries
from btcore.cli.provider_command import ProviderCommand, command_providers, create_run
from btcore.cli.run_summary import END_REASON_TEXT, print_reports
from btcore.cli.terminal import print_json
from btcore.registry.registry import Registry
from btcore.runs.run import Run, TreelessProgram
from btcore.runs.settings import GivenSettings

__all__ = [
    "GivenSettings",
    "ProviderCommand",
    "TreelessProgram",
    "create_run",
    "load_nodes",
    "print_json",
    "print_result",
]


def load_nodes(ctx: click.Context, plugins: Sequence[str]) -> Registry:
    """Return the nodes of the installed libraries and of *plugins*.

    Args:
        ctx: The context of a command of class `ProviderCommand`.
        plugins: Modules and Python files, such as the values of the option `--plugin`.

    Raises:
        RegistrationError: A plugin cannot be loaded.
        click.UsageError: A plugin is given twice.
    """
    return NodeLibraries(plugins, imported=command_providers(ctx).plugins).nodes


def print_result(name: str, run: Run, own_report: Mapping[str, object]) -> None:
    """Print the summary of a program on stderr.

    Args:
        name: The name of the program.
        run: The run of the program, which has ended.
        own_report: The program's own report.
    """
    took = f"{run.elapsed_s:.1f} s{END_REASON_TEXT[run.end_reason]}"
    terminal.stderr_console().print(Text.assemble(("■ ", "dim"), (name, "bold"), "  ", took), soft_wrap=True)
    print_reports({**({name: own_report} if own_report else {}), **run.report})
