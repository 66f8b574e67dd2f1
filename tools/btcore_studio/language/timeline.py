"""A recording in the studio, and the protocol by which another package runs it again.

A package offers a function under the entry point group `btcore.recordings`, named after the extension of the
files: it is called with the path of a file, and returns a `Timeline`. The entry point needs no import of this
module.
"""

import threading
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, Protocol

from btcore import entry_points
from btcore.clock import NS_PER_S
from btcore.errors import BtcoreError
from btcore.logs.moments import Explanation, Moment
from btcore.status import FAILURE, Status
from btcore.xml.plan.plan import Plans
from btcore_drawing.diagram import diagram_of_document
from btcore_studio.language.node_keys import diagram_nodes, keyed_nodes, node_keys, running_calls
from btcore_studio.language.studio_protocol import Why, WhyLink

_GROUP: Final = "btcore.recordings"
MAX_RECORDING: Final = 8 << 20
"""Maximum number of characters in a recording that a page sends."""
MAX_WAIT_S: Final = 0.4
"""Maximum time (s) for a reply while a part of a recording is run for the first time."""
_MAX_EXPLAINING_S: Final = 1.0
"""Time (s) after which no further changes are tried for an explanation."""
_MAX_COLOURS: Final = 600
"""Maximum number of colours in the track of a recording."""


class Timeline(Protocol):
    """A recording that is run again, used by one thread at a time."""

    @property
    def plans(self) -> Plans:
        """The plans of the recorded tree."""

    @property
    def count(self) -> int:
        """The number of steps, which are ticks of the root and halts of the tree."""

    @property
    def roots(self) -> Sequence[Status]:
        """The result of each step; IDLE for a halt."""

    @property
    def warnings(self) -> Sequence[str]:
        """What the recording lacks, as sentences."""

    def at(self, position: int, limit: float) -> Moment:
        """Return the moment after *position* steps, or the moment that was reached after *limit* s."""
        ...

    def why(self, uid: int, position: int, limit_s: float) -> Explanation:
        """Explain what a node did in the last tick before *position*, in a little more than *limit_s*.

        Raises:
            BtcoreError: There is no such tick, or it cannot be explained.
        """
        ...

    def recording_text(self) -> str:
        """Return the recording so far, `.btrec.txt`."""
        ...

    def test_text(self, name: str, tree: str) -> str:
        """Return a test that runs the recording *name* again with the tree in the file *tree*."""
        ...


def open_timeline(path: Path) -> Timeline | None:
    """Return the recording in a file, or None if the file is none by its extension.

    Raises:
        BtcoreError: The recording cannot be read, or a package is not installed.
    """
    for extension in ("".join(path.suffixes[-2:]), path.suffix):
        found, unavailable = entry_points.load(_GROUP, extension.removeprefix("."))
        for point in unavailable:
            raise BtcoreError(f"{path}: recordings cannot be shown: {point.remedy}")
        if found:
            timeline: Timeline = found[0].value(path)
            return timeline
    return None


def timeline_of_text(text: str) -> Timeline:
    """Return the recording whose file (`.btrec.txt`) has this text.

    Raises:
        BtcoreError: The recording cannot be read, or a package is not installed.
    """
    with TemporaryDirectory() as folder:
        path = Path(folder) / "run.btrec.txt"
        path.write_text(text, encoding="utf-8", errors="surrogatepass", newline="\n")
        try:
            timeline = open_timeline(path)
        except BtcoreError as error:
            # The user does not know the temporary file.
            raise BtcoreError(str(error).replace(str(path), "the recording")) from None
    if timeline is None:
        raise BtcoreError("recordings cannot be shown: no installed package reads them")
    return timeline


def colours_of(roots: Sequence[Status]) -> tuple[int, str]:
    """Return the track of a recording: a number of steps, and a status as a digit for each so many steps."""
    width = max(1, -(-len(roots) // _MAX_COLOURS))
    parts = (roots[start : start + width] for start in range(0, len(roots), width))
    statuses = (FAILURE if FAILURE in part else max(part) for part in parts)
    return width, "".join(str(int(status)) for status in statuses)


class RecordedRun:
    """A recording as JSON data for pages. Every method may be called from any thread.

    Attributes:
        timeline: The recording.
        keys: The keys of the nodes, in their order.
        uids: The numbers of the nodes, by their keys.
        calls: The calls of trees.
    """

    def __init__(self, timeline: Timeline) -> None:
        self.timeline = timeline
        self._lock = threading.Lock()
        drawn = diagram_nodes(diagram_of_document(timeline.plans))
        nodes = keyed_nodes(drawn)
        keys = node_keys(nodes)
        self.keys = list(keys.values())
        self.uids = {key: uid for uid, key in enumerate(self.keys, 1)}
        self.calls = running_calls(nodes, keys, {node.uid: node.tree for node, _ in drawn if node.tree})

    def summary(self) -> dict[str, Any]:
        """Return what does not depend on the moment: the nodes, the calls, and the results over time."""
        roots = self.timeline.roots
        width, colours = colours_of(roots)
        ticks = [position for position, status in enumerate(roots, 1) if status]
        return {
            "keys": self.keys,
            "calls": [call._asdict() for call in self.calls],
            "count": len(roots),
            "start": ticks[-1] if ticks else 0,
            "width": width,
            "colours": colours,
            "warnings": self.timeline.warnings,
        }

    def moment(self, position: int) -> dict[str, Any]:
        """Return the moment after *position* steps, or an earlier moment if that takes too long."""
        with self._lock:
            moment = self.timeline.at(position, MAX_WAIT_S)
        return self.data_of(moment)

    def why(self, key: str, position: int) -> Why:
        """Return why the node with a key did what it did.

        Raises:
            BtcoreError: There is no such node, or nothing can be explained.
        """
        if key not in self.uids:
            raise BtcoreError("this node is not in the tree that was run")
        with self._lock:
            found = self.timeline.why(self.uids[key], position, _MAX_EXPLAINING_S)
        links = [
            WhyLink(self.keys[uid - 1] if uid else "", tick, because, tried)
            for uid, tick, because, tried in found.links
        ]
        return Why(found.question, found.answer, links)

    def data_of(self, moment: Moment) -> dict[str, Any]:
        """Return a moment of the timeline."""
        return {
            "position": moment.position,
            "tick": moment.tick,
            "time": moment.time / NS_PER_S,
            "root": int(moment.root),
            "statuses": "".join(str(int(status)) for status in moment.statuses),
            "results": "".join(str(int(status)) for status in moment.results),
            "entries": moment.entries,
            "leaves": {
                self.keys[uid - 1]: {
                    "status": int(status),
                    "inputs": dict(inputs),
                    "outputs": dict(outputs),
                    "error": error,
                }
                for uid, _, status, inputs, outputs, error in moment.leaves
            },
            "problem": moment.problem,
        }
