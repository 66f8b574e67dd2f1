"""`btcore run`: run a tree, with what providers of other packages provide."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click

from btcore.cli import terminal
from btcore.cli.command_run import CommandRun, RunSession
from btcore.cli.node_libraries import NodeLibraries, load_libraries
from btcore.cli.provider_options import ProviderCommand, command_providers
from btcore.cli.tree_source import STDIN, TreeOptions, TreeSource, complete_tree, find_source
from btcore.field_options import add_options, pass_options
from btcore.options import from_values, option
from btcore.runs.run import Run
from btcore.runs.settings import RunSettings
from btcore.runs.tick_loop import Until

if TYPE_CHECKING:
    from btcore.cli.tree_changes import TreeChanges


class RunOptions(TreeOptions):
    """The options of `btcore run` about the tree and its end."""

    stub_results: Annotated[
        tuple[str, ...],
        option(
            "Results of a leaf from --model, given by its name or ID: one letter for each tick, R (RUNNING), "
            "S (SUCCESS), F (FAILURE) or K (SKIPPED), and | between two starts, for example Move=RRS|F. "
            "Leaves without a plan return SUCCESS. Repeatable.",
            metavar="NAME=LETTERS",
            name="plan",
        ),
    ] = ()
    substitute: Annotated[
        tuple[Path, ...],
        option(
            "Replace nodes by other nodes or by a TestNode, as described by BehaviorTree.CPP's substitution "
            "rules in a JSON file. Repeatable.",
            metavar="FILE.json",
        ),
    ] = ()
    set: Annotated[
        tuple[str, ...],
        option(
            "Set an entry of the main tree's blackboard before the first tick. VALUE has the type of the "
            "ports that use KEY; without a typed port it is read as JSON if possible, else as a string. "
            "Repeatable.",
            metavar="KEY=VALUE",
        ),
    ] = ()
    tick_limit: (
        Annotated[
            float,
            option(
                "Raise an error if a tick repeats nodes without a pause for more than S seconds of real "
                "time.",
                metavar="S",
                gt=0,
            ),
        ]
        | None
    ) = None
    until: Annotated[
        Until,
        option("The result of the tree that ends the run; after any other result the tree is ticked again."),
    ] = "done"
    watch: Annotated[
        bool,
        option(
            "Reload the tree whenever its file is saved, and keep the blackboard. A file with errors is "
            "reported, and the previous tree continues. After the tree has ended, wait for the next save, "
            "until --duration or Ctrl-C ends the run.",
        ),
    ] = False


@click.command(cls=ProviderCommand, short_help="Run a tree until it ends.")
@click.argument("source", metavar="TREE", shell_complete=complete_tree)
@pass_options(RunOptions, "options")
@add_options(RunSettings)
@click.option(
    "--json",
    "as_json",
    is_flag=True,
    help="Print the results as a JSON object on the last line of stdout (with --watch, of the last tree).",
)
@click.pass_context
def run(
    ctx: click.Context, /, source: str, options: RunOptions, as_json: bool, **settings_of_providers: Any
) -> int:
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
    # The settings of providers stay in the context, for `CommandRun`.
    session = create_session(ctx, source, options)
    session.run_to_end()
    return session.print_results(as_json)


@contextmanager
def parse_run(arguments: Sequence[str], installed: NodeLibraries | None = None) -> Iterator[RunSession]:
    """Return a context with the run of `btcore run` with *arguments*, before its providers are opened.

    Args:
        arguments: The arguments of the command.
        installed: As in `create_session`.

    Raises:
        click.ClickException: An argument is invalid.
        TreeError: The tree has an error.
        RegistrationError: A node library cannot be loaded.
    """
    with run.make_context("run", list(arguments)) as ctx:
        options = from_values(RunOptions, ctx.params)
        assert options is not None, "no option is required"
        yield create_session(ctx, ctx.params["source"], options, installed)


def create_session(
    ctx: click.Context, source: str, options: RunOptions, installed: NodeLibraries | None = None
) -> RunSession:
    """Return the run of the tree *source*, before its providers are opened.

    Args:
        ctx: The context of the command, with the settings of providers.
        source: The tree, as the user named it.
        options: The options of the run.
        installed: The installed nodes, for a process that loads them once for many runs. They are not
            changed.

    Raises:
        click.ClickException: An option has an invalid value.
        TreeError: The tree has an error.
        RegistrationError: A node library cannot be loaded.
    """
    changes = _create_changes(options)
    path = find_source(source)
    if options.watch and path == STDIN:
        raise click.UsageError("--watch needs a file: a tree on stdin cannot be saved again.")
    # The watcher looks at the files before they are read: a save in between is not missed.
    file_watcher = None
    if options.watch:
        from btcore.loading.hot_reload import FileWatcher

        file_watcher = FileWatcher(path, options.confined)
    if installed is None or options.plugins:
        partial = not options.substitute  # a rule may name a node of any library
        imported = command_providers(ctx).plugins
        libraries = load_libraries(options.plugins, options.models, options.confined, partial, imported)
    else:
        libraries = NodeLibraries(installed.nodes.copy(), installed.unavailable)
        libraries.add_models(options.models, options.confined)
    tree_source = TreeSource(path, options, libraries)
    if changes is not None:
        changes.add_rules(libraries.nodes)
    plans = tree_source.read_plans()
    if changes is not None:
        changes.check(plans)

    def prepare(run: Run) -> None:
        run.tree.count_ticks()  # before the first tick: the report contains the counts
        terminal.print_diagnostics(plans.diagnostics.warnings)
        if changes is not None:
            changes.prepare(run.tree, plans)

    provided = () if changes is None else changes.provided
    command_run = CommandRun(ctx, plans, prepare, provided=provided, tick_limit=options.tick_limit)
    return RunSession(command_run, tree_source, plans, options.until, file_watcher)


def _create_changes(options: RunOptions) -> "TreeChanges | None":
    """Return what the options change in the tree, or None; most runs do not need the module."""
    if not (options.stub_results or options.substitute or options.set):
        return None
    from btcore.cli.tree_changes import TreeChanges

    return TreeChanges(options.stub_results, options.substitute, options.set)
