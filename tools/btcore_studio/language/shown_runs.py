"""Recorded runs on the timeline of a page: counterexamples, runs with changes, and runs with real leaves."""

import itertools
from collections import OrderedDict
from collections.abc import Sequence
from typing import Any, Final

import msgspec

from btcore import entry_points
from btcore.errors import BtcoreError
from btcore_studio.language.studio_protocol import Data, RecordingParams
from btcore_studio.language.timeline import MAX_RECORDING, RecordedRun, Timeline, timeline_of_text

MAX_SHOWN: Final = 4
"""Maximum number of runs that a page may show again without a new request."""
NUMBERS: Final = itertools.count(1)
"""The numbers that identify runs of pages."""


class ShownMomentParams(Data, frozen=True):
    """The moment after *position* steps of the run with the number *run*."""

    position: int
    run: int = 0


class ShownRun(Data, frozen=True):
    """A run on the timeline, as a recording in the reply to `btcore/start`; *run* identifies it.

    Attributes:
        report: What a run with changes did, as sentences.
    """

    run: int
    keys: list[str]
    calls: list[dict[str, Any]]
    count: int
    start: int
    width: int
    colours: str
    warnings: list[str]
    report: tuple[str, ...] = ()


class ShownRuns:
    """The last runs that a page has shown.

    Attributes:
        recorded: The recording that the studio shows, which has the number 0; None if it shows none.
    """

    def __init__(self) -> None:
        self.recorded: RecordedRun | None = None
        self._runs: OrderedDict[int, RecordedRun] = OrderedDict()

    def show(self, text: str, start: int | None = None, report: Sequence[str] = ()) -> ShownRun:
        """Show a recording.

        Args:
            text: The recording, `.btrec.txt`.
            start: The number of steps before the moment to show first; None for the last moment.
            report: What the run did, as sentences.

        Raises:
            BtcoreError: The recording cannot be shown.
        """
        return self.add(timeline_of_text(text), start, report)

    def add(
        self, timeline: Timeline | None, start: int | None = None, report: Sequence[str] = ()
    ) -> ShownRun:
        """Show a recording that has been read by `open_timeline`; otherwise as `show`.

        Raises:
            BtcoreError: No installed package reads the recording.
        """
        if timeline is None:
            raise BtcoreError("runs cannot be shown: no installed package shows recordings")
        number, recorded = next(NUMBERS), RecordedRun(timeline)
        self._runs[number] = recorded
        while len(self._runs) > MAX_SHOWN:
            self._runs.popitem(last=False)
        summary = recorded.summary()
        if start is not None:
            summary["start"] = start
        return msgspec.convert({"run": number, "report": report, **summary}, ShownRun)

    def show_recording(self, params: RecordingParams) -> dict[str, Any]:
        """Show the recording with this text in place of the recording that the studio shows.

        Raises:
            BtcoreError: The recording is too large or cannot be shown.
        """
        if len(params.text) > MAX_RECORDING:
            raise BtcoreError(f"the recording is refused: it has more than {MAX_RECORDING:,} characters")
        self.recorded = RecordedRun(timeline_of_text(params.text))
        return self.recorded.summary()

    def find(self, number: int) -> RecordedRun | None:
        """Return the run with a number, or None."""
        if not number:
            return self.recorded
        if number in self._runs:
            self._runs.move_to_end(number)  # the run that is unused for the longest time is forgotten
        return self._runs.get(number)

    def moment(self, params: ShownMomentParams) -> dict[str, Any]:
        """Return a moment of a run.

        Raises:
            BtcoreError: The run is no longer shown.
        """
        recorded = self.find(params.run)
        if recorded is None:
            raise BtcoreError("this run is no longer shown: open it again")
        return recorded.moment(params.position)


def load_first(group: str, problem: str) -> Any:
    """Return the object of the first entry point of a group.

    Raises:
        BtcoreError: No entry point can be loaded; *problem* says what is not possible without one.
    """
    loaded, unavailable = entry_points.load(group)
    if not loaded:
        remedies = "; ".join(point.remedy for point in unavailable)
        raise BtcoreError(f"{problem}: {remedies or 'no installed package does it'}")
    return loaded[0].value
