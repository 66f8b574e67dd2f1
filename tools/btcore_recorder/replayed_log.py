"""A recording as a log: its transitions, as the replay repeats them."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, cast

from btcore.engine.observers import Observer
from btcore.loading.tree_xml import tree_to_xml
from btcore.logs import Recording
from btcore.logs.files import read_bytes
from btcore.logs.formats import LogFormat
from btcore.logs.log import Log
from btcore.logs.moments import Moment
from btcore.logs.recording import LoggedTransition, parse_nodes
from btcore.status import IDLE, Transition
from btcore.tree.tree import Tree
from btcore_bags.log import BagLog, read_bag
from btcore_recorder.file_recorder import FileRecorder
from btcore_recorder.files import RecordingFiles
from btcore_recorder.inputs import RunRecording
from btcore_recorder.moments import Moments
from btcore_recorder.recorder import RecorderOptions
from btcore_recorder.replay import Replay

MAX_MOMENTS: Final = 20_000
"""Maximum number of moments that are shown of a recording."""


@dataclass(frozen=True, slots=True)
class ReplayedLog(Recording):
    """What a log of a recorded run would contain.

    Attributes:
        run: The recording.
    """

    run: RunRecording = field(kw_only=True)

    def moments(self) -> Iterator[Moment]:
        """Yield the moments after the ticks; of more than MAX_MOMENTS, at equal intervals."""
        moments = Moments(self.run)
        interval = -(-moments.count // MAX_MOMENTS)
        for position in range(1, moments.count + 1, max(1, interval)):
            moment = moments.at(position)
            if moment.tick:
                yield moment
            if moment.problem:
                return


class _Collector(Observer):
    """Collects transitions, with their times by the wall clock of the recorded run."""

    def __init__(self, wall_time: int) -> None:
        self.found: list[LoggedTransition] = []
        self.wall_time = wall_time

    def transition(self, change: Transition) -> None:
        self.found.append(LoggedTransition(self.wall_time, change.uid, change.previous, change.status))


def read_as_log(path: Path) -> ReplayedLog:
    """Return what a log of the recorded run would contain. A transition has the time at which its tick began.

    Raises:
        LogError: The file cannot be read, or the recording is invalid.
        TreeError: The recorded tree cannot be loaded.
    """
    replay = Replay(path)
    head = replay.recording.head
    collector = _Collector(head.wall_time)
    for node in head.state.nodes:  # of a recording that begins within the run
        if node.status is not IDLE:
            collector.found.append(LoggedTransition(head.wall_time, node.uid, IDLE, node.status))
    replay.tree.subscribe(collector)
    for step in replay.steps:
        if step.tick:
            collector.wall_time = head.wall_time_at(step.time)
        if not replay.step():
            break
    xml = tree_to_xml(replay.tree)
    damage = replay.recording.damage
    if replay.difference is not None:
        damage = f"the replay differs from the recording at {replay.difference}"
    nodes = parse_nodes(xml, str(path))
    return ReplayedLog(path, xml, head.wall_time, nodes, collector.found, damage, run=replay.recording)


def read_mcap(path: Path) -> Recording:
    """Return the log in an MCAP file: of a recording if it contains one, otherwise of a bag."""
    with suppress(ModuleNotFoundError):  # without the package mcap there is no recording
        from btcore_recorder.mcap_form import has_recording

        if has_recording(read_bytes(path)):
            return read_as_log(path)
    return read_bag(path)


class _RecordingLog(FileRecorder):
    """A recorder with the attributes of a log."""

    @property
    def name(self) -> str:
        return str(self.path)


def write_recording(tree: Tree, path: Path) -> Log:
    """Record *tree* to a file, as a log of it is written."""
    return cast(Log, _RecordingLog(tree, RecordingFiles(path), RecorderOptions()))


FORMAT: Final = LogFormat(write_recording, read_as_log)
MCAP_FORMAT: Final = LogFormat(BagLog, read_mcap)
