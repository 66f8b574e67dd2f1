"""`btcore run`: run a tree, with what providers of other packages provide."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import click

from btcore.cli.node_libraries import NodeLibraries
from btcore.cli.provider_command import ProviderCommand, given_settings
from btcore.cli.run_session import RunOptions, RunSession
from btcore.cli.tree_source import complete_tree
from btcore.field_options import add_options, pass_options
from btcore.options import from_values
from btcore.runs.settings import GivenSettings, RunSettings


@click.command(cls=ProviderCommand, short_help="Run a tree until it ends.")
@click.argument("source", metavar="TREE", shell_complete=complete_tree)
@pass_options(RunOptions, "options")
@add_options(RunSettings)
@click.pass_context
def run(ctx: click.Context, /, source: str, options: RunOptions, settings: GivenSettings) -> int:
    """Run TREE until it ends.

    TREE is an XML file, - for stdin, or the name of a tree that is bundled with btcore, such as bumpgo. The
    summary is printed on stderr.

    \b
    Exit codes:
      0    the tree ended in SUCCESS or SKIPPED, or --duration ended the run
      1    the tree ended in FAILURE
      2    an error in the tree, on the command line, or of a robot or another resource
      3    a leaf raised an exception, or a tick exceeded --tick-limit
      4    a log or a recording is incomplete, for example because the disk is full
      70   an error in btcore itself
      129  the terminal was closed
      130  interrupted by Ctrl-C
      143  terminated by SIGTERM
    """
    session = RunSession(ctx, source, options, settings)
    session.run_to_end()
    return session.print_results()


@contextmanager
def parse_run(
    arguments: Sequence[str], installed: Callable[[], NodeLibraries] | None = None
) -> Iterator[RunSession]:
    """Return a context with the session of `btcore run` with *arguments*, before its providers are opened.

    Args:
        installed: As in `RunSession`.
    """
    with run.make_context("run", list(arguments)) as ctx:
        options = from_values(RunOptions, ctx.params)
        assert options is not None, "no option is required"
        yield RunSession(ctx, ctx.params["source"], options, given_settings(ctx), installed)
