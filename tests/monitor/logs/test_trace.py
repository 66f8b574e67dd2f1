"""A trace contains the events of MinitraceLogger, is always complete, and its slices are nested."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

import btcore
from btcore import NodeExecutionError, Registry, SimClock, Status, Transition, Tree
from btcore.testing.strategies import xml_documents
from btcore_monitor.logs import TraceLog
from tests.conformance.recorded_cases import CallLog, conformance_registry

NODES = conformance_registry()


def events(path: Path) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))["traceEvents"]
    return found


def open_slices(found: list[dict[str, Any]]) -> list[str]:
    """Names of the slices that have not ended; every E must end the slice that began last on its thread."""
    stacks: dict[int, list[str]] = {}
    for event in found:
        stack = stacks.setdefault(event["tid"], [])
        if event["ph"] == "B":
            stack.append(event["name"])
        elif event["ph"] == "E":
            assert stack.pop() == event["name"]
    return [name for stack in stacks.values() for name in stack]


def test_events_match_those_of_behaviortree_cpp(captures: Path, sample: Tree, tmp_path: Path) -> None:
    with TraceLog(sample, tmp_path / "run.json"):
        for _ in range(3):
            sample.tick_while_running()
    ours, theirs = events(tmp_path / "run.json"), events(captures / "v4_minitrace.json")
    shown = ("cat", "ph", "name")
    assert [[event[key] for key in shown] for event in ours] == [
        [event[key] for key in shown] for event in theirs
    ]
    assert {tuple(event) for event in ours} == {tuple(event) for event in theirs}
    assert {event["tid"] for event in ours} == {1}
    first = (tmp_path / "run.json").read_text().splitlines()
    assert (first[0], first[-1]) == ('{"traceEvents":[', "]}")


def test_times_are_microseconds_of_the_trees_clock(small: Callable[..., Tree], tmp_path: Path) -> None:
    clock = SimClock(7_000_000_000)
    tree = small('<Sleep msec="250"/>', clock=clock)
    with TraceLog(tree, tmp_path / "run.json"):
        clock.advance(0.5)
        tree.tick_while_running(period=0.05)
    assert [(event["ph"], event["ts"]) for event in events(tmp_path / "run.json")] == [
        ("B", 500_000),
        ("E", 750_000),
    ]


def test_arguments_contain_the_node_and_its_result(small: Callable[..., Tree], tmp_path: Path) -> None:
    tree = small('<Inverter><AlwaysSuccess name="a"/></Inverter>')
    with TraceLog(tree, tmp_path / "run.json"):
        tree.tick_once()
    assert [(event["ph"], event["args"]) for event in events(tmp_path / "run.json")] == [
        ("B", {"uid": 1, "path": "Inverter::1"}),
        ("I", {"uid": 2, "path": "a", "status": "SUCCESS"}),
        ("E", {"status": "FAILURE"}),
    ]


def test_names_are_escaped(small: Callable[..., Tree], tmp_path: Path) -> None:
    tree = small('<AlwaysSuccess name="say &quot;hé&quot; \\ twice"/>')
    with TraceLog(tree, tmp_path / "run.json"):
        tree.tick_once()
    assert events(tmp_path / "run.json")[0]["name"] == 'say "hé" \\ twice'


def test_halt_ends_the_slice_of_a_node(small: Callable[..., Tree], tmp_path: Path) -> None:
    tree = small('<Sequence><Sleep msec="1000"/></Sequence>')
    log = TraceLog(tree, tmp_path / "run.json")
    tree.tick_once()
    assert open_slices(events(tmp_path / "run.json")) == ["Sequence", "Sleep"]
    tree.halt()
    assert open_slices(events(tmp_path / "run.json")) == []
    assert events(tmp_path / "run.json")[-1]["args"] == {"status": "IDLE"}
    log.close()


def test_running_slices_are_ended_when_the_log_is_closed(small: Callable[..., Tree], tmp_path: Path) -> None:
    tree = small('<Parallel><Sleep name="a" msec="1000"/><Sleep name="b" msec="500"/></Parallel>')
    with TraceLog(tree, tmp_path / "run.json"):
        tree.tick_once()
    found = events(tmp_path / "run.json")
    assert open_slices(found) == []
    assert [event["args"]["status"] for event in found if event["ph"] == "E"] == ["RUNNING"] * 3


def test_concurrent_nodes_have_separate_lanes(small: Callable[..., Tree], tmp_path: Path) -> None:
    tree = small(
        '<Parallel><Sleep name="a" msec="100"/><Sleep name="b" msec="300"/>'
        '<Sleep name="c" msec="200"/></Parallel>'
    )
    with TraceLog(tree, tmp_path / "run.json"):
        tree.tick_while_running()
    found = events(tmp_path / "run.json")
    assert open_slices(found) == []
    assert [(event["name"], event["ph"], event["tid"]) for event in found] == [
        ("Parallel", "B", 1),
        ("a", "B", 1),
        ("b", "B", 2),
        ("c", "B", 3),
        ("a", "E", 1),
        ("c", "E", 3),
        ("b", "E", 2),
        ("Parallel", "E", 1),
    ]


def test_log_attached_to_running_nodes_shows_next_start(small: Callable[..., Tree], tmp_path: Path) -> None:
    tree = small('<Sleep msec="100"/>')
    tree.tick_once()
    with TraceLog(tree, tmp_path / "run.json"):
        tree.tick_while_running()
        assert events(tmp_path / "run.json") == []
        tree.tick_while_running()
    assert [event["ph"] for event in events(tmp_path / "run.json")] == ["B", "E"]


@given(text=xml_documents(raising=True, timed=True), ticks=st.integers(1, 6), halt=st.booleans())
def test_slices_are_nested_and_end_in_trees(text: str, ticks: int, halt: bool, tmp_path_factory: Any) -> None:
    path = tmp_path_factory.mktemp("trace") / "run.json"
    tree = btcore.loads(text, nodes=NODES, resources=[CallLog()], clock=SimClock(), format=4)
    with TraceLog(tree, path):
        try:
            for _ in range(ticks):
                tree.tick_exactly_once()
                open_slices(events(path))
                tree.sleep(0.05)
            if halt:
                tree.halt()
                assert open_slices(events(path)) == []
        except NodeExecutionError:
            assert open_slices(events(path)) == []
    assert open_slices(events(path)) == []


def test_direct_change_between_results_is_recorded(small: Callable[..., Tree], tmp_path: Path) -> None:
    nodes = Registry.standard()
    answers = iter([True, False])
    nodes.add(btcore.condition(ID="Ok")(lambda: next(answers)))
    tree = small('<ReactiveSequence><Ok/><Sleep msec="1000"/></ReactiveSequence>', nodes=nodes)
    with TraceLog(tree, tmp_path / "run.json"):
        tree.tick_once()
        tree.sleep(0.1)
        tree.tick_once()
    instants = [event for event in events(tmp_path / "run.json") if event["ph"] == "I"]
    assert [event["args"]["status"] for event in instants] == ["SUCCESS", "FAILURE"]


def test_slice_that_outlives_parent_is_cut_and_continued(small: Callable[..., Tree], tmp_path: Path) -> None:
    tree = small('<Inverter name="a"><Inverter name="b"><AlwaysSuccess name="c"/></Inverter></Inverter>')
    running, success, idle = Status.RUNNING, Status.SUCCESS, Status.IDLE
    steps = [(1, idle, running), (2, idle, running), (3, idle, running), (1, running, success)]
    steps += [(3, running, idle), (2, running, idle)]
    with TraceLog(tree, tmp_path / "run.json") as log:
        log.write([Transition(number, number * 1000, 1, *step) for number, step in enumerate(steps, 1)])
    found = events(tmp_path / "run.json")
    assert open_slices(found) == []
    assert [(event["name"], event["ph"], event["tid"], event["ts"]) for event in found] == [
        ("a", "B", 1, 1),
        ("b", "B", 1, 2),
        ("c", "B", 1, 3),
        ("c", "E", 1, 4),
        ("b", "E", 1, 4),
        ("a", "E", 1, 4),
        ("b", "B", 1, 4),
        ("c", "B", 1, 4),
        ("c", "E", 1, 5),
        ("b", "E", 1, 6),
    ]
