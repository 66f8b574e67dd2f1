"""The mock leaves of `btcore_recorder.mock_run`: how they answer, and where a tick stops."""

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from random import Random
from typing import Final, NamedTuple

from btcore.engine.node import TreeNode, tick_wrapper
from btcore.errors import TickInterrupt
from btcore.registry.outcome_grammar import Outcome, parse_outcomes
from btcore.status import IDLE, Status
from btcore.tree.tree import Tree

MAX_EVENTS: Final = 50_000
"""Maximum number of begins and ends of nodes in a tick: a tick may repeat a leaf without end."""
MAX_TICK_S: Final = 2.0
"""Maximum time (s, real time) of a tick."""


class LeafPlan(NamedTuple):
    """How a leaf answers; by default the user is asked.

    Attributes:
        outcomes: The outcomes that it follows, in the grammar of `parse_outcomes`; "" for none.
        chance: The probability with which each tick succeeds, and otherwise fails; None if it follows no
            chance.
        seed: Determines the results that *chance* draws.
    """

    outcomes: str = ""
    chance: float | None = None
    seed: int = 0


ASKED: Final = LeafPlan()


class Answer(NamedTuple):
    """What a leaf did in a tick.

    Attributes:
        position: The number of steps before the tick.
        uid: The number of the leaf.
        outcome: What it did.
        is_start: Whether it was not RUNNING before.
    """

    position: int
    uid: int
    outcome: Outcome
    is_start: bool


@dataclass(slots=True)
class MockLeaf:
    """The answers of a leaf, and how it answers.

    Attributes:
        path: The path of the leaf.
        is_condition: Whether each tick is a start.
        plan: How it answers.
        repeated: Answers of an earlier run, which come first.
        answers: Its answers so far.
        planned_from: The number of answers before the plan began.
        starts: The number of starts since then.
        since_start: The number of answers since the last start, which is included.
    """

    path: str
    is_condition: bool
    plan: LeafPlan = ASKED
    repeated: deque[Outcome] = field(default_factory=deque)
    answers: list[Answer] = field(default_factory=list)
    planned_from: int = 0
    starts: int = 0
    since_start: int = 0

    def add(self, answer: Answer) -> None:
        """Note an answer."""
        self.answers.append(answer)
        self._count(answer)

    def _count(self, answer: Answer) -> None:
        self.starts += answer.is_start
        self.since_start = 1 if answer.is_start else self.since_start + 1

    def keep(self, count: int) -> None:
        """Forget all but the first answers."""
        del self.answers[count:]
        self.planned_from = min(self.planned_from, count)
        self.starts = self.since_start = 0
        for answer in self.answers[self.planned_from :]:
            self._count(answer)

    def set_plan(self, plan: LeafPlan) -> None:
        """Follow *plan* from the next answer on."""
        self.plan, self.planned_from = plan, len(self.answers)
        self.repeated.clear()
        self.starts = self.since_start = 0

    def next(self, is_start: bool) -> Outcome | None:
        """Return the next answer; None if the user has to be asked."""
        if self.repeated:
            return self.repeated.popleft()
        outcomes, chance, seed = self.plan
        if chance is not None:
            number = Random(f"{seed} {self.path} {len(self.answers)}").random()
            return Outcome("S" if number < chance else "F")
        if not outcomes:
            return None
        starts = parse_outcomes(outcomes)
        if self.is_condition:  # as a `MockCondition`: each tick is a start
            letters = [outcome for start in starts for outcome in start]
            return letters[(len(self.answers) - self.planned_from) % len(letters)]
        if is_start:
            return starts[self.starts % len(starts)][0]
        start = starts[max(0, self.starts - 1) % len(starts)]
        return start[min(self.since_start, len(start) - 1)]


class LeafAsked(TickInterrupt):
    """Ends a tick at a leaf without an answer."""

    def __init__(self, node: TreeNode) -> None:
        self.node = node


class TickStopped(TickInterrupt):
    """Ends a tick at the wanted moment within it."""


class TickImpossible(TickInterrupt):
    """Ends a tick that cannot be run; its text is the reason."""


def ticks_its_children(node: TreeNode) -> bool:
    """Return whether a node without code ticks its children. A person decides the result of the other."""
    return bool(node.children) and node.config.id != "ManualSelector"


StopCondition = Callable[[int, int, bool], bool]
"""Returns whether a tick stops at an event.

The arguments are the number of events so far, the UID of the node, and whether the node ends.
"""


class TickCursor:
    """The begins and ends of the nodes of a tick, at one of which the tick can be stopped.

    Attributes:
        events: The number of each node that begins, with None, and of each that ends, with its result.
    """

    def __init__(self, tree: Tree) -> None:
        self.events: list[tuple[int, Status | None]] = []
        self._is_wanted: StopCondition | None = None
        self._deadline: float | None = None  # None in a replay
        for node in tree.nodes:
            wrapper = tick_wrapper(node)
            wrapper.on_tick_start = partial(self._add, node.config.uid, None)
            wrapper.post_tick = partial(self._end, wrapper.post_tick)

    def begin(self, is_wanted: StopCondition | None) -> None:
        """Begin a tick, which stops at the first event for which *is_wanted* is true."""
        self.events.clear()
        self._is_wanted = is_wanted
        self._deadline = time.monotonic() + MAX_TICK_S

    def end(self) -> None:
        """Stop no further tick."""
        self._is_wanted = self._deadline = None

    def _end(
        self, callback: Callable[[TreeNode, Status], Status] | None, node: TreeNode, status: Status
    ) -> Status:
        forced = IDLE if callback is None else callback(node, status)
        self._add(node.config.uid, status)
        return forced

    def _add(self, uid: int, result: Status | None) -> None:
        if self._deadline is None:
            return
        self.events.append((uid, result))
        if self._is_wanted is not None and self._is_wanted(len(self.events), uid, result is not None):
            raise TickStopped
        if len(self.events) > MAX_EVENTS or time.monotonic() > self._deadline:
            raise TickImpossible(
                f"the tick does not end: it took more than {MAX_TICK_S:g} s or ticked nodes more than "
                f"{MAX_EVENTS // 2:,} times; a leaf that is repeated without a pause has to return RUNNING"
            )
