"""`btcore run`: run a tree, with what providers of other packages provide, and print the results."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click

from btcore.cli import terminal
from btcore.cli.node_libraries import NodeLibraries
from btcore.cli.progress import Progress, log_to_console
from btcore.cli.provider_command import ProviderCommand, command_providers, create_run, given_settings
from btcore.cli.run_summary import print_leaf_error, print_summary, results_as_data
from btcore.cli.tree_changes import TreeChanges
from btcore.cli.tree_source import STDIN, TreeOptions, TreeReader, complete_tree, find_source
from btcore.errors import NodeExecutionError
from btcore.field_options import add_options, pass_options
from btcore.options import from_values, option
from btcore.runs.run import Run
from btcore.runs.settings import GivenSettings, RunSettings
from btcore.runs.tick_loop import Until
from btcore.suggestions import counted
from btcore.tree.tree import Tree
from btcore.xml.plan.plan import Plans

if TYPE_CHECKING:
    from btcore.cli.reloads import Reloads
    from btcore.loading.hot_reload import FileWatcher


class RunCommandOptions(TreeOptions):
    """The options of `btcore run` itself, about the tree and its end, beside `RunSettings` of every run."""

    outcomes: Annotated[
        tuple[str, ...],
        option(
            "Outcomes of a leaf from --model, given by its name or ID: a letter for each tick, R (RUNNING), "
            "S (SUCCESS), F (FAILURE), K (SKIPPED) or X (an exception), and | between two starts, for "
            "example Move=RRS|F. S(port=value) writes an output port. Other leaves return SUCCESS. "
            "Repeatable.",
            metavar="NAME=OUTCOMES",
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
            "until --duration or Ctrl-C ends the run."
        ),
    ] = False
    as_json: Annotated[
        bool,
        option(
            "Print the results as a JSON object on the last line of stdout (with --watch, of the last tree).",
            name="json",
        ),
    ] = False


@click.command(cls=ProviderCommand)
@click.argument("source", metavar="TREE", shell_complete=complete_tree)
@pass_options(RunCommandOptions, "options")
@add_options(RunSettings)
@click.pass_context
def run(ctx: click.Context, /, source: str, options: RunCommandOptions, settings: GivenSettings) -> int:
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
    session = create_session(ctx, source, options, settings)
    session.run_to_end()
    return session.print_results()


class RunSession:
    """The run of a tree on the terminal, with progress and summary; `create_session` creates it.

    Attributes:
        plans: The plans of the first tree.
        run: The run, whose providers are opened by `run_to_end`.
    """

    def __init__(
        self,
        plans: Plans,
        run: Run,
        options: RunCommandOptions,
        tree_reader: TreeReader,
        file_watcher: "FileWatcher | None",
    ) -> None:
        self.plans = plans
        self.run = run
        self._options = options
        self._tree_reader = tree_reader
        self._file_watcher = file_watcher
        self._reloads: Reloads | None = None

    def run_to_end(self, on_tree: Callable[[Tree], object] = lambda tree: None) -> None:
        """Run to the end.

        Args:
            on_tree: Called with the tree before its first tick.
        """
        run, console, settings = self.run, terminal.stderr_console(), self.run.run_settings
        with log_to_console(console), run:
            on_tree(run.tree)
            with closing(Progress(console, run.tree, self._tree_reader.name, settings.duration)) as progress:
                requests = run.reload_requests
                if self._file_watcher is not None or requests is not None:
                    from btcore.cli.reloads import Reloads  # most runs do not need it

                    self._reloads = Reloads(run, self._tree_reader, self._file_watcher, requests, progress)
                with suppress(NodeExecutionError):  # it is printed after the summary
                    run.tick_to_end(self._options.until, on_tick=progress.on_tick, reloader=self._reloads)
            if count := run.missed_ticks:
                missed = f"{counted(count, 'tick')} {'was' if count == 1 else 'were'} missed"
                terminal.print_warning(
                    f"{missed}, because the previous tick took longer than {1000 / settings.rate:g} ms; use "
                    "a lower --rate"
                )

    def print_results(self) -> int:
        """Print the summary and, with `--json`, the JSON object; return the exit code."""
        run = self.run
        print_summary(self._tree_reader.name, run)
        printed_error = None if self._reloads is None else self._reloads.printed_error
        if run.error is not None and run.error is not printed_error:
            print_leaf_error(run.error, run.tree)
        if self._options.as_json:
            terminal.print_json(results_as_data(run))
        return run.exit_code


def create_session(
    ctx: click.Context,
    source: str,
    options: RunCommandOptions,
    settings: GivenSettings,
) -> RunSession:
    """Read a tree, and return the session of its run.

    Args:
        ctx: The context of the command, with its providers and plugins.
        source: The tree, as the user named it.
        options: The options of the command itself.
        settings: The settings of the run and of providers.
    """
    changes = TreeChanges(options.outcomes, options.substitute, options.set)
    path = find_source(source)
    file_watcher = None
    if options.watch:
        if path == STDIN:
            raise click.UsageError("--watch needs a file: a tree on stdin cannot be saved again.")
        from btcore.loading.hot_reload import FileWatcher  # most runs do not need it

        # The watcher looks at the files before they are read: a save in between is not missed.
        file_watcher = FileWatcher(path, options.confined)
    libraries = NodeLibraries(
        options.plugins,
        options.models,
        options.confined,
        btcore_on_demand=not options.substitute,  # a rule may name a node of any library
        imported=command_providers(ctx).plugins,
    )
    tree_reader = TreeReader(path, options, libraries, changes.with_rules)
    plans = tree_reader.read_plans()
    changes.check(plans)

    def prepare(created: Run) -> None:
        created.tree.start_tick_counts()  # before the first tick, for the summary and --json
        terminal.print_diagnostics(plans.diagnostics.warnings)
        changes.apply_to(created.tree, plans)

    resources, tick_limit = changes.resources, options.tick_limit
    created = create_run(ctx, plans, settings, prepare, resources=resources, tick_limit=tick_limit)
    if options.watch:
        created.report["reloads"] = 0  # the first entry of the report
    return RunSession(plans, created, options, tree_reader, file_watcher)


@contextmanager
def parse_run(arguments: Sequence[str]) -> Iterator[RunSession]:
    """Return a context with the session of `btcore run` with *arguments*, before its providers are opened."""
    with run.make_context("run", list(arguments)) as ctx:
        options = from_values(RunCommandOptions, ctx.params)
        assert options is not None, "no option is required"
        yield create_session(ctx, ctx.params["source"], options, given_settings(ctx))
