"""`btcore replay` with the viewer: a log as a recording of rerun."""

import importlib.util
import logging
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from rerun.chunk import RrdReader

from btcore import Builder, In, Put, Registry, action
from btcore.cli.main import main
from btcore.clock import NS_PER_S
from btcore.logs import read_log
from btcore_monitor.events import (
    FAILURE,
    IDLE,
    RUN_CHANNEL,
    SUCCESS,
    BlackboardEvent,
    ExceptionEvent,
    LeavesEvent,
    MissingDataEvent,
    MovingSceneEvent,
    StaticSceneEvent,
    TickEvent,
    TransitionEvent,
    TreeEvent,
)
from btcore_monitor.log_viewer import events, observed_tree
from btcore_monitor.logs import read_fbl
from btcore_monitor.screen.robot_layouts import SingleRobotLayout
from btcore_monitor.screen.robot_view import RobotView
from btcore_monitor.screen.sinks import RecordingSinks
from btcore_monitor.wire.fulltree import read_fulltree
from btcore_recorder import record
from btcore_recorder.replayed_log import ReplayedLog
from btcore_scene import Box, Frame, MovingScene, StaticScene

CAPTURES = Path(__file__).parents[1] / "btcore" / "logs" / "captures"
LOGS = [CAPTURES / name for name in ("v4_sample.btlog", "v4_sample.db3", "v3_sample.fbl")]
EACH_LOG = pytest.mark.parametrize("log", LOGS, ids=lambda path: path.suffix[1:])

Replay = Callable[..., Result]


@pytest.fixture
def replay(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Replay:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    return lambda *arguments: CliRunner().invoke(main, ["replay", *map(str, arguments)], prog_name="btcore")


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there is always a display")
def test_the_error_without_a_display_lists_the_alternatives(replay: Replay) -> None:
    result = replay(LOGS[0])
    assert result.exit_code == 2
    assert all(text in result.stderr for text in ("no display", "--serve-web", "--save", "--text"))


def recorded(path: Path) -> list[tuple[int, int, int, int]]:
    """(number, uid, previous, status) in a recording of rerun."""
    rows = []
    for chunk in RrdReader(path).stream():
        if chunk.entity_path == "/log/numbers":
            batch = chunk.to_record_batch()
            columns = [batch.column(name).to_pylist() for name in ("number", "uid", "previous", "status")]
            rows += [tuple(value for (value,) in row) for row in zip(*columns, strict=True)]
    return sorted(rows)


@EACH_LOG
def test_the_recording_for_the_viewer_has_every_transition(replay: Replay, tmp_path: Path, log: Path) -> None:
    result = replay(log, "--save", "run.rrd")
    assert result.exit_code == 0, result.output
    assert recorded(tmp_path / "run.rrd") == [
        (number, uid, previous, status)
        for number, (_, uid, previous, status) in enumerate(read_log(log).transitions, 1)
    ]


def test_a_recording_is_shown_with_the_scene_of_its_run(replay: Replay, tmp_path: Path) -> None:
    tree = Builder().build(Builder().AlwaysSuccess())
    with record(tree, tmp_path / "run.btrec.txt"):
        for _ in range(3):
            tree.tick_once()
    run = read_log(tmp_path / "run.btrec.txt")
    assert isinstance(run, ReplayedLog)
    shown, *others = events(run, range(len(run.transitions)), run.moments())
    assert isinstance(shown, TreeEvent)
    view = RobotView(SingleRobotLayout(RecordingSinks(save=tmp_path / "scene.rrd")))
    view.process_event(replace(shown, source=RUN_CHANNEL))
    view.process_event(
        StaticSceneEvent(StaticScene(parts=[Box(frame="base", size=(1, 1, 1), position=(0, 0, 0))]))
    )
    for event in others:  # its times count from a second before the recording
        event = replace(event, stamp=event.stamp + NS_PER_S)
        view.process_event(event)
        if isinstance(event, TickEvent):
            frame = Frame("base", "map", (float(event.tick), 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
            view.process_event(MovingSceneEvent(event.stamp, event.wall, MovingScene(frames=[frame])))
    view.close()
    result = replay("run.btrec.txt", "--scene", "scene.rrd", "--save", "both.rrd")
    assert result.exit_code == 0, result.output
    times = {
        chunk.entity_path: chunk.to_record_batch().column("time of the tree").cast("int64").to_pylist()
        for chunk in RrdReader(tmp_path / "both.rrd").stream()
        if not chunk.is_static
    }
    assert times["/scene/frames/base"] == [each.time for each in run.moments()]
    assert "/leaves" in times
    assert replay("run.btrec.txt", "--save", "run.rrd").exit_code == 0
    for scene, message in (("no.rrd", "cannot read the scene"), ("run.rrd", "has no scene")):
        result = replay("run.btrec.txt", "--scene", scene, "--save", "both.rrd")
        assert (result.exit_code, message in result.stderr) == (2, True)
    assert "a log has no ticks" in replay(LOGS[0], "--scene", "scene.rrd", "--save", "both.rrd").stderr


def test_a_part_of_a_log_starts_with_the_statuses_at_its_beginning() -> None:
    recording = read_log(LOGS[0])
    seen, *rest = events(recording, range(5, 8))
    assert isinstance(seen, TreeEvent)
    assert seen.statuses == recording.statuses(5)
    assert [event.number for event in rest if isinstance(event, TransitionEvent)] == [6, 7, 8]
    assert set(seen.source.unavailable) == {"ticks", "exceptions", "blackboard"}


def test_truncation_and_gaps_are_reported_as_missed_data(tmp_path: Path) -> None:
    (tmp_path / "run.btlog").write_bytes(LOGS[0].read_bytes()[:-5])
    (tmp_path / "run.btlog.gaps").write_text("2 the transitions 3 to 9 are lost\n")
    recording = read_log(tmp_path / "run.btlog")
    reported = list(events(recording, range(56)))
    assert [
        (index, event.reason) for index, event in enumerate(reported) if isinstance(event, MissingDataEvent)
    ] == [
        (3, "the transitions 3 to 9 are lost"),
        (58, recording.damage),
    ]


def test_the_observed_tree_is_the_same_as_on_the_wire() -> None:
    recording = read_log(LOGS[0])
    ours, wires = observed_tree(recording), read_fulltree(recording.xml.encode(), "0" * 32)
    assert ours.nodes == wires.nodes
    assert list(ours.subtrees) == list(wires.subtrees)


def test_the_observed_tree_of_a_format_3_log_has_ports_and_subtrees() -> None:
    tree = observed_tree(read_fbl(LOGS[2]))
    assert tree.by_uid[5].ports == {"ticks": "3", "out": "{val}"}
    assert (tree.by_uid[8].parent, tree.by_uid[8].subtree) == (7, "Sub::6")
    assert tree.by_uid[6].type == "subtree"
    assert list(tree.subtrees.values())[1:] == ["Sub", "Sub"]


@pytest.mark.skipif(importlib.util.find_spec("rerun_cli") is None, reason="the viewer is not installed")
def test_a_screenshot_needs_no_display(replay: Replay, tmp_path: Path) -> None:
    done = replay(LOGS[0], "--screenshot", "run.png", "--size", "640x400")
    if "Vulkan driver" in done.stderr:
        pytest.skip("no graphics driver")
    assert done.exit_code == 0, done.stderr
    assert (tmp_path / "run.png").read_bytes().startswith(b"\x89PNG")


def test_changes_within_a_tick_are_drawn_together(replay: Replay, tmp_path: Path) -> None:
    replay(LOGS[2], "--save", "run.rrd")
    drawn = sum(
        len(chunk.to_record_batch())
        for chunk in RrdReader(tmp_path / "run.rrd").stream()
        if chunk.entity_path == "/tree/pills" and not chunk.is_static
    )
    assert drawn == 4  # the first state, and the state after each of the log's three ticks


class Readings(list[float]):
    """The readings of a sensor."""


@action
def measure(readings: Readings, distance: Put[float], limit: In[float]) -> bool:
    distance(readings.pop(0))
    logging.getLogger("rover").warning("%d readings left", len(readings))
    return True


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """The recording of a run in which the distance falls below the limit, and then there is no reading."""
    from btcore_recorder import record

    nodes = Registry.standard()
    nodes.add(measure)
    b = Builder(nodes)
    approach = b.Sequence(
        b.Measure(distance="{d}", limit="0.5"), b.ScriptCondition(code="d < 1", name="near")
    )
    tree = b.build(approach, resources=[Readings([2.0, 0.5])])
    path = tmp_path / "approach.btrec.txt"
    with record(tree, path):
        tree.tick_exactly_once()
        tree.tick_exactly_once()
        with pytest.raises(Exception, match="pop from empty list"):
            tree.tick_exactly_once()
    return path


def test_a_recording_has_entries_and_ports_of_leaves_at_each_tick(run: Path) -> None:
    recording = read_log(run)
    moments = recording.moments()  # type: ignore[attr-defined]
    shown = list(events(recording, range(len(recording.transitions)), moments))
    assert [event.status for event in shown if isinstance(event, TickEvent)] == [FAILURE, SUCCESS, IDLE]
    boards = [event.boards for event in shown if isinstance(event, BlackboardEvent)]
    assert boards == [{"": {"d": "2"}}, {"": {"d": "0.5"}}, {"": {"d": "0.5"}}]
    leaves = [event.leaves for event in shown if isinstance(event, LeavesEvent)]
    assert leaves[:2] == [
        (
            (2, "Measure::2", SUCCESS, {"limit": "0.5"}, {"distance": distance, "logged": logged}, ""),
            (3, "near", status, {"code": "d < 1", "d": distance}, {}, ""),
        )
        for distance, status, logged in (
            ("2", FAILURE, "1 readings left"),
            ("0.5", SUCCESS, "0 readings left"),
        )
    ]
    assert leaves[2] == ((2, "Measure::2", IDLE, {"limit": "0.5"}, {}, "pop from empty list"),)
    assert [event.path for event in shown if isinstance(event, ExceptionEvent)] == ["Measure::2"]
    stamps = [change.stamp for change in recording.transitions]
    second = stamps.index(next(stamp for stamp in stamps if stamp > stamps[0]))
    part = events(recording, range(second, second + 1), recording.moments())  # type: ignore[attr-defined]
    assert [event.tick for event in part if isinstance(event, TickEvent)] == [2]


def test_the_viewer_has_the_leaves_and_entries_of_a_recording(
    replay: Replay, tmp_path: Path, run: Path
) -> None:
    result = replay(run, "--save", "run.rrd")
    assert result.exit_code == 0, result.output
    texts = {"/leaves": "", "/blackboard": ""}
    for chunk in RrdReader(tmp_path / "run.rrd").stream():
        if chunk.entity_path in texts:
            texts[chunk.entity_path] += str(chunk.to_record_batch().column("TextDocument:text").to_pylist())
    assert "Measure | raised | `limit: 0.5` |" in texts["/leaves"]
    assert "pop from empty list" in texts["/leaves"]
    assert "`0.5`" in texts["/blackboard"]
