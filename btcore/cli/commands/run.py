"""`btcore run`: run a tree, with what providers of other packages provide."""

from pathlib import Path
from typing import Annotated, Any

import click

from btcore.cli import initial_blackboard, stub_results, substitute, terminal
from btcore.cli.command_run import CommandRun
from btcore.cli.completion import complete_tree
from btcore.cli.node_libraries import NodeLibraries, load_libraries
from btcore.cli.provider_options import ProviderCommand, command_providers
from btcore.cli.run_session import RunSession
from btcore.cli.tree_source import STDIN, TreeOptions, TreeSource, find_source
from btcore.loading.hot_reload import FileWatcher
from btcore.runs.run import Run
from btcore.runs.settings import RunSettings, from_values, option, setting_options
from btcore.runs.tick_loop import Until
from btcore.xml.models.stubs import StubResults


class RunOptions(TreeOptions):
    """The options of `btcore run` about the tree and its end."""

    plan: Annotated[
        tuple[str, ...],
        option(
            "Results of a leaf from --model, given by its name or ID: one letter for each tick, R (RUNNING), "
            "S (SUCCESS), F (FAILURE) or K (SKIPPED), and | between two starts, for example Move=RRS|F. "
            "Leaves without a plan return SUCCESS. Repeatable.",
            metavar="NAME=LETTERS",
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
@setting_options(RunOptions)
@setting_options(RunSettings)
@click.option(
    "--json",
    "as_json",
    is_flag=True,
    help="Print the results as a JSON object on the last line of stdout (with --watch, of the last tree).",
)
@click.pass_context
def run(ctx: click.Context, /, as_json: bool, **options: Any) -> int:
    """Run TREE until it ends.

    TREE is an XML file, - for stdin, or the name of a tree that is bundled with btcore, such as bumpgo. The
    summary is printed on stderr.

    \b
    Exit codes:
      0    the tree ended in SUCCESS or SKIPPED, or --duration ended the run
      1    the tree ended in FAILURE
      2    an error in the tree or on the command line
      3    a leaf raised an exception, or a tick exceeded --tick-limit
      4    a log or a recording is incomplete, for example because the disk is full
      129  the terminal was closed
      130  interrupted by Ctrl-C
      143  terminated by SIGTERM
    """
    session = create_session(ctx)
    session.run()
    return session.print_results(as_json)


def create_session(ctx: click.Context, installed: NodeLibraries | None = None) -> RunSession:
    """Return the run of the command with the context *ctx*, before its providers are opened.

    Args:
        ctx: The context, whose parameters are those of `run`.
        installed: The installed nodes, for a process that loads them once for many runs. They are not
            changed.

    Raises:
        click.ClickException: An option has an invalid value.
        TreeError: The tree has an error.
        RegistrationError: A node library cannot be loaded.
    """
    options = from_values(RunOptions, ctx.params)
    assert options is not None, "no option is required"
    letters = stub_results.parse_letters(options.plan)
    entries = initial_blackboard.parse_entries(options.set)
    path = find_source(ctx.params["source"])
    if options.watch and path == STDIN:
        raise click.UsageError("--watch needs a file: a tree on stdin cannot be saved again.")
    # The watcher looks at the files before they are read: a save in between is not missed.
    file_watcher = FileWatcher(path, options.confined) if options.watch else None
    if installed is None or options.plugins:
        # Models and rules may name nodes of the installed libraries. Also, they would be lost when
        # `NodeLibraries.load_for` loads what is missing, because it begins anew.
        partial = not options.models and not options.substitute
        plugins = command_providers(ctx).plugins
        libraries = load_libraries(options.plugins, partial=partial, imported=plugins)
    else:
        libraries = NodeLibraries(installed.nodes.copy(), installed.unavailable)
    libraries.add_models(options.models, options.confined)
    source = TreeSource(path, options, libraries)
    substitute.add_rules(libraries.nodes, options.substitute)
    plans = source.read_plans()
    stub_results.check(letters, plans)

    def prepare(run: Run) -> None:
        run.tree.count_ticks()  # before the first tick: the report contains the counts
        initial_blackboard.write(run.tree, entries, plans)
        terminal.print_diagnostics(plans.diagnostics.warnings)
        substitute.warn_unused_rules(run.tree)

    stubs = [StubResults(letters)] if letters else []
    run = CommandRun(ctx, plans, prepare, provided=stubs, tick_limit=options.tick_limit)
    return RunSession(run, source, plans, options.until, file_watcher)
