"""Runs a recording again: the engine ticks the recorded tree, whose external nodes do what was recorded."""

import os
from collections.abc import Callable, Iterable, Iterator
from itertools import zip_longest
from pathlib import Path
from typing import Final, NamedTuple

from btcore.clock import NS_PER_S
from btcore.engine.node import TreeNode
from btcore.engine.observers import Observer
from btcore.engine.recorded_events import StatusForced
from btcore.engine.transition_records import Transitions
from btcore.errors import BtcoreError, NodeExecutionError, TickInterrupt
from btcore.logs.files import LogError
from btcore.status import FAILURE, IDLE, SUCCESS, Status
from btcore.tree.tree import Tree
from btcore_recorder.files import read_recording
from btcore_recorder.inputs import UNKNOWN_CHECKSUM, RunRecording, Segment, Step, TreeState
from btcore_recorder.recorded_tree import RecordedTree
from btcore_recorder.tree_state import capture, describe_difference
from btcore_recorder.values import Encoder

STATE_INTERVAL: Final = 250
"""The number of steps between two saved states, from which `Replay.seek` runs to any step between them."""


class Difference(NamedTuple):
    """The first difference between a recording and its replay.

    Attributes:
        step: The index of the step.
        tick: The number of the tick; 0 = a halt.
        recorded: What was recorded.
        now: What happens in the replay.
        node: The path of the node at which they differ; "" = not known.
        place: The place of this node in the XML, `file:line`; "" = not known.
        code: The place of its code, if it is an external node, `file:line`; "" = not known.
        transition: The number of the transition in the step, from 1; 0 = not known.
    """

    step: int
    tick: int
    recorded: str
    now: str
    node: str = ""
    place: str = ""
    code: str = ""
    transition: int = 0

    def __str__(self) -> str:
        moment = f"tick {self.tick}" if self.tick else f"the halt after step {self.step}"
        moment += f", transition {self.transition}" if self.transition else ""
        places = ", ".join(filter(None, (self.place, self.code)))
        return f"{moment}: recorded: {self.recorded}; now: {self.now}{f' ({places})' if places else ''}"


class _Checksum(Observer):
    def __init__(self) -> None:
        self.value = 0
        self.changes: list[tuple[int, Status]] | None = None

    def transitions(self, changes: Transitions) -> None:
        self.value = changes.checksum(self.value)
        if self.changes is not None:
            self.changes += ((change.uid, change.status) for change in changes)


class _Ends(Observer):
    """Counts how often a node succeeds or fails."""

    def __init__(self, uid: int) -> None:
        self.count = 0
        self._uid = uid

    def transitions(self, changes: Transitions) -> None:
        for change in changes:
            self.count += change.uid == self._uid and change.status in (SUCCESS, FAILURE)


class Replay(RecordedTree):
    """A recording that is run again, step by step.

    The leaves return, write and raise what was recorded; the engine computes everything else. Neither a robot
    nor the libraries of the leaves are needed.

    Args:
        recording: A recording, or the path of its file.

    Attributes:
        recording: The recording.
        steps: The recorded steps: the ticks of the root, and the halts of the whole tree.
        position: The number of steps that have been run.
        tree: The tree, after these steps.
        difference: The first difference between the recording and the replay, or None.

    Raises:
        LogError: The file cannot be read, or the recording is invalid.
        TreeError: The recorded tree cannot be loaded.

    Examples:
        >>> import btcore
        >>> from btcore_recorder import Replay, record
        >>> b = btcore.Builder()
        >>> tree = b.build(b.Inverter(b.AlwaysSuccess(name="door")))
        >>> with record(tree, "run.btrec.txt"):
        ...     _ = tree.tick_once()
        >>> replay = Replay("run.btrec.txt")
        >>> replay.step(), replay.tree.status
        (True, <Status.FAILURE: 3>)
    """

    def __init__(self, recording: RunRecording | str | os.PathLike[str]) -> None:
        if not isinstance(recording, RunRecording):
            recording = read_recording(Path(recording))
        head, steps = recording.head, recording.steps
        super().__init__(head)
        self.recording = recording
        self.steps = steps
        self.difference: Difference | None = None
        self.position = 0
        _check_numbers(recording, len(self.tree.nodes), len(self.boards))
        self._checksum = _Checksum()
        self.tree.subscribe(self._checksum)
        self.restore(head.state)
        self._encoder = Encoder(lambda name, description: None)  # the types are those of the recording
        self._segments = {segment.position: segment for segment in recording.segments}
        # The states from which `seek` starts, with the checksums. A recording of BehaviorTree.CPP has no
        # states of nodes.
        self._states = {0: (self._capture(), 0)} | {
            position: (segment.state, 0) for position, segment in self._segments.items() if not segment.gap
        }
        self.add_callbacks({event.uid for event in forced_statuses(steps)})

    def _capture(self) -> TreeState:
        return capture(self.tree, self.boards, self._encoder.encode)

    def step(self) -> bool:
        """Run the next step. Return False if there is none, or if it differs from the recording."""
        if self.difference is not None or self.position == len(self.steps):
            return False
        if self.position in self._segments:
            self._begin_segment(self._segments[self.position])
            if self.difference is not None:
                return False
        elif self.position % STATE_INTERVAL == 0 and self.position not in self._states:
            self._states[self.position] = self._capture(), self._checksum.value
        step = self.steps[self.position]
        self.position += 1
        self._checksum.changes = None if step.transitions is None else []
        status = IDLE
        error: NodeExecutionError | None = None
        try:
            status = self.run_step(step)
        except NodeExecutionError as raised:
            error = raised
        except TickInterrupt:
            pass
        if self._mismatch is not None:
            self.difference = self._describe(step.tick, *self._mismatch, self._external)
        else:
            left = self._inputs
            end = (self._words(left[0]), "the step ends") if left else self._compare(step, status, error)
            if end is not None:
                self.difference = self._find_transition(step) or self._describe(step.tick, *end, None)
        return self.difference is None

    def _compare(
        self, step: Step, status: Status, error: NodeExecutionError | None
    ) -> tuple[str, str] | None:
        """Return the difference between the recorded and the present end of *step*, or None."""
        if status is not step.status:
            raised = "" if error is None else f": {error.cause}"
            return f"the result is {step.status.name}", f"the result is {status.name}{raised}"
        if step.checksum not in (self._checksum.value, UNKNOWN_CHECKSUM):
            return "other transitions", "transitions with another checksum"
        return None

    def _describe(
        self, tick: int, recorded: str, now: str, node: TreeNode | None, transition: int = 0
    ) -> Difference:
        """Return the difference at *node*, with its places."""
        if node is None:
            return Difference(self.position, tick, recorded, now)
        code = self.recording.head.facts.code.get(node.config.id)
        places = node.path, node.config.where, "" if code is None else code.place
        return Difference(self.position, tick, recorded, now, *places, transition)

    def _find_transition(self, step: Step) -> Difference | None:
        """Return the difference at the first transition that differs, if the transitions are recorded."""
        pairs = zip_longest(step.transitions or (), self._checksum.changes or ())
        for number, pair in enumerate(pairs, start=1):
            if pair[0] != pair[1]:
                nodes = [None if change is None else self.tree.nodes[change[0] - 1] for change in pair]
                recorded, now = [
                    "no further transition"
                    if change is None or node is None
                    else f"'{node.path}' becomes {change[1].name}"
                    for change, node in zip(pair, nodes, strict=True)
                ]
                return self._describe(step.tick, recorded, now, nodes[0] or nodes[1], number)
        return None

    def _begin_segment(self, segment: Segment) -> None:
        self._checksum.value = 0
        if segment.gap:
            self.restore(segment.state)
            return
        state = self._capture()
        if state != segment.state:
            recorded, now, uid = describe_difference(segment.state, state)
            node = self.tree.nodes[uid - 1] if uid else None
            self.difference = self._describe(segment.state.ticks, recorded, now, node)

    def seek(
        self,
        position: int | None = None,
        *,
        tick: int | None = None,
        time: float | None = None,
        until: Callable[[Tree], object] | None = None,
    ) -> bool:
        """Run the tree, forward or backward, to another moment of the recording.

        Args:
            position: Go to the end of this number of steps.
            tick: Go to the end of the tick with this number.
            time: Go to the end of the last tick that began at this time or before (s since the start).
            until: Run until the first step after which *until* of the tree is true.

        Returns:
            Whether the moment was reached: there is such a moment, and no difference since the last saved
            state before it, such as that with which each minute of a recording begins.
        """
        if until is not None:
            while self.step():
                if until(self.tree):
                    return True
            return False
        if position is None:
            position = self._find_tick(tick) if tick is not None else self._find_time(time or 0.0)
        if not 0 <= position <= len(self.steps):
            return False
        start = max(known for known in self._states if known <= position)
        if position < self.position or self.position < start:
            self._go_back(start, *self._states[start])
        while self.position < position and self.step():
            pass
        return self.position == position and self.difference is None

    def cut(self, begin: int, end: int) -> RunRecording:
        """Return a part of the recording, which begins with a saved state.

        Args:
            begin: The index of the first step.
            end: The index of the step after the last one.

        Raises:
            BtcoreError: The replay differs from the recording before *end*.
        """
        if not self.seek(begin):
            raise BtcoreError(f"the replay differs from the recording: {self.difference}")
        state = self._capture()
        if begin in self._segments and self._segments[begin].gap:
            state = self._segments[begin].state
        head = self.recording.head
        time = self.recording.time_at(begin)
        head = head._replace(state=state, time=head.time + time, wall_time=head.wall_time + time)
        segments = {each.position: each for each in self.recording.segments if begin < each.position < end}
        steps = []
        checksum = _Checksum()
        unsubscribe = self.tree.subscribe(checksum)
        for position in range(begin, end):
            if position in segments:
                checksum.value = 0
            if not self.step():
                break
            steps.append(self.steps[position]._replace(checksum=checksum.value))
        unsubscribe()
        if self.difference is not None:
            raise BtcoreError(f"the replay differs from the recording: {self.difference}")
        moved = tuple(each._replace(position=each.position - begin) for each in segments.values())
        return RunRecording(head, tuple(steps), moved)

    def find_write(self, scope: int, key: str, position: int) -> int | None:
        """Return the last of the first *position* steps that wrote an entry; None if none did.

        Args:
            scope: The index of the scope that holds the entry.
            key: The key of the entry there.
            position: The number of steps.

        Returns:
            The index of the step.
        """

        def count() -> int:
            entry = self.boards[scope].local_entries().get(key)
            return -1 if entry is None else entry.sequence_id

        return self._find_change(count, position)

    def find_end(self, uid: int, position: int) -> int | None:
        """Return the last of the first *position* steps in which a node succeeded or failed; None if none is.

        Args:
            uid: The UID of the node.
            position: The number of steps.

        Returns:
            The index of the step.
        """
        ends = _Ends(uid)
        unsubscribe = self.tree.subscribe(ends)
        try:
            return self._find_change(lambda: ends.count, position)
        finally:
            unsubscribe()

    def _find_change(self, count: Callable[[], int], position: int) -> int | None:
        """Return the last of the first *position* steps that changed *count*, or None."""
        end = position
        while end > 0:
            begin = (end - 1) // STATE_INTERVAL * STATE_INTERVAL
            self.seek(begin)
            found = None
            before = count()
            while self.position < end and self.step():
                if count() != before:
                    found, before = self.position - 1, count()
            if found is not None:
                return found
            end = begin
        return None

    def _find_tick(self, tick: int) -> int:
        return next((index for index, step in enumerate(self.steps, 1) if step.tick == tick), -1)

    def _find_time(self, seconds: float) -> int:
        time = self.recording.head.time + round(seconds * NS_PER_S)
        return next((index for index, step in enumerate(self.steps) if step.time > time), len(self.steps))

    def _go_back(self, position: int, state: TreeState, checksum: int) -> None:
        """Go to a state that was saved after *position* steps."""
        self.position = position
        self.difference = self._mismatch = None
        self.restore(state)
        self.tree.status = self.steps[position - 1].status if position else self.tree.root.status
        self._checksum.value = checksum

    def verify(self) -> Difference | None:
        """Run all steps, and return the first difference, or None."""
        while self.step():
            pass
        return self.difference


def forced_statuses(steps: Iterable[Step]) -> Iterator[StatusForced]:
    """Yield the statuses that callbacks forced in *steps*."""
    return (event for step in steps for event in step.inputs if isinstance(event, StatusForced))


def _check_numbers(recording: RunRecording, node_count: int, board_count: int) -> None:
    """Raise LogError if the recording names a node or a scope that the tree does not have."""
    for state in (recording.head.state, *(segment.state for segment in recording.segments)):
        if len(state.scopes) != board_count:
            raise LogError(f"the recording has {len(state.scopes)} scopes, but its tree has {board_count}")
        for node in state.nodes:
            if not 1 <= node.uid <= node_count:
                raise LogError(f"the recording has the state of a node {node.uid}, which does not exist")
    for step in recording.steps:
        uids = [max(step.woken_by or 1, 1), *(uid for uid, _ in step.transitions or ())]
        if not all(1 <= uid <= node_count for uid in uids):
            raise LogError(f"the recording of tick {step.tick} names a node or scope that does not exist")
        for event in (*step.before, *step.inputs):
            uid, scope = getattr(event, "uid", 1), getattr(event, "scope", 0)
            if not (1 <= uid <= node_count and 0 <= scope < board_count):
                raise LogError(f"the recording of tick {step.tick} names a node or scope that does not exist")
