"""The course of a run: attaching extensions, ticking, reloading a saved tree, and reporting."""

import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from typing import Any, cast

from btcore.cli import initial_blackboard, terminal
from btcore.cli.exit_codes import ExitCode, code_of_signal
from btcore.cli.extension import merge_reports
from btcore.cli.progress import Progress, log_to_console
from btcore.cli.run_logs import Logs
from btcore.cli.run_report import RunReport, print_leaf_error
from btcore.cli.tick_loop import EndReason, TickLoop, Until
from btcore.cli.tree_source import SaveWatcher, TreeSource
from btcore.clock import NS_PER_S
from btcore.errors import BtcoreError, NodeExecutionError
from btcore.loading.hot_reload import rebuild_tree
from btcore.run_extension import OutputError, RunExtension
from btcore.status import Status
from btcore.tree.tree import Tree
from btcore.xml.plan.plan import Plans


class RunSession:
    """The run of a tree and, with `--watch`, of the trees that replace it.

    Args:
        source: The file of the tree, from which the tree is reloaded.
        extensions: The extensions in the order in which they are attached.
        save_watcher: Detects that the tree's file was saved; None without `--watch`.

    Attributes:
        report: The result of the run, for the summary and `--json`.
        reloads: The number of trees that have replaced the first tree.
    """

    def __init__(
        self,
        tree: Tree,
        source: TreeSource,
        settings: Mapping[str, Any],
        extensions: Sequence[RunExtension],
        resources: Sequence[object],
        save_watcher: SaveWatcher | None = None,
    ) -> None:
        self.tree = tree
        self.source = source
        self.settings = settings
        self.extensions = extensions
        self.resources = resources
        self.save_watcher = save_watcher
        self.logs = Logs(settings["logs"])
        tree_id = settings["tree"]
        self.report = RunReport(source.name if tree_id is None else f"{source.name}:{tree_id}")
        self.reloads = 0
        self._signal = 0
        self._is_output_incomplete = False
        self._printed_error: NodeExecutionError | None = None

    def run_and_report(self) -> int:
        """Call `run`, print the summary, and return the exit code."""
        end_reason, code, extension_reports = self.run()
        report = self.report
        report.print_summary(self.tree, end_reason, extension_reports)
        if report.error is not None and report.error is not self._printed_error:
            self._print_execution_error(report.error)
        if self.settings["as_json"]:
            terminal.print_json(report.as_data(self.tree, extension_reports))
        return code

    def run(self) -> tuple[EndReason, ExitCode, dict[str, object]]:
        """Run to the end without printing a summary.

        Returns:
            The reason why the run ended, the exit code, and the reports of the extensions.

        Raises:
            LogError: A log cannot be written.
            click.UsageError: An extension rejects the options of the run.
        """
        self.tree.count_ticks()  # before the first tick: the report contains the counts
        end_reason: EndReason = "done"
        try:
            with ExitStack() as attached:
                with log_to_console(terminal.stderr_console()):
                    for extension in self.extensions:
                        attached.enter_context(extension.attach(self.tree, self.resources, self.settings))
                # An ExitStack unwinds in reverse order: the logs are closed before extensions are detached.
                attached.callback(self.logs.close)
                self.logs.open(self.tree)
                end_reason = self._run_loop()
                if end_reason == "interrupted":
                    for extension in self.extensions:
                        extension.on_interrupt()
        except OutputError as error:
            self._is_output_incomplete = True
            terminal.print_error(str(error))
        extension_reports = merge_reports(self.extensions)
        if self.save_watcher is not None:
            extension_reports = {"reloads": self.reloads, **extension_reports}
        return end_reason, self._choose_exit_code(end_reason), extension_reports

    def _choose_exit_code(self, end_reason: EndReason) -> ExitCode:
        if self.report.error is not None:
            return ExitCode.LEAF_ERROR
        if self._is_output_incomplete or self.logs.are_incomplete:
            return ExitCode.INCOMPLETE_OUTPUT
        if end_reason == "interrupted":
            return code_of_signal(self._signal)
        failed = end_reason == "done" and self.report.status is Status.FAILURE
        return ExitCode.FAILURE if failed else ExitCode.SUCCESS

    def _run_loop(self) -> EndReason:
        """Tick until the end of the run, and halt the tree, also after an exception."""
        settings = self.settings
        duration = settings["duration"]
        progress = Progress(self.tree, self.report.name, duration)
        until = cast(Until, settings["until"])
        was_saved = None if self.save_watcher is None else self.save_watcher.was_saved
        loop = TickLoop(
            self.tree, settings["rate"], duration, until, progress.on_tick, was_saved, settings["fast"]
        )
        began = time.perf_counter()
        end_reason: EndReason = "done"
        try:
            with loop.handle_signals(), log_to_console(progress.console):
                end_reason = loop.run() if self.save_watcher is None else self._run_and_reload(loop, progress)
            self.tree.halt()
        except NodeExecutionError as error:
            self.report.error = error
        except BaseException:
            self.tree.halt()
            raise
        finally:
            self.report.status = loop.status if self.report.error is None else Status.IDLE
            self.report.elapsed_s = loop.elapsed_ns / NS_PER_S
            self._signal = loop.received_signal
            self.report.wall_s = time.perf_counter() - began
            progress.close()
        count = loop.skipped_ticks
        if count:
            skipped = f"{terminal.counted(count, 'tick')} {'was' if count == 1 else 'were'} skipped"
            terminal.print_warning(
                f"{skipped}, because the previous tick took longer than "
                f"{1000 / settings['rate']:g} ms; use a lower --rate"
            )
        return end_reason

    def _run_and_reload(self, loop: TickLoop, progress: Progress) -> EndReason:
        """Tick the tree, and reload it after each save; when it has ended, wait for the next save."""
        waiting = False
        while True:
            try:
                end_reason = loop.wait_for_save() if waiting else loop.run()
            except NodeExecutionError as error:
                self.report.error = self._printed_error = error
                with progress.suspend():
                    self._print_execution_error(error)
                end_reason = "done"
            if end_reason == "done":
                waiting = True
                raised = self.report.error is not None
                progress.show_waiting(None if raised else loop.status, self.source.path.name)
            elif end_reason == "saved":
                with progress.suspend():
                    if self._reload():
                        loop.tree = self.tree
                        progress.set_tree(self.tree)
                        waiting = False
            else:
                return end_reason

    def _print_execution_error(self, error: NodeExecutionError) -> None:
        print_leaf_error(error)
        hint = initial_blackboard.unwritten_entry_hint(self.tree, error)
        terminal.print_notes([hint] if hint else [])

    def _reload(self) -> bool:
        """Replace the tree by the tree in the saved file; on errors, print them and return False."""
        plans: Plans | None = None
        try:
            plans = self.source.read_plans()
            tree = rebuild_tree(self.tree, plans, self.resources)
        except BtcoreError as error:
            if plans is not None:
                self._note_missing_resources(error, plans)
            terminal.print_btcore_error(error)
            action = "continues" if self.tree.status is Status.RUNNING else "is kept"
            terminal.print_warning(f"{self.source.path.name} has errors: the previous tree {action}")
            return False
        terminal.print_diagnostics(plans.diagnostics.warnings)
        self._replace_tree(tree)
        terminal.print_labelled("reloaded", str(self.source.path))
        return True

    def _note_missing_resources(self, error: BtcoreError, plans: Plans) -> None:
        """Add a note to *error* if leaves of the new tree need resources that this run does not have."""
        wanted = plans.required_resources()
        try:
            complete = all(any(isinstance(resource, kind) for resource in self.resources) for kind in wanted)
        except TypeError:
            return  # isinstance does not support one of the types, which *error* already reports
        if not complete:
            error.add_note("resources are created only at the start of a run: start a new run for this tree")

    def _replace_tree(self, tree: Tree) -> None:
        """Halt the current tree, and continue with *tree*."""
        try:
            self.tree.halt()
        except NodeExecutionError as error:
            print_leaf_error(error)
        tree.count_ticks()
        self.tree = tree
        self.report.error = None
        self.reloads += 1
        self.logs.open_next(tree)
        for extension in self.extensions:
            extension.replace_tree(tree, self.resources, self.settings)
