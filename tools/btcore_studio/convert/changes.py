"""The changes of a conversion: edits of the document's text, and a diagnostic for each."""

from btcore.diagnostic_codes import DiagnosticCode
from btcore.diagnostics import Diagnostic
from btcore.registry.registry import Registry
from btcore.xml.edit.editor import DocumentEditor, Edit, escape_value
from btcore.xml.read.document import Document
from btcore.xml.read.element import Element, ElementPart
from btcore.xml.read.scan import ScannedElement


class ConversionChanges:
    """Collects edits of the text of *document*, and diagnostics that describe them.

    Arguments always name attributes as in the original document, even after an attribute was renamed. The
    codes of the diagnostics classify the changes. `C1…`: another spelling with the same meaning. `C2…`:
    the tree behaves differently in format 4. `C3…`: the user must make the change.

    Attributes:
        edits: The edits.
        diagnostics: The diagnostics.
    """

    def __init__(self, document: Document, registry: Registry) -> None:
        self.document = document
        self.registry = registry
        self.diagnostics: list[Diagnostic] = []
        self._editor = DocumentEditor(document.source_map.scan)
        self.edits: list[Edit] = []

    def note(
        self,
        code: DiagnosticCode,
        message: str,
        element: Element,
        attribute: str = "",
        hint: str = "",
        part: ElementPart = "value",
    ) -> None:
        """Add a diagnostic about a change of an element or of one of its attributes.

        Args:
            element: The element in the original document.
            attribute: Name of the attribute; "" means the element itself.
            part: Whether the diagnostic points to the attribute's name or to its value.
        """
        self.diagnostics.append(
            self.document.diagnostic(code, message, element, attribute=attribute, hint=hint, part=part)
        )

    def rename_element(self, element: Element, name: str) -> None:
        """Change the name of *element* to *name*, in the start tag and in the end tag."""
        self.edits += self._editor.rename_element(self._scanned(element), name)

    def insert_attribute(self, element: Element, name: str, text: str) -> None:
        """Insert an attribute before the other attributes of an element.

        Args:
            text: The value, not escaped.
        """
        at = self._scanned(element).tag_end
        self.edits.append(Edit(at, at, f' {name}="{escape_value(text)}"'))

    def set_attribute(self, element: Element, attribute: str, text: str) -> None:
        """Replace the value of an attribute, and keep its quotes.

        Args:
            text: The new value, not escaped.
        """
        self.edits.append(self._editor.set_attribute(self._scanned(element), attribute, text))

    def rename_attribute(self, element: Element, attribute: str, name: str) -> None:
        """Rename an attribute.

        Args:
            attribute: The original name of the attribute.

        Raises:
            EditError: The element has no such attribute.
        """
        self.edits.append(self._editor.rename_attribute(self._scanned(element), attribute, name))

    def remove_attribute(self, element: Element, attribute: str) -> None:
        """Remove an attribute and the space before it.

        Raises:
            EditError: The element has no such attribute.
        """
        self.edits.append(self._editor.remove_attribute(self._scanned(element), attribute))

    def _scanned(self, element: Element) -> ScannedElement:
        return self.document.source_map.scanned(element)
