"""A recording in the preview: the run at any moment."""

import json
import subprocess
import sys
from collections.abc import Generator, Iterator
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

from btcore import Builder, Put, Registry, Status, action
from btcore.status import IDLE
from btcore_recorder import record
from btcore_recorder.files import read_recording
from btcore_recorder.moments import Moments
from btcore_recorder.replay import STATE_INTERVAL
from btcore_studio.pages.timeline import RecordedRun, open_timeline
from btcore_studio.preview.server import PreviewServer
from btcore_studio.preview.session import PreviewSession
from btcore_studio.preview.tree_reading import RecordedTree
from tests.tools.btcore_studio.preview.test_server import JSON, request

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


@pytest.fixture
def server(run: tuple[Path, list[tuple[Status, ...]]]) -> Iterator[PreviewServer]:
    timeline = open_timeline(run[0])
    assert timeline is not None
    session = PreviewSession(RecordedTree(run[0], timeline.plans), None, timeline)
    with PreviewServer(session) as server:
        Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        yield server
        server.shutdown()


def test_the_server_answers_with_a_moment(server: PreviewServer) -> None:
    status, data, _ = request(server, "POST", f"/{server.token}/moment", {"position": 7}, JSON)
    moment = json.loads(data)
    assert (status, moment["tick"], moment["entries"]) == (200, 7, [["", "n", "7"]])
    drawn = json.loads(request(server, "GET", f"/{server.token}/drawing")[1])["nodes"]
    keys = {node["key"]: node["name"] for node in drawn}
    assert [keys[key] for key in moment["leaves"]] == ["Count", "<far>"]
    assert [status["status"] for status in moment["leaves"].values()] == [2, 2]
    for body in ({}, {"position": "7"}, {"position": None}):
        assert request(server, "POST", f"/{server.token}/moment", body, JSON)[0] == 400


def test_the_results_over_time_are_bounded_and_keep_a_failure(run: tuple[Path, list[Any]]) -> None:
    timeline = Moments(run[0])
    data = RecordedRun(timeline).summary()
    assert len(data["colours"]) * data["width"] >= data["count"] == timeline.count
    assert len(data["keys"]) == len(set(data["keys"])) == 4
    assert data["start"] == timeline.count


def test_the_page_goes_to_moments_by_the_slider_and_by_keys(
    run: tuple[Path, list[tuple[Status, ...]]], browser: Any
) -> None:
    command = [sys.executable, "-m", "btcore", "preview", "--json", str(run[0])]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            page = browser.new_page(viewport={"width": 1280, "height": 760})
            page.goto(json.loads(process.stdout.readline())["url"])
            page.wait_for_selector(f"#moment :text('Tick {TICKS}')")
            page.fill("#position", "7")
            page.wait_for_selector("#moment :text('Tick 7')")
            assert page.text_content("#entries tbody") == "n7"
            page.evaluate("document.activeElement.blur()")
            page.keyboard.press("ArrowLeft")
            page.wait_for_selector("#moment :text('Tick 6')")
            page.evaluate("select(state.drawing.nodes.find((node) => node.id === 'Count').key)")
            page.wait_for_selector("#node .value.out:text('6')")
            assert page.text_content("#node .status") == "RUNNING"
            page.keyboard.press("ArrowRight")
            page.wait_for_selector("#moment :text('Tick 7')")
            page.wait_for_selector("#node .value.out:text('7')")
            page.close()
        finally:
            process.terminate()
