"""The providers of the core: logs (`--log`), and random numbers."""

import logging
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from btcore.errors import OutputError, SettingsError
from btcore.options import option
from btcore.runs.providers import provider
from btcore.runs.settings import RunSettings, Settings
from btcore.suggestions import join_names
from btcore.tree.tree import Tree

if TYPE_CHECKING:
    from btcore.logs import Log

_log = logging.getLogger("btcore")


class LogSettings(Settings):
    """The logs of a run."""

    log: Annotated[
        tuple[str, ...],
        option(
            "Log all status changes to FILE: .btlog (for Groot 2), .db3 (SQLite), .mcap (a bag of ROS 2), "
            ".json (trace for Perfetto), or - for text on stdout. Repeatable.",
            metavar="FILE",
            one_run_only=True,
        ),
    ]

    def __post_init__(self) -> None:
        files = [Path(name).resolve() for name in self.log]
        for number, file in enumerate(files):
            if file in files[:number]:
                raise SettingsError(f"--log '{self.log[number]}' is given more than once.")


class TreeLogs:
    """The logs of a tree, and of those that replace it.

    Args:
        names: The names of the logs, as in `btcore.logs.open_log`.

    Attributes:
        incomplete: The names of the logs that end early or are missing.
    """

    def __init__(self, names: tuple[str, ...]) -> None:
        self.incomplete: list[str] = []
        self._names = names
        self._number = 1
        self._open: list[Log] = []

    def open(self, tree: Tree) -> None:
        """Start the logs."""
        from btcore.logs import open_log

        for name in self._names:
            self._open.append(open_log(tree, name))

    def replace_tree(self, tree: Tree) -> None:
        """Close the logs, and log *tree* to files with the next number in their names: `run.2.btlog`.

        A file that cannot be written is skipped with a warning, so that the run continues.
        """
        from btcore.logs import LogError, open_log
        from btcore.logs.formats import CONSOLE
        from btcore.output_files import numbered_file

        self.close()
        self._number += 1
        for name in self._names:
            numbered = str(numbered_file(Path(name), self._number))
            try:
                self._open.append(open_log(tree, CONSOLE if name == CONSOLE else numbered))
            except LogError as error:
                self.incomplete.append(numbered)
                _log.warning("%s", error)

    def close(self) -> None:
        """Close the logs."""
        while self._open:
            log = self._open.pop()
            log.close()
            if log.is_incomplete:
                self.incomplete.append(log.name)


@provider
def tree_logs(settings: LogSettings, tree: Tree) -> Iterator[object]:
    """Log the tree to files.

    Raises:
        LogError: A log cannot be written.
        OutputError: At the end: a log is incomplete.
    """
    logs = TreeLogs(settings.log)
    try:
        logs.open(tree)
        yield logs
    finally:
        logs.close()
        if logs.incomplete:
            raise OutputError(f"logs are incomplete: {join_names(logs.incomplete)}")


@provider(provides=("random.Random",), default=True)
def random_numbers(settings: RunSettings) -> object:
    """Return the random numbers of a run, which its seed determines."""
    from random import Random

    return Random(settings.seed)
