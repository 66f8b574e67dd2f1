"""Reporting the problems of nodes, as the checks of a document do."""

from collections.abc import Sequence
from typing import NamedTuple, Unpack

from btcore.diagnostic_codes import DiagnosticCode
from btcore.fixes import Fix
from btcore.xml.plan.tree_plan import NodePlan
from btcore.xml.read.document import DiagnosticCollector, Document, Mark


class NodeReporter(NamedTuple):
    """Adds diagnostics about the nodes of *document* to *collector*."""

    document: Document
    collector: DiagnosticCollector

    def report(
        self,
        node: NodePlan,
        code: DiagnosticCode,
        message: str,
        hint: str = "",
        fixes: Sequence[Fix] = (),
        **mark: Unpack[Mark],
    ) -> None:
        """Add a diagnostic about *node* or one of its attributes; see `Document.diagnostic`."""
        self.collector.report(self.document, code, message, node.element, hint, fixes, **mark)
