"""Find text between the elements of a tree, which is ignored (W108)."""

import re
from collections.abc import Iterator
from typing import Final

from btcore.diagnostic_codes import LOOSE_TEXT
from btcore.xml.read.diagnostics import DiagnosticCollector
from btcore.xml.read.positions import LineIndex
from btcore.xml.read.read import Document
from btcore.xml.read.tinyxml2_compat import iter_markup

_OPAQUE: Final = re.compile(r"<!--.*?-->|<!\[CDATA\[.*?\]\]>|<\?.*?\?>", re.DOTALL)


def check_loose_text(document: Document, collector: DiagnosticCollector) -> None:
    """Warn about each text between the elements of *document*, in its trees and between them."""
    lines = LineIndex(document.text)
    for start, text in _iter_loose_text(document.text):
        shown = text if len(text) <= 40 else f"{text[:39]}…"
        message = f"the text {shown!r} between the elements of a tree is ignored"
        hint = "pass values to a node in its attributes; write comments as <!-- … -->"
        place = lines.span(start, len(text))
        collector.add(place.diagnostic(LOOSE_TEXT, message, document.file, hint))


def _iter_loose_text(text: str) -> Iterator[tuple[int, str]]:
    """Yield the offset and the text of each text between elements."""
    open_tags: list[str] = []
    end = 0
    for at, tag in iter_markup(text):
        # Text inside a TreeNodesModel is a description.
        if open_tags == ["root"] or open_tags[1:2] == ["BehaviorTree"]:
            # Comments and the like become spaces of the same length, so that offsets stay valid.
            between = _OPAQUE.sub(lambda match: " " * len(match[0]), text[end:at])
            if between.strip():
                yield end + len(between) - len(between.lstrip()), " ".join(between.split())
        end = tag.end() if tag is not None else text.find(">", at) + 1
        if tag is None:
            if open_tags and text.startswith("</", at):
                open_tags.pop()
        elif not tag[0].endswith("/>"):
            open_tags.append(tag[1])
