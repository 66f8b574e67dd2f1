"""What `btcore run` shows on stderr: one live line while it runs, a table at its end."""

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

_LIVE_EVERY: Final = 0.1  # s of real time between two pictures of the live line
_PLAIN_EVERY: Final = 10.0  # s between two lines where the output is no terminal


class Progress:
    """The line that lives while a tree runs. In a pipe or a log: a line now and then."""

    def __init__(self, tree: Tree, name: str, duration: float | None) -> None:
        self.tree = tree
        self.name = name
        self.duration = duration
        self.console: Console = terminal.stderr_console()
        self.live: Live | None = None
        self.start = tree.clock.now()
        self.began = self.shown = time.perf_counter()
        self.line = Text()
        self._open()

    def _open(self) -> None:
        if self.console.is_terminal:
            self.live = Live(console=self.console, auto_refresh=False, transient=True)
            self.live.start()

    def ticked(self, status: Status) -> None:
        """Show how things stand, if it is time to."""
        now = time.perf_counter()
        if now - self.shown < (_LIVE_EVERY if self.live is not None else _PLAIN_EVERY):
            return
        self.shown = now
        self._show(self._line(status, now - self.began))

    def follow(self, tree: Tree) -> None:
        """Show *tree* from now on."""
        self.tree = tree
        self.line = Text()

    def show_waiting(self, status: Status | None, file: str) -> None:
        """Show that the tree ended with *status* (None = a leaf raised), and that *file* is waited for."""
        result = Text("✘ RAISED", style="bold red") if status is None else terminal.format_status(status)
        line = Text.assemble(result, "  ", (self.name, "bold"), f"  tick {self.tree.ticks}")
        line.append(f"  waiting until {file} is saved", style="dim")
        self._show(line)

    @contextmanager
    def suspend(self) -> Iterator[None]:
        """Within it other things can be printed; the line comes back below them."""
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
        """Take the line away."""
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
        line.truncate(max(20, self.console.width - 1), overflow="ellipsis")
        return line


def print_summary(
    tree: Tree,
    heading: Text,
    results: Mapping[str, Mapping[str, object]],
    figures: Mapping[str, object],
    most: int = 40,
) -> None:
    """Print, on stderr, how the run ended, and what each node did in it (the first *most* of them).

    *figures* are what others report of it, say, of the robot.
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
    for node, result in list(zip(tree.nodes, results.values(), strict=True))[:most]:
        quiet = not result["ticks"]
        name = Text("  " * depths[node.uid])
        name.append(
            terminal.node_symbol(node.node_symbol, node.type) + " ",
            style=terminal.KIND_STYLE.get(node.type, ""),
        )
        name.append(node.name, style="dim" if quiet else "")
        if node.name != node.id:
            name.append(f" {node.id}", style="dim")
        columns = [str(result[key] or "·") for key in ("ticks", "success", "failure", "skipped", "halted")]
        table.add_row(name, *columns, style="dim" if quiet else "")
    console = terminal.stderr_console()
    console.print(heading, soft_wrap=True)
    console.print()
    console.print(table)
    if len(tree.nodes) > most:
        console.print(f"  … and {len(tree.nodes) - most} more nodes; --json has them all", style="dim")
    print_figures(figures)


def print_figures(figures: Mapping[str, object]) -> None:
    """Print *figures* on stderr: a line for each word of it, what belongs to it beside."""
    for word, figure in figures.items():
        line = Text.assemble("\n ", (f"{word}  ", "bold"), *_figures(figure))
        line.rstrip()
        terminal.stderr_console().print(line, soft_wrap=True)


def _figures(figure: object) -> list[tuple[str, str]]:
    """A report as words and numbers on one line, names dim; of several that are None, the others."""
    if isinstance(figure, Mapping):
        known = {key: value for key, value in figure.items() if value is not None}
        if figure and not known:
            return [("not measured  ", "dim")]
        return [part for key, value in known.items() for part in ((f"{key} ", "dim"), *_figures(value))]
    return [(f"{_said(figure)}  ", "")]


def _said(figure: object) -> str:
    """One figure, or a list of them."""
    if isinstance(figure, (list, tuple)):
        return ", ".join(map(_said, figure)) or "none"
    if figure is None:
        return "not measured"
    return f"{figure:g}" if isinstance(figure, float) else str(figure)


def _depths(tree: Tree) -> dict[int, int]:
    """How deep each node stands, by uid."""
    depths = {tree.root.uid: 0}
    for node in tree.nodes:
        for child in node.children:
            depths[child.uid] = depths[node.uid] + 1
    return depths
