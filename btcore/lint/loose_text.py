"""Find text between the elements of a tree, which is ignored (W108)."""

import re
from typing import Final

from btcore.diagnostic_codes import LOOSE_TEXT
from btcore.xml.read.diagnostics import DiagnosticCollector
from btcore.xml.read.document import Document
from btcore.xml.read.positions import LineIndex
from btcore.xml.read.scan import ScannedElement

_OPAQUE: Final = re.compile(r"<!--.*?-->|<!\[CDATA\[.*?\]\]>|<\?.*?\?>", re.DOTALL)


def check_loose_text(document: Document, collector: DiagnosticCollector) -> None:
    """Warn about each text between the elements of *document*, in its trees and between them."""
    lines = LineIndex(document.text)
    for start, end, parent in document.source_map.scan.iter_text():
        # Comments and the like become spaces of the same length, so that offsets stay valid.
        between = _OPAQUE.sub(lambda match: " " * len(match[0]), document.text[start:end])
        text = " ".join(between.split())
        if text and _is_of_trees(parent):
            shown = text if len(text) <= 40 else f"{text[:39]}…"
            message = f"the text {shown!r} between the elements of a tree is ignored"
            hint = "pass values to a node in its attributes; write comments as <!-- … -->"
            place = lines.span(start + len(between) - len(between.lstrip()), len(text))
            collector.add(place.diagnostic(LOOSE_TEXT, message, document.file, hint))


def _is_of_trees(parent: ScannedElement | None) -> bool:
    """Return whether a text in *parent* is in a tree or between trees. In a model it is a description."""
    around = [] if parent is None else [parent, *parent.ancestors()]
    tags = [element.tag for element in reversed(around)]
    return tags == ["root"] or tags[1:2] == ["BehaviorTree"]
