"""A recording in the studio: the run at any moment."""

from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest

import btcore
from btcore import Builder, Put, Registry, Status, action
from btcore.status import IDLE
from btcore_recorder import record
from btcore_recorder.files import read_recording
from btcore_recorder.moments import Moments
from btcore_recorder.replay import STATE_INTERVAL
from btcore_studio.language.timeline import RecordedRun
from btcore_studio.page_server.command import StudioOptions, find_shown
from tests.tools.btcore_studio.page_server.conftest import TREE, running_studio
from tests.tools.btcore_studio.page_server.test_server import initialize, open_document

TICKS = 2 * STATE_INTERVAL + 10


class Counter:
    """Counts the ticks of a leaf."""

    value = 0


@action
def count(counter: Counter, number: Put[int]) -> Generator[None, None, bool]:
    while True:
        counter.value += 1
        number(counter.value)
        if counter.value % 7 == 0:
            return True
        yield


@pytest.fixture
def run(tmp_path: Path) -> tuple[Path, list[tuple[Status, ...]]]:
    """A recording with a halt, and the statuses after each step of the run."""
    nodes = Registry.standard()
    nodes.add(count)
    b = Builder(nodes)
    far = b.ScriptCondition(code="n > 3", name="<far>")
    root = b.ReactiveSequence(b.SubTree(ID="Counting", number="{n}"), far, name="round")
    tree = b.build(root, Counting=b.Count(number="{number}"), resources=[Counter()])
    seen = [tuple(node.status for node in tree.nodes)]
    path = tmp_path / "run.btrec.txt"
    with record(tree, path):
        for number in range(TICKS):
            if number == STATE_INTERVAL:
                tree.halt()
                seen.append(tuple(node.status for node in tree.nodes))
            tree.tick_exactly_once()
            seen.append(tuple(node.status for node in tree.nodes))
    return path, seen


def test_each_moment_has_the_statuses_of_the_run(run: tuple[Path, list[tuple[Status, ...]]]) -> None:
    path, seen = run
    moments = Moments(path)
    assert moments.count == len(seen) - 1
    last = STATE_INTERVAL + 1
    for position in (len(seen) - 1, 0, 1, last - 1, last, last + 1, 7, 8, len(seen) + 9):
        moment = moments.at(position)
        assert moment.position == min(position, moments.count)
        assert moment.statuses == seen[moment.position]
        number = moment.tick
        assert (number == 0) == (position in (0, last))
        if number:
            assert moment.entries[0] == ("", "n", str(number))
            [leaf, *_] = moment.leaves
            assert (leaf.outputs, leaf.status is Status.SUCCESS) == ({"number": str(number)}, number % 7 == 0)
    assert moments.at(last).root is IDLE


def test_a_recording_that_differs_is_shown_up_to_there(run: tuple[Path, list[tuple[Status, ...]]]) -> None:
    path, seen = run
    recording = read_recording(path)
    steps = list(recording.steps)
    steps[8] = steps[8]._replace(status=Status.FAILURE)
    moments = Moments(recording._replace(steps=tuple(steps)))
    for position in (9, 300, 10):
        moment = moments.at(position)
        assert (moment.position, "tick 9: recorded: the result is FAILURE" in moment.problem) == (9, True)
    before = moments.at(8)
    assert (before.problem, before.statuses) == ("", seen[8])


def test_a_moment_far_ahead_is_reached_in_several_replies(run: tuple[Path, list[tuple[Status, ...]]]) -> None:
    moments = Moments(run[0])
    reached = [moments.at(moments.count, 0.0).position for _ in range(3)]
    assert reached == sorted({*reached})
    assert reached[0] < moments.count == reached[-1]
    assert moments.at(STATE_INTERVAL, 0.0).position == STATE_INTERVAL


def test_the_keys_of_a_moment_are_those_of_the_drawing(
    run: tuple[Path, list[tuple[Status, ...]]], built: Path, previous: Path, tmp_path: Path
) -> None:
    shown = find_shown(str(run[0]), StudioOptions(), None, tmp_path / "recording")
    with running_studio(shown, previous, built) as studio, studio.page() as page:
        start = page.request("btcore/start")
        initialize(page)
        text = page.request("btcore/read", {"uri": start["uri"]})["text"]
        open_document(page, start["uri"], text)
        moment = page.request("btcore/moment", {"position": 7})
        assert (moment["tick"], moment["entries"]) == (7, [["", "n", "7"]])
        params = {"textDocument": {"uri": start["uri"]}, "tree": None, "folded": []}
        drawn = page.request("btcore/drawing", params)["nodes"]
        keys = {node["key"]: node["name"] for node in drawn}
        assert [keys[key] for key in moment["leaves"]] == ["Count", "<far>"]
        assert [leaf["status"] for leaf in moment["leaves"].values()] == [2, 2]
        assert start["recording"]["keys"] == list(keys)
        # A tree that is shown alone has the keys of the nodes below its call.
        [call] = start["recording"]["calls"]
        assert (call["tree"], call["path"], call["size"]) == ("Counting", "Counting", 1)
        alone = page.request("btcore/drawing", {**params, "tree": "Counting", "call": call["key"]})["nodes"]
        assert [keys[node["key"]] for node in alone] == ["Count"]
        far = next(key for key, name in keys.items() if name == "<far>")
        why = page.request("btcore/why", {"key": far, "position": 2})
        assert why["question"].startswith("why was '<far>' not ticked in tick 2")
        assert keys[why["links"][0]["key"]] == "<far>"


def test_documents_of_a_recording_keep_their_places(tmp_path: Path) -> None:
    part = f'<root BTCPP_format="4">{TREE[TREE.index("<BehaviorTree") :]}'.replace("Rounds", "Visit")
    part = part.replace("</root>", "<TreeNodesModel/></root>")
    main = TREE.replace("<AlwaysSuccess/>", '<SubTree ID="Visit"/>').replace(
        ">", '><include path="../shared/part.xml"/>', 1
    )
    (tmp_path / "shared").mkdir()
    (tmp_path / "trees").mkdir()
    (tmp_path / "shared/part.xml").write_text(part, encoding="utf-8")
    (tmp_path / "trees/main.xml").write_text(main, encoding="utf-8")
    with btcore.load(tmp_path / "trees/main.xml") as tree, record(tree, tmp_path / "run.btrec.txt"):
        tree.tick_while_running()
    shown = find_shown(str(tmp_path / "run.btrec.txt"), StudioOptions(), None, tmp_path / "recording")
    assert shown.file is not None
    assert shown.file.is_relative_to(tmp_path / "recording")
    assert [Path(model).name for model in shown.models] == ["part.xml"]
    assert shown.file.read_text(encoding="utf-8") == main
    assert (shown.file.parent / "../shared/part.xml").resolve().read_text(encoding="utf-8") == part


def test_the_results_over_time_are_bounded_and_keep_a_failure(run: tuple[Path, list[Any]]) -> None:
    timeline = Moments(run[0])
    data = RecordedRun(timeline).summary()
    assert len(data["colours"]) * data["width"] >= data["count"] == timeline.count
    assert len(data["keys"]) == len(set(data["keys"])) == 4
    assert data["start"] == timeline.count
