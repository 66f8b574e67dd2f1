"""The table of statistics: results, success rates and running times of every node, at any time."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from btcore_monitor.events import ObservedNode, ObservedTree, TransitionEvent, TreeEvent
from btcore_monitor.screen.panels import MAX_TABLE_ROWS, UPDATE_INTERVAL_NS
from tests.monitor.screen.conftest import Recording

IDLE, RUNNING, SUCCESS, FAILURE, SKIPPED = range(5)
SECOND = 10**9


def table(document: str) -> dict[str, list[str]]:
    """Name → the other cells of its row."""
    rows = [line.strip("| ").split(" | ") for line in document.splitlines()[2:] if line.startswith("|")]
    return {row[0].strip(): row[1:] for row in rows}


def leaf_events(*changes: tuple[float, int], first: int = IDLE) -> list[object]:
    """A tree of one leaf that goes to a status at each time (s)."""
    tree = ObservedTree("d" * 32, "One", (ObservedNode(1, "Dock|it", "Dock", "action", "Dock|it"),))
    events: list[object] = [TreeEvent(tree, 0, 0, {1: first})]
    status = first
    for number, (seconds, new) in enumerate(changes, start=1):
        t = round(seconds * SECOND)
        events.append(TransitionEvent(number, t, t, number, 1, status, new))
        status = new
    return events


def last_table(recording: Recording) -> dict[str, list[str]]:
    return table(recording.of("/statistics", "TextDocument:text")[-1][1][0])


def test_a_run_of_bumpgo_has_the_results_and_times_of_each_node(
    run: Callable[..., Any], tmp_path: Path, recorded: Callable[..., Any]
) -> None:
    rows = last_table(recorded(run(130), tmp_path / "run.rrd"))
    assert list(rows) == ["bumpgo", "avoid", "clear", "IsObstacle", "escape", "Back", "Turn", "Forward"]
    # two rounds of 1 s back and 0.9 s turning, of which the second has just ended at tick 120
    assert rows["Back"] == ["2", "100 %", "2.0 s", "1.00 s"]
    assert rows["Turn"] == ["2", "100 %", "1.8 s", "0.90 s"]
    assert rows["bumpgo"] == ["0", "–", "12.9 s", "–"]


def test_names_are_indented_by_their_depth_in_the_tree(
    run: Callable[..., Any], tmp_path: Path, recorded: Callable[..., Any]
) -> None:
    document = recorded(run(5), tmp_path / "run.rrd").of("/statistics", "TextDocument:text")[-1][1][0]
    depth = {
        match[2]: len(match[1]) // 4 for match in re.finditer(r"^\| ((?:\xa0{4})*)(\S+)", document, re.M)
    }
    assert (depth["bumpgo"], depth["avoid"], depth["clear"], depth["IsObstacle"]) == (0, 1, 2, 3)


def test_the_success_rate_ignores_skips_which_are_counted_separately(
    tmp_path: Path, recorded: Callable[..., Any]
) -> None:
    changes = [(1, SUCCESS), (2, IDLE), (3, FAILURE), (4, IDLE), (5, FAILURE), (6, SKIPPED), (7, SUCCESS)]
    rows = last_table(recorded(leaf_events(*changes), tmp_path / "run.rrd"))
    assert rows == {"Dock¦it": ["4 + 1 skipped", "50 %", "–", "–"]}


def test_the_running_time_ends_with_the_result(tmp_path: Path, recorded: Callable[..., Any]) -> None:
    recording = recorded(leaf_events((1, IDLE), (2, RUNNING), (4.5, SUCCESS)), tmp_path / "run.rrd")
    assert last_table(recording)["Dock¦it"] == ["1", "100 %", "2.5 s", "2.50 s"]


def test_the_running_time_of_a_node_first_seen_running_starts_then(
    tmp_path: Path, recorded: Callable[..., Any]
) -> None:
    recording = recorded(leaf_events((3, FAILURE), first=RUNNING), tmp_path / "run.rrd")
    assert last_table(recording)["Dock¦it"] == ["1", "0 %", "3.0 s", "3.00 s"]


def test_the_table_shows_the_statistics_at_the_selected_time(
    run: Callable[..., Any], tmp_path: Path, recorded: Callable[..., Any]
) -> None:
    recording = recorded(run(130), tmp_path / "run.rrd")
    rows = table(recording.at("/statistics", "TextDocument:text", 5 * SECOND)[0])
    assert rows["Turn"] == ["0", "–", "–", "–"]
    assert float(rows["Forward"][2].removesuffix(" s")) == pytest.approx(4.0, abs=0.11)


def test_a_table_is_written_once_a_second_at_any_tick_rate(
    run: Callable[..., Any], tmp_path: Path, recorded: Callable[..., Any]
) -> None:
    recording = recorded(run(130), tmp_path / "run.rrd")
    times = [t for t, _ in recording.of("/statistics", "TextDocument:text")]
    assert times[:-1] == [seconds * UPDATE_INTERVAL_NS for seconds in range(14)]
    assert times[-1] == 13 * SECOND  # and one at the end


def test_a_big_tree_lists_the_leaves_that_ran_longest_first(
    big_tree: Callable[..., Any], tmp_path: Path, recorded: Callable[..., Any]
) -> None:
    tree = big_tree(300)
    busy = [node for node in tree.nodes if not node.children][: MAX_TABLE_ROWS + 5]
    events: list[object] = [TreeEvent(tree, 0, 0, {})]
    for number, node in enumerate(busy, start=1):
        t = number * SECOND
        events.append(TransitionEvent(2 * number, t, t, 0, node.uid, IDLE, RUNNING))
        events.append(
            TransitionEvent(2 * number + 1, t + number, t + number * 10**7, 0, node.uid, RUNNING, IDLE)
        )
    document = recorded(events, tmp_path / "run.rrd").of("/statistics", "TextDocument:text")[-1][1][0]
    assert list(table(document))[:3] == [node.path for node in reversed(busy[-3:])]
    assert f"the {MAX_TABLE_ROWS} leaves that ran longest, of 300 nodes" in document
