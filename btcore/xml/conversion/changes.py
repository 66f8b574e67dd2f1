"""What a conversion does to a document: edits of its text, and a diagnostic for each."""

from typing import Final

from btcore.errors import Diagnostic
from btcore.registry import Registry
from btcore.xml.conversion.rewrite import Rewriter
from btcore.xml.element import Element
from btcore.xml.places import Part
from btcore.xml.source import Document

FORMAT_WRITTEN: Final = "C101"
NODE_RENAMED: Final = "C102"
ATTRIBUTE_RENAMED: Final = "C103"
BRACES: Final = "C104"
TEXT_REWRITTEN: Final = "C105"
COMPACT: Final = "C106"
WITHOUT_EFFECT: Final = "C107"

YIELDS: Final = "C201"
REMEMBERS: Final = "C202"
THRESHOLDS: Final = "C203"
EQUALITY: Final = "C204"
STORES: Final = "C205"
NAMED: Final = "C206"
CONNECTED: Final = "C207"
SHARED: Final = "C208"
EVERY_KEY: Final = "C209"
CONSTANT: Final = "C210"
CHECKED_ONCE: Final = "C211"
READ_OTHERWISE: Final = "C212"
LAST_TREE: Final = "C213"
EMPTY: Final = "C214"

LEFT_TO_YOU: Final = "C301"


class Changes:
    """The changes to *document*: make them with *rewriter*, and :meth:`note` each.

    Codes tell three sorts apart: ``C1…`` is written differently and means the same, ``C2…`` means
    something else in format 4, ``C3…`` is left to the user.
    """

    def __init__(self, document: Document, registry: Registry) -> None:
        self.document = document
        self.registry = registry
        self.rewriter = Rewriter(document)
        self.found: list[Diagnostic] = []

    def note(
        self,
        code: str,
        said: str,
        element: Element,
        attribute: str = "",
        hint: str = "",
        part: Part = "value",
    ) -> None:
        """Tell of a change at *element*, or at one of its attributes."""
        self.found.append(self.document.diagnostic(code, said, element, attribute, part, hint))


def changes_meaning(one: Diagnostic) -> bool:
    """Whether *one* tells of something that format 4 does differently, or that is left to the user."""
    return one.code.startswith(("C2", "C3"))
