"""W108: text between the elements of a tree, which is ignored."""

import re
from collections.abc import Iterator
from typing import Final

from btcore.diagnostic_codes import LOOSE_TEXT
from btcore.xml.read.diagnostics import DiagnosticCollector
from btcore.xml.read.document import Document
from btcore.xml.read.positions import span_at
from btcore.xml.read.tinyxml2_compat import iter_markup

_OPAQUE: Final = re.compile(r"<!--.*?-->|<!\[CDATA\[.*?\]\]>|<\?.*?\?>", re.DOTALL)


def check_stray_text(document: Document, diagnostics: DiagnosticCollector) -> None:
    """Warn about each text between the elements of *document*, in its trees and between them."""
    for start, text in _loose(document.text):
        shown = text if len(text) <= 40 else f"{text[:39]}…"
        message = f"the text {shown!r} between the elements of a tree is ignored"
        hint = "pass values to a node in its attributes; write comments as <!-- … -->"
        place = span_at(document.text, start, len(text))
        diagnostics.add(place.diagnostic(LOOSE_TEXT, message, document.file, hint))


def _loose(text: str) -> Iterator[tuple[int, str]]:
    """Yield the offset and the text of each text between elements."""
    # Blanks of the same length keep the offsets.
    bare = _OPAQUE.sub(lambda match: " " * len(match[0]), text)
    around: list[str] = []
    for at, tag in iter_markup(bare):
        end = tag.end() if tag is not None else bare.find(">", at) + 1
        if tag is None:
            if around and bare.startswith("</", at):
                around.pop()
        elif not tag[0].endswith("/>"):
            around.append(tag[1])
        # Text inside a TreeNodesModel is a description.
        if around == ["root"] or around[1:2] == ["BehaviorTree"]:
            following = bare.find("<", end)
            stretch = bare[end:following]
            if stretch.strip():
                yield end + len(stretch) - len(stretch.lstrip()), " ".join(stretch.split())
