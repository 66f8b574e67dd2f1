"""``btcore run --log``: the logs of a run, a file each; a tree that is loaded anew gets files of its own."""

from collections.abc import Sequence
from pathlib import Path

import click

from btcore.cli import terminal
from btcore.logs import Log, LogError, open_log
from btcore.logs.formats import CONSOLE
from btcore.tree.tree import Tree


def _distinct(ctx: click.Context, parameter: click.Parameter, names: Sequence[str]) -> Sequence[str]:
    seen: set[str] = set()
    for name in names:
        place = name if name == CONSOLE else str(Path(name).resolve())
        if place in seen:
            raise click.UsageError(f"--log names '{name}' twice, and a file holds one log.")
        seen.add(place)
    return names


log_option = click.option(
    "--log",
    "logs",
    multiple=True,
    callback=_distinct,
    metavar="FILE",
    help="Log every change of a status: .btlog (Groot 2), .db3 (SQLite), .json (a trace for Perfetto), "
    "or - for lines on stdout; may be given several times.",
)


class Logs:
    """The logs called *names*, of one tree after the other."""

    def __init__(self, names: Sequence[str]) -> None:
        self.names = names
        self.number = 1
        self._open: list[Log] = []

    def open(self, tree: Tree) -> None:
        """Log *tree* from now on. Raises LogError."""
        for name in self.names:
            self._open.append(open_log(tree, name))

    def open_next(self, tree: Tree) -> None:
        """End the logs, and log *tree* in files whose names have the next number, as ``run.2.btlog``.

        One that can't be written is told of, and left out.
        """
        self.close()
        self.number += 1
        for name in self.names:
            try:
                self._open.append(open_log(tree, self._numbered(name)))
            except LogError as fault:
                terminal.print_warning(str(fault))

    def close(self) -> None:
        """End the logs."""
        while self._open:
            self._open.pop().close()

    def _numbered(self, name: str) -> str:
        if name == CONSOLE:
            return name
        path = Path(name)
        return str(path.with_name(f"{path.stem}.{self.number}{path.suffix}"))
