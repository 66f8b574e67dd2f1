"""What if: the run that a page shows is run again with the edited tree, or with other inputs.

A package offers a function under the entry point group `btcore.what_if`, which is called as `RunChanged`
describes. The entry point needs no import of this module.
"""

from collections.abc import Callable, Sequence
from typing import Annotated, Final, Literal, Protocol

import msgspec
from msgspec import Meta

from btcore.errors import BtcoreError, TreeError
from btcore_studio.language.project import Project
from btcore_studio.language.shown_runs import ShownRun, ShownRuns, load_first
from btcore_studio.language.studio_protocol import Data, DocumentIdentifier
from btcore_studio.language.timeline import RecordedRun, Timeline
from btcore_studio.language.tree_reading import read_xml

_GROUP: Final = "btcore.what_if"
_Tick = Annotated[int, Meta(ge=1)]


class ChangedRecording(Protocol):
    """A run with changes."""

    @property
    def report(self) -> Sequence[str]:
        """What it did, as sentences."""

    @property
    def position(self) -> int:
        """The number of steps up to the first difference, or up to the end."""

    @property
    def text(self) -> str:
        """Its recording, `.btrec.txt`."""


class RunChanged(Protocol):
    """Runs a recording again with changes."""

    def __call__(
        self,
        timeline: Timeline,
        document: tuple[str, str] | None,
        entries: Sequence[tuple[int, str, str]],
        results: Sequence[tuple[int, int, str]],
    ) -> ChangedRecording:
        """Run a recording again.

        Args:
            timeline: The recording, from an entry point of `btcore.recordings` or `btcore.runs`.
            document: The file name and the text of another tree; None for the recorded tree.
            entries: Entries of the main tree to write: the tick, the key and the value.
            results: Other results of leaves: the tick, the number of the node, and a letter of outcomes.

        Raises:
            BtcoreError: The recording cannot be changed in this way.
        """
        ...


class NewValue(Data, frozen=True):
    """An entry of the main tree has another *value* from the beginning of a tick."""

    tick: _Tick
    key: Annotated[str, Meta(max_length=1_000)]
    value: Annotated[str, Meta(max_length=10_000)]


class NewResult(Data, frozen=True):
    """The leaf with a *key* has another *result* in a tick."""

    tick: _Tick
    key: str
    result: Literal["S", "F", "R", "K"]


class WhatIfParams(Data, frozen=True):
    """The changes of the run with a number; 0 is the recording that the studio shows.

    Attributes:
        text_document: The document with the tree to run; None for the tree of the run.
    """

    run: int
    text_document: DocumentIdentifier | None = None
    entries: Annotated[tuple[NewValue, ...], Meta(max_length=100)] = ()
    results: Annotated[tuple[NewResult, ...], Meta(max_length=100)] = ()


def run_what_if(
    project: Project, shown: ShownRuns, find: Callable[[int], RecordedRun], params: WhatIfParams
) -> ShownRun:
    """Run a run of the page again with changes, and show the result.

    Args:
        find: Returns the run with a number. Raises BtcoreError if there is none.

    Raises:
        BtcoreError: The run cannot be changed in this way.
    """
    recorded = find(params.run)
    document: tuple[str, str] | None = None
    if params.text_document is not None:
        source = read_xml(project, params.text_document.uri).source
        document = str(source.path or source.uri), source.text
    results: list[tuple[int, int, str]] = []
    for tick, key, result in map(msgspec.structs.astuple, params.results):
        if key not in recorded.uids:
            raise BtcoreError("the tree that was run does not have this node")
        results.append((tick, recorded.uids[key], result))
    run_changed: RunChanged = load_first(_GROUP, "runs cannot be changed")
    entries = [(entry.tick, entry.key, entry.value) for entry in params.entries]
    try:
        changed = run_changed(recorded.timeline, document, entries, results)
    except TreeError as error:
        raise BtcoreError(f"the tree cannot be run: {error.diagnostics[0].message}") from None
    return shown.show(changed.text, changed.position, changed.report)
