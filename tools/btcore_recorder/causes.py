"""The causes of what nodes did in a recorded run, from replays of single ticks.

A cause leads from a result down to the leaves and conditions that it depends on, and from the entries that
these have read to the nodes that wrote them, also in earlier ticks.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import Enum
from itertools import islice
from typing import Final

from btcore.clock import NS_PER_S
from btcore.engine.node import TreeNode
from btcore.engine.recorded_events import MessageLogged, Raised
from btcore.errors import BtcoreError, ScriptError
from btcore.script.expressions import Literal as ScriptLiteral
from btcore.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, Status
from btcore.suggestions import counted, join_names
from btcore.tree.tree import parents_of
from btcore.xml.plan.key_uses import WRITING, find_name_uses, iter_subexpressions, parse_statements
from btcore_recorder.inputs import Result, is_external
from btcore_recorder.replay import Replay
from btcore_recorder.tick_trace import (
    MAX_OBSERVATIONS,
    EntryName,
    Halt,
    Read,
    TickTrace,
    Visit,
    Write,
    scripts_of,
)
from btcore_recorder.values import NotReplayable, value_text
from btcore_recorder.what_if import Change, HoldEntry, SetResult

MAX_CAUSES: Final = 300
"""Maximum number of causes that are considered for an answer."""
_MAX_VALUE: Final = 60
_VALUES_TRIED: Final = 12
_MAX_STEPS_BACK: Final = 50


@dataclass
class Cause:
    """A part of an explanation; *causes* are its own causes, the most important first.

    Attributes:
        step: The index of the step.
        because: What the node did, or why, for a sentence that begins with the node.
        details: With what values a leaf did it, and what it logged.
        changes: Other values of the input that the cause is; empty if it is none.
        is_passed_on: Whether the node only passes on the result of a child.
        is_context: Whether it only explains how the tick came to what follows it.
    """

    step: int
    uid: int
    because: str
    details: str = ""
    changes: Sequence[Change] = ()
    is_passed_on: bool = False
    is_context: bool = False
    causes: "list[Cause]" = field(default_factory=list)
    tried: str = ""

    def is_like(self, other: "Cause") -> bool:
        """Return whether *other* says the same."""
        return (self.step, self.uid, self.because) == (other.step, other.uid, other.because)

    def walk(self) -> "Iterator[Cause]":
        """Yield the cause and its own causes, each before the next."""
        yield self
        for cause in self.causes:
            yield from cause.walk()


class CauseFinder:
    """Finds the causes of what nodes did in the run of *replay*."""

    def __init__(self, replay: Replay) -> None:
        self._replay = replay
        self._nodes = replay.tree.nodes
        self._steps = replay.steps
        self.paths = list(replay.tree.nodes_by_path())
        self._parents = parents_of(replay.tree)
        self._traces: dict[int, TickTrace] = {}
        self._count = 0

    def begin(self) -> None:
        """Begin a new question."""
        self._count = 0
        self._traces.clear()

    def seek(self, position: int) -> None:
        """Run the replay to the end of *position* steps.

        Raises:
            BtcoreError: It differs from the recording.
        """
        if not self._replay.seek(position):
            raise BtcoreError(f"the replay differs from the recording: {self._replay.difference}")

    def trace(self, index: int) -> TickTrace:
        """Return what happens in the step with this index.

        Raises:
            BtcoreError: The replay differs from the recording, or too much happens in the steps of this
                question.
        """
        if index not in self._traces:
            self.seek(index)
            observed = sum(trace.size for trace in self._traces.values())
            trace = TickTrace(self._replay.tree, MAX_OBSERVATIONS - observed)
            self._replay.step()
            trace.close()
            if trace.is_truncated:
                raise BtcoreError(
                    f"tick {self.tick(index)} cannot be explained: with the ticks that it depends on, it has "
                    f"more than {MAX_OBSERVATIONS:,} ticks of nodes, reads and writes; ask about another "
                    "tick, or about a node that depends on fewer"
                )
            self.seek(index + 1)
            self._traces[index] = trace
        return self._traces[index]

    def tick(self, index: int) -> int:
        """Return the number of a tick; for a halt that of the tick before it."""
        tick = self._replay.recording.tick_at(index)
        return 0 if tick is None else tick.tick

    def time(self, index: int) -> float:
        """Return the time of a tick (s since the recording began); for a halt that of the tick before it."""
        return self._replay.recording.time_at(index) / NS_PER_S

    def path(self, uid: int) -> str:
        """Return the path of a node; "" for 0."""
        return self.paths[uid - 1] if uid else ""

    def _names(self, visits: Iterable[Visit]) -> str:
        names = dict.fromkeys(f"'{self.paths[visit.uid - 1]}'" for visit in visits)
        return join_names(list(names), most=4)

    # --- explanations

    def _new(self, index: int, uid: int, because: str, changes: Sequence[Change] = ()) -> Cause:
        self._count += 1
        return Cause(index, uid, because, changes=changes)

    @property
    def _is_full(self) -> bool:
        return self._count >= MAX_CAUSES

    def explain_result(self, index: int, visit: Visit) -> Cause:
        """Explain the result of a tick of a node."""
        node = self._nodes[visit.uid - 1]
        if visit.decided_by == "condition" and node.config.conditions:
            return self._explain_condition(index, visit)
        children = visit.children
        if visit.decided_by == "callback":
            cause = self._new(index, visit.uid, f"a callback of the program forced {name_of(visit.result)}")
        elif is_external(type(node)):
            cause = self._explain_external(index, visit)
        elif visit.result is None and not children:
            cause = self._new(index, visit.uid, self._describe_error(index))
        else:
            own = [read for read in visit.reads if read.by not in node.config.conditions]
            cause = self._new(index, visit.uid, self._describe(node, visit, own))
            cause.is_passed_on = bool(children) and not own
            self._add_children(cause, children, visit.result)
            self._add_earlier_child(cause, visit)
            self._add_halted_children(cause, visit)
            self._add_reads(cause, own, is_input=True)
            return cause
        self._add_children(cause, children, visit.result)
        return cause

    def _add_children(
        self, cause: Cause, children: Sequence[Visit], result: Status | None, is_context: bool = False
    ) -> None:
        """Add the results of children, those first that are equal to *result*, the last ones first."""
        last_first = children[::-1]
        ordered = sorted(last_first, key=lambda each: (each.result is not result, each.result is SKIPPED))
        seen: set[tuple[int, Status | None]] = set()
        for child in ordered:
            if not self._is_full and (child.uid, child.result) not in seen:
                seen.add((child.uid, child.result))
                cause.causes.append(self.explain_result(cause.step, child))
                cause.causes[-1].is_context = is_context or child.result is not ordered[0].result

    def _add_earlier_child(self, cause: Cause, visit: Visit) -> None:
        """Add the result, in an earlier tick, of the child before the first one that was ticked."""
        siblings = self._nodes[visit.uid - 1].children
        if visit.before is not RUNNING or not visit.children or self._is_full:
            return
        first = next(i for i, each in enumerate(siblings) if each.config.uid == visit.children[0].uid)
        found = self._find_end(siblings[first - 1].config.uid, cause.step) if first else None
        if found is not None:
            at, end = found
            cause.causes.append(self.explain_result(at, end))
            cause.causes[-1].is_context = end.result is not visit.result

    def _find_end(self, uid: int, index: int) -> tuple[int, Visit] | None:
        """Return the last step before *index* in which a node ended, and its last tick there, or None."""
        at = self._replay.find_end(uid, index)
        return None if at is None else (at, self.trace(at).visits_of(uid)[-1])

    def _add_halted_children(self, cause: Cause, visit: Visit) -> None:
        """Add the last results of children that the node halted and did not tick, as a Timeout does."""
        ticked = {child.uid for child in visit.children}
        for halt in self.trace(cause.step).halts:
            parent = self._parents.get(halt.uid)
            if halt.by is not visit or halt.uid in ticked or parent != visit.uid:
                continue
            cause.details += f"; it halted '{self.path(halt.uid)}', which was RUNNING"
            for at in range(cause.step - 1, max(-1, cause.step - _MAX_STEPS_BACK), -1):
                visits = self.trace(at).visits_of(halt.uid)
                if visits:
                    cause.causes.append(self.explain_result(at, visits[-1]))
                    break

    def _describe_error(self, index: int) -> str:
        """Return the exception that ended a tick, for a sentence."""
        error = self.trace(index).error
        if error is None:
            return "raised an exception"
        return f"raised {type(error.cause).__name__}: {_one_line(str(error.cause))}"

    def _describe(self, node: TreeNode, visit: Visit, reads: Sequence[Read]) -> str:
        """Return why a built-in node had its result."""
        values = _describe_reads(reads)
        children = visit.children
        if not children:
            script = next((read for read in reads if read.script), None)
            if script is not None and node.config.id == "ScriptCondition":
                truth = "true" if visit.result is SUCCESS else "false"
                return f'code="{_one_line(script.script)}" is {truth}: {values}'
            values = ", ".join(filter(None, (_describe_literals(node), values)))
            return (
                f"<{node.config.id}> returned {name_of(visit.result)}{f', with {values}' if values else ''}"
            )
        last = min(children[::-1], key=lambda each: each.result is not visit.result)
        same = [child for child in children if child.result is last.result]
        verb = "raised an exception" if last.result is None else f"returned {name_of(last.result)}"
        who = f"its child {self._names([last])}"
        if len({child.uid for child in same}) > 1 and last.result is visit.result:
            who = f"its children {self._names(same)}"
        return f"{who} {verb}{f', with {values}' if values else ''}"

    def _explain_condition(self, index: int, visit: Visit) -> Cause:
        """Explain a result that a pre-condition determined."""
        if visit.result is None:
            return self._new(index, visit.uid, f"in its conditions, {self._describe_error(index)}")
        conditions = self._nodes[visit.uid - 1].config.conditions
        names: tuple[str, ...] = {FAILURE: ("_failureIf",), SUCCESS: ("_successIf",)}.get(
            visit.result, ("_while",) if visit.before is RUNNING else ("_skipIf", "_while")
        )
        given = [name for name in names if name in conditions]
        reads = [read for read in visit.reads if read.by in given]
        texts = " and ".join(f'{name}="{_one_line(conditions[name])}"' for name in given)
        truth = "is false" if given == ["_while"] else "is true" if len(given) == 1 else "decide"
        values = _describe_reads(reads)
        because = f"its condition {texts} {truth}{f': {values}' if values else ''}"
        cause = self._new(index, visit.uid, because)
        self._add_reads(cause, reads, is_input=True)
        return cause

    def _explain_external(self, index: int, visit: Visit) -> Cause:
        """Explain the result of an external node: an input."""
        step = self._steps[index]
        node = self._nodes[visit.uid - 1]
        key = self.path(visit.uid)
        error = next(
            (each.error for each in step.inputs if isinstance(each, Raised) and each.uid == visit.uid), None
        )
        if visit.result is None and error is not None:
            because = f"raised {error.type}: {_one_line(error.text)}"
        else:
            because = f"returned {name_of(visit.result)}"
        values = ", ".join(filter(None, (_describe_literals(node), _describe_reads(visit.reads))))
        others = {SUCCESS: (FAILURE,), RUNNING: (SUCCESS, FAILURE)}.get(visit.result or IDLE, (SUCCESS,))
        changes = [SetResult(step.tick, key, status) for status in others] if step.tick else []
        cause = self._new(index, visit.uid, because, changes)
        cause.details = f"{f', with {values}' if values else ''}{self._messages(index, visit.uid)}"
        self._add_reads(cause, visit.reads, is_input=False)
        return cause

    def _messages(self, index: int, uid: int) -> str:
        """Return what the last tick of an external node in a step logged, for a sentence."""
        found: list[str] = []
        since: list[str] = []
        for event in self._steps[index].inputs:
            if isinstance(event, MessageLogged):
                since.append(event.text)
            elif isinstance(event, (Result, Raised)):
                found = since if event.uid == uid else found
                since = []
        return "".join(f'; it logged "{_one_line(text)}"' for text in found[-2:])

    def explain_halt(self, index: int, halt: Halt) -> Cause:
        """Explain why a node was halted."""
        uid = halt.uid
        if halt.by is None:
            return self._new(index, uid, "the whole tree was halted from outside, between two ticks")
        by = halt.by
        if by.uid == uid:
            return self._explain_condition(index, by)
        cause = self._new(index, uid, f"'{self.path(by.uid)}' halted it")
        if is_external(type(self._nodes[by.uid - 1])):
            own = self._new(index, by.uid, "its own code halted the child")
            cause.causes.append(own)
        # What was ticked before the halt decided: the parent halts children after the result of another one.
        decided = by if by.result is not RUNNING or not by.children else by.children[-1]
        cause.causes.append(self.explain_result(index, decided))
        return cause

    def explain_no_tick(self, index: int, uid: int) -> Cause:
        """Explain why a node was not ticked."""
        child = uid
        while (parent := self._parents.get(child)) is not None:
            visits = self.trace(index).visits_of(parent)
            if visits:
                return self._explain_not_reached(index, uid, child, visits[-1])
            child = parent
        return self._new(index, uid, "the tree was not ticked")

    def _explain_not_reached(self, index: int, uid: int, child: int, visit: Visit) -> Cause:
        """Explain why *visit* of the parent of *child*, in which the node is, did not tick *child*."""
        above = self.path(visit.uid)
        if visit.decided_by == "condition" and self._nodes[visit.uid - 1].config.conditions:
            cause = self._new(index, uid, f"'{above}' above it was not started")
            cause.causes.append(self._explain_condition(index, visit))
            return cause
        before = visit.children
        earlier = self._explain_earlier_end(index, uid, child, visit)
        if earlier is not None:
            return earlier
        if not before:
            cause = self._new(index, uid, f"'{above}' returned {name_of(visit.result)} without ticking it")
            cause.causes.append(self.explain_result(index, visit))
            return cause
        last = self.path(before[-1].uid)
        because = f"'{above}' ended at '{last}', which returned {name_of(before[-1].result)}"
        if before[-1].result is RUNNING:
            because = f"'{above}' waits for '{last}', which is RUNNING"
        cause = self._new(index, uid, because)
        for each in reversed(before):
            if not self._is_full:
                cause.causes.append(self.explain_result(index, each))
        return cause

    def _explain_earlier_end(self, index: int, uid: int, child: int, visit: Visit) -> Cause | None:
        """Explain that *child*, in which the node is, had ended in an earlier tick; None if it had not."""
        if not visit.children or visit.children[0].uid <= child:
            return None
        found = self._find_end(child, index)
        if found is None:
            return None
        at, end = found
        above, ended = self.path(visit.uid), self.path(child)
        because = (
            f"'{above}' goes on after '{ended}', which returned {name_of(end.result)} in tick {self.tick(at)}"
        )
        cause = self._new(index, uid, because)
        cause.causes.append(self.explain_result(at, end))
        return cause

    # --- entries

    def _add_reads(self, cause: Cause, reads: Sequence[Read], is_input: bool) -> None:
        for read in reads:
            if not self._is_full:
                others = [other.value for other in reads if other.script and other.script == read.script]
                cause.causes.append(self.explain_value(cause.step, read, is_input, others))

    def explain_value(self, index: int, read: Read, is_input: bool, others: Sequence[object] = ()) -> Cause:
        """Explain the value of an entry.

        Args:
            index: The step in which it is read.
            is_input: Whether the engine read it, so that another value can be tried.
            others: The values that the same script has read.
        """
        if read.entry is None or not read.sequence_id:
            return self._new(index, 0, f"had not written {read.key}, nor had any node")
        tick = self._steps[index].tick
        trace = self.trace(index)
        write = trace.last_write(read.entry, read.sequence_id)
        at: int | None = index
        if write is None:
            at = self._replay.find_write(*read.entry, index)
            if at is not None:
                write = self.trace(at).last_write(read.entry, read.sequence_id)
        if at is None or write is None:
            because = f"had written {read.key} = {short_text(read.value)} when the recording began"
            cause = self._new(index, 0, because)
            cause.details = self._describe_other_entries(index, -1, read.entry)
            if is_input and tick:
                cause.changes = self._other_values(tick, read, None, others)
            return cause
        cause = self._new(at, write.uid, self._describe_write(index, at, read, write))
        if at != index:
            cause.details = self._describe_other_entries(index, at, read.entry)
        visit = next((each for each in reversed(self.trace(at).visits) if each.uid == write.uid), None)
        is_outside = not write.uid or is_external(type(self._nodes[write.uid - 1]))
        if is_outside and is_input and tick:
            cause.changes = self._other_values(tick, read, self._value_before(at, read.entry, write), others)
        if visit is not None and not self._is_full:
            self._add_reads(cause, visit.reads, is_input and not is_outside)
            if visit.parent is not None and not is_outside:  # why it was ticked
                count = next(i for i, each in enumerate(visit.parent.children) if each is visit)
                self._add_children(cause, visit.parent.children[:count], None, is_context=True)
        return cause

    def _describe_write(self, index: int, at: int, read: Read, write: Write) -> str:
        key = write.entry.key
        what = f"{key} = {short_text(read.value)}"
        if key != read.key.removeprefix("@"):
            what += f", which is {read.key} here"
        script = self._writing_script(write.uid, {read.key, write.entry.key}) if write.uid else ""
        if at == index:
            return f"wrote {what}{script} {'in' if write.uid else 'before'} this tick"
        ticks = self.tick(index) - self.tick(at)
        seconds = self.time(index) - self.time(at)
        return f"wrote {what}{script}, {counted(ticks, 'tick')} ({seconds:g} s) before it was read"

    def _describe_other_entries(self, index: int, at: int, entry: EntryName) -> str:
        """Return which entries of the same key were written later in other trees, for a sentence."""
        others = [name for name in self.trace(index).entries if name.key == entry.key and name != entry]
        later = []
        for name in others[:3]:
            written = self._replay.find_write(*name, index + 1)
            if written is not None and written > at:
                later.append(f"'{self.path_of(name)}' in tick {self.tick(written)}")
        return f"; another entry was written later: {join_names(later, 'and')}" if later else ""

    def path_of(self, entry: EntryName) -> str:
        """Return the key of an entry, in a subtree after the path of the subtree."""
        board = self._replay.boards[entry.scope]
        subtrees = self._replay.tree.subtrees
        path = next((each.path for each in subtrees if each.blackboard is board), "")
        return f"{path}/{entry.key}" if path else entry.key

    def _writing_script(self, uid: int, keys: set[str]) -> str:
        """Return the script of a node that writes one of *keys*, for a sentence; "" if none does."""
        node = self._nodes[uid - 1]
        for by, text in scripts_of(node):
            uses = find_name_uses(text, node.config.enums)
            if any(use.access in WRITING and use.name.lstrip("@") in keys for use in uses):
                return f' by {by}="{_one_line(text)}"'
        return ""

    def _value_before(self, at: int, entry: EntryName, write: Write) -> object:
        """Return the value that an entry had before a write in step *at*; None if it is not known."""
        earlier = [each for each in self.trace(at).writes if each.entry == entry]
        count = next(i for i, each in enumerate(earlier) if each is write)
        if count:
            return earlier[count - 1].value
        self.seek(at)
        held = self._replay.boards[entry.scope].local_entries().get(entry.key)
        return None if held is None else held.value

    def _other_values(self, tick: int, read: Read, before: object, others: Sequence[object]) -> list[Change]:
        """Return changes that give an entry another value: the value *before*, and values near a limit."""
        assert read.entry is not None
        value = read.value
        if isinstance(value, NotReplayable):
            return []
        found: list[object] = [] if before is None else [before]
        literals = list(_literals(read.script))
        if isinstance(value, Enum):
            found += list(type(value))
        elif isinstance(value, bool):
            found.append(not value)
        elif isinstance(value, (int, float)):
            numbers = [0, *(each for each in (*literals, *others) if isinstance(each, (int, float)))]
            numbers.append(sum(map(abs, numbers)))
            near = [number + step for number in numbers for step in (0, 1, -1)]
            fitting: list[int | float] = [int(each) for each in near if each % 1 == 0]
            if isinstance(value, float):
                fitting = list(map(float, near))
            present = float(value)
            nearest = sorted(fitting, key=lambda each: abs(each - present))
            found += nearest
        elif isinstance(value, str):
            found += [*literals, "", "0", "1"]
        elif value is None:
            found += [*literals, 0, 1, True]
        else:
            found += [[], 0]
        tried: list[object] = []
        for each in found:
            fits = type(each) is type(value) or value is None or isinstance(value, (str, Enum))
            if fits and each != value and each not in tried:
                tried.append(each)
        return [HoldEntry(tick, *read.entry, each) for each in tried[:_VALUES_TRIED]]


def _describe_literals(node: TreeNode) -> str:
    """Return the ports of *node* that are literals in the document, for a sentence."""
    ports = [port for port in node.config.inputs.values() if port.key is None and port.is_explicit]
    return ", ".join(f'{port.name}="{_one_line(port.text)}"' for port in ports[:6])


def _describe_reads(reads: Sequence[Read]) -> str:
    values = dict.fromkeys(
        f"{read.key} = {short_text(read.value)}" if read.entry is not None else f"no entry {read.key}"
        for read in reads
    )
    return ", ".join(islice(values, 6))


def _literals(script: str) -> Iterator[object]:
    """Yield the literals of a script."""
    try:
        statements = parse_statements(script, {}) if script else ()
    except ScriptError:
        return
    for statement in statements:
        for part in iter_subexpressions(statement):
            if isinstance(part, ScriptLiteral):
                yield part.value


def short_text(value: object) -> str:
    """Return *value* as a text of at most 60 characters."""
    return value_text(value, _MAX_VALUE)


def name_of(status: Status | None) -> str:
    """Return the name of a result for a sentence; None = the node raised."""
    return "nothing" if status is None else status.name


def _one_line(text: str) -> str:
    return " ".join(text.split())[:100]
