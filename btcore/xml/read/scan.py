"""Find the elements of a text that is being edited, whether it is well-formed XML or not.

The scan of a text that `btcore.xml.read` can parse has the same elements. In any other text, the scan is a
guess that keeps a mistake local: an element without end tag ends with its parent, a tag without `>` ends
at the next `<`, and a value without closing quote ends in its line at the latest.
"""

import re
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

from btcore.xml.read.element import Element
from btcore.xml.read.tinyxml2_compat import SPACE, START_TAG, WRITTEN_CHARACTER, decode

# More than XML allows, so that a name with a wrong character is found as a whole.
_NAME: Final = r"[^\s<>/!?=\"'&]++"
_WITHOUT_TAGS: Final = (("<!--", "-->"), ("<![CDATA[", "]]>"), ("<?", "?>"), ("<!", ">"))
_GAP: Final = re.compile(SPACE)
_TAG: Final = re.compile(rf"<{SPACE}({_NAME})")
_END_TAG: Final = re.compile(rf"<{SPACE}/{SPACE}({_NAME})?{SPACE}(>)?")
_ATTRIBUTE: Final = re.compile(rf"({_NAME})(?:{SPACE}={SPACE}(?:(\")([^\"]*+)(\")?|(')([^']*+)(')?)?)?")
# What can follow the closing quote of a value: white space, the end of the tag or the next attribute.
_AFTER_VALUE: Final = re.compile(rf"\s|/?>|\Z|{_NAME}{SPACE}=")
_TAG_ON_NEW_LINE: Final = re.compile(rf"[\n\r]{SPACE}<(?:!--|/?{_NAME}(?=[\s/>]))")
_END_OF_OPEN_VALUE: Final = re.compile(r"[\n\r<>]|/>")

PlaceKind = Literal["tag", "attribute", "value", "in_tag", "end_tag", "text", "comment"]
"""What an offset is in: the name of a start tag, the name or the value of an attribute, another part of a
start tag, an end tag, the text between tags, or a comment (also a declaration or CDATA)."""


@dataclass(slots=True, eq=False)
class ScannedAttribute:
    """An attribute in a start tag. All numbers are offsets in the text.

    Attributes:
        name: The name.
        start: The start of the name.
        name_end: The end of the name.
        value: The value with its references replaced; None if the attribute has no quotes yet.
        value_start: The start of the value, after the quote; *end* if there is no value.
        value_end: The end of the value, before the closing quote.
        end: The end of the attribute, after the closing quote.
        is_closed: Whether the value has its closing quote.
    """

    name: str
    start: int
    name_end: int
    value: str | None
    value_start: int
    value_end: int
    end: int
    is_closed: bool


class ScannedElement:
    """An element. All numbers are offsets in the text.

    Attributes:
        tag: The name of the tag.
        parent: The element around it, or None.
        start: The `<` of the start tag.
        tag_start: The start of the tag's name.
        tag_end: The end of the tag's name.
        children: The child elements in the order of the text.
        start_tag_end: The end of the start tag, after its `>`.
        is_complete: Whether the start tag has its `>`.
        is_empty: Whether the start tag ends with `/>`.
        end_tag_start: The `<` of the end tag, or -1 if there is none.
        end: The end of the element, after the end tag. An element whose end tag is missing ends where the
            element around it ends.
    """

    __slots__ = (
        "_attributes", "_by_name", "_scanner", "children", "end", "end_tag_start", "is_complete", "is_empty",
        "parent", "start", "start_tag_end", "tag", "tag_end", "tag_start",
    )  # fmt: skip

    def __init__(self, tag: re.Match[str], parent: "ScannedElement | None", scanner: "_Scanner") -> None:
        self.tag = tag[1]
        self.parent = parent
        self.start = tag.start()
        self.tag_start, self.tag_end = tag.span(1)
        self.children: list[ScannedElement] = []
        self.start_tag_end = self.end = -1
        self.is_complete = self.is_empty = False
        self.end_tag_start = -1
        self._scanner = scanner
        self._attributes: list[ScannedAttribute] | None = None
        self._by_name: dict[str, ScannedAttribute] | None = None

    @property
    def attributes(self) -> list[ScannedAttribute]:
        """The attributes in the order of the text; a name can occur twice."""
        if self._attributes is None:
            self._attributes = self._scanner.attributes_from(self.tag_end)[0]
        return self._attributes

    def node_children(self) -> list["ScannedElement"]:
        """Return the children without the obsolete `<Root>` of Groot 1."""
        return [child for child in self.children if child.tag != "Root"]

    def attribute(self, name: str) -> ScannedAttribute | None:
        """Return the first attribute with this name, or None."""
        if self._by_name is None:
            self._by_name = {attribute.name: attribute for attribute in reversed(self.attributes)}
        return self._by_name.get(name)

    def get(self, name: str) -> str | None:
        """Return the value of the attribute *name*, or None if it has no value."""
        attribute = self.attribute(name)
        return attribute.value if attribute is not None else None

    def parsed(self) -> Element:
        """Return the element as the parser returns it, but without children and line."""
        attributes: dict[str, str] = {}
        for attribute in self.attributes:
            attributes.setdefault(attribute.name, attribute.value or "")
        return Element(self.tag, attributes, 0)

    def ancestors(self) -> "Iterator[ScannedElement]":
        """Return the elements around this element, from the inside to the outside."""
        element = self.parent
        while element is not None:
            yield element
            element = element.parent

    def iter(self, *tags: str) -> "Iterator[ScannedElement]":
        """Yield the element and its descendants in the order of the text; with *tags*, only these."""
        pending = [self]
        while pending:
            element = pending.pop()
            if not tags or element.tag in tags:
                yield element
            pending += reversed(element.children)


class Place(NamedTuple):
    """What an offset of the text is in.

    Attributes:
        kind: The kind of the place.
        element: The element whose tag contains the offset; None in text and comments, at a `<` without name
            (kind "tag"), and in an end tag without start tag.
        attribute: The attribute whose name or value contains the offset, or None.
        parent: The innermost element whose content contains the offset, or None. In a tag, the parent of
            the tag's element.
        start: The start of the name or the value; elsewhere the start of the markup or the text.
        end: The end of the name or the value; elsewhere the end of the markup or the text.
    """

    kind: PlaceKind
    element: ScannedElement | None
    attribute: ScannedAttribute | None
    parent: ScannedElement | None
    start: int
    end: int


class _Markup(NamedTuple):
    """A tag or a comment from *start* to *end*, whether it has its `>`, and its element."""

    start: int
    end: int
    kind: Literal["start", "end", "comment", "bare"]
    is_complete: bool
    element: ScannedElement | None


class Scan:
    """The elements of a text.

    Attributes:
        text: The text.
        roots: The outermost elements; a correct document has one.
        elements: All elements in the order of the text.
        opaque: The start and the end of each comment, declaration and section of character data.
    """

    def __init__(
        self, text: str, roots: list[ScannedElement], elements: list[ScannedElement], markup: list[_Markup]
    ) -> None:
        self.text = text
        self.roots = roots
        self.elements = elements
        self.opaque = [(start, end) for start, end, kind, _, _ in markup if kind == "comment"]
        self._markup = markup
        self._starts = [part.start for part in markup]

    @property
    def comments(self) -> list[tuple[int, int]]:
        """The start and the end of each comment."""
        return [(start, end) for start, end in self.opaque if self.text.startswith("<!--", start)]

    def iter_text(self) -> Iterator[tuple[int, int, ScannedElement | None]]:
        """Yield the start, the end and the parent of each text between tags and comments."""
        start = 0
        parent: ScannedElement | None = None
        for index, (at, end, kind, _, _) in enumerate(self._markup):
            yield start, at, parent
            start = end
            if kind in ("start", "end"):
                parent = self._inside(index)
        yield start, len(self.text), parent

    def element_at(self, offset: int) -> Place:
        """Return what the cursor before the character at *offset* is in.

        A cursor at the end of a name or a value is still in it.
        """
        offset = max(0, min(offset, len(self.text)))
        index = bisect_right(self._starts, offset - 1) - 1
        if index >= 0:
            start, end, kind, is_complete, element = self._markup[index]
            if offset < end or (offset == end and not is_complete):
                parent = self._inside(index - 1) if element is None else element.parent
                if kind == "start" and element is not None:
                    return _place_in_tag(element, offset)
                if kind == "bare":
                    return Place("tag", None, None, parent, offset, offset)
                place_kind: PlaceKind = "end_tag" if kind == "end" else "comment"
                return Place(place_kind, element, None, parent, start, end)
        text_start = self._markup[index].end if index >= 0 else 0
        following = index + 1
        text_end = self._starts[following] if following < len(self._starts) else len(self.text)
        return Place("text", None, None, self._inside(index), text_start, text_end)

    def _inside(self, index: int) -> ScannedElement | None:
        """Return the innermost element that contains the text after the markup at *index*."""
        while index >= 0:
            _, _, kind, _, element = self._markup[index]
            if element is not None and kind == "start":
                is_leaf = not element.is_complete and element.end_tag_start < 0
                return element.parent if element.is_empty or is_leaf else element
            if element is not None and kind == "end":
                return element.parent
            index -= 1
        return None


def _place_in_tag(element: ScannedElement, offset: int) -> Place:
    if offset <= element.tag_end:
        # White space between the "<" and the name belongs to the place of the name.
        start = min(offset, element.tag_start)
        return Place("tag", element, None, element.parent, start, element.tag_end)
    for attribute in element.attributes:
        if offset > attribute.end:
            continue
        if offset < attribute.start:
            break
        if offset <= attribute.name_end:
            start, end = attribute.start, attribute.name_end
            return Place("attribute", element, attribute, element.parent, start, end)
        if attribute.value is not None and attribute.value_start <= offset <= attribute.value_end:
            start, end = attribute.value_start, attribute.value_end
            return Place("value", element, attribute, element.parent, start, end)
    return Place("in_tag", element, None, element.parent, offset, offset)


def value_offsets(text: str, attribute: ScannedAttribute) -> list[int]:
    """Return the offset in *text* of each character of an attribute's value, and of the value's end.

    A reference such as `&amp;` is one character of the value.
    """
    offsets: list[int] = []
    at = attribute.value_start
    for match in WRITTEN_CHARACTER.finditer(text, at, attribute.value_end):
        offsets += range(at, match.start() + 1)
        # A reference to a character that does not exist is read as text.
        offsets += range(match.start() + 1, match.start() + len(decode(match[0])))
        at = match.end()
    return [*offsets, *range(at, attribute.value_end + 1)]


def scan(text: str, is_parsed: bool = False) -> Scan:
    """Find the elements of *text*. Never raises; takes time and memory linear in the length.

    Args:
        is_parsed: Whether the parser has accepted the text, so that no quote is missing.
    """
    return _Scanner(text, is_parsed).scan()


class _Scanner:
    def __init__(self, text: str, is_parsed: bool) -> None:
        self._text = text
        self._is_parsed = is_parsed
        self._roots: list[ScannedElement] = []
        self._elements: list[ScannedElement] = []
        self._markup: list[_Markup] = []
        # The open elements. An element whose start tag is cut off has no content unless its end tag follows:
        # until then, its followers belong to the element around it.
        self._open: list[ScannedElement] = []
        # For each open element: the element that its followers belong to, and the number of that element's
        # children before them.
        self._content: list[tuple[ScannedElement | None, int]] = []
        self._open_by_tag: dict[str, list[int]] = {}

    def scan(self) -> Scan:
        text = self._text
        at = text.find("<")
        while at >= 0:
            at = text.find("<", self._read_markup(at))
        self._close_to(0, len(text))
        return Scan(text, self._roots, self._elements, self._markup)

    def _read_markup(self, at: int) -> int:
        """Read the markup at *at*, and return the offset of its end."""
        text = self._text
        tag = _TAG.match(text, at)
        if tag is not None:
            return self._read_start_tag(tag)
        end_tag = _END_TAG.match(text, at)
        if end_tag is not None:
            return self._read_end_tag(end_tag)
        for opening, closing in _WITHOUT_TAGS:
            if text.startswith(opening, at):
                closed_at = text.find(closing, at + len(opening))
                end = len(text) if closed_at < 0 else closed_at + len(closing)
                self._markup.append(_Markup(at, end, "comment", closed_at >= 0, None))
                return end
        self._markup.append(_Markup(at, at + 1, "bare", False, None))
        return at + 1

    def _read_start_tag(self, tag: re.Match[str]) -> int:
        text, at = self._text, tag.end()
        parent = self._content[-1][0] if self._content else None
        element = ScannedElement(tag, parent, self)
        whole = START_TAG.match(text, tag.start())
        if whole is not None and (self._is_parsed or not ("<" in whole[2] or ">" in whole[2])):
            # Most tags. Their attributes are read when they are needed.
            at, element.is_complete = whole.end(), True
            element.is_empty = text[at - 2] == "/"
        else:
            element._attributes, at = self.attributes_from(at)
            element.is_complete = text.startswith(">", at) or text.startswith("/>", at)
            element.is_empty = text.startswith("/", at)
            at += element.is_complete + element.is_empty
        element.start_tag_end = element.end = at
        self._markup.append(_Markup(element.start, at, "start", element.is_complete, element))
        self._elements.append(element)
        siblings = self._roots if parent is None else parent.children
        siblings.append(element)
        if not element.is_empty:
            self._open_by_tag.setdefault(element.tag, []).append(len(self._open))
            self._open.append(element)
            self._content.append((element, 0) if element.is_complete else (parent, len(siblings)))
        return at

    def attributes_from(self, at: int) -> tuple[list[ScannedAttribute], int]:
        """Return the attributes of a start tag from *at* on, and the offset of its `>`, `/>` or end."""
        text = self._text
        attributes: list[ScannedAttribute] = []
        while True:
            at = _GAP.match(text, at).end()  # type: ignore[union-attr]
            if at == len(text) or text[at] in "<>" or text.startswith("/>", at):
                return attributes, at
            match = _ATTRIBUTE.match(text, at)
            if match is None:
                at += 1  # a character that cannot be in a tag
            else:
                attributes.append(self._attribute(match))
                at = attributes[-1].end

    def _attribute(self, match: re.Match[str]) -> ScannedAttribute:
        name, name_end = match[1], match.end(1)
        group = 3 if match[2] is not None else 6
        if match[group] is None:
            # Without a quote, a "=" belongs to the attribute.
            return ScannedAttribute(
                name, match.start(), name_end, None, match.end(), match.end(), match.end(), False
            )
        start, end = match.span(group)
        is_closed = match[group + 1] is not None
        if is_closed and self._contains_markup(start, end):
            is_closed = False
        if not is_closed:
            cut = _END_OF_OPEN_VALUE.search(self._text, start, end)
            end = cut.start() if cut is not None else end
        value = decode(self._text[start:end])
        return ScannedAttribute(name, match.start(), name_end, value, start, end, end + is_closed, is_closed)

    def _contains_markup(self, start: int, end: int) -> bool:
        """Return whether the quote at *end* belongs to another value, because a quote is missing before."""
        text = self._text
        if self._is_parsed or (text.find("<", start, end) < 0 and text.find(">", start, end) < 0):
            return False
        if _TAG_ON_NEW_LINE.search(text, start, end) is not None:
            return True
        return _AFTER_VALUE.match(text, end + 1) is None

    def _read_end_tag(self, match: re.Match[str]) -> int:
        indexes = self._open_by_tag.get(match[1] or "")
        element = None
        if indexes:
            index = indexes[-1]
            element = self._open[index]
            self._close_to(index + 1, match.start())
            self._pop(match.end())
            element.end_tag_start = match.start()
        self._markup.append(_Markup(match.start(), match.end(), "end", match[2] is not None, element))
        return match.end()

    def _close_to(self, depth: int, end: int) -> None:
        """Close the open elements but the outer *depth*: their end tags are missing."""
        while len(self._open) > depth:
            self._pop(end if self._open[-1].is_complete else -1)

    def _pop(self, end: int) -> None:
        """Close the innermost open element at *end*; -1 means that it has no content."""
        element = self._open.pop()
        self._open_by_tag[element.tag].pop()
        parent, before = self._content.pop()
        if end < 0:
            return
        element.end = end
        if not element.is_complete:
            siblings = self._roots if parent is None else parent.children
            element.children = siblings[before:]
            del siblings[before:]
            for child in element.children:
                child.parent = element
