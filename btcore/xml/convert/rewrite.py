"""Changing single tags and attributes of a document, and nothing else of its text."""

import re
from typing import Final

from btcore.xml.read.document import Document
from btcore.xml.read.element import Element
from btcore.xml.read.tinyxml2_compat import find_attribute, iter_markup, value_span

_IN_VALUE: Final = {"&": "&amp;", "<": "&lt;", "\n": "&#10;", "\r": "&#13;", "\t": "&#9;"}


def escape_value(text: str, quote: str = '"') -> str:
    """*text* as it stands between quotes of an attribute, with as few references as XML allows."""
    quoted = {**_IN_VALUE, quote: "&quot;" if quote == '"' else "&apos;"}
    return "".join(quoted.get(char, char) for char in text)


class Rewriter:
    """Gathers changes to *document*; :meth:`text` applies them. All that isn't changed stays as it is.

    Elements and attributes are named as they are in the document, whatever was changed before.
    """

    def __init__(self, document: Document) -> None:
        self._document = document
        self._source = document.text
        self._starts: list[re.Match[str]] = []
        self._ends: dict[int, int] = {}
        self._edits: list[tuple[int, int, str]] = []
        self._match_tags()

    def _match_tags(self) -> None:
        """Find every start tag, and the end tag that belongs to it."""
        open_tags: list[int] = []
        for at, tag in iter_markup(self._source):
            if tag is not None:
                if not tag[0].endswith("/>"):
                    open_tags.append(len(self._starts))
                self._starts.append(tag)
            elif self._source.startswith("</", at) and open_tags:
                self._ends[open_tags.pop()] = at + 2

    def _tag(self, element: Element) -> re.Match[str]:
        return self._starts[self._document.source_map.index(element)]

    def rename_element(self, element: Element, name: str) -> None:
        """Call *element* *name*, in its start tag and its end tag."""
        index = self._document.source_map.index(element)
        tag = self._starts[index]
        self._edits.append((tag.start(1), tag.end(1), name))
        end = self._ends.get(index)
        if end is not None:
            self._edits.append((end, end + len(tag[1]), name))

    def insert_attribute(self, element: Element, name: str, text: str) -> None:
        """Write one more attribute, before all others."""
        at = self._tag(element).end(1)
        self._edits.append((at, at, f' {name}="{escape_value(text)}"'))

    def set_attribute(self, element: Element, attribute: str, text: str) -> None:
        """Write another value; the quotes stay as they are."""
        found = self._attribute(element, attribute)
        start, end = value_span(found)
        self._edits.append((start, end, escape_value(text, self._source[end])))

    def rename_attribute(self, element: Element, attribute: str, name: str) -> None:
        """Call an attribute *name*."""
        found = self._attribute(element, attribute)
        self._edits.append((found.start(1), found.end(1), name))

    def remove_attribute(self, element: Element, attribute: str) -> None:
        """Take an attribute out, with the space before it."""
        found = self._attribute(element, attribute)
        start = found.start()
        while self._source[start - 1].isspace():
            start -= 1
        self._edits.append((start, found.end(), ""))

    def _attribute(self, element: Element, name: str) -> re.Match[str]:
        found = find_attribute(self._tag(element), name)
        if found is None:
            raise KeyError(name)
        return found

    def text(self) -> str:
        """The document with all changes made."""
        pieces: list[str] = []
        done = 0
        for start, end, replacement in sorted(self._edits, key=lambda edit: edit[:2]):
            if start < done:  # a change to what is removed as a whole
                continue
            pieces += (self._source[done:start], replacement)
            done = end
        return "".join([*pieces, self._source[done:]])
