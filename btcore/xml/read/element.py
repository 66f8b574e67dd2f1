"""Elements as a document has them, and how a text becomes elements.

A plain text is read in one pass by expat, which comes with Python. Whatever expat refuses, and anything
that libxml2 may see in another way, is left to libxml2, which has the last word on what is XML.
"""

from collections.abc import Iterator
from typing import Any, Final
from xml.parsers import expat

from lxml import etree

# Of libxml2's own, which are 2,048.
_MOST_LEVELS: Final = 2_000


class Element:
    """One element: its *tag*, its *attributes* and *children* in the order written.

    *line* (from 1) is that in which its start tag begins, where the reader of the text knows it, else 0.
    """

    __slots__ = ("attributes", "children", "line", "tag")

    def __init__(self, tag: str, attributes: dict[str, str], line: int) -> None:
        self.tag = tag
        self.attributes = attributes
        self.line = line
        self.children: list[Element] = []

    def get(self, name: str) -> str | None:
        """The attribute *name*, or None."""
        return self.attributes.get(name)

    def iterchildren(self, *tags: str) -> Iterator["Element"]:
        """The children that are called one of *tags*, in order."""
        return (child for child in self.children if child.tag in tags)

    def iter(self, *tags: str) -> Iterator["Element"]:
        """It and all below it, in the order of their start tags; of *tags* alone if any are given."""
        pending = [self]
        while pending:
            element = pending.pop()
            if not tags or element.tag in tags:
                yield element
            pending += reversed(element.children)


class _Unusual(Exception):
    """Expat met something that libxml2 is to look at."""


def parse_with_expat(data: bytes) -> Element | None:
    """The outermost element of *data* (UTF-8), with lines; None unless libxml2 would surely see the same."""
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
        # It holds the parser, which holds it.
        parser.StartElementHandler = None
    # Namespaces are none of expat's business.
    if "xmlns" in names or any(":" in name for name in names):
        return None
    return top[0]


def _declaration(version: str, encoding: str | None, standalone: int) -> None:
    if version != "1.0" or standalone != -1 or (encoding or "utf-8").lower() != "utf-8":
        raise _Unusual


def _unusual(*_: object) -> None:
    raise _Unusual


def parse_with_libxml2(data: bytes) -> Element:
    """The outermost element of *data* (UTF-8) as libxml2 sees it, without lines. Raises XMLSyntaxError."""
    top: list[Element] = []
    pending: list[tuple[Any, list[Element]]] = [(parse_lxml_tree(data), top)]
    while pending:
        parsed, siblings = pending.pop()
        element = Element(parsed.tag, dict(parsed.items()), 0)
        siblings.append(element)
        pending += [(child, element.children) for child in parsed.iterchildren("*", reversed=True)]
    return top[0]


def parse_lxml_tree(data: bytes) -> etree._Element:
    """What libxml2 makes of *data* (UTF-8). Raises XMLSyntaxError.

    It is told to look nothing up: no document types with content, no entities of the document's own, no
    network.
    """
    # Of itself it allows 256 levels counted from <root>; with huge_tree 2,048, so that the format's
    # own limit, counted from the BehaviorTree, can hold.
    parser = etree.XMLParser(
        encoding="utf-8",
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        collect_ids=False,
        huge_tree=True,
    )
    return etree.fromstring(data, parser)
