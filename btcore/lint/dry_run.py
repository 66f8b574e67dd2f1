"""Create a tree without its user-defined nodes, and record the uses of each blackboard entry.

The dry run creates nodes as loading does: it creates the same blackboards and connects the same
ports. It therefore finds the same errors, except for errors that user code raises.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cache

from btcore.blackboard.blackboard import Blackboard, Entry
from btcore.blackboard.ports import SCRIPT_ROLES, Binding, Port
from btcore.clock import SystemClock
from btcore.diagnostic_codes import DiagnosticCode
from btcore.engine.node import TreeNode
from btcore.engine.node_config import NodeConfig
from btcore.errors import BlackboardError
from btcore.fixes import Fix
from btcore.lint.possible_results import is_built_in
from btcore.loading.instantiate import NodeCreator, SubtreeDraft
from btcore.registry.manifest import Manifest
from btcore.registry.nodes_without_code import is_mock
from btcore.script.expressions import Assignment
from btcore.xml.plan.key_uses import WRITING, AccessKind, find_name_uses, port_uses, uses_whole_blackboard
from btcore.xml.plan.plan import Plans
from btcore.xml.plan.tree_plan import NodePlan, SubtreeCall, TreePlan
from btcore.xml.read.document import DiagnosticCollector, Document, Mark


@dataclass(frozen=True, slots=True, eq=False)
class EntryUse:
    """One place where *key* is used in *scope*: an attribute, or a name in its script.

    *column* is the column (from 1) of the name in the script, or 0 outside of a script. *port* is the port
    that uses the key; it is None in a script and in an attribute of a SubTree element. *statement* is the
    statement of a script that assigns to the name.
    """

    access: AccessKind
    key: str
    scope: Blackboard
    document: Document
    node: NodePlan
    attribute: str
    column: int = 0
    port: Port | None = None
    statement: Assignment | None = None

    @property
    def is_in_script(self) -> bool:
        """Whether the key is a name in a script."""
        return self.column > 0

    @property
    def title(self) -> str:
        """The script or the port, with its node, for messages."""
        return f"the {'script in' if self.port is None else 'port'} '{self.attribute}' of {self.node.label}"


class DryRun(NodeCreator):
    """A dry run of one tree.

    Args:
        plans: The plans of the document.
        tree: The main tree, or any other tree, whose entries its callers may set.
        collector: Gets the errors that loading the tree would report; by default a new collector.
        given: Keys that the tree's blackboard holds before the first tick.

    Attributes:
        uses: Every entry with the places that use it.
        homes: For each entry, the blackboard of the outermost tree that holds it, and its key there.
        has_untracked_access: Whether the tree may use entries that are known only when it runs: because a
            leaf takes the whole blackboard, or because a script or a key is read from an entry.
        has_untracked_writes: The same for entries that the tree may write. A leaf that takes the whole
            blackboard can declare the keys that it writes in its `spec`.
        has_mocks: Whether mock nodes replace nodes without code. Then the registry may lack enums that the
            C++ code registers.
        entrances: For each inner blackboard, the call that creates it, and the subtree of the call.
        written_in: Returns the keys of a blackboard that are written or given.
    """

    def __init__(
        self,
        plans: Plans,
        tree: TreePlan,
        collector: DiagnosticCollector | None = None,
        given: Collection[str] = (),
    ) -> None:
        super().__init__(plans, (), SystemClock())
        if collector is not None:
            self.collector = collector
        self.uses: dict[Entry, list[EntryUse]] = {}
        self.has_untracked_access = False
        self.has_untracked_writes = False
        self.has_mocks = False
        self.entrances: dict[Blackboard, tuple[SubtreeCall, SubtreeDraft]] = {}
        self.homes: dict[Entry, tuple[Blackboard, str]] = {}
        self.written_in = cache(self._find_written)
        self._given = given
        self._is_main = tree is plans.main_tree
        self._recorded: list[EntryUse] = []
        self.create_nodes(tree)
        self._assign_uses()

    def _assign_uses(self) -> None:
        """Assign the recorded uses, which name a key of a scope, to the entries of the blackboards."""
        for use in self._recorded:
            try:
                entry = use.scope.find(use.key) or use.scope.declare(use.key)
            except BlackboardError:
                continue  # a key with two @, which has been reported
            self.uses.setdefault(entry, []).append(use)
        # A node that reads a key from an entry which the tree writes may write to any entry.
        if any(
            has_writer(uses) and any(use.access is AccessKind.READS_AS_KEY for use in uses)
            for uses in self.uses.values()
        ):
            self.has_untracked_access = self.has_untracked_writes = True
        # Trees that share a blackboard count once.
        for board in dict.fromkeys(draft.subtree.blackboard for draft in self.drafts):
            for key, entry in board.local_entries().items():
                self.homes.setdefault(entry, (board, key))

    def may_be_given(self, board: Blackboard, key: str) -> bool:
        """Return whether the program or a caller may set an entry of *board* before the first tick."""
        return board is self.blackboard and (not self._is_main or key in self._given)

    def report(
        self,
        use: EntryUse,
        code: DiagnosticCode,
        message: str,
        hint: str,
        fixes: Sequence[Fix] = (),
        outer_key: str = "",
    ) -> None:
        """Add a diagnostic about the place of *use*; see `Diagnostic`."""
        mark: Mark = {"attribute": use.attribute, "column": use.column, "width": len(use.key)}
        diagnostic = use.document.diagnostic(code, message, use.node.element, hint, fixes, **mark)
        self.collector.add(diagnostic._replace(outer_key=outer_key))

    def _find_written(self, board: Blackboard) -> Collection[str]:
        written = [
            key for key, entry in board.local_entries().items() if has_writer(self.uses.get(entry, ()))
        ]
        given = sorted(self._given) if board is self.blackboard else []
        return dict.fromkeys([*written, *given])

    def plan_of(self, board: Blackboard) -> TreePlan:
        """Return the plan of the innermost tree whose nodes use *board*."""
        # In format 3, trees may share a blackboard.
        return next(draft.plan for draft in reversed(self.drafts) if draft.subtree.blackboard is board)

    # --- steps of the creation, each recording the entries that it uses

    def create_node(
        self,
        node_plan: NodePlan,
        manifest: Manifest,
        config: NodeConfig,
        draft: SubtreeDraft,
        children: list[TreeNode],
    ) -> TreeNode:
        """Create a built-in node; other nodes are replaced by a node without effect."""
        # Leaves of users are not created: they may need resources, and their code may have effects.
        if not is_built_in(manifest.cls):
            return TreeNode()
        for binding in config.inputs.values():
            if binding.port.role in SCRIPT_ROLES and binding.key is not None:
                return TreeNode()  # the node would compile a script from the blackboard, which is empty here
        return super().create_node(node_plan, manifest, config, draft, children)

    def bind_ports(self, node_plan: NodePlan, config: NodeConfig, draft: SubtreeDraft) -> None:
        """Bind the ports, and record the entries that ports and scripts use."""
        super().bind_ports(node_plan, config, draft)
        for binding in node_plan.bindings:
            self._record_port(node_plan, binding, draft)
        for attribute, text in node_plan.conditions.items():
            self._record_script(node_plan, attribute, text, draft)
        if uses_whole_blackboard(node_plan.manifest):
            self._record_leaf(node_plan, draft)
        self.has_mocks = self.has_mocks or is_mock(node_plan.manifest.cls)

    def _record_port(self, node_plan: NodePlan, binding: Binding, draft: SubtreeDraft) -> None:
        document, board, port = draft.document, draft.subtree.blackboard, binding.port
        key, accesses = port_uses(port, binding.text, binding.is_explicit, self.format)
        if port.role in SCRIPT_ROLES:
            if key is None:
                self._record_script(node_plan, port.name, binding.text, draft)
            else:
                self.has_untracked_access = self.has_untracked_writes = True
        for access in accesses if key else ():
            self._recorded.append(
                EntryUse(access, key or "", board, document, node_plan, port.name, port=port)
            )

    def _record_leaf(self, node_plan: NodePlan, draft: SubtreeDraft) -> None:
        """Record a leaf that takes the whole blackboard."""
        self.has_untracked_access = True
        manifest, board = node_plan.manifest, draft.subtree.blackboard
        self.has_untracked_writes = self.has_untracked_writes or manifest.spec.writes is None
        for key in manifest.spec.writes or ():
            if key not in manifest.ports:
                self._recorded.append(EntryUse(AccessKind.WRITES, key, board, draft.document, node_plan, ""))

    def _record_script(self, node_plan: NodePlan, attribute: str, text: str, draft: SubtreeDraft) -> None:
        document, board = draft.document, draft.subtree.blackboard
        for use in find_name_uses(text, self.enums):
            place = (board, document, node_plan, attribute, use.column)
            self._recorded.append(EntryUse(use.access, use.name, *place, statement=use.statement))

    def create_scope(self, node_plan: NodePlan, call: SubtreeCall, draft: SubtreeDraft) -> Blackboard:
        """Return the blackboard of the called tree, and record the entries that the call uses."""
        document, outer = draft.document, draft.subtree.blackboard
        inner = super().create_scope(node_plan, call, draft)
        for attribute, text in node_plan.conditions.items():
            self._record_script(node_plan, attribute, text, draft)
        if inner is not outer:
            self.entrances[inner] = call, draft
            for key in call.constants:
                self._recorded.append(EntryUse(AccessKind.WRITES, key, inner, document, node_plan, key))
            for key, outside in call.remaps.items():
                self._recorded.append(EntryUse(AccessKind.MENTIONS, outside, outer, document, node_plan, key))
        return inner


def has_writer(uses: Sequence[EntryUse]) -> bool:
    """Return whether one of the *uses* writes the entry."""
    return any(use.access in WRITING for use in uses)
