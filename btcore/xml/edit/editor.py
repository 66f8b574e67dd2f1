"""Edits of a text, and operations on the elements of a document as edits that change the fewest characters.

Comments, the order of attributes, white space and line ends outside of the change remain.
"""

import re
from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

from btcore.errors import BtcoreError
from btcore.xml.read.scan import Scan, ScannedAttribute, ScannedElement, scan

INDENT: Final = "  "
"""The indentation of a child in a document that does not show another indentation."""
_COMMENTS_IN_LINE: Final = re.compile(r"(?:[ \t]*<!--(?:(?!-->)[^\r\n])*-->)+")
# XML parsers other than tinyxml2 read line breaks and tabs in values as spaces.
_ESCAPES: Final = {"&": "&amp;", "<": "&lt;", "\n": "&#10;", "\r": "&#13;", "\t": "&#9;"}


class EditError(BtcoreError):
    """An operation cannot be applied to a document; the message is the reason."""


class Edit(NamedTuple):
    """The characters from *start* to *end* of a text are replaced by *text*."""

    start: int
    end: int
    text: str


def apply_edits(text: str, edits: Iterable[Edit]) -> str:
    """Return *text* after all *edits*, whose offsets count in *text*.

    Insertions at the same place keep their order. An edit that begins inside another edit is ignored.
    """
    pieces: list[str] = []
    done = 0
    # The sort is stable: insertions at the same place keep their order.
    for start, end, replacement in sorted(edits, key=lambda edit: edit[:2]):
        if start >= done:
            pieces += (text[done:start], replacement)
            done = end
    return "".join([*pieces, text[done:]])


def escape_value(text: str, quote: str = '"') -> str:
    """Return *text* as it is written in an attribute's value between *quote* characters."""
    escapes = {**_ESCAPES, quote: "&quot;" if quote == '"' else "&apos;"}
    return "".join(escapes.get(character, character) for character in text)


class DocumentEditor:
    """Makes edits of a document from operations on its elements.

    The operations do not check whether the result is a valid tree.

    Args:
        scan: The elements of the document's text.
    """

    def __init__(self, scan: Scan) -> None:
        self.scan = scan
        self.text = scan.text
        at = self.text.find("\n")
        self.line_break = "\r\n" if at > 0 and self.text[at - 1] == "\r" else "\n"

    # --- attributes

    def set_attribute(self, element: ScannedElement, name: str, value: str) -> Edit:
        """Give an attribute a value; a new attribute follows the others."""
        attribute = element.attribute(name)
        if attribute is not None and attribute.is_closed:
            return self.set_value(attribute, value)
        written = f'{name}="{escape_value(value)}"'
        if attribute is not None:  # its value is missing or not closed
            return Edit(attribute.start, attribute.end, written)
        at = element.attributes[-1].end if element.attributes else element.tag_end
        return Edit(at, at, f" {written}")

    def set_value(self, attribute: ScannedAttribute, value: str) -> Edit:
        """Replace the value of an attribute, which keeps its quotes."""
        start, end = attribute.value_start, attribute.value_end
        return Edit(start, end, escape_value(value, self.text[start - 1 : start]))

    def rename_attribute(self, element: ScannedElement, name: str, new_name: str) -> Edit:
        """Rename an attribute.

        Raises:
            EditError: There is no such attribute, or there is an attribute *new_name* already.
        """
        attribute = self._attribute(element, name)
        if element.attribute(new_name) is not None:
            raise EditError(f"<{element.tag}> has an attribute '{new_name}' already")
        return Edit(attribute.start, attribute.name_end, new_name)

    def remove_attribute(self, element: ScannedElement, name: str) -> Edit:
        """Remove an attribute and the white space before it.

        Raises:
            EditError: There is no such attribute.
        """
        attribute = self._attribute(element, name)
        return Edit(self.before_space(attribute.start), attribute.end, "")

    def _attribute(self, element: ScannedElement, name: str) -> ScannedAttribute:
        attribute = element.attribute(name)
        if attribute is None:
            raise EditError(f"<{element.tag}> has no attribute '{name}'")
        return attribute

    # --- elements

    def rename_element(self, element: ScannedElement, name: str) -> list[Edit]:
        """Change the name of an element in its start tag and its end tag."""
        edits = [Edit(element.tag_start, element.tag_end, name)]
        if element.end_tag_start >= 0:
            at = self.text.index(element.tag, element.end_tag_start)
            edits.append(Edit(at, at + len(element.tag), name))
        return edits

    def insert(self, parent: ScannedElement, index: int, xml: str) -> Edit:
        """Insert elements among the children of an element.

        Args:
            index: The number of children before the new elements.
            xml: The new elements, which are indented like their neighbours.

        Raises:
            EditError: *xml* is not a sequence of complete elements.
        """
        fragment = scan(xml.strip())
        if not fragment.roots or not _is_whole(fragment):
            raise EditError("the text is not a sequence of complete elements")
        children = parent.children
        if not children:
            return self._fill(parent, fragment)
        neighbour = children[min(index, len(children) - 1)]
        own = self.indent(neighbour)
        written = self._indented(fragment, own or "")
        if index < len(children):
            separator = "" if own is None else self.line_break + own
            return Edit(neighbour.start, neighbour.start, written + separator)
        comments = _COMMENTS_IN_LINE.match(self.text, neighbour.end)
        at = neighbour.end if comments is None else comments.end()
        return Edit(at, at, ("" if own is None else self.line_break + own) + written)

    def _fill(self, parent: ScannedElement, fragment: Scan) -> Edit:
        """Give an element without children the elements of *fragment*."""
        own, text = self.indent(parent), self.text
        if own is None:
            inner = self._indented(fragment, "")
        else:
            indent = own + self.step()
            inner = self.line_break + indent + self._indented(fragment, indent) + self.line_break + own
        if parent.is_empty:
            slash = self.before_space(parent.start_tag_end - 2)
            return Edit(slash, parent.start_tag_end, f">{inner}</{parent.tag}>")
        start = parent.start_tag_end
        end = parent.end_tag_start if parent.end_tag_start >= 0 else start
        if text[start:end].strip():  # a comment or a text, which remains
            end = self.before_space(end)
            return Edit(end, end, inner.rstrip())
        return Edit(start, end, inner)

    def _indented(self, fragment: Scan, indent: str) -> str:
        """Return the elements of *fragment*; lines after the first begin with *indent* or more."""
        inner = DocumentEditor(fragment)
        closing = fragment.roots[-1].end_tag_start
        old = inner.indent_at(closing) if closing >= 0 else None
        edits = inner.reindent(0, len(fragment.text), old or "", indent)
        text = apply_edits(fragment.text, edits)
        return text.replace("\r\n", "\n").replace("\n", self.line_break)

    def remove(self, element: ScannedElement) -> Edit:
        """Remove an element with its content; if it has lines of its own, with these lines."""
        start, end = element.start, element.end
        own = self.indent(element)
        line_end = self.text.find("\n", end) + 1 or len(self.text)
        if own is not None and not self.text[end:line_end].strip():
            return Edit(start - len(own), line_end, "")
        return Edit(start, end, "")

    def remove_children(self, element: ScannedElement) -> Edit:
        """Remove the content of an element, which becomes an empty tag."""
        end = element.end if element.end_tag_start >= 0 else element.children[-1].end
        return Edit(element.start_tag_end - 1, end, "/>")

    def wrap(self, children: Sequence[ScannedElement], tag: str, attributes: str = "") -> list[Edit]:
        """Put consecutive siblings into a new element, which is indented like its neighbours.

        Args:
            tag: The tag of the new element.
            attributes: Its attributes, with a space before each.
        """
        start, end = children[0].start, children[-1].end
        own = self.indent(children[0])
        if own is None:
            return [Edit(start, start, f"<{tag}{attributes}>"), Edit(end, end, f"</{tag}>")]
        inner = own + self.step()
        before = Edit(start, start, f"<{tag}{attributes}>{self.line_break}{inner}")
        after = Edit(end, end, f"{self.line_break}{own}</{tag}>")
        return [before, *self.reindent(start, end, own, inner), after]

    def append_lines(self, element: ScannedElement, lines: Sequence[str]) -> Edit:
        """Add *lines*, which have their indentation, before the end tag of an element."""
        at = element.end_tag_start if element.end_tag_start >= 0 else element.end
        own = self.indent_at(at)
        at -= len(own) if own is not None else 0
        return Edit(at, at, "".join(line + self.line_break for line in lines))

    # --- layout

    def before_space(self, offset: int) -> int:
        """Return the start of the white space before *offset*."""
        while offset and self.text[offset - 1].isspace():
            offset -= 1
        return offset

    def indent(self, element: ScannedElement) -> str | None:
        """Return the white space before an element that begins its line; None for any other element."""
        return self.indent_at(element.start)

    def indent_at(self, offset: int) -> str | None:
        """Return the white space before *offset* in its line; None if there is something else."""
        line = self.text[self.text.rfind("\n", 0, offset) + 1 : offset]
        return line if not line.strip() else None

    def step(self) -> str:
        """Return the indentation by which a child is deeper than its parent in this document."""
        for element in self.scan.elements:
            if element.parent is not None:
                inner, outer = self.indent(element), self.indent(element.parent)
                if inner is not None and outer is not None and inner.startswith(outer) and inner != outer:
                    return inner[len(outer) :]
        return INDENT

    def reindent(self, start: int, end: int, old: str, new: str) -> list[Edit]:
        """Replace the indentation *old* by *new* in the lines that begin between *start* and *end*.

        Lines that begin in a value, a comment or a text keep their indentation.
        """
        edits: list[Edit] = []
        at = self.text.find("\n", start, end) + 1
        while at:
            first = at
            while first < end and self.text[first] in " \t":
                first += 1
            kind = self.scan.element_at(at).kind
            is_markup = kind == "in_tag" or (kind == "text" and self.text[first : first + 1] == "<")
            if is_markup and self.text.startswith(old, at):
                edits.append(Edit(at, at + len(old), new))
            at = self.text.find("\n", at, end) + 1
        return edits


def _is_whole(fragment: Scan) -> bool:
    """Return whether a text consists of complete elements, comments and white space."""
    at = 0
    for start, end in sorted([*((root.start, root.end) for root in fragment.roots), *fragment.comments]):
        if start >= at:
            if fragment.text[at:start].strip():
                return False
            at = end
    return not fragment.text[at:].strip() and all(map(_is_closed, fragment.elements))


def _is_closed(element: ScannedElement) -> bool:
    is_ended = element.is_empty or element.end_tag_start >= 0
    return element.is_complete and is_ended and all(item.is_closed for item in element.attributes)
