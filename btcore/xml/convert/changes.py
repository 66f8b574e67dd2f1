"""What a conversion does to a document: edits of its text, and a diagnostic for each."""

from btcore.diagnostic_codes import DiagnosticCode
from btcore.errors import Diagnostic
from btcore.registry.registry import Registry
from btcore.xml.convert.rewrite import Rewriter
from btcore.xml.read.document import Document
from btcore.xml.read.element import Element
from btcore.xml.read.positions import ElementPart


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
        code: DiagnosticCode,
        message: str,
        element: Element,
        attribute: str = "",
        hint: str = "",
        part: ElementPart = "value",
    ) -> None:
        """Tell of a change at *element*, or at one of its attributes."""
        self.found.append(self.document.diagnostic(code, message, element, attribute, part, hint))
