"""`btcore run --log`: the logs of a run; each reloaded tree is logged to new files."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from btcore.cli import terminal
from btcore.tree.tree import Tree

if TYPE_CHECKING:
    from btcore.logs import Log


def _reject_duplicates(ctx: click.Context, parameter: click.Parameter, names: Sequence[str]) -> Sequence[str]:
    if not names:
        return names
    from btcore.logs.formats import CONSOLE  # only a run with logs imports the formats

    places = [name if name == CONSOLE else str(Path(name).resolve()) for name in names]
    for number, place in enumerate(places):
        if place in places[:number]:
            raise click.UsageError(f"--log '{names[number]}' is given more than once.")
    return names


log_option = click.option(
    "--log",
    "logs",
    multiple=True,
    callback=_reject_duplicates,
    metavar="FILE",
    help="Log all status changes to FILE: .btlog (for Groot 2), .db3 (SQLite), .mcap (a bag of ROS 2), "
    ".json (trace for Perfetto), or - for text on stdout. Repeatable.",
)


class Logs:
    """The logs of a run.

    Args:
        names: The file names that `--log` gives.

    Attributes:
        are_incomplete: Whether writing failed, so that a log ends early or is missing.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.names = names
        self.number = 1
        self.are_incomplete = False
        self._open: list[Log] = []

    def open(self, tree: Tree) -> None:
        """Start logging *tree*.

        Raises:
            LogError: A file cannot be written.
        """
        if self.names:
            from btcore.logs import open_log

            for name in self.names:
                self._open.append(open_log(tree, name))

    def open_next(self, tree: Tree) -> None:
        """Close the logs, and log *tree* to files with the next number in their names: `run.2.btlog`.

        A file that cannot be written is skipped with a warning, so that the run continues.
        """
        self.close()
        self.number += 1
        if not self.names:
            return
        from btcore.logs import LogError, open_log

        for name in self.names:
            try:
                self._open.append(open_log(tree, self._number_file(name)))
            except LogError as error:
                self.are_incomplete = True
                terminal.print_warning(str(error))

    def close(self) -> None:
        """Close the logs."""
        while self._open:
            log = self._open.pop()
            log.close()
            self.are_incomplete = self.are_incomplete or log.is_incomplete

    def _number_file(self, name: str) -> str:
        from btcore.logs.formats import CONSOLE

        if name == CONSOLE:
            return name
        path = Path(name)
        return str(path.with_name(f"{path.stem}.{self.number}{path.suffix}"))
