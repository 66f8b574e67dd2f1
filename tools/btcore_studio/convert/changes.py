"""The changes of a conversion: edits of the document's text, and a diagnostic for each."""

import re
from typing import Final

from btcore.diagnostic_codes import DiagnosticCode
from btcore.errors import Diagnostic
from btcore.registry.registry import Registry
from btcore.xml.read.element import Element, ElementPart
from btcore.xml.read.read import Document
from btcore.xml.read.tinyxml2_compat import iter_attributes, iter_markup, value_span

# XML parsers other than tinyxml2 read line breaks and tabs in values as spaces.
_IN_VALUE: Final = {"&": "&amp;", "<": "&lt;", "\n": "&#10;", "\r": "&#13;", "\t": "&#9;"}


def escape_value(text: str, quote: str = '"') -> str:
    """Escape the characters of *text* that an attribute value between *quote* characters must not have."""
    quoted = {**_IN_VALUE, quote: "&quot;" if quote == '"' else "&apos;"}
    return "".join(quoted.get(char, char) for char in text)


class ConversionChanges:
    """Collects edits of the text of *document*, and diagnostics that describe them.

    Arguments always name attributes as in the original document, even after an attribute was renamed. The
    codes of the diagnostics classify the changes. `C1…`: another spelling with the same meaning. `C2…`:
    the tree behaves differently in format 4. `C3…`: the user must make the change.
    """

    def __init__(self, document: Document, registry: Registry) -> None:
        self.document = document
        self.registry = registry
        self.diagnostics: list[Diagnostic] = []
        self._source = document.text
        self._starts: list[re.Match[str]] = []
        self._ends: dict[int, int] = {}
        self._edits: list[tuple[int, int, str]] = []
        self._match_tags()

    def note(
        self,
        code: DiagnosticCode,
        message: str,
        element: Element,
        attribute: str = "",
        hint: str = "",
        part: ElementPart = "value",
    ) -> None:
        """Add a diagnostic about a change of an element or of one of its attributes.

        Args:
            element: The element in the original document.
            attribute: Name of the attribute; "" means the element itself.
            part: Whether the diagnostic points to the attribute's name or to its value.
        """
        self.diagnostics.append(self.document.diagnostic(code, message, element, attribute, part, hint))

    def _match_tags(self) -> None:
        """Find every start tag with its end tag."""
        open_tags: list[int] = []
        for at, tag in iter_markup(self._source):
            if tag is not None:
                if not tag[0].endswith("/>"):
                    open_tags.append(len(self._starts))
                self._starts.append(tag)
            elif self._source.startswith("</", at) and open_tags:
                self._ends[open_tags.pop()] = at + len("</")

    def _tag(self, element: Element) -> re.Match[str]:
        return self._starts[self.document.source_map.index(element)]

    def rename_element(self, element: Element, name: str) -> None:
        """Change the name of *element* to *name*, in the start tag and in the end tag."""
        index = self.document.source_map.index(element)
        tag = self._starts[index]
        self._edits.append((tag.start(1), tag.end(1), name))
        end = self._ends.get(index)
        if end is not None:
            self._edits.append((end, end + len(tag[1]), name))

    def insert_attribute(self, element: Element, name: str, text: str) -> None:
        """Insert an attribute before the other attributes of an element.

        Args:
            text: The value, not escaped.
        """
        at = self._tag(element).end(1)
        self._edits.append((at, at, f' {name}="{escape_value(text)}"'))

    def set_attribute(self, element: Element, attribute: str, text: str) -> None:
        """Replace the value of an attribute, and keep its quotes.

        Args:
            text: The new value, not escaped.

        Raises:
            KeyError: The element has no such attribute.
        """
        start, end = value_span(self._attribute(element, attribute))
        self._edits.append((start, end, escape_value(text, self._source[end])))

    def rename_attribute(self, element: Element, attribute: str, name: str) -> None:
        """Rename an attribute.

        Args:
            attribute: The original name of the attribute.

        Raises:
            KeyError: The element has no such attribute.
        """
        match = self._attribute(element, attribute)
        self._edits.append((match.start(1), match.end(1), name))

    def remove_attribute(self, element: Element, attribute: str) -> None:
        """Remove an attribute and the space before it.

        Raises:
            KeyError: The element has no such attribute.
        """
        match = self._attribute(element, attribute)
        start = match.start()
        while self._source[start - 1].isspace():
            start -= 1
        self._edits.append((start, match.end(), ""))

    def _attribute(self, element: Element, name: str) -> re.Match[str]:
        for match in iter_attributes(self._tag(element)):
            if match[1] == name:
                return match
        raise KeyError(name)

    def text(self) -> str:
        """Return the text of the document with all edits applied."""
        pieces: list[str] = []
        done = 0
        # The sort is stable, so edits at the same place keep their order.
        for start, end, replacement in sorted(self._edits, key=lambda edit: edit[:2]):
            if start < done:  # an edit inside a removed attribute
                continue
            pieces += (self._source[done:start], replacement)
            done = end
        return "".join([*pieces, self._source[done:]])
