"""Drawings of trees as text, in Unicode or ASCII: branches, and the symbols and styles of nodes."""

import os
import sys
from collections.abc import Callable, Iterable, Sequence
from typing import IO, Final, TextIO, TypeVar

from btcore.engine.node import TreeNode
from btcore.escaping import escape_controls
from btcore.status import IDLE, RUNNING, NodeType, Status
from btcore.suggestions import counted

T = TypeVar("T")

Fragment = tuple[str, str]
"""A part of a line: a text, and the words of its style, such as "bold yellow", in the notation of rich."""

STATUS_SIGNS: Final[dict[Status, Fragment]] = {
    Status.IDLE: ("○", "dim"),
    Status.RUNNING: ("▶", "bold yellow"),
    Status.SUCCESS: ("✔", "bold green"),
    Status.FAILURE: ("✘", "bold red"),
    Status.SKIPPED: ("↷", "cyan"),
}
_NODE_SIGNS: Final[dict[NodeType, Fragment]] = {
    NodeType.ACTION: ("▪", "green"),
    NodeType.CONDITION: ("◦", "cyan"),
    NodeType.CONTROL: ("●", "bold blue"),
    NodeType.DECORATOR: ("◇", "magenta"),
    NodeType.SUBTREE: ("▣", "bold yellow"),
}
# Before a node with a later sibling, before the last sibling, and below each of them.
_UNICODE_BRANCHES: Final = ("├── ", "└── ", "│   ", "    ")
_ASCII_BRANCHES: Final = ("|-- ", "`-- ", "|   ", "    ")

# The numbers of styles in the escape sequences of terminals (ECMA-48, "select graphic rendition").
_ANSI: Final = {
    "bold": "1", "dim": "2", "italic": "3",
    "red": "31", "green": "32", "yellow": "33", "blue": "34", "magenta": "35", "cyan": "36",
}  # fmt: skip


def node_sign(symbol: str, node_type: NodeType) -> Fragment:
    """Return the character for a node in drawings, in the style of the node's type.

    Args:
        symbol: The symbol that the node's class declares, or "". Only its first character is used.
        node_type: The node type, whose symbol is used by default.
    """
    sign, style = _NODE_SIGNS.get(node_type, ("▪", ""))
    return symbol[:1] or sign, style


def node_label(name: str, id: str, symbol: str, node_type: NodeType, ascii: bool = False) -> list[Fragment]:
    """Return the symbol and the name of a node, and its ID if it differs.

    Args:
        symbol: The symbol that the node's class declares, or "".
        ascii: Whether to leave out the symbol.
    """
    sign, style = node_sign(symbol, node_type)
    label = [] if ascii else [(f"{sign} ", style)]
    label.append((name, style if node_type is NodeType.ACTION or "bold" in style else f"bold {style}"))
    if name != id:
        label.append((f"  {id}", style))
    return label


def status_label(status: Status, ascii: bool = False) -> Fragment:
    """Return the symbol and the name of a status; in ASCII the name alone."""
    sign, style = STATUS_SIGNS[status]
    return status.name if ascii else f"{sign} {status.name}", style


def draw_branches(
    root: T,
    children: Callable[[T], Sequence[T]],
    label: Callable[[T], list[Fragment]],
    title: list[Fragment] | None = None,
    ascii: bool = False,
) -> list[list[Fragment]]:
    """Return the lines of a tree drawing, a line for each node. Control characters in texts are escaped.

    Args:
        children: Returns the children of a node.
        label: Returns the text of a node.
        title: A line above the root, from which the root branches off; None = no such line.
        ascii: Whether to draw the branches with ASCII characters only.
    """
    middle, last, bar, gap = _ASCII_BRANCHES if ascii else _UNICODE_BRANCHES
    lines = [] if title is None else [title]
    # A loop instead of recursion, because trees may be very deep: node, text before it, text below it.
    pending = [(root, "", "") if title is None else (root, last, gap)]
    while pending:
        node, before, below = pending.pop()
        lines.append([(before, "dim"), *label(node)] if before else label(node))
        end = last, gap
        for child in reversed(children(node)):
            pending.append((child, below + end[0], below + end[1]))
            end = middle, bar
    return [[(escape_controls(text, one_line=True), style) for text, style in line] for line in lines]


def draw_results(id: str, ticks: int, root: TreeNode, ascii: bool = False) -> list[list[Fragment]]:
    """Return the lines of a drawing of a tree, with the status or the last result of each node.

    Args:
        ascii: Whether to use ASCII characters only, except in names.
    """

    def label(node: TreeNode) -> list[Fragment]:
        parts = node_label(node.name, node.config.id, node.spec.symbol, node.spec.node_type, ascii)
        return [*parts, ("  ", ""), _result(node, ascii)]

    title = [(id, "bold"), (f"  {counted(ticks, 'tick')}", "dim")]
    return draw_branches(root, lambda node: node.children, label, title, ascii)


def _result(node: TreeNode, ascii: bool) -> Fragment:
    """Return the status of a node; if it is IDLE, the last result in parentheses."""
    status, last = node._status, node._status_before_reset
    if status is not IDLE or last is IDLE:
        return status_label(status, ascii)
    text, style = status_label(last, ascii)
    # A node that was reset while it was RUNNING has no result.
    return ("(halted)", "dim yellow") if last is RUNNING else (f"({text})", style.replace("bold", "dim"))


def node_depths(nodes: Iterable[TreeNode]) -> dict[int, int]:
    """Return the depth below the root for each of *nodes*, in which parents come before children, by UID."""
    depths: dict[int, int] = {}
    for node in nodes:
        depth = depths.setdefault(node.config.uid, 0)
        depths.update((child.config.uid, depth + 1) for child in node.children)
    return depths


def to_text(lines: Iterable[Iterable[Fragment]], styled: bool = False) -> str:
    """Return the lines of a drawing as a text.

    Args:
        styled: Whether to write the styles as escape sequences of terminals.
    """
    return "\n".join(
        "".join(_with_style(text, style) if styled and style else text for text, style in line)
        for line in lines
    )


def _with_style(text: str, style: str) -> str:
    numbers = ";".join(_ANSI[word] for word in style.split())
    return f"\x1b[{numbers}m{text}\x1b[0m" if numbers else text


def is_ascii_only(file: IO[str] | None) -> bool:
    """Return whether *file* cannot write the characters of drawings."""
    encoding = getattr(file, "encoding", None)
    if not encoding:
        return False  # a StringIO, for example
    try:
        "├▶".encode(encoding)
    except (UnicodeEncodeError, LookupError):
        return True
    return False


def shows_colours(file: TextIO) -> bool:
    """Return whether *file* is a terminal with colours; the usual environment variables override it."""
    if os.environ.get("NO_COLOR"):
        return False
    if os.environ.get("FORCE_COLOR"):
        return True
    # The old console of Windows prints the codes of colours; Windows Terminal sets WT_SESSION.
    default = "dumb" if sys.platform == "win32" and "WT_SESSION" not in os.environ else ""
    return file.isatty() and os.environ.get("TERM", default) != "dumb"


def print_results(id: str, ticks: int, root: TreeNode, file: TextIO | None) -> None:
    """Print `draw_results` on *file* (default: standard output), in colours if it is a terminal."""
    file = sys.stdout if file is None else file
    text = to_text(draw_results(id, ticks, root, is_ascii_only(file)), shows_colours(file))
    encoding = getattr(file, "encoding", None)
    if encoding:
        # A name may contain characters that the file cannot write.
        text = text.encode(encoding, "backslashreplace").decode(encoding)
    file.write(f"{text}\n")


def results_text(id: str, ticks: int, root: TreeNode) -> str:
    """Return `draw_results` as a text that standard output can write."""
    ascii = is_ascii_only(sys.stdout)
    text = to_text(draw_results(id, ticks, root, ascii))
    return text.encode("ascii", "backslashreplace").decode() if ascii else text
