"""The output of ``btcore run`` on stderr: a live status line during the run, and a table at its end."""

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Final

from rich import box
from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from btcore.cli import terminal
from btcore.clock import NS_PER_S
from btcore.status import Status
from btcore.tree.tree import Tree

_LIVE_INTERVAL_S: Final = 0.1  # real time between two updates of the live line
_PLAIN_INTERVAL_S: Final = 10.0  # real time between two lines if stderr is not a terminal


class Progress:
    """The live status line of a run. If stderr is not a terminal, a plain line every few seconds.

    Args:
        tree: The tree of the run.
        name: The name of the run.
        duration: The limit of the run (s of the tree's clock), or None.
    """

    def __init__(self, tree: Tree, name: str, duration: float | None) -> None:
        self.tree = tree
        self.name = name
        self.duration = duration
        self.console: Console = terminal.stderr_console()
        self.live: Live | None = None
        self.start = tree.clock.now()
        self.began = self.updated = time.perf_counter()
        self.line = Text()
        self._open()

    def _open(self) -> None:
        if self.console.is_terminal:
            self.live = Live(console=self.console, auto_refresh=False, transient=True)
            self.live.start()

    def ticked(self, status: Status) -> None:
        """Update the line after a tick that returned *status*, unless the last update is too recent."""
        now = time.perf_counter()
        if now - self.updated < (_LIVE_INTERVAL_S if self.live is not None else _PLAIN_INTERVAL_S):
            return
        self.updated = now
        self._show(self._line(status, now - self.began))

    def follow(self, tree: Tree) -> None:
        """Show *tree*, which replaces the previous tree of the run."""
        self.tree = tree
        self.line = Text()

    def show_waiting(self, status: Status | None, file: str) -> None:
        """Show that the tree has ended and that the run waits for the next save of its file.

        Args:
            status: The last status of the tree; None if a leaf raised an exception.
            file: The name of the file.
        """
        result = Text("✘ RAISED", style="bold red") if status is None else terminal.format_status(status)
        line = Text.assemble(result, "  ", (self.name, "bold"), f"  tick {self.tree.ticks}")
        line.append(f"  waiting for a new version of {file}", style="dim")
        self._show(line)

    @contextmanager
    def suspend(self) -> Iterator[None]:
        """Return a context without the line, for other output; afterwards the line appears below that."""
        self.close()
        try:
            yield
        finally:
            self._open()
            if self.live is not None:
                self.live.update(self.line, refresh=True)

    def _show(self, line: Text) -> None:
        self.line = line
        if self.live is not None:
            self.live.update(line, refresh=True)
        else:
            self.console.print(line, soft_wrap=True)

    def close(self) -> None:
        """Remove the line."""
        if self.live is not None:
            self.live.stop()
            self.live = None

    def _line(self, status: Status, wall: float) -> Text:
        elapsed = (self.tree.clock.now() - self.start) / NS_PER_S
        line = Text.assemble(terminal.format_status(status), "  ", (self.name, "bold"), f"  {elapsed:.1f}")
        line.append(" s" if self.duration is None else f" / {self.duration:g} s")
        line.append(f"  tick {self.tree.ticks}  ×{elapsed / max(wall, 1e-9):.1f}", style="dim")
        leaves = [
            node.name for node in self.tree.nodes if node.status is Status.RUNNING and not node.children
        ]
        if leaves:
            line.append("  ▸ ", style="dim")
            line.append(", ".join(leaves), style="yellow")
        # A line that wraps would leave its first part on the screen when it is updated.
        line.truncate(max(20, self.console.width - 1), overflow="ellipsis")
        return line


def print_summary(
    tree: Tree,
    heading: Text,
    results: Mapping[str, Mapping[str, object]],
    figures: Mapping[str, object],
    max_nodes: int = 40,
) -> None:
    """Print the summary of a run on stderr.

    Args:
        tree: The tree of the run, for the order, depth and symbols of the nodes.
        heading: The first line.
        results: The tick counts of each node of *tree*, in its order.
        figures: The reports of the extensions, such as the robot's.
        max_nodes: The number of nodes that are printed at most.
    """
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), show_edge=False)
    table.add_column("node", overflow="fold")
    for title, style in (
        ("ticks", ""),
        ("success", "green"),
        ("failure", "red"),
        ("skipped", "cyan"),
        ("halted", "yellow"),
    ):
        table.add_column(title, justify="right", style=style)
    depths = _depths(tree)
    for node, result in list(zip(tree.nodes, results.values(), strict=True))[:max_nodes]:
        never_ticked = not result["ticks"]
        name = Text("  " * depths[node.uid])
        name.append(
            terminal.node_symbol(node.node_symbol, node.type) + " ",
            style=terminal.KIND_STYLE.get(node.type, ""),
        )
        name.append(node.name, style="dim" if never_ticked else "")
        if node.name != node.id:
            name.append(f" {node.id}", style="dim")
        columns = [str(result[key] or "·") for key in ("ticks", "success", "failure", "skipped", "halted")]
        table.add_row(name, *columns, style="dim" if never_ticked else "")
    console = terminal.stderr_console()
    console.print(heading, soft_wrap=True)
    console.print()
    console.print(table)
    if len(tree.nodes) > max_nodes:
        console.print(f"  … and {len(tree.nodes) - max_nodes} more nodes; --json lists all", style="dim")
    print_figures(figures)


def print_figures(figures: Mapping[str, object]) -> None:
    """Print *figures*, the reports of extensions, on stderr: a line for each heading."""
    for heading, figure in figures.items():
        line = Text.assemble("\n ", (f"{heading}  ", "bold"), *_figures(figure))
        line.rstrip()
        terminal.stderr_console().print(line, soft_wrap=True)


def _figures(figure: object) -> list[tuple[str, str]]:
    """Return the parts of a line for a report, with styles: names and values, without values of None."""
    if isinstance(figure, Mapping):
        known = {key: value for key, value in figure.items() if value is not None}
        if figure and not known:
            return [("not measured  ", "dim")]
        return [part for key, value in known.items() for part in ((f"{key} ", "dim"), *_figures(value))]
    return [(f"{_format_figure(figure)}  ", "")]


def _format_figure(figure: object) -> str:
    """Return the text of a value, or of a list of values."""
    if isinstance(figure, (list, tuple)):
        return ", ".join(map(_format_figure, figure)) or "none"
    if figure is None:
        return "not measured"
    return f"{figure:g}" if isinstance(figure, float) else str(figure)


def _depths(tree: Tree) -> dict[int, int]:
    """Return the depth of each node below the root, by UID."""
    depths = {tree.root.uid: 0}
    for node in tree.nodes:
        for child in node.children:
            depths[child.uid] = depths[node.uid] + 1
    return depths
