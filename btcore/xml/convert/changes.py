"""The changes of a conversion: edits of the document's text, and a diagnostic for each."""

from btcore.diagnostic_codes import DiagnosticCode
from btcore.errors import Diagnostic
from btcore.registry.registry import Registry
from btcore.xml.convert.rewrite import Rewriter
from btcore.xml.read.document import Document
from btcore.xml.read.element import Element, ElementPart


class ConversionContext:
    """The changes to *document*: make each with *rewriter*, and describe it with :meth:`note`.

    Codes classify changes: ``C1…`` keeps the meaning, ``C2…`` has another meaning in format 4, ``C3…``
    is left to the user.
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
        """Add a diagnostic for a change of an element or an attribute of it.

        Args:
            code: The diagnostic code.
            message: What changes.
            element: The element in the original document.
            attribute: Name of the attribute; "" means the element itself.
            hint: Further advice, or "".
            part: Whether the place is the attribute's name or its value.
        """
        self.found.append(self.document.diagnostic(code, message, element, attribute, part, hint))
