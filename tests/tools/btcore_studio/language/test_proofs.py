"""Proofs by the requests of a page: the questions, the answers, and their counterexamples on the timeline."""

import asyncio
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("pygls")

from btcore.errors import BtcoreError
from btcore_recorder import Replay
from btcore_studio.language import proofs
from btcore_studio.language.server import create_server
from btcore_studio.language.studio_protocol import DocumentIdentifier
from tests.tools.btcore_studio.language.test_studio_requests import Client

URI = "untitled:door.xml"
DOCUMENT = {"textDocument": {"uri": URI}}
TREE = """<root BTCPP_format="4" main_tree_to_execute="Enter">
  <BehaviorTree ID="Enter">
    <ReactiveSequence> <IsClosed/> <SubTree ID="Open"/> </ReactiveSequence>
  </BehaviorTree>
  <BehaviorTree ID="Open"> <Fallback> <Turn/> <Push/> </Fallback> </BehaviorTree>
  <TreeNodesModel>
    <Condition ID="IsClosed"/> <Action ID="Push"/> <Action ID="Turn"/>
  </TreeNodesModel>
</root>"""
NEVER = "never Push"
BEFORE = "Turn is FAILURE before Push"


@pytest.fixture
def client() -> Client:
    client = Client(create_server(has_processes=False))
    client.server.project.open(URI, TREE, 1)
    return client


def prove(client: Client, **params: object) -> dict[str, Any]:
    result: dict[str, Any] = client.result("btcore/prove", {**DOCUMENT, **params})
    return result


def answers_of(result: dict[str, Any]) -> dict[str, str]:
    return {answer["question"]: answer["answer"] for answer in result["answers"]}


def test_the_edited_tree_is_proved_or_refuted(client: Client) -> None:
    result = prove(client, questions=[NEVER, BEFORE, "Lift leads to Push"])
    answers = answers_of(result)
    assert answers["the tree ends"] == answers["no node raises an exception"] == "proved"
    assert (answers[NEVER], answers[BEFORE], answers["Lift leads to Push"]) == (
        "refuted",
        "proved",
        "unknown",
    )
    assert "no node 'Lift'" in result["answers"][-1]["detail"]
    edited = TREE.replace("<Turn/> <Push/>", "<Push/> <Turn/>", 1)
    client.server.project.open(URI, edited, 2)
    assert answers_of(prove(client, questions=[BEFORE]))[BEFORE] == "refuted"
    assert answers_of(prove(client, tree="Open", questions=["never Turn"]))["never Turn"] == "refuted"


def test_a_counterexample_is_a_run_on_the_timeline(client: Client, tmp_path: Path) -> None:
    result = prove(client, questions=[NEVER])
    *standard, refuted = result["answers"]
    assert (refuted["playable"], refuted["cycle"]) == (True, 0)
    assert not any(answer["playable"] for answer in standard if answer["answer"] == "proved")
    run = client.result(
        "btcore/counterexample", {"proof": result["proof"], "answer": len(result["answers"]) - 1}
    )
    assert (run["count"], run["start"], run["colours"]) == (1, 1, "1")
    moment = client.result("btcore/moment", {"run": run["run"], "position": 1})
    drawing = client.result("btcore/drawing", {**DOCUMENT, "tree": "Open", "call": run["calls"][0]["key"]})
    keys = {node["name"]: node["key"] for node in drawing["nodes"]}
    results = {name: moment["leaves"][keys[name]]["status"] for name in ("Turn", "Push")}
    assert results == {"Turn": 3, "Push": 1}
    why = client.result("btcore/why", {"run": run["run"], "key": keys["Push"], "position": 1})
    assert "Push" in why["question"]
    file = tmp_path / "run.btrec.txt"
    (recording,) = client.result("btcore/runFiles", {"run": run["run"]})["files"]
    file.write_text(recording["text"], encoding="utf-8")
    assert Replay(file).verify() is None


def test_a_run_that_never_ends_names_the_tick_that_repeats(client: Client) -> None:
    tree = """<root BTCPP_format="4"><BehaviorTree ID="A">
      <RetryUntilSuccessful num_attempts="-1"> <AlwaysFailure/> </RetryUntilSuccessful>
    </BehaviorTree></root>"""
    client.server.project.open(URI, tree, 2)
    assert prove(client)["answers"][0]["answer"] != "refuted"  # it is meant to run forever
    tree = "<KeepRunningUntilFailure> <B/> </KeepRunningUntilFailure>"
    client.server.project.open(
        URI, f'<root BTCPP_format="4"><BehaviorTree ID="A"> {tree} </BehaviorTree></root>', 3
    )
    result = prove(client, questions=["B leads to B is FAILURE"])
    refuted = result["answers"][-1]
    assert (refuted["answer"], refuted["playable"], refuted["cycle"] > 0) == ("refuted", True, True)


def test_given_keys_are_written_before_the_first_tick(client: Client) -> None:
    tree = '<root BTCPP_format="4"><BehaviorTree ID="A"> <Sleep msec="{wait}"/> </BehaviorTree></root>'
    client.server.project.open(URI, tree, 2)
    question = "every mandatory input is written before it is read"
    assert answers_of(prove(client))[question] == "refuted"
    assert answers_of(prove(client, given=["wait"]))[question] != "refuted"


@pytest.mark.parametrize(
    ("method", "params", "reason"),
    [
        ("btcore/prove", {**DOCUMENT, "questions": ["Push maybe"]}, "Push maybe"),
        ("btcore/prove", {**DOCUMENT, "seconds": 1e9}, "the parameters of btcore/prove are invalid"),
        (
            "btcore/prove",
            {**DOCUMENT, "questions": ["x" * 1001]},
            "the parameters of btcore/prove are invalid",
        ),
        ("btcore/prove", {**DOCUMENT, "questions": ["a"] * 51}, "the parameters of btcore/prove are invalid"),
        ("btcore/prove", {**DOCUMENT, "tree": "Gone"}, "Gone"),
        ("btcore/prove", {"textDocument": {"uri": "untitled:gone"}}, "is not open"),
        ("btcore/counterexample", {"proof": 0, "answer": 0}, "ask again"),
        ("btcore/moment", {"run": 999_999, "position": 0}, "no longer shown"),
    ],
)
def test_what_cannot_be_answered_is_refused_with_a_sentence(
    client: Client, method: str, params: object, reason: str
) -> None:
    assert reason in client.request(method, params)["error"]["message"]


def test_a_text_that_is_not_xml_or_has_errors_is_refused(client: Client) -> None:
    client.server.project.open(URI, TREE.replace("</root>", "<"), 2)
    assert "is not XML" in client.request("btcore/prove", DOCUMENT)["error"]["message"]
    client.server.project.open(URI, TREE.replace('ID="Open"/>', 'ID="Gone"/>'), 3)
    assert "Gone" in client.request("btcore/prove", DOCUMENT)["error"]["message"]


def test_answers_without_a_counterexample_and_old_answers_are_refused(client: Client) -> None:
    first = prove(client)
    proved = {"proof": first["proof"], "answer": 0}
    assert "no counterexample" in client.request("btcore/counterexample", proved)["error"]["message"]
    assert (
        "no counterexample"
        in client.request("btcore/counterexample", {**proved, "answer": 99})["error"]["message"]
    )
    prove(client)
    assert "ask again" in client.request("btcore/counterexample", proved)["error"]["message"]


def test_a_search_in_a_process_has_the_same_answers_and_can_be_stopped(
    client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = prove(client, questions=[NEVER])
    # A tree with so many states that the search takes longer than any test.
    counters = " ".join(
        f'<Sequence> <Act{i}/> <Script code="k{i} := 1"/> <Act{i}/> </Sequence>' for i in range(12)
    )
    large = f"<Parallel> {counters} </Parallel>"
    large = f'<root BTCPP_format="4"><BehaviorTree ID="A"> {large} </BehaviorTree></root>'
    started = asyncio.Event()
    server = create_server()
    monkeypatch.setattr(server.proofs, "_notify", lambda _: started.set())

    async def search() -> None:
        server.project.open(URI, TREE, 1)
        params = proofs.ProofParams(_document(), questions=(NEVER,))
        found = await server.proofs.prove_in_process(params)
        assert [answer.answer for answer in found.answers] == [each["answer"] for each in expected["answers"]]
        assert found.answers[-1].playable
        server.project.open(URI, large, 2)
        started.clear()
        task = asyncio.create_task(
            server.proofs.prove_in_process(proofs.ProofParams(_document(), seconds=600))
        )
        await started.wait()
        server.proofs.stop()
        with pytest.raises(BtcoreError, match="the search was stopped"):
            await task
        # A stop before the process has started.
        task = asyncio.create_task(server.proofs.prove_in_process(proofs.ProofParams(_document())))
        await asyncio.sleep(0)
        server.proofs.stop()
        with pytest.raises(BtcoreError, match="the search was stopped"):
            await task

    asyncio.run(search())


def _document() -> Any:

    return DocumentIdentifier(URI)
