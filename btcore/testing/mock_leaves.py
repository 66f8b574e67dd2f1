"""Leaves whose results are given from outside: one plan for all leaves of a tree, whatever they are.

nodes = with_mock_leaves(nodes)                  # any leaf that isn't btcore's own
tree = btcore.load("patrol.xml", nodes=nodes, clock=SimClock())
Outcomes("RRS", "F").drive(tree, ticks=6)
"""

from collections.abc import Sequence
from typing import Any, ClassVar

from btcore.engine.leaf import Condition, StatefulAction
from btcore.engine.node import TreeNode
from btcore.registry.registry import Registry
from btcore.status import NodeType, Status
from btcore.testing.plan_leaves import LETTERS, LeafPlanError
from btcore.tree.tree import Tree


class Outcomes:
    """What leaves do, one entry a start, in the order in which they start; after the last the first again.

    An entry is S (success), F (failure), K (skipped) or X (raises :class:`LeafPlanError`), with an R before
    it for every tick that an action runs first. Of a condition the last letter alone counts, and K is a
    failure: several control nodes don't let their condition be skipped.
    Raises ValueError for any other entry, and for none at all.
    """

    def __init__(self, *entries: str) -> None:
        wrong = [one for one in entries if not one or one[-1] not in "SFKX" or one[:-1].strip("R")]
        if wrong or not entries:
            said = repr(wrong[0]) if wrong else "nothing"
            raise ValueError(f"a plan has entries such as 'S', 'F' and 'RRS', not {said}")
        self.entries = entries
        self._next = 0

    def __repr__(self) -> str:
        return f"Outcomes({', '.join(map(repr, self.entries))})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Outcomes) and self.entries == other.entries

    def __hash__(self) -> int:
        return hash(self.entries)

    def next_entry(self) -> str:
        """The entry of the next start."""
        entry = self.entries[self._next % len(self.entries)]
        self._next += 1
        return entry

    def attach(self, tree: Tree) -> None:
        """Let the planned leaves of *tree* follow this plan, from its first entry on.

        Raises ValueError if it has leaves of its own, but none is planned.
        """
        leaves: Sequence[Any] = [*tree.find(MockAction), *tree.find(MockCondition)]
        own = [node.path for node in tree if not node.children and not _built_in(node, tree.registry)]
        if own and not leaves:
            raise ValueError(
                f"no leaf of the tree '{tree.id}' follows a plan, not even '{own[0]}'; "
                "load it with nodes=with_mock_leaves(nodes)"
            )
        self._next = 0
        for leaf in leaves:
            leaf.outcomes = self

    def drive(self, tree: Tree, ticks: int = 10, period: float = 0.01) -> list[Status]:
        """Tick *tree* exactly *ticks* times, *period* seconds of its clock apart; the root's results.

        Begins as :meth:`attach`, and raises what a tick raises.
        """
        self.attach(tree)
        results = []
        for _ in range(ticks):
            results.append(tree.tick_exactly_once())
            tree.sleep(period)
        return results


def _built_in(node: TreeNode, nodes: Registry) -> bool:
    manifest = nodes.get(node.id, node.config.format)
    return manifest is not None and manifest.distribution == "btcore"


def _letter(letter: str) -> Status:
    if letter == "X":
        raise LeafPlanError("the plan says so")
    return LETTERS[letter]


class MockAction(StatefulAction):
    """An action that does what the tree's :class:`Outcomes` say; without any it succeeds."""

    state_fields: ClassVar[tuple[str, ...] | None] = ("outcomes", "left")

    def __init__(self) -> None:
        self.outcomes = Outcomes("S")
        self.left = ""

    def on_start(self) -> Status:
        """Take an entry."""
        self.left = self.outcomes.next_entry()
        return self.on_running()

    def on_running(self) -> Status:
        """Go on in it."""
        letter, self.left = self.left[0], self.left[1:] or self.left
        return _letter(letter)


class MockCondition(Condition):
    """A condition that gives the last letter of an entry of the tree's :class:`Outcomes`."""

    state_fields: ClassVar[tuple[str, ...] | None] = ("outcomes",)

    def __init__(self) -> None:
        self.outcomes = Outcomes("S")

    def tick(self) -> Status:
        """Take an entry."""
        return _letter(self.outcomes.next_entry()[-1].replace("K", "F"))


def with_mock_leaves(nodes: Registry) -> Registry:
    """A copy of *nodes* in which every leaf but btcore's own follows a plan, and so do <Act> and <Ask>.

    What the leaves ask for by type needn't be handed in, and what they write stays unwritten.
    """
    made = nodes.copy()
    for ID, leaf in (("Act", MockAction), ("Ask", MockCondition)):
        if ID not in made:
            made.add(leaf, ID=ID)
    for format in (3, 4):
        for ID, manifest in made.manifests_of(format).items():
            if manifest.distribution == "btcore" or ID in made.substitutions:
                continue
            if manifest.type is NodeType.ACTION:
                made.substitute(ID, MockAction)
            elif manifest.type is NodeType.CONDITION:
                made.substitute(ID, MockCondition)
    return made
