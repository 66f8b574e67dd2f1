"""Verification of a recording: whether the engine does again what was recorded."""

from pathlib import Path
from typing import Literal, NamedTuple

import btcore
from btcore.clock import NS_PER_S
from btcore.engine.observers import Observer
from btcore.engine.transition_records import Transitions
from btcore.suggestions import counted
from btcore_recorder.facts import hash_documents, hash_file
from btcore_recorder.replay import Difference, Replay

ProbableCause = Literal[
    "the tree changed",
    "steps are missing",
    "a value is not replayable",
    "a rule of the engine changed",
    "the code of a leaf changed",
    "something was not recorded",
]
"""Why a replay differs from its recording, probably."""


class Verification(NamedTuple):
    """The result of `verify`.

    Attributes:
        ticks: The number of ticks that were run again.
        transitions: The number of their transitions.
        damage: Where the file is truncated or damaged, as a sentence; "" if it is complete.
        difference: The first difference, or None.
        time: The time at which its tick began (s since the recording began).
        cause: Its probable cause.
    """

    ticks: int
    transitions: int
    damage: str
    difference: Difference | None
    time: float
    cause: ProbableCause | None

    @property
    def is_same(self) -> bool:
        """Whether everything that could be read was repeated."""
        return self.difference is None

    @property
    def short_text(self) -> str:
        """The result in a line."""
        return str(self).partition("\n")[0]

    def as_data(self) -> dict[str, object]:
        """Return the result as data of JSON."""
        data: dict[str, object] = {
            "ticks": self.ticks,
            "transitions": self.transitions,
            "equal": self.is_same,
        }
        if self.damage:
            data["damage"] = self.damage
        if self.difference is not None:
            data |= {
                "tick": self.difference.tick,
                "time_s": self.time,
                "node": self.difference.node or None,
                "place": self.difference.place or None,
                "code": self.difference.code or None,
                "transition": self.difference.transition or None,
                "recorded": self.difference.recorded,
                "now": self.difference.now,
                "cause": self.cause,
            }
        return data

    def __str__(self) -> str:
        count = f"{counted(self.ticks, 'tick')} with {counted(self.transitions, 'transition')}"
        damage = f"\nthe file is incomplete: {self.damage}" if self.damage else ""
        if self.difference is None:
            return f"equal: {count}{damage}"
        return (
            f"equal: {count}; then, at {self.time:.3f} s, {self.difference}\n"
            f"probable cause: {self.cause}{damage}"
        )


class _Counter(Observer):
    def __init__(self) -> None:
        self.count = 0

    def transitions(self, changes: Transitions) -> None:
        self.count += len(changes)


def verify(path: Path) -> Verification:
    """Run a recording again, and compare each tick with what was recorded.

    Raises:
        LogError: The file cannot be read, or the recording is invalid.
        TreeError: The recorded tree cannot be loaded.
    """
    replay = Replay(path)
    counter = _Counter()
    replay.tree.subscribe(counter)
    ticks = transitions = 0
    while replay.step():
        ticks += bool(replay.steps[replay.position - 1].tick)
        replay.tree.flush_observers()
        transitions = counter.count
    recording, difference = replay.recording, replay.difference
    time, cause = 0.0, None
    if difference is not None:
        time = recording.time_at(difference.step - 1) / NS_PER_S
        cause = _find_cause(replay, difference)
    return Verification(ticks, transitions, recording.damage, difference, time, cause)


def _find_cause(replay: Replay, difference: Difference) -> ProbableCause:
    """Return the first cause in the order of `ProbableCause` that the recording shows.

    The tree of a recording may have been edited in its text form. The code of a leaf has changed if its file
    is on this machine and has another hash; it is only read.
    """
    head = replay.recording.head
    facts, segments = head.facts, replay.recording.segments
    if facts.tree not in ("", hash_documents(head.documents)):
        return "the tree changed"
    if any(segment.gap and segment.position < difference.step for segment in segments):
        return "steps are missing"
    if replay.has_unreplayable_values:
        return "a value is not replayable"
    if head.versions.get("btcore") != btcore.__version__:
        return "a rule of the engine changed"
    codes = [code for code in facts.code.values() if code.place == difference.code]
    if any(hash_file(code.place.rpartition(":")[0]) not in ("", code.hash) for code in codes):
        return "the code of a leaf changed"
    return "something was not recorded"
