"""Excerpts of a recording: the ticks of a period, or a few ticks and inputs that still make it fail."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Final, NamedTuple, TypeVar

from btcore.clock import NS_PER_S
from btcore.errors import BtcoreError, NodeExecutionError
from btcore.logs.files import LogError
from btcore.status import FAILURE, SUCCESS, Status
from btcore_recorder.failures import Failure, FailureObserver
from btcore_recorder.inputs import Input, RunRecording, Step
from btcore_recorder.replay import Replay

MAX_STEPS_TO_SHRINK: Final = 200_000
"""Maximum number of steps that `shrink` runs, so that it ends, on every machine with the same result."""
ITEMS_PER_STEP: Final = 100
"""The number of list items, or repetitions in a step, that count as a step, because they take as long."""

T = TypeVar("T")


class _Rerun(Replay):
    """Runs steps whose results and checksums are not known, and collects the steps with both.

    Attributes:
        done: The steps that were run.
        cost: The number of these steps, in which many repetitions count as further steps.
        failures: Finds the first failure.
    """

    def __init__(self, recording: RunRecording) -> None:
        super().__init__(recording._replace(segments=()))
        self.done: list[Step] = []
        self.cost = 0
        self.failures = FailureObserver(self.tree)
        self.tree.subscribe(self.failures)

    def run(self, steps: Sequence[Step]) -> Failure | None:
        """Run *steps* from the start up to the first failure, and return it."""
        self.steps = tuple(steps)
        self._states = {0: self._states[0]}
        self._go_back(0, *self._states[0])
        self.done.clear()
        self.cost = 0
        self.failures.reset()
        while self.failures.found is None and self.step():
            pass
        return self.failures.found

    def step(self) -> bool:
        """Run the next step."""
        has_run = super().step()
        self.cost += 1 + self._repetitions // ITEMS_PER_STEP
        return has_run

    def _compare(
        self, step: Step, status: Status, error: NodeExecutionError | None
    ) -> tuple[str, str] | None:
        self.done.append(step._replace(status=status, checksum=self._checksum.value))
        return None


def cut(recording: RunRecording, from_s: float | None = None, to_s: float | None = None) -> RunRecording:
    """Return the part of a recording between two times (s since its start), with the state before it.

    Raises:
        LogError: There are no ticks between these times, or steps are missing there.
        BtcoreError: The replay differs from the recording.
    """
    head, steps = recording.head, recording.steps
    ticks = [(at, (step.time - head.time) / NS_PER_S) for at, step in enumerate(steps) if step.tick]
    first, last = 0, len(steps)
    if from_s is not None:
        first = next((at for at, time in ticks if time >= from_s), last)
    if to_s is not None:
        last = next((at for at, time in ticks if time > to_s), last)
    if not any(first <= at < last for at, _ in ticks):
        known = (
            f"the ticks are at {ticks[0][1]:.3f} s to {ticks[-1][1]:.3f} s" if ticks else "there is no tick"
        )
        raise LogError(f"there are no ticks in this time range; {known}")
    gaps = [segment.position for segment in recording.segments if segment.gap]
    inner = next((steps[at].tick for at in gaps if first < at < last), None)
    if inner is not None:
        raise LogError(f"steps are missing before tick {inner}: choose a range on one side of this gap")
    return Replay(recording).cut(first, last)


class Shrunk(NamedTuple):
    """A recording that was shrunk.

    Attributes:
        recording: The shrunk recording.
        failure: Its failure.
        before: The number of steps and of inputs before.
        after: The number of steps and of inputs of the shrunk recording.
        is_complete: Whether all attempts were made before the limit was reached.
    """

    recording: RunRecording
    failure: Failure
    before: tuple[int, int]
    after: tuple[int, int]
    is_complete: bool

    def __str__(self) -> str:
        (steps, inputs), (steps_now, inputs_now) = self.before, self.after
        fewer_inputs = f", and from {inputs:,} to {inputs_now:,} inputs" if inputs else ""
        limit = "" if self.is_complete else "; further attempts would take too long"
        return f"shrunk from {steps:,} to {steps_now:,} ticks and halts{fewer_inputs}{limit}"


def shrink(recording: RunRecording) -> Shrunk:
    """Remove ticks and inputs from a recording as long as the same node makes the tree fail, or raises.

    The ticks after the first failure are removed, too. The result depends on the recording alone.

    Raises:
        BtcoreError: The run does not fail, or the replay differs from the recording.
    """
    return _Shrinking(recording).run()


class _Shrinking:
    def __init__(self, recording: RunRecording) -> None:
        self._recording = recording
        self._rerun = _Rerun(recording)
        self._left = max(MAX_STEPS_TO_SHRINK, 2 * len(recording.steps))
        # Facts that are no longer true without other steps are not known.
        unknown = [step._replace(woken_by=None, transitions=None) for step in recording.steps]
        failure = self._rerun.run(unknown)
        if self._rerun.difference is not None:
            raise LogError(f"the replay differs from the recording at {self._rerun.difference}")
        if failure is None:
            raise BtcoreError("the recorded run does not fail: only failures can be shrunk")
        self._failure: Failure = failure
        self._steps: list[Step] = list(self._rerun.done)

    def run(self) -> Shrunk:
        before = _size(self._recording.steps)
        size = None
        while size != (size := _size(self._steps)):
            self._remove(
                _rounds(self._steps), lambda rounds: self._fails([step for each in rounds for step in each])
            )
            self._remove(self._steps, self._fails)
            inputs = [(at, event) for at, step in enumerate(self._steps) for event in _inputs_of(step)]
            self._remove(inputs, partial(self._fails_with_inputs, tuple(self._steps)))
        recording = self._recording._replace(steps=tuple(self._steps), segments=(), damage="")
        return Shrunk(recording, self._failure, before, _size(self._steps), self._left > 0)

    def _remove(self, units: Sequence[T], fails: Callable[[Sequence[T]], bool]) -> None:
        """Remove units as long as *fails* returns True for the others: half of them, a quarter, … and one."""
        size = max(len(units) // 2, 1)
        while size and units:
            index, count = 0, len(units)
            while index < len(units) and self._left > 0:
                others = [*units[:index], *units[index + size :]]
                self._left -= len(others) // ITEMS_PER_STEP
                if fails(others):
                    units = others
                else:
                    index += size
            if size > 1 or len(units) == count:
                size //= 2

    def _fails_with_inputs(
        self, steps: Sequence[Step], kept: Sequence[tuple[int, tuple[bool, Input]]]
    ) -> bool:
        """Return whether *steps* still fail with these inputs only, each with the index of its step."""
        events: dict[int, list[tuple[bool, Input]]] = defaultdict(list)
        for at, event in kept:
            events[at].append(event)
        return self._fails(
            [
                step._replace(
                    before=tuple(event for is_before, event in events[at] if is_before),
                    inputs=tuple(event for is_before, event in events[at] if not is_before),
                )
                for at, step in enumerate(steps)
            ]
        )

    def _fails(self, steps: Sequence[Step]) -> bool:
        """Return whether the run still fails with *steps* only, and keep them if so."""
        if not steps:
            return False
        failure = self._rerun.run(steps)
        self._left -= self._rerun.cost
        if failure is None or self._rerun.difference is not None:
            return False
        if (failure.node, failure.error) != (self._failure.node, self._failure.error):
            return False
        done = list(self._rerun.done)
        # The recording of this run must fail in the same way: it may lack events of nodes without ticks.
        again = self._rerun.run(done)
        self._left -= self._rerun.cost
        if again != failure:
            return False
        self._failure, self._steps = failure, done
        return True


def _size(steps: Sequence[Step]) -> tuple[int, int]:
    return len(steps), sum(len(step.before) + len(step.inputs) for step in steps)


def _rounds(steps: Sequence[Step]) -> list[list[Step]]:
    """Divide *steps* after each result of the tree."""
    rounds: list[list[Step]] = [[]]
    for step in steps:
        rounds[-1].append(step)
        if step.status in (SUCCESS, FAILURE):
            rounds.append([])
    return rounds


def _inputs_of(step: Step) -> Iterator[tuple[bool, Input]]:
    """Yield the inputs of *step*, with whether they are before it."""
    yield from ((True, event) for event in step.before)
    yield from ((False, event) for event in step.inputs)
