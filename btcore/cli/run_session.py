"""The course of `btcore run`: progress, reloading a saved tree, and reporting."""

from collections.abc import Callable
from contextlib import closing, suppress

from btcore.cli import initial_blackboard, terminal
from btcore.cli.command_run import CommandRun
from btcore.cli.progress import Progress, log_to_console
from btcore.cli.run_report import RunSummary, print_leaf_error
from btcore.cli.tree_source import TreeSource
from btcore.errors import BtcoreError, NodeExecutionError
from btcore.loading.hot_reload import FileWatcher
from btcore.runs.reload import TreeWatcher
from btcore.runs.tick_loop import Until
from btcore.status import Status
from btcore.tree.tree import Tree
from btcore.xml.plan.plan import Plans


class RunSession(TreeWatcher):
    """The run of a tree and, with `--watch`, of the trees that replace it.

    Args:
        run: The run, not yet entered.
        source: The file of the tree, from which the tree is reloaded.
        plans: The plans of the tree.
        until: The result that ends the run.
        file_watcher: Detects that the tree's file was saved; None without `--watch`.

    Attributes:
        tree_run: The run.
        plans: The plans of the first tree.
        summary: The results of the run, for the terminal and `--json`.
    """

    def __init__(
        self,
        run: CommandRun,
        source: TreeSource,
        plans: Plans,
        until: Until,
        file_watcher: FileWatcher | None = None,
    ) -> None:
        self.tree_run = run
        self.plans = plans
        self.summary = RunSummary(source.name, run)
        self._source = source
        self._until: Until = until
        self._file_watcher = file_watcher
        self._progress: Progress
        self._reloads = 0
        self._printed_error: NodeExecutionError | None = None

    def run(self, on_tree: Callable[[Tree], object] = lambda tree: None) -> None:
        """Run to the end.

        Args:
            on_tree: Called with the tree before its first tick.

        Raises:
            LogError: A log cannot be written.
            click.UsageError: A provider rejects its settings.
            TreeError: The tree lacks a resource.
        """
        run, console = self.tree_run, terminal.stderr_console()
        if self._file_watcher is not None:
            run.report["reloads"] = self._reloads  # the first entry
        with log_to_console(console), run:
            on_tree(run.tree)
            limit = run.run_settings.duration
            with closing(Progress(console, run.tree, self.summary.name, limit)) as self._progress:
                watcher = None if self._file_watcher is None else self
                with suppress(NodeExecutionError):  # it is printed after the summary
                    run.until_done(self._until, on_tick=self._progress.on_tick, watcher=watcher)
            self._warn_about_skipped_ticks()

    def print_results(self, as_json: bool) -> int:
        """Print the summary and, with *as_json*, the JSON object; return the exit code."""
        run = self.tree_run
        self.summary.print_summary()
        if run.error is not None and run.error is not self._printed_error:
            self._print_error(run.error)
        if as_json:
            terminal.print_json(self.summary.as_data())
        return run.exit_code

    def _print_error(self, error: NodeExecutionError) -> None:
        self._printed_error = error
        print_leaf_error(error)
        hint = initial_blackboard.unwritten_entry_hint(self.tree_run.tree, error)
        terminal.print_notes([hint] if hint else [])

    def _warn_about_skipped_ticks(self) -> None:
        count = self.tree_run.skipped_ticks
        if count:
            skipped = f"{terminal.counted(count, 'tick')} {'was' if count == 1 else 'were'} skipped"
            terminal.print_warning(
                f"{skipped}, because the previous tick took longer than "
                f"{1000 / self.tree_run.run_settings.rate:g} ms; use a lower --rate"
            )

    # --- the watcher of the run

    def was_saved(self) -> bool:
        """Return whether the tree's file was saved."""
        return self._file_watcher is not None and self._file_watcher.was_saved()

    def read_plans(self) -> Plans:
        """Return the plans of the saved file."""
        return self._source.read_plans()

    def on_end(self) -> None:
        """Show that the run waits for the next save."""
        run = self.tree_run
        self._progress.show_waiting(None if run.error is not None else run.status, self._source.path.name)

    def on_error(self, error: NodeExecutionError) -> None:
        """Print the exception of a leaf."""
        with self._progress.suspend():
            self._print_error(error)

    def on_rejected(self, error: BtcoreError) -> None:
        """Print the errors of the saved file."""
        with self._progress.suspend():
            terminal.print_btcore_error(error)
            action = "continues" if self.tree_run.tree.status is Status.RUNNING else "is kept"
            terminal.print_warning(f"{self._source.path.name} has errors: the previous tree {action}")

    def on_reload(self, tree: Tree, plans: Plans) -> None:
        """Count the reload, and show *tree*."""
        tree.count_ticks()
        self._reloads += 1
        self.tree_run.report["reloads"] = self._reloads
        with self._progress.suspend():
            terminal.print_diagnostics(plans.diagnostics.warnings)
            terminal.print_labelled("reloaded", str(self._source.path))
        self._progress.set_tree(tree)
