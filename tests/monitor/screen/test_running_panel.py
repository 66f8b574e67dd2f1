"""The panel that lists the running leaves."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from btcore_monitor.events import (
    MovingSceneEvent,
    ObservedNode,
    ObservedTree,
    TickEvent,
    TransitionEvent,
    TreeEvent,
)
from btcore_scene import MovingScene

SECOND = 10**9
IDLE, RUNNING, SUCCESS, FAILURE = range(4)
NODES = (
    ObservedNode(1, "root", "Fallback", "control", "root", 0, (2, 3, 4)),
    ObservedNode(2, "Charged", "Charged", "condition", "Charged", 1),
    ObservedNode(3, "Move", "Move", "action", "Move", 1, (), {"goal": "{dock}"}),
    ObservedNode(4, "Move", "Move", "action", "Move::4", 1, (), {"goal": "{next}"}),
)


@pytest.fixture
def panel(recorded: Callable[..., Any], tmp_path: Path) -> Callable[..., Any]:
    """``panel({second: [(uid, status), …]}, notes)``: the panel's text at the end of each second."""

    def texts(ticks: dict[int, list[tuple[int, int]]], notes: dict[str, str] | None = None) -> dict[int, str]:
        tree = ObservedTree("a" * 32, "Main", NODES, {"": "Main"})
        events = [TreeEvent(tree, 0, 0, {node.uid: IDLE for node in NODES})]
        events += [MovingSceneEvent(0, 0, MovingScene(notes=notes or {}))]
        stands, number = {node.uid: IDLE for node in NODES}, 0
        for second, changes in ticks.items():
            t = second * SECOND
            for uid, status in changes:
                number += 1
                events.append(TransitionEvent(number, t, t, second, uid, stands[uid], status))
                stands[uid] = status
            if stands[1] != IDLE:
                events.append(TickEvent(second, t, t, 1000, stands[1]))
        recording = recorded(events, tmp_path / "run.rrd")
        return {second: recording.at("/now", "TextDocument:text", second * SECOND)[0] for second in ticks}

    return texts


def test_ports_distinguish_running_nodes_with_the_same_name(panel: Callable[..., Any]) -> None:
    now = panel({1: [(1, RUNNING), (3, RUNNING)], 2: [(3, FAILURE), (4, RUNNING)]})
    assert "| runs | **Move {dock}** |" in now[1]
    assert "| runs | **Move {next}** |" in now[2]


def test_a_leaf_that_failed_is_listed_for_one_tick(panel: Callable[..., Any]) -> None:
    now = panel({1: [(1, RUNNING), (2, SUCCESS)], 2: [(2, FAILURE), (2, IDLE), (3, RUNNING)], 3: []})
    assert "failed" not in now[1]
    assert "| failed | **Charged** |" in now[2]
    assert "failed" not in now[3], "listed in the tick before"


def test_a_tree_that_is_halted_after_its_last_tick_lists_no_running_leaf(panel: Callable[..., Any]) -> None:
    now = panel({1: [(1, RUNNING), (3, RUNNING)], 2: [(3, IDLE), (1, IDLE)]})
    assert "| runs | **Move {dock}** |" in now[1]
    assert "| runs | – |" in now[2]
    assert "| root | IDLE |" in now[2]


def test_a_long_note_is_below_the_table_where_it_can_wrap(panel: Callable[..., Any]) -> None:
    way = "(-10.6, -12.2), 19.9 m to go, 2 recoveries"
    (now,) = panel({1: [(1, RUNNING)]}, {"localisation": "sure", "goal": way}).values()
    assert "| localisation | sure |" in now
    assert now.endswith(f"\n\ngoal: {way}")
