"""The elements of a document, and the parsers that create them.

Expat, which comes with Python, parses a plain text in one pass. Texts that expat rejects, and texts that
libxml2 may parse differently, are parsed by libxml2, which decides what is valid XML.
"""

from collections.abc import Iterator
from typing import Any, Final
from xml.parsers import expat

from lxml import etree

# Below libxml2's own limit of 2,048 levels, so that libxml2 reports deeper documents.
_MOST_LEVELS: Final = 2_000


class Element:
    """One element: its *tag*, and its *attributes* and *children* in document order.

    *line* (from 1) is the line in which its start tag begins, or 0 if the parser doesn't know it.
    """

    __slots__ = ("attributes", "children", "line", "tag")

    def __init__(self, tag: str, attributes: dict[str, str], line: int) -> None:
        self.tag = tag
        self.attributes = attributes
        self.line = line
        self.children: list[Element] = []

    def get(self, name: str) -> str | None:
        """Return the value of the attribute *name*, or None."""
        return self.attributes.get(name)

    def iterchildren(self, *tags: str) -> Iterator["Element"]:
        """Return the children with one of *tags*, in order."""
        return (child for child in self.children if child.tag in tags)

    def iter(self, *tags: str) -> Iterator["Element"]:
        """Yield the element and all its descendants in document order; only those with *tags*, if any."""
        pending = [self]
        while pending:
            element = pending.pop()
            if not tags or element.tag in tags:
                yield element
            pending += reversed(element.children)


class _Unusual(Exception):
    """Expat found something that libxml2 must parse."""


def parse_with_expat(data: bytes) -> Element | None:
    """Return the outermost element of *data* (UTF-8), with lines, or None if libxml2 must parse it."""
    names: dict[str, str] = {}
    parser = expat.ParserCreate("utf-8", None, names)
    top: list[Element] = []
    around = [top]

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, attributes, parser.CurrentLineNumber)
        around[-1].append(element)
        around.append(element.children)

    def end(_: str) -> None:
        if len(around) > _MOST_LEVELS:
            raise _Unusual
        around.pop()

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.XmlDeclHandler = _declaration
    parser.ProcessingInstructionHandler = parser.StartDoctypeDeclHandler = _unusual
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, _Unusual):
        return None
    finally:
        # Break the reference cycle between the handler and the parser.
        parser.StartElementHandler = None
    # Expat is not set up for namespaces.
    if "xmlns" in names or any(":" in name for name in names):
        return None
    return top[0]


def _declaration(version: str, encoding: str | None, standalone: int) -> None:
    if version != "1.0" or standalone != -1 or (encoding or "utf-8").lower() != "utf-8":
        raise _Unusual


def _unusual(*_: object) -> None:
    raise _Unusual


def parse_with_libxml2(data: bytes) -> Element:
    """Return the outermost element of *data* (UTF-8), parsed by libxml2, without lines.

    Raises:
        lxml.etree.XMLSyntaxError: *data* is not valid XML.
    """
    top: list[Element] = []
    pending: list[tuple[Any, list[Element]]] = [(parse_lxml_tree(data), top)]
    while pending:
        parsed, siblings = pending.pop()
        element = Element(parsed.tag, dict(parsed.items()), 0)
        siblings.append(element)
        pending += [(child, element.children) for child in parsed.iterchildren("*", reversed=True)]
    return top[0]


def parse_lxml_tree(data: bytes) -> etree._Element:
    """Parse *data* (UTF-8) with libxml2, without document types, custom entities and network access.

    Raises:
        lxml.etree.XMLSyntaxError: *data* is not valid XML.
    """
    # By default libxml2 allows 256 levels counted from <root>. With huge_tree it allows 2,048, so that
    # the limit of the format, which counts from the BehaviorTree, takes effect.
    parser = etree.XMLParser(
        encoding="utf-8",
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        collect_ids=False,
        huge_tree=True,
    )
    return etree.fromstring(data, parser)
