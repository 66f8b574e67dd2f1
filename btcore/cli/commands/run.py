"""`btcore run`: run a tree, with what providers of other packages provide."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import click

from btcore.cli import initial_blackboard, node_libraries, stub_results, substitute, terminal
from btcore.cli.command_run import CommandRun
from btcore.cli.completion import complete_tree
from btcore.cli.provider_options import ProviderCommand, available_providers
from btcore.cli.run_logs import log_option
from btcore.cli.run_session import RunSession
from btcore.cli.tree_source import STDIN, SaveWatcher, TreeSource, find_source, tree_options
from btcore.diagnostic_codes import NODE_NOT_CREATED
from btcore.errors import TreeError
from btcore.registry.registry import Plugin
from btcore.runs.run import Run
from btcore.runs.settings import FiniteRange, RunSettings, setting_options
from btcore.runs.tick_loop import Until
from btcore.xml.models.stubs import StubResults
from btcore.xml.plan.plan import Plans


class RunOptions(NamedTuple):
    """The options of `btcore run` that are not settings of providers, by their click names."""

    source: str
    tree: str | None
    format: int | None
    confined: bool
    plugins: Sequence[str]
    models: Sequence[Path]
    stub_letters: Mapping[str, str]
    substitute: Sequence[Path]
    set: Any
    tick_limit: float | None
    until: Until
    watch: bool
    logs: Sequence[str]

    @classmethod
    def of(cls, ctx: click.Context) -> "RunOptions":
        """Return the options in the context of the command."""
        return cls(*(ctx.params[name] for name in cls._fields))


@click.command(cls=ProviderCommand, short_help="Run a tree until it ends.")
@click.argument("source", metavar="TREE", shell_complete=complete_tree)
@tree_options
@stub_results.stub_results_option
@substitute.substitute_option
@initial_blackboard.set_option
@setting_options(RunSettings, "rate", "duration")
@click.option(
    "--tick-limit",
    type=FiniteRange(0, min_open=True),
    metavar="S",
    help="Raise an error if a tick repeats nodes without a pause for more than S seconds of real time.",
)
@setting_options(RunSettings, "seed", "fast")
@click.option(
    "--until",
    type=click.Choice(["done", "success", "failure", "never"]),
    default="done",
    show_default=True,
    help="The result of the tree that ends the run; after any other result the tree is ticked again.",
)
@click.option(
    "--watch",
    is_flag=True,
    help="Reload the tree whenever its file is saved, and keep the blackboard. A file with errors is "
    "reported, and the previous tree continues. After the tree has ended, wait for the next save, until "
    "--duration or Ctrl-C ends the run.",
)
@log_option
@click.option(
    "--json",
    "as_json",
    is_flag=True,
    help="Print the results as a JSON object on the last line of stdout (with --watch, of the last tree).",
)
@click.pass_context
def run(ctx: click.Context, /, **options: Any) -> int:
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
      130  interrupted by Ctrl-C
      143  terminated by SIGTERM
    """
    return create_session(ctx).run_and_report(ctx.params["as_json"])


def create_session(
    ctx: click.Context, installed_nodes: node_libraries.NodeLibraries | None = None
) -> RunSession:
    """Return a run, before its providers are opened.

    Args:
        ctx: The context of the command.
        installed_nodes: The installed nodes, for a process that loads them once for many runs. They are
            copied, not changed.

    Raises:
        click.ClickException: An option has an invalid value.
        TreeError: The tree has an error.
        RegistrationError: A node library cannot be loaded.
    """
    options = RunOptions.of(ctx)
    # The watcher looks at the files before they are read: a save in between is not missed.
    save_watcher = None
    if options.watch:
        file = find_source(options.source)
        if file == STDIN:
            raise click.UsageError("--watch needs a file: a tree on stdin cannot be saved again.")
        save_watcher = SaveWatcher(file, options.confined)
    source, plans = read_source_and_plans(options, installed_nodes, available_providers(ctx).plugins)

    def prepare(run: Run) -> None:
        run.tree.count_ticks()  # before the first tick: the report contains the counts
        initial_blackboard.write(run.tree, options.set, plans)
        terminal.print_diagnostics(plans.diagnostics.warnings)
        substitute.warn_unused_rules(run.tree)

    stubs = StubResults(options.stub_letters)
    run = TreeRun(ctx, plans, prepare, tick_limit=options.tick_limit, stubs=stubs)
    name = source.name if options.tree is None else f"{source.name}:{options.tree}"
    return RunSession(run, source, name, options.until, options.logs, save_watcher)


class TreeRun(CommandRun):
    """The run of `btcore run`, whose errors explain how to provide an object."""

    def __enter__(self) -> "TreeRun":
        try:
            return super().__enter__()
        except TreeError as error:
            if any(diagnostic.code == NODE_NOT_CREATED for diagnostic in error.diagnostics) and any(
                getattr(kind, "__module__", "builtins") != "builtins" for kind in self.missing_types()
            ):
                error.add_note(
                    "`btcore run` does not create objects of your own classes: derive the class from "
                    "btcore.TreeState, or write a provider of the object: see 'Your own resources'"
                )
            raise


def read_source_and_plans(
    options: RunOptions,
    installed_nodes: node_libraries.NodeLibraries | None = None,
    plugins: Mapping[str, Plugin] | None = None,
) -> tuple[TreeSource, Plans]:
    """Read and check the document of a run's tree, before providers create objects such as a simulator.

    Args:
        options: The options of the run.
        installed_nodes: The installed nodes, or None to load them.
        plugins: Plugins that are imported already, by the values of `--plugin`.

    Returns:
        The source of the tree, and its plans.

    Raises:
        click.UsageError: An option has an invalid value.
        TreeError: The document has an error.
        RegistrationError: A node library cannot be loaded.
    """
    path = find_source(options.source)
    if installed_nodes is None or options.plugins:
        # Models and rules may name nodes of the installed libraries. Also, they would be lost when
        # `NodeLibraries.load_for` loads what is missing, because it begins anew.
        partial = not options.models and not options.substitute
        libraries = node_libraries.load_libraries(options.plugins, partial=partial, imported=plugins)
    else:
        libraries = node_libraries.NodeLibraries(installed_nodes.nodes.copy(), installed_nodes.unavailable)
    libraries.add_models(options.models, options.confined)
    source = TreeSource(path, options.tree, libraries, options.format, options.confined)
    substitute.add_rules(libraries.nodes, options.substitute)
    plans = source.read_plans()
    stub_results.check(options.stub_letters, plans)
    return source, plans
