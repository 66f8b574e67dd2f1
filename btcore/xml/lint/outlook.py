"""What a node may result in, as far as that is certain, and whether it may do so in its first tick."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final

from btcore.errors import ConversionFault
from btcore.leaf import Condition, StatefulAction, SyncAction
from btcore.node import TreeNode
from btcore.nodes import legacy
from btcore.nodes.branch import IfThenElse, WhileDoElse
from btcore.nodes.data import UnsetBlackboard
from btcore.nodes.fallback import AsyncFallback, Fallback, ReactiveFallback
from btcore.nodes.fixed import AlwaysFailure, AlwaysSuccess
from btcore.nodes.outcome import ForceFailure, ForceSuccess, Inverter, KeepRunningUntilFailure
from btcore.nodes.repeat import Repeat, RetryUntilSuccessful
from btcore.nodes.scripted import Script, ScriptCondition
from btcore.nodes.sequence import AsyncSequence, ReactiveSequence, Sequence, SequenceWithMemory
from btcore.nodes.timing import Delay, Sleep, Timeout
from btcore.nodes.updated import WaitValueUpdate, WasEntryUpdated
from btcore.ports import pointer
from btcore.status import FAILURE, SKIPPED, SUCCESS, Status
from btcore.values import INT, UINT, IntegerType
from btcore.xml.lint.advice import is_built_in, is_stand_in
from btcore.xml.plan import NodePlan

NOTHING: Final[frozenset[Status]] = frozenset()
ANYTHING: Final = frozenset({SUCCESS, FAILURE, SKIPPED})
ORDERED: Final[dict[type[TreeNode], Status]] = {
    Sequence: SUCCESS, AsyncSequence: SUCCESS, SequenceWithMemory: SUCCESS, ReactiveSequence: SUCCESS,
    legacy.SequenceStar: SUCCESS, Fallback: FAILURE, AsyncFallback: FAILURE, ReactiveFallback: FAILURE,
}  # fmt: skip
"""The nodes that go from child to child, and after which result of one they do."""
_REMEMBERING: Final = (SequenceWithMemory, legacy.SequenceStar)
_YIELDING: Final = (AsyncSequence, AsyncFallback, SequenceWithMemory)


@dataclass(frozen=True, slots=True)
class Outlook:
    """The results that a node may give: *quick* those in its first tick, *late* those after RUNNING.

    *runs* tells whether it may be RUNNING at all. What is in none of both is certain not to happen.
    """

    quick: frozenset[Status]
    late: frozenset[Status] = NOTHING
    runs: bool = False

    @property
    def results(self) -> frozenset[Status]:
        """All results that may be."""
        return self.quick | self.late

    def passes(self, going: Status) -> bool:
        """Whether the next child may follow, in a node that goes on after *going* and what is skipped."""
        return bool(self.results & {going, SKIPPED})


UNKNOWN: Final = Outlook(ANYTHING, ANYTHING, True)


def outlook_of(cls: type[TreeNode], node: NodePlan, children: list[Outlook], format: int) -> Outlook:
    """The outlook of *node*, of class *cls*, without its conditions; *children* are those of its children."""
    manifest = node.manifest
    if manifest is None or is_stand_in(manifest):
        return UNKNOWN
    if not is_built_in(manifest):
        return _of_leaf(cls) if not children else _of_any(children)
    if cls in ORDERED:
        return _of_ordered(cls, children)
    if len(children) == 1:
        return _of_decorator(cls, node, children[0], format)
    if issubclass(cls, (IfThenElse, WhileDoElse)) and len(children) in (2, 3):
        return _of_branches(children)
    if children:
        return _of_any(children)
    return _of_built_in_leaf(cls, node, format)


def with_conditions(node: NodePlan, bare: Outlook) -> Outlook:
    """*bare* with what the conditions of *node* may make of it."""
    early = {
        result
        for attribute, result in (
            ("_failureIf", FAILURE),
            ("_successIf", SUCCESS),
            ("_skipIf", SKIPPED),
            ("_while", SKIPPED),
        )
        if attribute in node.scripts
    }
    return replace(bare, quick=bare.quick | early)


def in_order(children: Iterable[Outlook], going: Status, yields: bool = False) -> Outlook:
    """Of a node that ticks its children in turn while they give *going* or are skipped.

    One that *yields* ends its tick after each that gives *going*.
    """
    stopping = FAILURE if going is SUCCESS else SUCCESS
    results: tuple[set[Status], set[Status]] = (set(), set())
    at_once, later, all_skip, runs = True, False, True, False
    each = list(children)
    for index, child in enumerate(each):
        if not at_once and not later:
            break
        runs = runs or child.runs
        if stopping in child.quick:
            results[0].update({stopping} if at_once else ())
            results[1].update({stopping} if later else ())
        if stopping in child.late:
            results[1].add(stopping)
        yielding = yields and index + 1 < len(each)
        passes = SKIPPED in child.quick or (going in child.quick and not yielding)
        passes_late = bool({going, SKIPPED} & child.late) or (yielding and going in child.quick)
        runs = runs or (yielding and going in child.quick)
        later = (later and (passes or passes_late)) or (at_once and passes_late)
        at_once = at_once and passes
        all_skip = all_skip and SKIPPED in child.results
    end = {going, SKIPPED} if all_skip else {going}
    results[0].update(end if at_once else ())
    results[1].update(end if later else ())
    return Outlook(frozenset(results[0]), frozenset(results[1]), runs)


def _of_leaf(cls: type[TreeNode]) -> Outlook:
    if issubclass(cls, StatefulAction):
        # A leaf may say that it often is done in the tick in which it starts.
        at_once = ANYTHING if getattr(cls, "may_end_at_once", False) else NOTHING
        return Outlook(at_once, ANYTHING, True)
    if issubclass(cls, (SyncAction, Condition)):
        return Outlook(ANYTHING)
    return UNKNOWN


def _of_built_in_leaf(cls: type[TreeNode], node: NodePlan, format: int) -> Outlook:
    if issubclass(cls, (AlwaysSuccess, Script, UnsetBlackboard)):
        return Outlook(frozenset({SUCCESS}))
    if issubclass(cls, AlwaysFailure):
        return Outlook(frozenset({FAILURE}))
    if issubclass(cls, (ScriptCondition, WasEntryUpdated)):
        return Outlook(frozenset({SUCCESS, FAILURE}))
    if issubclass(cls, Sleep):
        done = frozenset({SUCCESS})
        return Outlook(done) if _number(node, "msec", UINT, format) == 0 else Outlook(NOTHING, done, True)
    return _of_leaf(cls)


def _of_ordered(cls: type[TreeNode], children: list[Outlook]) -> Outlook:
    going, yields = ORDERED[cls], issubclass(cls, _YIELDING)
    whole = in_order(children, going, yields)
    if not issubclass(cls, _REMEMBERING):
        return whole
    # It may begin at any of its children.
    begins = [in_order(children[index:], going, yields) for index in range(len(children))]
    return replace(whole, quick=whole.quick.union(*(one.quick for one in begins)))


def _of_any(children: list[Outlook]) -> Outlook:
    """Of a node that may do anything with its children."""
    runs = any(child.runs for child in children)
    return Outlook(ANYTHING, ANYTHING if runs else NOTHING, runs)


def _of_branches(children: list[Outlook]) -> Outlook:
    condition = children[0]
    quick: set[Status] = set()
    late: set[Status] = set()
    branches = [(SUCCESS, children[1]), (FAILURE, children[2] if len(children) == 3 else None)]
    runs = condition.runs
    for chosen, branch in branches:
        if chosen not in condition.results:
            continue
        found = branch if branch is not None else Outlook(frozenset({FAILURE}))
        runs = runs or found.runs
        late |= found.late
        if chosen in condition.quick:
            quick |= found.quick
        if chosen in condition.late:
            late |= found.quick
    if len(children) == 2:
        quick |= condition.results & {FAILURE}  # which its condition keeps
    return Outlook(frozenset(quick), frozenset(late), runs)


def _of_decorator(cls: type[TreeNode], node: NodePlan, child: Outlook, format: int) -> Outlook:
    if issubclass(cls, Inverter):
        return _mapped(child, {SUCCESS: FAILURE, FAILURE: SUCCESS})
    if issubclass(cls, ForceSuccess):
        return _mapped(child, {FAILURE: SUCCESS})
    if issubclass(cls, ForceFailure):
        return _mapped(child, {SUCCESS: FAILURE})
    if issubclass(cls, KeepRunningUntilFailure):
        return Outlook(child.quick & {FAILURE}, child.results & {FAILURE}, True)
    if issubclass(cls, Delay):
        return Outlook(NOTHING, child.results, True)
    if issubclass(cls, Timeout):
        return replace(child, late=child.late | {FAILURE}) if child.runs else child
    if issubclass(cls, (Repeat, RetryUntilSuccessful, legacy.Repeat3, legacy.RetryUntilSuccessful3)):
        going = SUCCESS if issubclass(cls, (Repeat, legacy.Repeat3)) else FAILURE
        return _of_turns(node, child, going, format)
    # What may be skipped, or give a result of its own, whatever the child does.
    runs = child.runs or issubclass(cls, WaitValueUpdate)
    return Outlook(ANYTHING, ANYTHING, runs)


def _mapped(child: Outlook, table: dict[Status, Status]) -> Outlook:
    quick = frozenset(table.get(one, one) for one in child.quick)
    return Outlook(quick, frozenset(table.get(one, one) for one in child.late), child.runs)


def _of_turns(node: NodePlan, child: Outlook, going: Status, format: int) -> Outlook:
    """Of a node that ticks its child again and again while it gives *going*."""
    turns = _turns(node, format)
    if turns is None:
        return Outlook(child.quick | {going}, child.results | {going}, True)
    if turns == 0:
        return Outlook(frozenset({going}))
    if turns == 1:
        return child
    endless = turns < 0
    results = child.results - {going} if endless else child.results
    # Format 4 ends its tick after a turn that took no time.
    waits = format == 4 and going in child.quick
    quick = child.quick & results
    if waits and SKIPPED not in child.results:
        quick -= {going}
    late = results if child.runs or waits else NOTHING
    return Outlook(quick, late, child.runs or waits or endless)


def _turns(node: NodePlan, format: int) -> int | None:
    """How often the child may be ticked, -1 for ever; None if it isn't known."""
    turns = _number(node, "num_cycles", INT, format)
    if turns is None:
        turns = _number(node, "num_attempts", INT, format)
    return turns if turns is None or turns >= -1 else 0


def _number(node: NodePlan, port: str, kind: IntegerType, format: int) -> int | None:
    """The number written out for *port*; None if there is none."""
    for one, text, _ in node.ports:
        if one.name == port and pointer(text, port, format) is None:
            try:
                return kind.from_text(text, format)
            except ConversionFault:
                return None
    return None
