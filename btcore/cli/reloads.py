"""Reloading the tree of `btcore run`: when its file is saved (`--watch`), or when a client sends a text."""

from collections.abc import Callable
from functools import partial

from btcore.cli import terminal
from btcore.cli.progress import Progress
from btcore.cli.run_summary import print_leaf_error
from btcore.cli.tree_source import TreeReader
from btcore.errors import BtcoreError, NodeExecutionError
from btcore.loading.hot_reload import FileWatcher, rebuild_tree
from btcore.registry.resources import fits
from btcore.runs.run import Run
from btcore.runs.tick_loop import ReloadRequests
from btcore.status import Status
from btcore.xml.plan.plan import Plans


class Reloads:
    """Replaces the tree of a run when there is a new text, and prints what happens.

    Args:
        tree_reader: Reads the plans of the tree from its file.
        file_watcher: Detects saves of the file, and of files that it includes; None = saves have no effect.
        requests: The texts that clients send, or None.
        progress: The status line of the run.

    Attributes:
        printed_error: The last exception of a leaf, which was printed; None without one.
    """

    def __init__(
        self,
        run: Run,
        tree_reader: TreeReader,
        file_watcher: FileWatcher | None,
        requests: ReloadRequests | None,
        progress: Progress,
    ) -> None:
        self.printed_error: NodeExecutionError | None = None
        self._run = run
        self._tree_reader = tree_reader
        self._file_watcher = file_watcher
        self._requests = requests
        if requests is not None:
            requests.is_used = True
        self._progress = progress
        self._count = 0

    @property
    def is_endless(self) -> bool:
        """Whether the run waits for a save after its end."""
        return self._file_watcher is not None

    def on_end(self, error: NodeExecutionError | None) -> None:
        """Print the exception of a leaf, if it has ended the tree, and show that the run waits for a save."""
        if error is not None:
            self._print_leaf_error(error)
        status = None if error is not None else self._run.status
        self._progress.show_waiting(status, self._tree_reader.path.name)

    def reload(self) -> bool:
        """Replace the tree if there is a new text without errors; return whether the tree was replaced."""
        if self._file_watcher is not None and self._file_watcher.take_save():
            return not self._replace(
                self._tree_reader.read_plans, f"{self._tree_reader.path.name} has errors"
            )
        request = None if self._requests is None else self._requests.take()
        if request is None:
            return False
        error = self._replace(partial(self._tree_reader.read_plans, request.text), "the text has errors")
        request.finish(error)
        return not error

    def _replace(self, read_plans: Callable[[], Plans], failure: str) -> str:
        """Replace the tree by that of new plans. Return "", or why the previous tree continues.

        Args:
            read_plans: Returns the plans.
            failure: What is printed if the tree cannot be replaced.
        """
        run, tree = self._run, self._run.tree
        try:
            plans = read_plans()
            try:
                new_tree = rebuild_tree(tree, plans, run.resources)
            except BtcoreError as error:
                types = plans.required_resources()
                if not all(any(fits(resource, type) for resource in run.resources) for type in types):
                    error.add_note(
                        "resources are created only at the start of a run: start a new run for this tree"
                    )
                raise
        except BtcoreError as error:
            with self._progress.suspend():
                terminal.print_btcore_error(error)
                action = "continues" if tree.status is Status.RUNNING else "is kept"
                terminal.print_warning(f"{failure}: the previous tree {action}")
            return "\n".join([str(error), *getattr(error, "__notes__", [])])
        try:
            tree.halt()
        except NodeExecutionError as error:
            self._print_leaf_error(error)
        new_tree.start_tick_counts()
        self._count += 1
        run.report["reloads"] = self._count
        with self._progress.suspend():
            terminal.print_diagnostics(plans.diagnostics.warnings)
            terminal.print_labelled("reloaded", str(self._tree_reader.path))
        self._progress.set_tree(new_tree)
        run.replace_tree(new_tree)
        return ""

    def _print_leaf_error(self, error: NodeExecutionError) -> None:
        self.printed_error = error
        with self._progress.suspend():
            print_leaf_error(error, self._run.tree)
