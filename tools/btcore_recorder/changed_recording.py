"""What if, as another recording: the entry point of the group `btcore.what_if`, for the studio."""

from collections.abc import Sequence
from contextlib import suppress
from typing import Any, Final, NamedTuple

from btcore.errors import BtcoreError
from btcore.json_text import load_json
from btcore.registry.outcome_grammar import LETTERS
from btcore_recorder.moments import Moments
from btcore_recorder.run_text import record_run
from btcore_recorder.what_if import Change, ChangedRun, SetEntry, SetResult, run_changed

MAX_STEPS: Final = 5_000
"""Maximum number of steps of a recording that is run with changes."""


class ChangedRecording(NamedTuple):
    """A recorded run that was run again with changes.

    Attributes:
        report: What it did, as sentences; see `ChangedRun`.
        position: The number of steps up to the first difference, or up to the end.
        text: The recording of the changed run, `.btrec.txt`.
    """

    report: Sequence[str]
    position: int
    text: str


def run_with_changes(
    timeline: Moments,
    document: tuple[str, str] | None,
    entries: Sequence[tuple[int, str, str]],
    results: Sequence[tuple[int, int, str]],
) -> ChangedRecording:
    """Run a recording again with changes.

    Args:
        timeline: The recording.
        document: The file name and the text of another tree; None for the recorded tree.
        entries: Entries to write: the tick, the key, and the value as in `btcore replay --set`.
        results: Other results of leaves: the tick, the number of the node in the recording, and a letter.

    Raises:
        TreeError: The other tree cannot be loaded.
        BtcoreError: The recording cannot be changed in this way.
    """
    recording = timeline.recording
    if len(recording.steps) > MAX_STEPS:
        raise BtcoreError(
            f"only recordings with at most {MAX_STEPS:,} steps are run with changes here: use btcore replay"
        )
    paths = list(timeline.tree.nodes_by_path())
    changes: list[Change] = [
        SetResult(tick, paths[uid - 1], LETTERS[letter]) for tick, uid, letter in results
    ]
    changes += [SetEntry(tick, key, _decoded(value)) for tick, key, value in entries]
    found: list[ChangedRun] = []
    text = record_run(lambda attach: found.append(run_changed(recording, changes, document, attach=attach)))
    (run,) = found
    ticks = [step.tick for step in recording.steps]
    position = ticks.index(run.differs_from) + 1 if run.differs_from in ticks else len(ticks)
    return ChangedRecording(str(run).splitlines(), position, text)


def _decoded(value: str) -> Any:
    with suppress(ValueError):  # a text
        return load_json(value)
    return value
