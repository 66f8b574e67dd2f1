"""Runs with mock leaves by the requests of a page."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("pygls")

from btcore import bundled_trees
from btcore_recorder import Replay
from btcore_studio.language import mock_runs
from btcore_studio.language.project import Project, file_uri
from btcore_studio.language.server import create_server
from btcore_studio.language.timeline import MAX_RECORDING
from tests.tools.btcore_studio.language.test_studio_requests import Client

URI = "untitled:door.xml"
DOCUMENT = {"textDocument": {"uri": URI}}
TREE = """<root BTCPP_format="4" main_tree_to_execute="Enter">
  <BehaviorTree ID="Enter">
    <Sequence>
      <IsClosed/>
      <SubTree ID="Open" angle="{a}"/>
      <Script code="b := a + 1"/>
    </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="Open"> <Fallback> <Turn angle="{angle}"/> <Push/> </Fallback> </BehaviorTree>
  <TreeNodesModel>
    <Condition ID="IsClosed"/> <Action ID="Push"/>
    <Action ID="Turn"> <output_port name="angle" type="int"/> </Action>
  </TreeNodesModel>
</root>"""


class RunClient(Client):
    """Sends the requests of a page about its run."""

    number = 0

    def start(self, **params: object) -> dict[str, Any]:
        """Start a run."""
        state: dict[str, Any] = self.result("btcore/run", {**DOCUMENT, **params})
        self.number = state["run"]
        return state

    def step(self, to: str = "tick", ticks: int = 1) -> dict[str, Any]:
        """Return the state after a step."""
        return self.of_run("btcore/runStep", {"to": to, "ticks": ticks})

    def of_run(self, method: str, params: Mapping[str, object]) -> Any:
        """Return the result of a request about the run."""
        return self.result(method, {"run": self.number, **params})


@pytest.fixture
def client() -> RunClient:
    client = RunClient(create_server())
    client.server.project.open(URI, TREE, 1)
    return client


def keys_by_name(client: RunClient, tree: str, call: str = "") -> dict[str, str]:
    """Return the keys of the drawn nodes by their names."""
    drawing = client.result("btcore/drawing", {**DOCUMENT, "tree": tree, "call": call})
    return {node["name"]: node["key"] for node in drawing["nodes"]}


def test_a_run_asks_for_the_leaves_and_shows_what_happens(client: RunClient) -> None:
    state = client.start()
    names = keys_by_name(client, "Enter")
    call = state["calls"][0]
    assert (call["tree"], call["key"]) == ("Open", names["Open"])
    inner = keys_by_name(client, "Open", names["Open"])
    assert set(state["leaves"]) == {names["IsClosed"], inner["Turn"], inner["Push"]}
    assert state["leaves"][names["IsClosed"]] == {"outcomes": "", "chance": None, "seed": 0}
    assert (state["count"], state["event"], state["moment"]["tick"], state["question"]) == (0, 0, 0, None)
    state = client.step()
    assert state["question"] == {
        "key": names["IsClosed"],
        "path": "IsClosed::2",
        "inputs": {},
        "outputs": [],
        "canRun": True,
    }
    assert (state["stopped"], state["moment"]["statuses"][:2]) == (names["IsClosed"], "10")
    assert state["keys"] is None
    state = client.of_run("btcore/runAnswer", {"result": "S"})
    assert state["question"]["key"] == inner["Turn"]
    assert state["question"]["outputs"] == [{"name": "angle", "type": "int", "key": "angle"}]
    state = client.of_run("btcore/runAnswer", {"result": "S", "outputs": {"angle": "4"}})
    assert (state["count"], state["colours"], state["question"], state["stopped"]) == (1, "2", None, "")
    assert ["", "b", "5"] in state["moment"]["entries"]
    assert state["moment"]["leaves"][inner["Turn"]]["outputs"] == {"angle": "4"}
    state = client.of_run("btcore/runMoment", {"position": 0, "event": 3})
    assert (state["moment"]["position"], state["event"], state["stopped"]) == (0, 3, names["IsClosed"])
    state = client.step("out")
    assert (state["stopped"], state["moment"]["statuses"][0]) == (names["Sequence"], "2")
    assert client.step("out")["moment"]["position"] == 1


def test_planned_leaves_run_many_ticks_until_the_tree_completes(client: RunClient) -> None:
    key = keys_by_name(client, "Enter")["IsClosed"]
    inner = keys_by_name(client, "Open", keys_by_name(client, "Enter")["Open"])
    state = client.start(
        plans={key: {"outcomes": "S"}, "gone": {"outcomes": "S"}, inner["Push"]: {"chance": 2}}
    )
    assert (state["leaves"][key]["outcomes"], state["leaves"][inner["Push"]]["chance"]) == ("S", None)
    client.of_run("btcore/runLeaf", {"key": inner["Turn"], "plan": {"outcomes": "RRRS(angle=2)"}})
    state = client.step(ticks=100)
    assert (state["count"], state["colours"], state["moment"]["time"]) == (4, "1112", pytest.approx(0.3))
    client.of_run("btcore/runLeaf", {"key": inner["Turn"], "plan": {"outcomes": "F"}})
    client.of_run("btcore/runLeaf", {"key": inner["Push"], "plan": {}})
    assert client.step()["question"]["key"] == inner["Push"]
    state = client.of_run("btcore/runMoment", {"position": 2, "cut": True})
    assert (state["count"], state["moment"]["tick"]) == (2, 2)


def test_a_run_stops_at_breakpoints(client: RunClient) -> None:
    names = keys_by_name(client, "Enter")
    client.start(plans={names["IsClosed"]: {"outcomes": "S"}})
    stops = {"to": "tick", "ticks": 9, "breakpoints": [names["Open"], names["IsClosed"], "gone"]}
    seen = [client.of_run("btcore/runStep", stops) for _ in range(3)]
    assert [state["stopped"] for state in seen[:2]] == [names["IsClosed"], names["Open"]]
    assert seen[2]["question"] is not None


def test_an_edited_tree_is_run_again_with_the_same_answers(client: RunClient) -> None:
    client.start()
    for answer in ("S", "F", "R", "S", "F", "S"):
        client.step()
        client.of_run("btcore/runAnswer", {"result": answer})
    before, state = client.number, client.step()
    assert (state["count"], state["colours"]) == (3, "103")  # the Script raises: there is no entry 'a'
    edited = TREE.replace("<Sequence>", '<Sequence> <Script code="a := 9"/>').replace(
        "<Push/>", "<Push/> <Wipe/>", 1
    )
    client.server.project.open(URI, edited, 2)
    state = client.start(again=before)
    assert (state["count"], state["colours"]) == (3, "123")
    assert ["", "b", "10"] in state["moment"]["entries"]
    reply = client.request("btcore/runStep", {"run": before, "to": "tick"})
    assert reply["error"]["message"] == "this run has ended: start another"


def test_a_run_explains_what_its_nodes_did(client: RunClient) -> None:
    names = keys_by_name(client, "Enter")
    client.start()
    asked = {"key": names["Sequence"], "position": 0}
    reply = client.request("btcore/why", {"run": client.number, **asked})
    assert "there is no tick yet" in reply["error"]["message"]
    client.step()
    reply = client.request("btcore/why", {"run": client.number, **asked})
    assert "has not ended" in reply["error"]["message"]
    client.of_run("btcore/runAnswer", {"result": "F"})
    why = client.of_run("btcore/why", {**asked, "position": 1})
    assert why["question"] == "why did 'Sequence::1' return FAILURE in tick 1 (0 s)?"
    assert [link["key"] for link in why["links"]] == [names["Sequence"], names["IsClosed"]]
    assert "'IsClosed::2' had returned SUCCESS in tick 1" in why["links"][1]["tried"]
    reply = client.request("btcore/why", {"run": client.number, "key": "gone", "position": 1})
    assert "not in the tree" in reply["error"]["message"]


def test_a_run_is_saved_as_a_recording_and_a_test(client: RunClient, tmp_path: Path) -> None:
    client.start(plans={keys_by_name(client, "Enter")["IsClosed"]: {"outcomes": "F"}})
    client.step()
    (recording,) = client.of_run("btcore/runFiles", {"tree": "a/b/my door.xml"})["files"]
    assert recording["name"] == "my_door.btrec.txt"
    path = tmp_path / recording["name"]
    path.write_text(recording["text"], encoding="utf-8")
    assert Replay(path).verify() is None
    files = client.of_run("btcore/runFiles", {"tree": "a/b/my door.xml", "test": True})["files"]
    assert [file["name"] for file in files] == ["my_door.btrec.txt", "test_my_door.py"]
    assert 'tree=FOLDER / "my door.xml"' in files[1]["text"]


@pytest.mark.parametrize(
    ("method", "params", "message"),
    [
        ("btcore/run", {**DOCUMENT, "tree": "Gone"}, "the tree cannot be run: "),
        (
            "btcore/run",
            {**DOCUMENT, "period": 0},
            "the time between two ticks must be from 0.001 s to 3600 s",
        ),
        ("btcore/run", {"textDocument": {"uri": "untitled:gone"}}, "is not open"),
        ("btcore/run", {**DOCUMENT, "again": 12345}, "this run has ended"),
        ("btcore/runStep", {"to": "tick", "ticks": 0}, "from 1 to 1,000 ticks"),
        ("btcore/runAnswer", {"result": "S"}, "no leaf waits for an answer"),
        ("btcore/runLeaf", {"key": "gone", "plan": {}}, "does not have this node"),
        ("btcore/runFiles", {"test": True}, "nothing to test"),
        (
            "btcore/runStep",
            {"to": "moon"},
            "the parameters of btcore/runStep are invalid: Invalid enum value 'moon'",
        ),
        ("btcore/runAnswer", {"result": 7}, "the parameters of btcore/runAnswer are invalid"),
        ("btcore/runMoment", {"position": "first"}, "the parameters of btcore/runMoment are invalid"),
        ("btcore/endRun", {"run": "all"}, "the parameters of btcore/endRun are invalid"),
    ],
)
def test_what_a_run_cannot_do_is_refused(
    client: RunClient, method: str, params: Mapping[str, object], message: str
) -> None:
    client.start()
    assert message in client.request(method, {"run": client.number, **params})["error"]["message"]
    assert client.step()["question"]["path"] == "IsClosed::2"


def test_a_tree_that_is_broken_or_too_large_is_refused(
    client: RunClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    client.server.project.open(URI, TREE.replace("</Sequence>", ""), 2)
    assert "the text is not XML" in client.request("btcore/run", DOCUMENT)["error"]["message"]
    client.server.project.open(URI, TREE.replace('<Script code="b := a + 1"/>', "<Inverter/>"), 3)
    assert "the tree cannot be run: " in client.request("btcore/run", DOCUMENT)["error"]["message"]
    monkeypatch.setattr(mock_runs, "MAX_NODES", 3)
    client.server.project.open(URI, TREE, 4)
    assert "more than 3 nodes" in client.request("btcore/run", DOCUMENT)["error"]["message"]


def test_the_end_of_a_run_frees_it(client: RunClient) -> None:
    client.start()
    client.of_run("btcore/endRun", {})
    assert "has ended" in client.request("btcore/endRun", {"run": client.number})["error"]["message"]


def test_bundled_trees_run(robot_project: Project) -> None:
    client = RunClient(create_server())
    client.server.project.registry, client.server.project.models = (
        robot_project.registry,
        robot_project.models,
    )
    trees = sorted(bundled_trees.folder().rglob("*.xml"))
    finished = 0
    for path in trees:
        document = {"textDocument": {"uri": file_uri(path)}}
        reply = client.request("btcore/run", document)
        if "error" in reply:
            assert "no main tree" in reply["error"]["message"], path
            continue
        state = reply["result"]
        client.number = state["run"]
        for key in state["leaves"]:
            client.of_run("btcore/runLeaf", {"key": key, "plan": {"outcomes": "RS|F"}})
        state = client.step(ticks=8)
        assert state["question"] is None
        finished += state["count"] > 0
    assert finished > 10


def test_a_recording_that_a_page_sends_is_shown_and_explained(client: RunClient) -> None:
    names = keys_by_name(client, "Enter")
    reply = client.request("btcore/moment", {"position": 1})
    assert reply["error"]["message"] == "this run is no longer shown: open it again"
    client.start(plans={names["IsClosed"]: {"outcomes": "F"}})
    client.step()
    text = client.of_run("btcore/runFiles", {"test": False, "tree": "door.xml"})["files"][0]["text"]
    summary = client.result("btcore/recording", {"text": text})
    assert (summary["count"], summary["start"], summary["colours"]) == (1, 1, "3")
    moment = client.result("btcore/moment", {"position": 1})
    assert moment["leaves"][names["IsClosed"]]["status"] == 3
    why = client.result("btcore/why", {"run": 0, "key": names["IsClosed"], "position": 1})
    assert why["question"].startswith("why did 'IsClosed::2' return FAILURE")


@pytest.mark.parametrize("text", ["", "{}", "<root/>", "\ud800", "[" * 100_000, "a" * (MAX_RECORDING + 1)])
def test_a_text_that_is_no_recording_is_refused_without_the_name_of_a_file(
    client: RunClient, text: str
) -> None:
    reply = client.request("btcore/recording", {"text": text})
    assert reply["error"]["message"].startswith("the recording")
