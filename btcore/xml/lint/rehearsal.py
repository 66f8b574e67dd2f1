"""Connects all the ports of a tree without making its leaves, to see who would read and write what.

It is the builder itself that does so, with the same blackboards: whatever it refuses is refused here in
the same words, except for what only the leaves' own code can say.
"""

import enum
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from btcore.blackboard import Blackboard, Entry
from btcore.config import NodeConfig
from btcore.errors import BlackboardFault, ScriptFault
from btcore.manifest import Manifest
from btcore.node import TreeNode
from btcore.nodes.data import SetBlackboard, UnsetBlackboard
from btcore.nodes.loop import LoopNode
from btcore.nodes.scripted import Precondition, Script, ScriptCondition
from btcore.nodes.updated import UpdatedNode, WasEntryUpdated
from btcore.ports import Port, pointer
from btcore.registry import Registry
from btcore.tree import Subtree
from btcore.values import ValueType
from btcore.xml.build import Maker
from btcore.xml.check import Examined
from btcore.xml.faults import Faults
from btcore.xml.forest import Definition
from btcore.xml.lint.advice import is_built_in, is_stand_in
from btcore.xml.lint.scripts import Mention, mentions
from btcore.xml.plan import Call, NodePlan, Planner
from btcore.xml.source import Document

SCRIPT_PORTS: Final[dict[type[TreeNode], str]] = {Script: "code", ScriptCondition: "code", Precondition: "if"}


class How(enum.Enum):
    """What is done with an entry: NAMES reads the name of the entry that is meant, ASSIGNS needs one."""

    READS = enum.auto()
    WRITES = enum.auto()
    NAMES = enum.auto()
    ASSIGNS = enum.auto()
    MENTIONS = enum.auto()


@dataclass(frozen=True, slots=True, eq=False)
class Use:
    """One place where *key* is used in *scope*: an attribute, or the word *within* its script.

    *port* is None where a script, or a constant of a SubTree, does it.
    """

    how: How
    key: str
    scope: Blackboard
    document: Document
    node: NodePlan
    attribute: str
    within: int = 0
    port: Port | None = None
    kind: ValueType | None = None


class Rehearsal(Maker):
    """One tree, all but made. After :meth:`run`, *uses* has every entry and what is done with it.

    *opaque* tells that a leaf, or a script that is not written here, may use entries unseen;
    *has_stand_ins* that the enums, too, may be known elsewhere.
    """

    def __init__(self, planner: Planner, main: Definition, registry: Registry) -> None:
        super().__init__(Examined(planner, main, Faults()), registry, None, (), None)
        self.uses: dict[Entry, list[Use]] = {}
        self.opaque = False
        self.has_stand_ins = False
        self.entrances: dict[Blackboard, Use] = {}
        self._met: list[Use] = []

    def run(self) -> Faults:
        """Connect everything; what the builder would refuse."""
        self._instance(self._planner.plan(self._main), "", self._blackboard)
        for use in self._met:
            entry = self._entry(use)
            if entry is not None:
                self.uses.setdefault(entry, []).append(use)
        # Where an entry says which one is written, that may be any.
        named = [uses for uses in self.uses.values() if any(use.how is How.NAMES for use in uses)]
        self.opaque = self.opaque or any(written(uses) for uses in named)
        return self._faults

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

    def _entry(self, use: Use) -> Entry | None:
        found = use.scope.find(use.key)
        if found is not None:
            return found
        try:
            return use.scope.create(use.key)
        except BlackboardFault:
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
        script = config.inputs.get(SCRIPT_PORTS.get(manifest.cls, ""))
        if script is not None and script.key is not None:
            return TreeNode()  # it compiles what the blackboard comes with
        return super()._make(plan, manifest, config, document, blackboard, children)

    def _ports(self, plan: NodePlan, config: NodeConfig, document: Document, blackboard: Blackboard) -> None:
        super()._ports(plan, config, document, blackboard)
        for port, text, written in plan.ports:
            self._met += self._of_port(plan, port, text, written, document, blackboard)
        for attribute, text in plan.scripts.items():
            self._script(plan, attribute, text, document, blackboard)
        if plan.manifest is not None:
            self.opaque = self.opaque or reaches_the_blackboard(plan.manifest)
            self.has_stand_ins = self.has_stand_ins or is_stand_in(plan.manifest)

    def _of_port(
        self, plan: NodePlan, port: Port, text: str, written: bool, document: Document, board: Blackboard
    ) -> Iterator[Use]:
        key = pointer(text, port.name, self._format)
        cls = plan.manifest.cls if plan.manifest is not None else TreeNode
        how = []
        if key is None:
            if port.name == SCRIPT_PORTS.get(cls):
                self._script(plan, port.name, text, document, board)
            elif issubclass(cls, SetBlackboard) and port.name == "output_key":
                how = [How.WRITES]
            elif issubclass(cls, (UpdatedNode, WasEntryUpdated)):
                how = [How.READS]
            elif issubclass(cls, UnsetBlackboard):
                how = [How.MENTIONS]
            elif port.writes and self._format == 3 and written and not issubclass(cls, LoopNode):
                how = [How.WRITES]
            if text:
                key = text
        elif port.name == SCRIPT_PORTS.get(cls):
            self.opaque = True
            how = [How.READS]
        elif issubclass(cls, SetBlackboard) and port.name == "output_key":
            how = [How.NAMES]
        else:
            if port.reads:
                how.append(How.READS)
            if (
                port.writes
                and not (issubclass(cls, LoopNode) and port.reads)
                and (written or self._format == 4)
            ):
                how.append(How.WRITES)
        for one in how if key else ():
            yield Use(one, key or "", board, document, plan, port.name, 0, port, port.type)

    def _script(
        self, plan: NodePlan, attribute: str, text: str, document: Document, board: Blackboard
    ) -> None:
        try:
            found = mentions(text, self._enums)
        except ScriptFault:
            return  # said already
        for one in found:
            self._met.append(Use(_HOW[one.how], one.name, board, document, plan, attribute, one.column))

    def _scope(self, plan: NodePlan, call: Call, document: Document, outer: Blackboard) -> Blackboard:
        inner = super()._scope(plan, call, document, outer)
        for attribute, text in plan.scripts.items():
            self._script(plan, attribute, text, document, outer)
        if inner is not outer:
            self.entrances[inner] = Use(How.MENTIONS, call.tree, outer, document, plan, "ID")
            for key in call.constants:
                self._met.append(Use(How.WRITES, key, inner, document, plan, key))
            for key, outside in call.remaps.items():
                self._met.append(Use(How.MENTIONS, outside, outer, document, plan, key))
        return inner


_HOW = {
    Mention.READ: How.READS,
    Mention.MADE: How.WRITES,
    Mention.ASSIGNED: How.ASSIGNS,
}


def written(uses: Sequence[Use]) -> bool:
    """Whether anything writes the entry of *uses*."""
    return any(use.how in (How.WRITES, How.ASSIGNS) for use in uses)


def reaches_the_blackboard(manifest: Manifest) -> bool:
    """Whether the leaf asks for the blackboard itself, and may use any entry."""
    return any(
        one.port is None and isinstance(one.wanted, type) and issubclass(one.wanted, Blackboard)
        for one in manifest.parameters
    )
