"""Mistakes as sentences with an address: where, what, what you may do."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from btcore.diagnostic_codes import DiagnosticCode


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """One fault in what a user wrote.

    *code* is stable (btcore/diagnostic_codes.py is the table, docs/errors.md explains each), *line*
    and *column* count from 1 (0 = unknown), columns in characters; *source* is the text of
    that line and *width* how many characters of it are meant.
    """

    code: DiagnosticCode
    message: str
    file: str = ""
    line: int = 0
    column: int = 0
    hint: str = ""
    source: str = ""
    width: int = 1

    @property
    def is_error(self) -> bool:
        """Whether the tree is refused for it, or raises as soon as it is ticked."""
        return self.code.severity == "error"

    @property
    def where(self) -> str:
        """``file:line:column``, as far as known."""
        parts = [self.file or "<text>"]
        if self.line:
            parts.append(str(self.line))
            if self.column:
                parts.append(str(self.column))
        return ":".join(parts)

    def __str__(self) -> str:
        text = f"{self.where}: {self.code} {self.message}"
        if self.source and self.line:
            text += "\n" + excerpt(self.source, self.line, self.column, self.width)
        if self.hint:
            text += "\n      " + self.hint
        return text


def excerpt(source: str, line: int, column: int, width: int = 1, room: int = 100) -> str:
    """*source*, one line of text, with carets under what is meant; long lines are cut to *room*."""
    start = max(0, min(column - 1 - room // 3, len(source) - room))
    shown = source[start : start + room].replace("\t", " ")
    text = f"   {line} |  {shown}"
    if column:
        gap = " " * (len(str(line)) + 3) + " |  "
        carets = max(1, min(width, room, len(source) - column + 1))
        text += "\n" + gap + " " * (column - 1 - start) + "^" * carets
    return text


class BtcoreError(Exception):
    """Everything that the engine raises on purpose."""


class TreeError(BtcoreError):
    """A tree can't be made as written. *diagnostics* holds every fault found, not only the first."""

    def __init__(self, diagnostics: Iterable[Diagnostic]) -> None:
        self.diagnostics: tuple[Diagnostic, ...] = tuple(diagnostics)
        super().__init__("\n".join(str(one) for one in self.diagnostics))


class XmlSyntaxError(TreeError):
    """The document is not XML, or not XML that a tree can be read from."""


class UnknownNodeError(TreeError):
    """A tag that no registered node answers to. Common causes: a typing mistake, or a plugin not loaded."""


class PortError(TreeError):
    """A port that the node doesn't have, or a value that doesn't fit its type."""


class RegistrationError(BtcoreError):
    """A node, type or enum can't be registered as it is."""


MOST_SHOWN: Final = 9
"""How many errors a sentence tells of that came after the first."""


class NodeExecutionError(BtcoreError):
    """A node raised while it was ticked or halted; the original is the ``__cause__``.

    *path* is the failing node's full path, *node_id* its registration ID, *where* its place in
    the XML, and *backtrace* the paths from the root to it. *also* are those that raised after it,
    while the tree was halted.
    """

    def __init__(
        self, path: str, node_id: str, cause: BaseException, doing: str = "ticking", where: str = ""
    ) -> None:
        self.path = path
        self.node_id = node_id
        self.cause = cause
        self.doing = doing
        self.where = where
        self.backtrace: list[str] = []
        self.later_errors: list[NodeExecutionError] = []
        super().__init__(path, node_id, str(cause))

    def __str__(self) -> str:
        kind = type(self.cause).__name__
        said = str(self.cause)
        text = f"node '{self.path}' <{self.node_id}> raised while {self.doing}: {kind}"
        if said:
            text += f": {said}"
        if self.where:
            text = f"{self.where}: {text}"
        for depth, step in enumerate(self.backtrace):
            mark = "→" if depth == len(self.backtrace) - 1 else " "
            text += f"\n    {mark} {'  ' * depth}{step}"
        for other in self.later_errors[:MOST_SHOWN]:
            text += f"\nand {other}"
        if len(self.later_errors) > MOST_SHOWN:
            text += f"\nand {len(self.later_errors) - MOST_SHOWN} more"
        return text


class NodeError(BtcoreError):
    """A node was used in a way that its rules forbid (say, too few children, a missing port)."""


class BlackboardError(BtcoreError):
    """An entry is missing, empty, or of another type than asked for."""


class ConversionError(BtcoreError, ValueError):
    """A text, or a value, can't become the type that is wanted."""


class ScriptError(BtcoreError):
    """A script can't be parsed or run; *column* counts from 1 in *text* (0 = the whole)."""

    def __init__(self, message: str, text: str = "", column: int = 0, width: int = 1) -> None:
        self.message = message
        self.text = text
        self.column = column
        self.width = width
        super().__init__(message)

    def __str__(self) -> str:
        if not self.text:
            return self.message
        if not self.column:
            return f"{self.message} in the script «{self.text}»"
        line = self.text.count("\n", 0, self.column - 1)
        start = self.text.rfind("\n", 0, self.column - 1) + 1
        shown = self.text[start:].split("\n", 1)[0]
        return f"{self.message}\n{excerpt(shown, line + 1, self.column - start, self.width)}"
