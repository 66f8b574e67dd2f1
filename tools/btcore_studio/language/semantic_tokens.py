"""Colour the scripts and the blackboard keys of a document."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Final, NamedTuple

from lsprotocol import types

from btcore.script import lexer
from btcore.xml.read.scan import ScannedAttribute
from btcore_studio.language.node_attributes import file_symbols, node_element, script_tokens
from btcore_studio.language.project import Project, SourceDocument
from btcore_studio.language.symbols import FileSymbols, KeyForm

_TYPES: Final = ("variable", "property", "number", "string", "keyword", "operator", "enumMember")
LEGEND: Final = types.SemanticTokensLegend(list(_TYPES), ["modification"])
"""The token types and modifiers. A key is a variable; as the name of a SubTree's attribute, a property."""

_TYPE_OF_TOKEN: Final = {
    lexer.NAME: "variable",
    lexer.INTEGER: "number",
    lexer.REAL: "number",
    lexer.STRING: "string",
    lexer.BOOLEAN: "keyword",
}
# Names in scripts are tokens of the script; defaults are not written in the document.
_NOT_HERE: Final = (KeyForm.SCRIPT, KeyForm.DEFAULT)


class _Token(NamedTuple):
    start: int
    end: int
    type: str
    is_modification: bool


def semantic_tokens(
    project: Project, document: SourceDocument, range: types.Range | None = None
) -> types.SemanticTokens:
    """Return the tokens of all scripts and keys, or of those in a range.

    Args:
        project: The project of the document.
        range: The range to colour; None = the whole document.
    """
    first, last = 0, len(document.text)
    if range is not None:
        first, last = document.positions.offset(range.start), document.positions.offset(range.end)
    symbols = file_symbols(project, document)
    tokens = [*_keys(symbols), *_scripts(project, document, symbols, first, last)]
    shown = sorted(token for token in tokens if token.start < last and token.end > first)
    return types.SemanticTokens(list(_encode(document, shown)))


def _keys(symbols: FileSymbols) -> Iterator[_Token]:
    """Yield the tokens of the keys outside of scripts."""
    for tree in symbols.trees:
        uses = [use for use in tree.uses if use.form not in _NOT_HERE]
        for call in tree.calls:
            for port in call.ports.values():
                yield _Token(port.inner.start, port.inner.end, "property", port.inner.writes)
                if port.outer is not None:
                    uses.append(port.outer)
        for use in uses:
            if use.start < use.end:
                yield _Token(use.start, use.end, "variable", use.writes)


def _scripts(
    project: Project, document: SourceDocument, symbols: FileSymbols, first: int, last: int
) -> Iterator[_Token]:
    """Yield the tokens of the scripts in the elements between two offsets."""
    enums = project.registry.types.enums
    written = {
        use.start for tree in symbols.trees for use in tree.uses if use.form is KeyForm.SCRIPT and use.writes
    }
    for tree in symbols.trees:
        for element in tree.nodes:
            if element.start >= last or element.start_tag_end <= first:
                continue
            node = node_element(element, symbols.format, project.registry)
            for attribute in element.attributes:
                if attribute.value and node.is_script(attribute.name):
                    yield from _script(document.text, attribute, enums, written)


def _script(
    text: str, attribute: ScannedAttribute, enums: Mapping[str, int], written: set[int]
) -> Iterator[_Token]:
    for token, start, end in script_tokens(text, attribute):
        if token.type == lexer.MALFORMED:
            continue
        token_type = _TYPE_OF_TOKEN.get(token.type, "operator")
        if token.type == lexer.NAME and token.text in enums:
            token_type = "enumMember"
        yield _Token(start, end, token_type, start in written)


def _encode(document: SourceDocument, tokens: Iterable[_Token]) -> Iterator[int]:
    """Yield five numbers per token: lines and characters after the previous token, length, type, modifier."""
    line = character = 0
    positions = document.positions
    for token in tokens:
        start, end = positions.position(token.start), positions.position(token.end)
        if start.line != end.line:
            continue  # clients need not support tokens of several lines, such as a long text in a script
        yield start.line - line
        yield start.character - (character if start.line == line else 0)
        yield end.character - start.character
        yield _TYPES.index(token.type)
        yield int(token.is_modification)
        line, character = start.line, start.character
