"""What all checks of the nodes of a document need, and how they report problems."""

from collections.abc import Sequence
from typing import NamedTuple, Unpack

from btcore.diagnostic_codes import DiagnosticCode
from btcore.fixes import Fix
from btcore.lint.possible_results import ResultAnalysis
from btcore.xml.plan.key_uses import TreeKeys
from btcore.xml.plan.plan import Plans
from btcore.xml.plan.tree_plan import NodePlan
from btcore.xml.read.document import DiagnosticCollector, Document, Mark


class CheckContext(NamedTuple):
    """The argument of a check besides the node.

    Attributes:
        document: The document of the node.
        plans: The plans of all trees.
        results: The possible results of nodes.
        tree_keys: The keys that each tree uses.
        collector: Collects the diagnostics.
    """

    document: Document
    plans: Plans
    results: ResultAnalysis
    tree_keys: TreeKeys
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
