"""What a node may result in, as far as that is certain, and whether it may do so in its first tick."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final

from btcore.blackboard.ports import remapped_key
from btcore.engine.leaf import Condition, StatefulAction, SyncAction
from btcore.engine.node import TreeNode
from btcore.errors import ConversionError
from btcore.nodes import format3
from btcore.nodes.blackboard_actions import UnsetBlackboard
from btcore.nodes.branch import IfThenElse, WhileDoElse
from btcore.nodes.constant_results import AlwaysFailure, AlwaysSuccess
from btcore.nodes.entry_updates import WaitValueUpdate, WasEntryUpdated
from btcore.nodes.fallback import AsyncFallback, Fallback, ReactiveFallback
from btcore.nodes.repeat import Repeat, RetryUntilSuccessful
from btcore.nodes.result_decorators import (
    ForceFailure,
    ForceSuccess,
    Inverter,
    KeepRunningUntilFailure,
)
from btcore.nodes.script_nodes import Script, ScriptCondition
from btcore.nodes.sequence import (
    AsyncSequence,
    ReactiveSequence,
    Sequence,
    SequenceWithMemory,
)
from btcore.nodes.timing import Delay, Sleep, Timeout
from btcore.status import (
    FAILURE,
    SKIPPED,
    SUCCESS,
    Status,
)
from btcore.values import INT, UINT, IntegerType
from btcore.xml.lint.advice import is_built_in, is_stub
from btcore.xml.plan.plan import NodePlan

NOTHING: Final[frozenset[Status]] = frozenset()
ANYTHING: Final = frozenset({SUCCESS, FAILURE, SKIPPED})
CONTINUE_STATUS: Final[dict[type[TreeNode], Status]] = {
    Sequence: SUCCESS, AsyncSequence: SUCCESS, SequenceWithMemory: SUCCESS, ReactiveSequence: SUCCESS,
    format3.SequenceStar: SUCCESS, Fallback: FAILURE, AsyncFallback: FAILURE, ReactiveFallback: FAILURE,
}  # fmt: skip
"""The nodes that go from child to child, and after which result of one they do."""
_REMEMBERING: Final = (SequenceWithMemory, format3.SequenceStar)
_YIELDING: Final = (AsyncSequence, AsyncFallback, SequenceWithMemory)


@dataclass(frozen=True, slots=True)
class PossibleResults:
    """The results that a node may give: *quick* those in its first tick, *late* those after RUNNING.

    *runs* tells whether it may be RUNNING at all. What is in none of both is certain not to happen.
    """

    in_first_tick: frozenset[Status]
    after_running: frozenset[Status] = NOTHING
    may_run: bool = False

    @property
    def results(self) -> frozenset[Status]:
        """All results that may be."""
        return self.in_first_tick | self.after_running

    def passes(self, going: Status) -> bool:
        """Whether the next child may follow, in a node that goes on after *going* and what is skipped."""
        return bool(self.results & {going, SKIPPED})


UNKNOWN: Final = PossibleResults(ANYTHING, ANYTHING, True)


def infer_results(
    cls: type[TreeNode], node: NodePlan, children: list[PossibleResults], format: int
) -> PossibleResults:
    """The outlook of *node*, of class *cls*, without its conditions; *children* are those of its children."""
    manifest = node.manifest
    if manifest is None or is_stub(manifest):
        return UNKNOWN
    if not is_built_in(manifest):
        return _of_leaf(cls) if not children else _of_any(children)
    if cls in CONTINUE_STATUS:
        return _of_ordered(cls, children)
    if len(children) == 1:
        return _of_decorator(cls, node, children[0], format)
    if issubclass(cls, (IfThenElse, WhileDoElse)) and len(children) in (2, 3):
        return _of_branches(children)
    if children:
        return _of_any(children)
    return _of_built_in_leaf(cls, node, format)


def with_conditions(node: NodePlan, bare: PossibleResults) -> PossibleResults:
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
    return replace(bare, in_first_tick=bare.in_first_tick | early)


def combine_in_order(
    children: Iterable[PossibleResults], going: Status, yields: bool = False
) -> PossibleResults:
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
        runs = runs or child.may_run
        if stopping in child.in_first_tick:
            results[0].update({stopping} if at_once else ())
            results[1].update({stopping} if later else ())
        if stopping in child.after_running:
            results[1].add(stopping)
        yielding = yields and index + 1 < len(each)
        passes = SKIPPED in child.in_first_tick or (going in child.in_first_tick and not yielding)
        passes_late = bool({going, SKIPPED} & child.after_running) or (
            yielding and going in child.in_first_tick
        )
        runs = runs or (yielding and going in child.in_first_tick)
        later = (later and (passes or passes_late)) or (at_once and passes_late)
        at_once = at_once and passes
        all_skip = all_skip and SKIPPED in child.results
    end = {going, SKIPPED} if all_skip else {going}
    results[0].update(end if at_once else ())
    results[1].update(end if later else ())
    return PossibleResults(frozenset(results[0]), frozenset(results[1]), runs)


def _of_leaf(cls: type[TreeNode]) -> PossibleResults:
    if issubclass(cls, StatefulAction):
        # A leaf may say that it often is done in the tick in which it starts.
        at_once = ANYTHING if getattr(cls, "may_complete_on_start", False) else NOTHING
        return PossibleResults(at_once, ANYTHING, True)
    if issubclass(cls, (SyncAction, Condition)):
        return PossibleResults(ANYTHING)
    return UNKNOWN


def _of_built_in_leaf(cls: type[TreeNode], node: NodePlan, format: int) -> PossibleResults:
    if issubclass(cls, (AlwaysSuccess, Script, UnsetBlackboard)):
        return PossibleResults(frozenset({SUCCESS}))
    if issubclass(cls, AlwaysFailure):
        return PossibleResults(frozenset({FAILURE}))
    if issubclass(cls, (ScriptCondition, WasEntryUpdated)):
        return PossibleResults(frozenset({SUCCESS, FAILURE}))
    if issubclass(cls, Sleep):
        done = frozenset({SUCCESS})
        return (
            PossibleResults(done)
            if _number(node, "msec", UINT, format) == 0
            else PossibleResults(NOTHING, done, True)
        )
    return _of_leaf(cls)


def _of_ordered(cls: type[TreeNode], children: list[PossibleResults]) -> PossibleResults:
    going, yields = CONTINUE_STATUS[cls], issubclass(cls, _YIELDING)
    whole = combine_in_order(children, going, yields)
    if not issubclass(cls, _REMEMBERING):
        return whole
    # It may begin at any of its children.
    begins = [combine_in_order(children[index:], going, yields) for index in range(len(children))]
    return replace(whole, in_first_tick=whole.in_first_tick.union(*(one.in_first_tick for one in begins)))


def _of_any(children: list[PossibleResults]) -> PossibleResults:
    """Of a node that may do anything with its children."""
    runs = any(child.may_run for child in children)
    return PossibleResults(ANYTHING, ANYTHING if runs else NOTHING, runs)


def _of_branches(children: list[PossibleResults]) -> PossibleResults:
    condition = children[0]
    quick: set[Status] = set()
    late: set[Status] = set()
    branches = [(SUCCESS, children[1]), (FAILURE, children[2] if len(children) == 3 else None)]
    runs = condition.may_run
    for chosen, branch in branches:
        if chosen not in condition.results:
            continue
        found = branch if branch is not None else PossibleResults(frozenset({FAILURE}))
        runs = runs or found.may_run
        late |= found.after_running
        if chosen in condition.in_first_tick:
            quick |= found.in_first_tick
        if chosen in condition.after_running:
            late |= found.in_first_tick
    if len(children) == 2:
        quick |= condition.results & {FAILURE}  # which its condition keeps
    return PossibleResults(frozenset(quick), frozenset(late), runs)


def _of_decorator(
    cls: type[TreeNode], node: NodePlan, child: PossibleResults, format: int
) -> PossibleResults:
    if issubclass(cls, Inverter):
        return _mapped(child, {SUCCESS: FAILURE, FAILURE: SUCCESS})
    if issubclass(cls, ForceSuccess):
        return _mapped(child, {FAILURE: SUCCESS})
    if issubclass(cls, ForceFailure):
        return _mapped(child, {SUCCESS: FAILURE})
    if issubclass(cls, KeepRunningUntilFailure):
        return PossibleResults(child.in_first_tick & {FAILURE}, child.results & {FAILURE}, True)
    if issubclass(cls, Delay):
        return PossibleResults(NOTHING, child.results, True)
    if issubclass(cls, Timeout):
        return replace(child, after_running=child.after_running | {FAILURE}) if child.may_run else child
    if issubclass(cls, (Repeat, RetryUntilSuccessful, format3.Repeat3, format3.RetryUntilSuccessful3)):
        going = SUCCESS if issubclass(cls, (Repeat, format3.Repeat3)) else FAILURE
        return _of_turns(node, child, going, format)
    # What may be skipped, or give a result of its own, whatever the child does.
    runs = child.may_run or issubclass(cls, WaitValueUpdate)
    return PossibleResults(ANYTHING, ANYTHING, runs)


def _mapped(child: PossibleResults, table: dict[Status, Status]) -> PossibleResults:
    quick = frozenset(table.get(one, one) for one in child.in_first_tick)
    return PossibleResults(
        quick, frozenset(table.get(one, one) for one in child.after_running), child.may_run
    )


def _of_turns(node: NodePlan, child: PossibleResults, going: Status, format: int) -> PossibleResults:
    """Of a node that ticks its child again and again while it gives *going*."""
    turns = _turns(node, format)
    if turns is None:
        return PossibleResults(child.in_first_tick | {going}, child.results | {going}, True)
    if turns == 0:
        return PossibleResults(frozenset({going}))
    if turns == 1:
        return child
    endless = turns < 0
    results = child.results - {going} if endless else child.results
    # Format 4 ends its tick after a turn that took no time.
    waits = format == 4 and going in child.in_first_tick
    quick = child.in_first_tick & results
    if waits and SKIPPED not in child.results:
        quick -= {going}
    late = results if child.may_run or waits else NOTHING
    return PossibleResults(quick, late, child.may_run or waits or endless)


def _turns(node: NodePlan, format: int) -> int | None:
    """How often the child may be ticked, -1 for ever; None if it isn't known."""
    turns = _number(node, "num_cycles", INT, format)
    if turns is None:
        turns = _number(node, "num_attempts", INT, format)
    return turns if turns is None or turns >= -1 else 0


def _number(node: NodePlan, port: str, kind: IntegerType, format: int) -> int | None:
    """The number written out for *port*; None if there is none."""
    for one, text, _ in node.ports:
        if one.name == port and remapped_key(text, port, format) is None:
            try:
                return kind.from_text(text, format)
            except ConversionError:
                return None
    return None
