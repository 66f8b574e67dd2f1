"""The runs of commands: their providers come from the command line, and their problems are printed."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing, suppress
from typing import TYPE_CHECKING, Any, Unpack

import click

from btcore.cli import terminal
from btcore.cli.progress import Progress, log_to_console
from btcore.cli.provider_options import command_providers, given_options, settings_of
from btcore.cli.run_report import RunSummary, print_leaf_error
from btcore.cli.tree_source import TreeSource
from btcore.errors import BtcoreError, NodeExecutionError
from btcore.loading.load import LoadArguments
from btcore.runs.choice import GivenSettings
from btcore.runs.run import Run, TreelessProgram
from btcore.runs.settings import Settings
from btcore.runs.tick_loop import Until
from btcore.status import Status
from btcore.suggestions import join_names
from btcore.tree.tree import Tree
from btcore.xml.plan.plan import Plans

if TYPE_CHECKING:
    from btcore.loading.hot_reload import FileWatcher


class CommandRun(Run):
    """A run of a command of class `ProviderCommand`.

    Options that no provider uses are printed, and what the providers raise when they are closed.

    Args:
        ctx: The context of the command.
        source: The tree or the program.
        prepare: As in `Run`.
        settings: Settings in place of those of the command line.
        provided: As in `Run`.
        used: Classes of settings that the command uses itself.
        option_defaults: Values of options that were not given, by the names of their parameters.
        arguments: As in `Run`.
    """

    def __init__(
        self,
        ctx: click.Context,
        source: Plans | TreelessProgram,
        prepare: Callable[[Any], None] | None = None,
        *,
        settings: Sequence[Settings] = (),
        provided: Sequence[object] = (),
        used: Iterable[type[Settings]] = (),
        option_defaults: Mapping[str, Any] | None = None,
        **arguments: Unpack[LoadArguments],
    ) -> None:
        super().__init__(
            source,
            settings=GivenSettings([*settings_of(ctx, option_defaults), *settings]),
            provided=provided,
            providers=command_providers(ctx).available,
            prepare=prepare,
            **arguments,
        )
        self._ctx = ctx
        self._used_settings |= set(used)

    def warn_unused(self, kind: type[Settings], reason: str) -> None:
        """Print a warning for the options of *kind* that were given."""
        names = [option.opts[0] for option in given_options(self._ctx) if option.struct is kind]
        have = "has" if len(names) == 1 else "have"
        terminal.print_warning(f"{join_names(names)} {have} no effect: {reason}")

    def report_closing_errors(self, error: BaseException | None) -> None:
        """Print the errors, which also determine the exit code."""
        for one in self.closing_errors:
            terminal.print_error(str(one))


class RunSession:
    """The run of a tree from the command line.

    Args:
        run: The run, not yet entered.
        source: The file of the tree.
        plans: The plans of the tree.
        until: The result that ends the run.
        files: Detects that the tree's file, or one that it includes, was saved; None without `--watch`.

    Attributes:
        run: The run.
        plans: The plans of the first tree.
        summary: The results of the run, for the terminal and `--json`.
    """

    def __init__(
        self, run: CommandRun, source: TreeSource, plans: Plans, until: Until, files: "FileWatcher | None"
    ) -> None:
        self.run = run
        self.plans = plans
        self.summary = RunSummary(source.name, run)
        self._source = source
        self._until: Until = until
        self._files = files
        self._printed_error: NodeExecutionError | None = None
        if files is not None:
            run.report["reloads"] = 0  # the first entry of the report

    def run_to_end(self, on_tree: Callable[[Tree], object] = lambda tree: None) -> None:
        """Run to the end.

        Args:
            on_tree: Called with the tree before its first tick.

        Raises:
            LogError: A log cannot be written.
            BtcoreError: A provider raises while it is opened.
            TreeError: The tree lacks a resource.
        """
        run, console, files = self.run, terminal.stderr_console(), self._files
        with log_to_console(console), run:
            on_tree(run.tree)
            limit = run.run_settings.duration
            with closing(Progress(console, run.tree, self.summary.name, limit)) as progress:
                reloads = None if files is None else Reloads(run, self._source, files, progress)
                with suppress(NodeExecutionError):  # it is printed after the summary
                    run.until_done(self._until, on_tick=progress.on_tick, watcher=reloads)
                self._printed_error = None if reloads is None else reloads.printed_error
            self._warn_about_skipped_ticks()

    def print_results(self, as_json: bool) -> int:
        """Print the summary and, with *as_json*, the JSON object; return the exit code."""
        run = self.run
        self.summary.print_summary()
        if run.error is not None and run.error is not self._printed_error:
            _print_error(run.tree, run.error)
        if as_json:
            terminal.print_json(self.summary.as_data())
        return run.exit_code

    def _warn_about_skipped_ticks(self) -> None:
        count = self.run.skipped_ticks
        if count:
            skipped = f"{terminal.counted(count, 'tick')} {'was' if count == 1 else 'were'} skipped"
            terminal.print_warning(
                f"{skipped}, because the previous tick took longer than "
                f"{1000 / self.run.run_settings.rate:g} ms; use a lower --rate"
            )


class Reloads:
    """Reloads the tree of a run when its file is saved, as a `TreeWatcher`, and prints what happens.

    Args:
        run: The run.
        source: The file of the tree.
        files: Detects that the file, or one that it includes, was saved.
        progress: The status line of the run.

    Attributes:
        printed_error: The last exception of a leaf, which was printed; None without one.
    """

    def __init__(self, run: CommandRun, source: TreeSource, files: "FileWatcher", progress: Progress) -> None:
        self.printed_error: NodeExecutionError | None = None
        self._run = run
        self._source = source
        self._files = files
        self._progress = progress
        self._count = 0

    def was_saved(self) -> bool:
        """Return whether the tree's file was saved."""
        return self._files.was_saved()

    def read_plans(self) -> Plans:
        """Return the plans of the saved file."""
        return self._source.read_plans()

    def on_end(self) -> None:
        """Show that the run waits for the next save."""
        status = None if self._run.error is not None else self._run.status
        self._progress.show_waiting(status, self._source.path.name)

    def on_error(self, error: NodeExecutionError) -> None:
        """Print the exception of a leaf."""
        self.printed_error = error
        with self._progress.suspend():
            _print_error(self._run.tree, error)

    def on_rejected(self, error: BtcoreError) -> None:
        """Print the errors of the saved file."""
        with self._progress.suspend():
            terminal.print_btcore_error(error)
            action = "continues" if self._run.tree.status is Status.RUNNING else "is kept"
            terminal.print_warning(f"{self._source.path.name} has errors: the previous tree {action}")

    def on_reload(self, tree: Tree, plans: Plans) -> None:
        """Count the reload, and show *tree*."""
        tree.count_ticks()
        self._count += 1
        self._run.report["reloads"] = self._count
        with self._progress.suspend():
            terminal.print_diagnostics(plans.diagnostics.warnings)
            terminal.print_labelled("reloaded", str(self._source.path))
        self._progress.set_tree(tree)


def _print_error(tree: Tree, error: NodeExecutionError) -> None:
    """Print the exception of a leaf, and how to set the entry that it lacked."""
    print_leaf_error(error)
    hint = _unwritten_entry_hint(tree, error)
    terminal.print_notes([hint] if hint else [])


def _unwritten_entry_hint(tree: Tree, error: NodeExecutionError) -> str:
    """Return how to set the entry that a node of *tree* needed, but that was never written; "" otherwise."""
    key = getattr(error.cause, "unwritten_key", "")
    board = next((node._blackboard for node in tree.nodes if node.config.path == error.path), None)
    if not key or board is None:
        return ""
    if board is not tree.blackboard:
        # The key in the main tree may be another key.
        entry = board.find(key)
        entries = tree.blackboard.local_entries().items()
        key = next((outer for outer, other in entries if other is entry), "")
    return f"to set the entry before the first tick, use --set {key}=VALUE" if key else ""
