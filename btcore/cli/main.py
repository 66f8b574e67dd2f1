"""``btcore``: the command line. One file a command; other packages' commands join by entry point."""

import os
import sys
import traceback
from collections.abc import Sequence
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import Any, NoReturn

import click

from btcore import builds
from btcore.cli import entry_points, terminal
from btcore.cli.exit_codes import ExitCode
from btcore.errors import BtcoreError
from btcore.suggestions import join_names, nearest_name

COMMANDS = "btcore.commands"
OWN = ("run", "validate", "show", "convert", "nodes", "schema", "stats", "diff", "bench")

_BROUGHT = "btcore.cli.main.brought"


class CommandLine(click.Group):
    """A group whose commands are imported when they are asked for, and whose errors are sentences."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The commands of btcore, then those of the packages around it."""
        return [*OWN, *(name for name in entry_points.names(COMMANDS) if name not in OWN)]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command called *cmd_name*; one whose package can't be loaded explains that when it is run."""
        if cmd_name in OWN:
            command: click.Command = getattr(import_module(f"btcore.cli.{cmd_name}"), cmd_name)
            return command
        found, missing = entry_points.load(COMMANDS, cmd_name)
        if found:
            brought: click.Command = found[0].value
            ctx.meta[_BROUGHT] = found[0]
            return brought
        return _absent(missing[0]) if missing else None

    def invoke(self, ctx: click.Context) -> Any:
        """As click does; a module that the command finds missing when it needs it is explained."""
        try:
            return super().invoke(ctx)
        except ModuleNotFoundError as error:
            name = ctx.invoked_subcommand or ""
            brought = ctx.meta.get(_BROUGHT)
            origin = entry_points.OWN_DISTRIBUTION if brought is None else brought.distribution
            remedy = entry_points.UnavailableEntryPoint(name, origin, error).remedy
            raise click.ClickException(f"'{name}' needs something more: {remedy}") from error

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """As click does, with the nearest name when there is no such command."""
        name = args[0]
        if self.get_command(ctx, name) is None and not name.startswith("-"):
            known = self.list_commands(ctx)
            meant = nearest_name(name, known)
            hint = f"Did you mean '{meant}'?" if meant else f"The commands are {join_names(known)}."
            raise click.UsageError(f"there is no command '{name}'. {hint}")
        return super().resolve_command(ctx, args)

    def main(
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        complete_var: str | None = None,
        standalone_mode: bool = True,
        **extra: Any,
    ) -> Any:
        """Run the command that *args* name; in stand-alone mode leave the process with its exit code."""
        if not standalone_mode:
            return super().main(args, prog_name, complete_var, standalone_mode=False, **extra)
        try:
            code = super().main(args, prog_name, complete_var, standalone_mode=False, **extra)
            sys.stdout.flush()
        except Exception as error:
            _leave(error)
        except KeyboardInterrupt:
            terminal.stderr_console().print("[bold]interrupted[/]")
            sys.exit(ExitCode.INTERRUPTED)
        sys.exit(code if isinstance(code, int) else ExitCode.SUCCESS)


def _leave(error: Exception) -> NoReturn:
    """Say what went wrong in one message, and exit by the kind of mistake."""
    if isinstance(error, BrokenPipeError):
        # The reader of our output has gone (`btcore nodes | head`); nothing more can be said there.
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123, SIM115
        sys.exit(ExitCode.SUCCESS)
    if builds.env_flag("BTCORE_DEBUG"):
        traceback.print_exception(error)
    if isinstance(error, click.Abort):
        sys.exit(ExitCode.INTERRUPTED)
    if isinstance(error, click.ClickException):
        terminal.print_click_error(error)
        sys.exit(ExitCode.USER_ERROR)
    if isinstance(error, BtcoreError):
        terminal.print_btcore_error(error)
        sys.exit(ExitCode.USER_ERROR)
    terminal.print_error(f"btcore itself failed: {type(error).__name__}: {error}")
    terminal.stderr_console().print(
        "BTCORE_DEBUG=1 shows where. A report of it is welcome.", style="dim", highlight=False
    )
    sys.exit(ExitCode.INTERNAL_ERROR)


def _absent(missing: entry_points.UnavailableEntryPoint) -> click.Command:
    """A stand-in for a command whose package can't be loaded."""

    def explain() -> None:
        raise click.ClickException(f"the command '{missing.name}' can't be loaded: {missing.remedy}")

    return click.Command(
        missing.name,
        callback=explain,
        short_help=f"(not installed: pip install 'btcore[{missing.name}]')",
        context_settings={"ignore_unknown_options": True, "allow_extra_args": True},
        add_help_option=False,
    )


def _version(ctx: click.Context, parameter: click.Parameter, asked: bool) -> None:
    if asked and not ctx.resilient_parsing:
        python = ".".join(str(part) for part in sys.version_info[:3])
        try:
            number = version("btcore")
        except PackageNotFoundError:
            number = "(a checkout, not installed)"
        click.echo(f"btcore {number} ({builds.active_build()} build, Python {python})")
        if remark := builds.unused_build_message():
            click.echo(remark)
        ctx.exit()


@click.group(
    cls=CommandLine,
    no_args_is_help=False,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)
@click.option(
    "--version",
    is_flag=True,
    callback=_version,
    expose_value=False,
    is_eager=True,
    help="Show the version and which build runs.",
)
@click.pass_context
def main(ctx: click.Context) -> None:
    """Behavior trees written for BehaviorTree.CPP, run in Python, and watched live."""
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())
