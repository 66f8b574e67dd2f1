"""Connects all the ports of a tree without making its leaves, to see who would read and write what.

It is the builder itself that does so, with the same blackboards: whatever it refuses is refused here in
the same words, except for what only the leaves' own code can say.
"""

import enum
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from btcore.blackboard.blackboard import Blackboard, Entry
from btcore.blackboard.ports import SCRIPT_ROLES, Port, PortRole, remapped_key
from btcore.engine.node import TreeNode
from btcore.engine.node_config import NodeConfig
from btcore.errors import BlackboardError, ScriptError
from btcore.registry.manifest import Manifest
from btcore.registry.registry import Registry
from btcore.tree.tree import Subtree
from btcore.values import ValueType
from btcore.xml.build import TreeInstantiator
from btcore.xml.lint.advice import is_built_in, is_stub
from btcore.xml.lint.script_analysis import NameAccess, find_name_uses
from btcore.xml.plan.document_checks import DocumentAnalysis
from btcore.xml.plan.plan import NodePlan, SubtreeCall, TreePlanner
from btcore.xml.plan.tree_definitions import TreeDefinition
from btcore.xml.read.diagnostics import DiagnosticCollector
from btcore.xml.read.document import Document


class AccessKind(enum.Enum):
    """What is done with an entry: NAMES reads the name of the entry that is meant, ASSIGNS needs one."""

    READS = enum.auto()
    WRITES = enum.auto()
    READS_AS_KEY = enum.auto()
    ASSIGNS = enum.auto()
    MENTIONS = enum.auto()


@dataclass(frozen=True, slots=True, eq=False)
class EntryUse:
    """One place where *key* is used in *scope*: an attribute, or the word *within* its script.

    *port* is None where a script, or a constant of a SubTree, does it.
    """

    access: AccessKind
    key: str
    scope: Blackboard
    document: Document
    node: NodePlan
    attribute: str
    within: int = 0
    port: Port | None = None
    value_type: ValueType | None = None


class DryRun(TreeInstantiator):
    """One tree, all but made. After :meth:`run`, *uses* has every entry and what is done with it.

    *opaque* tells that a leaf, or a script that is not written here, may use entries unseen;
    *has_stubs* that the enums, too, may be known elsewhere.
    """

    def __init__(self, planner: TreePlanner, main: TreeDefinition, registry: Registry) -> None:
        super().__init__(DocumentAnalysis(planner, main, DiagnosticCollector()), registry, None, (), None)
        self.uses: dict[Entry, list[EntryUse]] = {}
        self.has_untracked_access = False
        self.has_stubs = False
        self.entrances: dict[Blackboard, EntryUse] = {}
        self._met: list[EntryUse] = []

    def run(self) -> DiagnosticCollector:
        """Connect everything; what the builder would refuse."""
        self._instance(self._planner.plan(self._main), "", self._blackboard)
        for use in self._met:
            entry = self._entry(use)
            if entry is not None:
                self.uses.setdefault(entry, []).append(use)
        # Where an entry says which one is written, that may be any.
        named = [
            uses for uses in self.uses.values() if any(use.access is AccessKind.READS_AS_KEY for use in uses)
        ]
        self.has_untracked_access = self.has_untracked_access or any(has_writer(uses) for uses in named)
        return self._diagnostics

    @property
    def root(self) -> Blackboard:
        """The main tree's blackboard."""
        return self._blackboard

    @property
    def subtrees(self) -> list[Subtree]:
        """The scopes, the main tree's first."""
        return self._subtrees

    @property
    def format(self) -> int:
        """3 or 4."""
        return self._format

    def _entry(self, use: EntryUse) -> Entry | None:
        found = use.scope.find(use.key)
        if found is not None:
            return found
        try:
            return use.scope.create(use.key)
        except BlackboardError:
            return None  # a key with two @, which the builder has refused

    # --- what the builder does, and what is noted of it

    def _make(
        self,
        plan: NodePlan,
        manifest: Manifest | None,
        config: NodeConfig,
        document: Document,
        blackboard: Blackboard,
        children: Sequence[TreeNode | None],
    ) -> TreeNode | None:
        if manifest is None or not is_built_in(manifest):
            return TreeNode()
        for bound in config.inputs.values():
            if bound.port.role in SCRIPT_ROLES and bound.key is not None:
                return TreeNode()  # it compiles what the blackboard comes with
        return super()._make(plan, manifest, config, document, blackboard, children)

    def _ports(self, plan: NodePlan, config: NodeConfig, document: Document, blackboard: Blackboard) -> None:
        super()._ports(plan, config, document, blackboard)
        for port, text, written in plan.ports:
            self._met += self._of_port(plan, port, text, written, document, blackboard)
        for attribute, text in plan.scripts.items():
            self._script(plan, attribute, text, document, blackboard)
        if plan.manifest is not None:
            self.has_untracked_access = self.has_untracked_access or uses_whole_blackboard(plan.manifest)
            self.has_stubs = self.has_stubs or is_stub(plan.manifest)

    def _of_port(
        self, plan: NodePlan, port: Port, text: str, written: bool, document: Document, board: Blackboard
    ) -> Iterator[EntryUse]:
        key = remapped_key(text, port.name, self._format)
        is_script = port.role in SCRIPT_ROLES
        writes = port.writes and port.role is not PortRole.QUEUE
        how = []
        if key is None:
            if is_script:
                self._script(plan, port.name, text, document, board)
            elif port.role in _ACCESS_BY_NAME:
                how = [_ACCESS_BY_NAME[port.role]]
            elif writes and self._format == 3 and written:
                how = [AccessKind.WRITES]
            if text:
                key = text
        elif is_script:
            self.has_untracked_access = True
            how = [AccessKind.READS]
        elif port.role is PortRole.WRITTEN_ENTRY:
            how = [AccessKind.READS_AS_KEY]
        else:
            if port.reads:
                how.append(AccessKind.READS)
            if writes and (written or self._format == 4):
                how.append(AccessKind.WRITES)
        for one in how if key else ():
            yield EntryUse(one, key or "", board, document, plan, port.name, 0, port, port.type)

    def _script(
        self, plan: NodePlan, attribute: str, text: str, document: Document, board: Blackboard
    ) -> None:
        try:
            found = find_name_uses(text, self._enums)
        except ScriptError:
            return  # said already
        for one in found:
            self._met.append(
                EntryUse(_HOW[one.access], one.name, board, document, plan, attribute, one.column)
            )

    def _scope(self, plan: NodePlan, call: SubtreeCall, document: Document, outer: Blackboard) -> Blackboard:
        inner = super()._scope(plan, call, document, outer)
        for attribute, text in plan.scripts.items():
            self._script(plan, attribute, text, document, outer)
        if inner is not outer:
            self.entrances[inner] = EntryUse(AccessKind.MENTIONS, call.tree, outer, document, plan, "ID")
            for key in call.constants:
                self._met.append(EntryUse(AccessKind.WRITES, key, inner, document, plan, key))
            for key, outside in call.remaps.items():
                self._met.append(EntryUse(AccessKind.MENTIONS, outside, outer, document, plan, key))
        return inner


_ACCESS_BY_NAME = {
    PortRole.WRITTEN_ENTRY: AccessKind.WRITES,
    PortRole.WATCHED_ENTRY: AccessKind.READS,
    PortRole.REMOVED_ENTRY: AccessKind.MENTIONS,
}
_HOW = {
    NameAccess.READ: AccessKind.READS,
    NameAccess.MADE: AccessKind.WRITES,
    NameAccess.ASSIGNED: AccessKind.ASSIGNS,
}


def has_writer(uses: Sequence[EntryUse]) -> bool:
    """Whether anything writes the entry of *uses*."""
    return any(use.access in (AccessKind.WRITES, AccessKind.ASSIGNS) for use in uses)


def uses_whole_blackboard(manifest: Manifest) -> bool:
    """Whether the leaf asks for the blackboard itself, and may use any entry."""
    return any(
        one.port is None and isinstance(one.resource_type, type) and issubclass(one.resource_type, Blackboard)
        for one in manifest.parameters
    )
