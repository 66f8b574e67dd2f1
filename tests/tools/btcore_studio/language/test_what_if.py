"""Runs with changes by the requests of a page: the edited tree, another result, another entry."""

import runpy
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("pygls")

from btcore_recorder import Replay
from btcore_recorder.moments import Moments
from btcore_studio.language.server import create_server
from btcore_studio.language.timeline import RecordedRun
from tests.tools.btcore_studio.language.test_mock_runs import DOCUMENT, TREE, URI, RunClient, keys_by_name


@pytest.fixture
def client() -> RunClient:
    """A page whose run had two ticks: Turn was RUNNING, and then wrote 4."""
    client = RunClient(create_server(has_processes=False))
    client.server.project.open(URI, TREE, 1)
    client.start()
    client.step()
    client.of_run("btcore/runAnswer", {"result": "S"})
    client.of_run("btcore/runAnswer", {"result": "R"})
    client.step()
    client.of_run("btcore/runAnswer", {"result": "S", "outputs": {"angle": "4"}})
    return client


def entries_at_end(client: RunClient, run: dict[str, Any]) -> list[list[str]]:
    moment = client.result("btcore/moment", {"run": run["run"], "position": run["count"]})
    assert moment["problem"] == ""
    entries: list[list[str]] = moment["entries"]
    return entries


def test_the_edited_tree_runs_with_the_recorded_leaves(client: RunClient, tmp_path: Path) -> None:
    client.server.project.open(URI, TREE.replace("a + 1", "a + 10"), 2)
    run = client.of_run("btcore/whatIf", DOCUMENT)
    assert (run["count"], run["colours"], run["report"][0]) == (2, "12", "the same in all 2 ticks")
    assert ["", "b", "14"] in entries_at_end(client, run)
    failing = TREE.replace('<Script code="b := a + 1"/>', '<ScriptCondition code="a == 5"/>')
    client.server.project.open(URI, failing, 3)
    run = client.of_run("btcore/whatIf", DOCUMENT)
    assert (run["colours"], run["start"]) == ("13", 2)
    assert run["report"][0].startswith("it differs from tick 2 on: recorded: 'Script::7' becomes SUCCESS")
    # The new run is a recording, which can be changed again, explained and saved.
    files = client.result("btcore/runFiles", {"run": run["run"], "test": True, "tree": "door.xml"})["files"]
    assert [file["name"] for file in files] == ["door.btrec.txt", "test_door.py"]
    for file in files:
        (tmp_path / file["name"]).write_text(file["text"], encoding="utf-8")
    assert Replay(tmp_path / "door.btrec.txt").verify() is None
    (tmp_path / "door.xml").write_text(TREE, encoding="utf-8")
    scope = runpy.run_path(str(tmp_path / "test_door.py"))
    scope["test_door"]()  # the tree that is on disk does not fail
    (tmp_path / "door.xml").write_text(failing, encoding="utf-8")
    with pytest.raises(AssertionError, match="fails in tick 2"):
        scope["test_door"]()
    root = run["keys"][0]
    assert client.result("btcore/why", {"run": run["run"], "key": root, "position": 2})["links"]
    client.server.project.open(URI, TREE, 4)
    again = client.result("btcore/whatIf", {**DOCUMENT, "run": run["run"]})
    assert again["colours"] == "12"


def test_another_result_and_another_entry(client: RunClient) -> None:
    inner = keys_by_name(client, "Open", keys_by_name(client, "Enter")["Open"])
    changed = {"tick": 1, "key": inner["Turn"], "result": "F"}
    run = client.of_run("btcore/whatIf", {"results": [changed]})
    assert "because no result is recorded at 'Open::3/Push::6'" in " ".join(run["report"])
    changed = {"tick": 2, "key": keys_by_name(client, "Enter")["IsClosed"], "result": "F"}
    run = client.of_run("btcore/whatIf", {"results": [changed]})
    assert "had no effect" in " ".join(run["report"])  # it is not ticked in the second tick
    run = client.of_run("btcore/whatIf", {"entries": [{"tick": 1, "key": "other", "value": "7"}]})
    assert ["", "other", "7"] in entries_at_end(client, run)


def test_the_recording_of_the_studio_has_the_number_0(client: RunClient, tmp_path: Path) -> None:
    assert "has ended" in client.request("btcore/whatIf", {"run": 0})["error"]["message"]
    text = client.of_run("btcore/runFiles", {})["files"][0]["text"]
    (tmp_path / "run.btrec.txt").write_text(text, encoding="utf-8")
    client.server.shown.recorded = RecordedRun(Moments(tmp_path / "run.btrec.txt"))
    assert client.result("btcore/whatIf", {"run": 0})["report"][0] == "the same in all 2 ticks"
    files = client.result("btcore/runFiles", {"run": 0, "test": True, "tree": "door.xml"})["files"]
    assert "assert_runs_as_recorded" in files[1]["text"]


def test_changes_that_are_not_possible_are_refused_with_a_sentence(client: RunClient) -> None:
    def refusal(**params: object) -> str:
        reply = client.request("btcore/whatIf", {"run": client.number, **params})
        message: str = reply["error"]["message"]
        return message

    root = client.start(again=client.number)["keys"][0]
    assert "does not have this node" in refusal(results=[{"tick": 1, "key": "gone", "result": "S"}])
    assert "whose results are recorded" in refusal(results=[{"tick": 1, "key": root, "result": "S"}])
    assert "are invalid" in refusal(results=[{"tick": 0, "key": root, "result": "S"}])
    assert "are invalid" in refusal(results=[{"tick": 1, "key": root, "result": "XX"}])
    assert "are invalid" in refusal(entries=[{"tick": 1, "key": "k", "value": "x" * 10_001}])
    client.server.project.open(URI, "<root", 2)
    assert "is not XML" in refusal(**DOCUMENT)
    client.server.project.open(URI, TREE.replace('ID="Enter"', 'ID="Leave"'), 3)
    assert "cannot be run" in refusal(**DOCUMENT)
