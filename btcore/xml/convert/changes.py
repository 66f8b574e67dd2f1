"""What a conversion does to a document: edits of its text, and a diagnostic for each."""

from typing import Final

from btcore.errors import Diagnostic
from btcore.registry.registry import Registry
from btcore.xml.convert.rewrite import Rewriter
from btcore.xml.read.document import Document
from btcore.xml.read.element import Element
from btcore.xml.read.positions import ElementPart

FORMAT_WRITTEN: Final = "C101"
NODE_RENAMED: Final = "C102"
ATTRIBUTE_RENAMED: Final = "C103"
BRACES: Final = "C104"
TEXT_REWRITTEN: Final = "C105"
COMPACT: Final = "C106"
WITHOUT_EFFECT: Final = "C107"

LOOP_YIELDS: Final = "C201"
SEQUENCE_MEMORY: Final = "C202"
THRESHOLDS: Final = "C203"
SWITCH_COMPARISON: Final = "C204"
ENTRY_TYPE_KEPT: Final = "C205"
SUBTREE_NAME: Final = "C206"
REMAPPING: Final = "C207"
SHARED: Final = "C208"
AUTOREMAP_ALL: Final = "C209"
CONSTANT: Final = "C210"
CHECKED_ONCE: Final = "C211"
TEXT_REINTERPRETED: Final = "C212"
LAST_TREE: Final = "C213"
EMPTY: Final = "C214"

MANUAL_STEP: Final = "C301"


class ConversionContext:
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
        part: ElementPart = "value",
    ) -> None:
        """Tell of a change at *element*, or at one of its attributes."""
        self.found.append(self.document.diagnostic(code, said, element, attribute, part, hint))


def changes_meaning(one: Diagnostic) -> bool:
    """Whether *one* tells of something that format 4 does differently, or that is left to the user."""
    return one.code.startswith(("C2", "C3"))
