"""The `btcore` command: a click group whose commands are imported when they are used.

Each command of btcore is a file in `btcore/cli/commands`. Other packages add commands by entry points.
"""

# Modules that only errors or single commands need (rich, traceback, btcore.errors) are imported where they
# are used, so that commands start fast.
import errno
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final, NoReturn

import click

import btcore
from btcore import builds, entry_points
from btcore.exit_codes import ExitCode

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

OWN_COMMANDS: Final = ("run", "validate", "nodes")
SHORT_HELP: Final = {
    "run": "Run a tree until it ends.",
    "validate": "Check trees, and report all errors and warnings.",
    "nodes": "List the available nodes and their ports.",
    "book": "Run an example from the book 'A Concise Introduction to Robot Programming with ROS2'.",
    "convert": "Convert a tree from XML format 3 to format 4.",
    "diff": "Find the first difference between two logs.",
    "drive": "Drive the robot with keys, and make a map.",
    "hook": "Set breakpoints, step, and inject statuses in a tree, by Groot 2's protocol.",
    "keys": "Create a key pair for encrypted connections.",
    "lsp": "Start the language server for editors.",
    "map": "Write the map of a world as YAML and PGM files for map_server.",
    "mcp": "Serve AI agents that write trees (MCP).",
    "monitor": "Watch running behavior trees of btcore, BehaviorTree.CPP or Nav2.",
    "prove": "Prove what holds in every run of a tree.",
    "record": "Record a running robot into log files.",
    "replay": "Show a log again, as text or in the viewer, or run a recording again.",
    "ros2": "Use ROS 2: serve trees, simulate a robot, replace parts of Nav2.",
    "schema": "Print an XML schema (XSD) for XML editors.",
    "show": "Draw a tree, or list its data flow.",
    "stats": "Print statistics of the nodes in a log.",
    "studio": "Edit trees in a browser, and watch them run.",
    "sweep": "Run a tree many times in parallel, and compare.",
    "why": "Explain why a node of a recorded run did what it did.",
    "world": "Make a random office or home.",
}
"""The lines of `btcore --help`, also for btcore's other packages: to import all commands takes a second."""


class CommandLine(click.Group):
    """A group that imports its commands on demand and prints each error as a message, without a traceback."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of btcore's commands, then those that installed packages add."""
        added = [point.name for point in entry_points.find(entry_points.COMMANDS_GROUP)]
        return list(dict.fromkeys([*OWN_COMMANDS, *added]))

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return the command *cmd_name*, or None.

        A command that cannot be imported is replaced by a command that explains what to install.
        """
        if cmd_name in OWN_COMMANDS:
            own: click.Command = getattr(import_module(f"btcore.cli.commands.{cmd_name}"), cmd_name)
            return own
        loaded, unavailable = entry_points.load(entry_points.COMMANDS_GROUP, cmd_name)
        if loaded:
            command: click.Command = loaded[0].value
            return command
        return _create_placeholder(unavailable[0]) if unavailable else None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands with their short help, without importing those of btcore."""
        with formatter.section("Commands"):
            formatter.write_dl([*self._read_short_help(ctx).items()])

    def shell_complete(self, ctx: click.Context, incomplete: str) -> "list[CompletionItem]":
        """Return the commands and options that begin with *incomplete*, without importing those of btcore."""
        from click.shell_completion import CompletionItem

        matching = [item for item in self._read_short_help(ctx).items() if item[0].startswith(incomplete)]
        commands = [CompletionItem(name, help=text) for name, text in matching]
        return [*commands, *click.Command.shell_complete(self, ctx, incomplete)]

    def _read_short_help(self, ctx: click.Context) -> dict[str, str]:
        """Return the short help of each command by name. Commands of other distributions are imported."""
        short_help = {}
        for name in self.list_commands(ctx):
            command = None if name in SHORT_HELP else self.get_command(ctx, name)
            short_help[name] = SHORT_HELP[name] if command is None else command.get_short_help_str(100)
        return short_help

    def invoke(self, ctx: click.Context) -> Any:
        """Invoke the command; if it fails to import an optional module, explain what to install."""
        try:
            return super().invoke(ctx)
        except ModuleNotFoundError as error:
            if (error.name or "").startswith("btcore."):
                raise  # an error of btcore itself
            name = ctx.invoked_subcommand or ""
            added = {
                point.name: point.distribution for point in entry_points.find(entry_points.COMMANDS_GROUP)
            }
            distribution = added.get(name, entry_points.OWN_DISTRIBUTION)
            remedy = entry_points.UnavailableEntryPoint(name, distribution, error).remedy
            raise click.ClickException(f"'{name}' requires an optional dependency: {remedy}") from error

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Resolve the command's name; the error for an unknown name suggests the nearest name."""
        name = args[0]
        if self.get_command(ctx, name) is None and not name.startswith("-"):
            from btcore.suggestions import did_you_mean, join_names

            known = self.list_commands(ctx)
            hint = did_you_mean(name, known) or f"; available commands: {join_names(known)}"
            raise click.UsageError(f"unknown command '{name}'{hint}")
        return super().resolve_command(ctx, args)

    def main(
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        complete_var: str | None = None,
        standalone_mode: bool = True,
        **extra: Any,
    ) -> Any:
        """Run the command in *args*. In standalone mode exit with the command's `ExitCode`."""
        if not standalone_mode:
            return super().main(args, prog_name, complete_var, standalone_mode=False, **extra)
        encodings = {getattr(stream, "encoding", None) or "utf-8" for stream in (sys.stdout, sys.stderr)}
        if not all(encoding.lower().startswith("utf") for encoding in encodings):  # few terminals
            from btcore.cli.terminal_encoding import make_encodable

            make_encodable()
        try:
            code = super().main(args, prog_name, complete_var, standalone_mode=False, **extra)
            sys.stdout.flush()
        except Exception as error:
            _exit_for_error(error)
        except KeyboardInterrupt:
            _exit_after_interrupt()
        sys.exit(code if isinstance(code, int) else ExitCode.SUCCESS)


def _exit_after_interrupt() -> NoReturn:
    from btcore.cli import terminal

    terminal.stderr_console().print("[bold]interrupted[/]")
    # CPython remembers that an interrupt ended an `eval`, such as that of `collections.namedtuple`, and would
    # exit by the signal, not with this code. The next `eval` clears the memory.
    eval("None")
    sys.exit(ExitCode.INTERRUPTED)


def _exit_for_error(error: Exception) -> NoReturn:
    from btcore.cli import terminal
    from btcore.errors import BtcoreError, NodeExecutionError

    if isinstance(error, BrokenPipeError):
        # The reader of stdout has exited (`btcore nodes | head`). Python flushes stdout once more at exit:
        # without a new stdout that would print a second error.
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123, SIM115
        sys.exit(ExitCode.SUCCESS)
    if builds.env_flag("BTCORE_DEBUG"):
        import traceback

        traceback.print_exception(error)
    if isinstance(error, click.Abort):  # click raises it for KeyboardInterrupt
        _exit_after_interrupt()
    if isinstance(error, click.ClickException):
        terminal.print_click_error(error)
        sys.exit(ExitCode.USER_ERROR)
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        # Mostly stdout, as other errors are reported where they occur. Python would flush it again, as above.
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123, SIM115
        terminal.print_error(f"cannot write {error.filename or 'the output'}: {error.strerror}")
        sys.exit(ExitCode.INCOMPLETE_OUTPUT)
    if isinstance(error, BtcoreError):
        terminal.print_btcore_error(error)
        sys.exit(ExitCode.LEAF_ERROR if isinstance(error, NodeExecutionError) else ExitCode.USER_ERROR)
    terminal.print_error(f"internal error (please report it): {type(error).__name__}: {error}")
    terminal.stderr_console().print(
        "Set BTCORE_DEBUG=1 to print the traceback.", style="dim", highlight=False
    )
    sys.exit(ExitCode.INTERNAL_ERROR)


def _create_placeholder(unavailable: entry_points.UnavailableEntryPoint) -> click.Command:
    """Return a command that takes the place of a command that cannot be imported, and explains why."""

    def explain() -> None:
        raise click.ClickException(f"the command '{unavailable.name}' cannot be loaded: {unavailable.remedy}")

    return click.Command(
        unavailable.name,
        callback=explain,
        context_settings={"ignore_unknown_options": True, "allow_extra_args": True},
        add_help_option=False,
    )


def _print_version(ctx: click.Context, parameter: click.Parameter, requested: bool) -> None:
    if requested and not ctx.resilient_parsing:
        python = ".".join(str(part) for part in sys.version_info[:3])
        click.echo(f"btcore {btcore.__version__} ({builds.active_build()} build, Python {python})")
        if message := builds.unused_build_message():
            click.echo(message)
        ctx.exit()


def _set_max_file_size(ctx: click.Context, parameter: click.Parameter, text: str | None) -> None:
    """Set the limit in the environment, which also reaches the processes that the command starts."""
    if text is None:
        return
    from btcore.input_files import SIZE_VARIABLE, parse_size

    try:
        parse_size(text)
    except ValueError as error:
        raise click.UsageError(f"--max-file-size or {SIZE_VARIABLE}: {error}.") from None
    before = os.environ.get(SIZE_VARIABLE)
    os.environ[SIZE_VARIABLE] = text
    if before is None:
        ctx.call_on_close(lambda: os.environ.pop(SIZE_VARIABLE, None))
    else:
        ctx.call_on_close(lambda: os.environ.__setitem__(SIZE_VARIABLE, before))


@click.group(
    cls=CommandLine,
    no_args_is_help=False,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)
@click.option(
    "--version",
    is_flag=True,
    callback=_print_version,
    expose_value=False,
    is_eager=True,
    help="Show the version and the active build (pure or compiled), and exit.",
)
@click.option(
    "--max-file-size",
    metavar="SIZE",
    envvar="BTCORE_MAX_FILE_SIZE",
    callback=_set_max_file_size,
    expose_value=False,
    help="The maximum size of each file that a command reads, such as 500MB or 2GB.  [default: 256MB]",
)
@click.pass_context
def main(ctx: click.Context) -> None:
    """Run, check and analyse behavior trees written for BehaviorTree.CPP.

    TREE arguments are XML files, or names of trees that are bundled with btcore, such as bumpgo.
    'btcore COMMAND --help' shows the options of a command.
    """
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())
