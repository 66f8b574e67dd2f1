"""Replacing the tree of a run whenever its file is saved (`btcore run --watch`)."""

from typing import TYPE_CHECKING, Protocol

from btcore.errors import BtcoreError, NodeExecutionError
from btcore.loading.hot_reload import rebuild_tree
from btcore.runs.providers import EndReason, fits
from btcore.runs.tick_loop import TickLoop
from btcore.tree.tree import Tree
from btcore.xml.plan.plan import Plans

if TYPE_CHECKING:
    from btcore.runs.run import Run


class TreeWatcher(Protocol):
    """What `Run.until_done` needs to replace a tree whenever its file is saved."""

    def was_saved(self) -> bool:
        """Return whether the file was saved since the last call."""

    def read_plans(self) -> Plans:
        """Return the plans of the saved file.

        Raises:
            BtcoreError: The file has errors.
        """

    def on_end(self) -> None:
        """Report that the tree has ended, and that the run waits for the next save."""

    def on_error(self, error: NodeExecutionError) -> None:
        """Report that a leaf raised an exception, which ends the tree."""

    def on_rejected(self, error: BtcoreError) -> None:
        """Report that the saved file has errors, so that the previous tree continues."""

    def on_reload(self, tree: Tree, plans: Plans) -> None:
        """Prepare *tree*, which now replaces the previous one."""


def tick_and_reload(run: "Run", loop: TickLoop, watcher: TreeWatcher) -> EndReason:
    """Tick the tree of *run*, and those that replace it, until the run ends; return the reason.

    After the end of a tree, also by an exception of a leaf, the run waits for the next save.
    """
    has_ended = False
    while True:
        try:
            reason = loop.wait_for_save() if has_ended else loop.run()
        except NodeExecutionError as error:
            run.error = error
            watcher.on_error(error)
            reason = "done"
        if reason == "saved":
            has_ended = not _reload(run, watcher) and has_ended
        elif reason == "done":
            has_ended = True
            run.status = loop.status
            watcher.on_end()
        else:
            return reason


def _reload(run: "Run", watcher: TreeWatcher) -> bool:
    """Replace the tree by that in the saved file, if it has no errors; return whether it was replaced."""
    try:
        plans = watcher.read_plans()
        tree = _rebuild(run, plans)
    except BtcoreError as error:
        watcher.on_rejected(error)
        return False
    try:
        run.tree.halt()
    except NodeExecutionError as error:
        watcher.on_error(error)
    watcher.on_reload(tree, plans)
    run.replace_tree(tree)
    return True


def _rebuild(run: "Run", plans: Plans) -> Tree:
    """Return the tree of *plans*, with the blackboard of the present tree."""
    try:
        return rebuild_tree(run.tree, plans, run.resources)
    except BtcoreError as error:
        if not all(any(fits(thing, kind) for thing in run.resources) for kind in plans.required_resources()):
            error.add_note("resources are created only at the start of a run: start a new run for this tree")
        raise
