"""Report diagnostics about nodes, and name nodes in messages."""

from btcore.diagnostic_codes import DiagnosticCode
from btcore.diagnostics import Hint
from btcore.xml.plan.tree_plan import NodePlan
from btcore.xml.read.diagnostic_collector import DiagnosticCollector
from btcore.xml.read.element import ElementPart
from btcore.xml.read.read import Document


class LintReporter:
    """Collects diagnostics, once per code and place, because a tree that is called twice is checked twice."""

    def __init__(self, collector: DiagnosticCollector) -> None:
        self.collector = collector
        self._reported = {
            (warning.code, warning.file, warning.line, warning.column) for warning in collector.warnings
        }

    def report(
        self,
        code: DiagnosticCode,
        message: str,
        document: Document,
        node: NodePlan,
        attribute: str = "",
        hint: str | Hint = "",
        part: ElementPart = "value",
        within: int = 0,
        width: int = 0,
    ) -> None:
        """Add a diagnostic about *node* or one of its attributes.

        Args:
            attribute: The attribute that the message is about; "" means the node itself.
            hint: How to fix the problem, or "".
            part: Whether the diagnostic points to the attribute's name or to its value.
            within: Number of the first character in the value, from 1; 0 means the whole value.
            width: Number of characters to underline from *within* on; 0 means 1.
        """
        diagnostic = document.diagnostic(code, message, node.element, attribute, hint, part, within)
        if width and diagnostic.width < width:
            diagnostic = diagnostic._replace(width=width)
        place = (code, diagnostic.file, diagnostic.line, diagnostic.column)
        if place not in self._reported:
            self._reported.add(place)
            self.collector.add(diagnostic)


def node_label(node: NodePlan) -> str:
    """Return the text that names *node* in messages, such as `<Sleep>` or `<SubTree ID="Dock">`."""
    return f"<{node.id}>" if node.subtree_call is None else f'<SubTree ID="{node.subtree_call.tree_id}">'


def line_of(document: Document, node: NodePlan) -> str:
    """Return the line of *node* as text, such as `line 4`."""
    return f"line {document.line(node.element)}"
