"""Replacing the tree of a run whenever its file is saved (`btcore run --watch`)."""

from collections.abc import Sequence
from typing import Protocol

from btcore.errors import BtcoreError, NodeExecutionError
from btcore.loading.hot_reload import rebuild_tree
from btcore.runs.providers import fits
from btcore.tree.tree import Tree
from btcore.xml.plan.plan import Plans


class TreeWatcher(Protocol):
    """What `Run.until_done` needs to replace a tree whenever its file is saved."""

    def was_saved(self) -> bool:
        """Return whether the file was saved since the last call."""

    def read_plans(self) -> Plans:
        """Return the plans of the saved file."""

    def on_end(self) -> None:
        """Report that the tree has ended, and that the run waits for the next save."""

    def on_error(self, error: NodeExecutionError) -> None:
        """Report that a leaf raised an exception, which ends the tree."""

    def on_rejected(self, error: BtcoreError) -> None:
        """Report that the saved file has errors, so that the previous tree continues."""

    def on_reload(self, tree: Tree, plans: Plans) -> None:
        """Prepare *tree*, which now replaces the previous one."""


def reload_tree(watcher: TreeWatcher, tree: Tree, resources: Sequence[object]) -> Tree | None:
    """Return the tree in the saved file, with the blackboard of *tree*, which is halted.

    Args:
        watcher: The watcher of the file, whose methods are called with the result.
        resources: The objects for leaves.

    Returns:
        The new tree; None if the file has errors, so that *tree* continues.
    """
    try:
        plans = watcher.read_plans()
        new_tree = _rebuild(tree, plans, resources)
    except BtcoreError as error:
        watcher.on_rejected(error)
        return None
    try:
        tree.halt()
    except NodeExecutionError as error:
        watcher.on_error(error)
    watcher.on_reload(new_tree, plans)
    return new_tree


def _rebuild(tree: Tree, plans: Plans, resources: Sequence[object]) -> Tree:
    try:
        return rebuild_tree(tree, plans, resources)
    except BtcoreError as error:
        if not all(any(fits(thing, kind) for thing in resources) for kind in plans.required_resources()):
            error.add_note("resources are created only at the start of a run: start a new run for this tree")
        raise
