"""Reporting the problems of nodes, as the checks of a document do."""

from typing import NamedTuple

from btcore.diagnostic_codes import DiagnosticCode
from btcore.xml.plan.tree_plan import NodePlan
from btcore.xml.read.document import DiagnosticCollector, Document
from btcore.xml.read.element import ElementPart


class NodeReporter(NamedTuple):
    """Adds diagnostics about the nodes of *document* to *collector*."""

    document: Document
    collector: DiagnosticCollector

    def report(
        self,
        node: NodePlan,
        code: DiagnosticCode,
        message: str,
        attribute: str = "",
        *,
        hint: str = "",
        part: ElementPart = "value",
        within: int = 0,
        width: int = 1,
    ) -> None:
        """Add a diagnostic about *node* or one of its attributes; see `Document.diagnostic`."""
        self.collector.report(
            self.document, code, message, node.element,
            attribute=attribute, hint=hint, part=part, within=within, width=width,
        )  # fmt: skip
