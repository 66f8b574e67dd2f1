"""The elements of a document, and their parser for plain texts: expat, which comes with Python.

Texts that expat rejects, and texts that tinyxml2 may parse differently, are parsed by the rules of tinyxml2
(tinyxml2_parser.py), which decides what BehaviorTree.CPP accepts. That parser could read all texts, but takes
five times as long as expat: loading a tree would take 1.4 times as long.
"""

from collections.abc import Iterator
from typing import Final, Literal
from xml.parsers import expat

ElementPart = Literal["name", "value"]
"""The part of an attribute that a position refers to."""

EXAMPLE: Final = 'a tree looks like: <root BTCPP_format="4"><BehaviorTree ID="Main">…</BehaviorTree></root>'
"""A hint for documents without a tree."""

MAX_LEVELS: Final = 2_048
"""Maximum number of levels of elements in a document. That of a `<BehaviorTree>` is lower."""


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

    def node_children(self) -> list["Element"]:
        """Return the children without the obsolete `<Root>` of Groot 1."""
        return [child for child in self.children if child.tag != "Root"]

    def iterchildren(self, *tags: str) -> Iterator["Element"]:
        """Return the children with one of *tags*, in order; without *tags*, none."""
        return (child for child in self.children if child.tag in tags)

    def iter(self, *tags: str) -> Iterator["Element"]:
        """Yield the element and its descendants in document order; with *tags*, only elements with these."""
        pending = [self]
        while pending:
            element = pending.pop()
            if not tags or element.tag in tags:
                yield element
            pending += reversed(element.children)


def encoded(text: str) -> bytes:
    """Return *text* as UTF-8 for a parser."""
    # A lone surrogate, which no file can contain, has no UTF-8 form: it becomes '?'.
    return text.encode("utf-8", "replace")


class _UnusualError(Exception):
    """Expat found something that tinyxml2 may parse differently, or that needs a warning or an error."""


def parse_with_expat(data: bytes) -> Element | None:
    """Return the outermost element of *data* (UTF-8), with lines, or None if tinyxml2's rules are needed."""
    names: dict[str, str] = {}
    parser = expat.ParserCreate("utf-8", None, names)
    top: list[Element] = []
    around = [top]

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, attributes, parser.CurrentLineNumber)
        around[-1].append(element)
        around.append(element.children)

    def end(_: str) -> None:
        if len(around) > MAX_LEVELS:
            raise _UnusualError
        around.pop()

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.XmlDeclHandler = _declaration
    parser.ProcessingInstructionHandler = parser.StartDoctypeDeclHandler = _unusual
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, _UnusualError):
        return None
    finally:
        # Break the reference cycle between the handler and the parser.
        parser.StartElementHandler = None
    prefixes = {name.partition(":")[0] for name in names if ":" in name} - {"xml", "xmlns"}
    if any(f"xmlns:{prefix}" not in names for prefix in prefixes):
        return None
    return top[0]


def _declaration(version: str, encoding: str | None, standalone: int) -> None:
    if version != "1.0" or standalone != -1 or (encoding or "utf-8").lower() != "utf-8":
        raise _UnusualError


def _unusual(*_: object) -> None:
    raise _UnusualError
