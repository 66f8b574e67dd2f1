"""Diagnostics: errors and warnings about a document; `xml/read/document.py` collects them while loading."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import Final, Literal, NamedTuple

from btcore.diagnostic_codes import DiagnosticCode
from btcore.escaping import escape_controls
from btcore.fixes import Fix, Rename
from btcore.suggestions import counted, suggestion


class HintAndFixes(NamedTuple):
    """The hint and the fixes of a diagnostic."""

    hint: str = ""
    fixes: Sequence[Fix] = ()

    @classmethod
    def similar_name(cls, name: str) -> "HintAndFixes":
        """Return the hint and the fix if the marked name may be a misspelt *name*."""
        return cls(suggestion(f"'{name}'"), [Rename(name)])


class Diagnostic(NamedTuple):
    """One error or warning about a document.

    Attributes:
        code: The stable code (docs/reference/errors.md explains each code).
        message: What is wrong.
        file: The file; "" = the document was given as a text.
        line: The line, from 1; 0 = unknown.
        column: The column in characters, from 1; 0 = unknown.
        hint: How to correct the problem, or "".
        source: The text of the line.
        width: The number of characters to mark.
        fixes: Changes of the document that remove the problem, the best first.
        outer_key: The key of an entry that a calling tree or the program may write instead; "" = none.
        attributes: The attributes of the element that the problem is about: the marked one, or missing ones.
        characters: The start and the end of the marked part of the attribute's value, from 0, where a
            reference such as `&amp;` is one character; (0, 0) = the whole value.

    Examples:
        >>> import btcore
        >>> b = btcore.Builder()
        >>> try:
        ...     b.build(b.Inverter())
        ... except btcore.TreeError as error:
        ...     diagnostic = error.diagnostics[0]
        >>> diagnostic.code, diagnostic.is_error, diagnostic.code.summary
        ('E104', True, 'wrong number of children')
    """

    code: DiagnosticCode
    message: str
    file: str = ""
    line: int = 0
    column: int = 0
    hint: str = ""
    source: str = ""
    width: int = 1
    fixes: tuple[Fix, ...] = ()
    outer_key: str = ""
    attributes: tuple[str, ...] = ()
    characters: tuple[int, int] = (0, 0)

    @property
    def is_error(self) -> bool:
        """Whether the problem prevents loading the tree, or makes every tick raise."""
        return self.code.severity == "error"

    @property
    def where(self) -> str:
        """`file:line:column`, without the unknown parts."""
        parts = [self.file or "<text>"]
        if self.line:
            parts.append(str(self.line))
            if self.column:
                parts.append(str(self.column))
        return ":".join(parts)

    def __str__(self) -> str:
        return "".join(text for _, text in diagnostic_parts(self))


DiagnosticPart = Literal["place", "code", "message", "line", "carets", "hint"]


def diagnostic_parts(diagnostic: Diagnostic) -> Iterator[tuple[DiagnosticPart, str]]:
    """Yield the parts of the text of a diagnostic, which the terminal prints in different styles."""
    yield "place", f"{diagnostic.where}: "
    yield "code", diagnostic.code
    yield "message", f" {diagnostic.message}"
    if diagnostic.source and diagnostic.line:
        shown = excerpt(diagnostic.source, diagnostic.line, diagnostic.column, diagnostic.width)
        line, line_break, carets = shown.partition("\n")
        yield "line", f"\n{line}"
        yield "carets", line_break + carets
    if diagnostic.hint:
        yield "hint", f"\n      {diagnostic.hint}"


class LiteralProblem(NamedTuple):
    """A literal in the text of a port that is invalid, found by `TreeNode.check_literals`.

    Attributes:
        port: The name of the port.
        message: What is wrong.
        hint: How to correct the problem, or "".
        start: The number of the first invalid character in the text, from 1; 0 = the whole text.
        width: The number of invalid characters.
        is_unchecked: Whether the literal could not be checked, which is a warning (W215) instead of an error.

    Examples:
        >>> import btcore
        >>> class Goto(btcore.SyncAction):
        ...     room: btcore.In[str]
        ...     @classmethod
        ...     def check_literals(cls, literals):
        ...         if literals.get("room", "kitchen") not in ("kitchen", "hall"):
        ...             yield btcore.LiteralProblem("room", "unknown room", "rooms: kitchen and hall")
        >>> [problem.message for problem in Goto.check_literals({"room": "cellar"})]
        ['unknown room']
    """

    port: str
    message: str
    hint: str = ""
    start: int = 0
    width: int = 0
    is_unchecked: bool = False


MAX_EXCERPT: Final = 100
"""The maximum number of characters of a line in a message; a longer line is cut."""


def excerpt(source: str, line: int, column: int, width: int = 1) -> str:
    """Return a line of text with carets below the marked characters. Control characters are escaped.

    Args:
        source: The line.
        line: The number of the line, from 1.
        column: The column of the first marked character, from 1; 0 = no marks.
        width: The number of marked characters.
    """
    start = max(0, min(column - 1 - MAX_EXCERPT // 3, len(source) - MAX_EXCERPT))
    shown = source[start : start + MAX_EXCERPT].replace("\t", " ")
    if not column:
        return f"   {line} |  {escape_controls(shown)}"
    first = column - 1 - start
    last = first + max(1, min(width, MAX_EXCERPT, len(source) - column + 1))
    before, marked, after = map(escape_controls, (shown[:first], shown[first:last], shown[last:]))
    gap = " " * (len(str(line)) + 3) + " |  "
    # Beyond the end of the line, a caret is below no character.
    indent = len(before) + first - len(shown[:first])
    carets = len(marked) + last - first - len(shown[first:last])
    return f"   {line} |  {before}{marked}{after}\n{gap}{' ' * indent}{'^' * carets}"


MAX_SHOWN_DIAGNOSTICS: Final = 100
"""The maximum number of diagnostics of one file in a message."""


def shown_diagnostics(diagnostics: Iterable[Diagnostic]) -> tuple[list[Diagnostic], list[str]]:
    """Return the first 100 diagnostics of each file, and a sentence that counts the others of each file."""
    shown: list[Diagnostic] = []
    kept: Counter[str] = Counter()
    omitted: dict[str, Counter[str]] = {}
    for diagnostic in diagnostics:
        file = diagnostic.file
        if kept[file] < MAX_SHOWN_DIAGNOSTICS:
            kept[file] += 1
            shown.append(diagnostic)
        else:
            omitted.setdefault(file, Counter())[diagnostic.code.severity] += 1
    sentences = [
        f"{file or '<text>'}: "
        + " and ".join(counted(count, f"more {what}") for what, count in counts.items())
        for file, counts in omitted.items()
    ]
    return shown, sentences
