"""The course of `btcore run`: ticking, reloading a saved tree, and reporting."""

import contextlib
from collections.abc import Callable, Sequence

from btcore.cli import initial_blackboard, terminal
from btcore.cli.command_run import CommandRun
from btcore.cli.progress import Progress, log_to_console
from btcore.cli.run_logs import Logs
from btcore.cli.run_report import RunSummary, print_leaf_error
from btcore.cli.tree_source import SaveWatcher, TreeSource
from btcore.errors import BtcoreError, NodeExecutionError
from btcore.runs.tick_loop import TickLoop, Until
from btcore.status import Status
from btcore.tree.tree import Tree


class RunSession:
    """The run of a tree and, with `--watch`, of the trees that replace it.

    Args:
        run: The run, not yet entered.
        source: The file of the tree, from which the tree is reloaded.
        name: The name of the run.
        until: The result that ends the run.
        logs: The values of `--log`.
        save_watcher: Detects that the tree's file was saved; None without `--watch`.

    Attributes:
        report: The result of the run, for the summary and `--json`.
        reloads: The number of trees that have replaced the first tree.
    """

    def __init__(
        self,
        run: CommandRun,
        source: TreeSource,
        name: str,
        until: Until,
        logs: Sequence[str],
        save_watcher: SaveWatcher | None = None,
    ) -> None:
        self.tree_run = run
        self.source = source
        self.until: Until = until
        self.save_watcher = save_watcher
        self.logs = Logs(logs)
        self.report = RunSummary(name, run)
        self.reloads = 0
        self._printed_error: NodeExecutionError | None = None

    def run_and_report(self, as_json: bool) -> int:
        """Call `run`, print the summary, and return the exit code."""
        run = self.tree_run
        self.run()
        self.report.print_summary()
        if run.error is not None and run.error is not self._printed_error:
            self._print_execution_error(run.error)
        if as_json:
            terminal.print_json(self.report.as_data())
        return run.exit_code

    def run(self, on_tree: Callable[[Tree], object] = lambda tree: None) -> None:
        """Run to the end without printing a summary.

        Args:
            on_tree: Called with the tree before its first tick.

        Raises:
            LogError: A log cannot be written.
            click.UsageError: A provider rejects its settings.
            TreeError: The tree lacks a resource.
        """
        if self.save_watcher is not None:
            self.tree_run.report["reloads"] = 0  # the first entry
        with contextlib.ExitStack() as stack:
            with log_to_console(terminal.stderr_console()):
                stack.enter_context(self.tree_run)
            stack.callback(self._close_logs)
            self.logs.open(self.tree_run.tree)
            on_tree(self.tree_run.tree)
            self._tick()
        if self.save_watcher is not None:
            self.tree_run.report["reloads"] = self.reloads

    def _close_logs(self) -> None:
        self.logs.close()
        self.tree_run.is_output_incomplete |= self.logs.are_incomplete

    def _tick(self) -> None:
        """Tick until the end of the run."""
        run, settings = self.tree_run, self.tree_run.run_settings
        progress = Progress(run.tree, self.report.name, settings.duration)
        was_saved = None if self.save_watcher is None else self.save_watcher.was_saved
        try:
            with log_to_console(progress.console):
                if self.save_watcher is None:
                    run.until_done(self.until, on_tick=progress.on_tick)
                else:
                    loop = run.loop(self.until, progress.on_tick, was_saved)
                    with run.ticking(loop):
                        self._tick_and_reload(loop, progress)
        finally:
            progress.close()
        count = run.skipped_ticks
        if count:
            skipped = f"{terminal.counted(count, 'tick')} {'was' if count == 1 else 'were'} skipped"
            terminal.print_warning(
                f"{skipped}, because the previous tick took longer than "
                f"{1000 / settings.rate:g} ms; use a lower --rate"
            )

    def _tick_and_reload(self, loop: TickLoop, progress: Progress) -> None:
        """Tick the tree, and reload it after each save; when it has ended, wait for the next save."""
        run = self.tree_run
        waiting = False
        while True:
            try:
                run.end_reason = loop.wait_for_save() if waiting else loop.run()
            except NodeExecutionError as error:
                run.error = self._printed_error = error
                with progress.suspend():
                    self._print_execution_error(error)
                run.end_reason = "done"
            if run.end_reason == "done":
                waiting = True
                progress.show_waiting(None if run.error is not None else loop.status, self.source.path.name)
            elif run.end_reason == "saved":
                with progress.suspend():
                    if self._reload():
                        progress.set_tree(run.tree)
                        waiting = False
            else:
                return

    def _print_execution_error(self, error: NodeExecutionError) -> None:
        print_leaf_error(error)
        hint = initial_blackboard.unwritten_entry_hint(self.tree_run.tree, error)
        terminal.print_notes([hint] if hint else [])

    def _reload(self) -> bool:
        """Replace the tree by the tree in the saved file; on errors, print them and return False."""
        run = self.tree_run
        try:
            plans = self.source.read_plans()
            tree = run.rebuild(plans)
        except BtcoreError as error:
            terminal.print_btcore_error(error)
            action = "continues" if run.tree.status is Status.RUNNING else "is kept"
            terminal.print_warning(f"{self.source.path.name} has errors: the previous tree {action}")
            return False
        terminal.print_diagnostics(plans.diagnostics.warnings)
        try:
            run.tree.halt()
        except NodeExecutionError as error:
            print_leaf_error(error)
        tree.count_ticks()
        self.reloads += 1
        self.logs.open_next(tree)
        run.replace_tree(tree)
        terminal.print_labelled("reloaded", str(self.source.path))
        return True
