"""Explanations of recorded runs: a smallest set of changed inputs changes the outcome, no part of it does."""

import logging
import os
import re
import subprocess
import sys
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lxml import etree

import btcore
from btcore import FAILURE, RUNNING, SUCCESS, Blackboard, In, Put, Registry, SimClock, Status
from btcore.errors import BtcoreError
from btcore_recorder import Answer, Explainer, Replay
from btcore_recorder.causes import MAX_CAUSES
from btcore_recorder.inputs import RunRecording
from btcore_recorder.tick_trace import TickTrace
from btcore_recorder.what_if import Change, ChangedReplay, RecordedRun
from tests.tools.btcore_recorder.test_replay import DOCUMENTS, Run, act, random_tree
from tests.tools.btcore_recorder.test_what_if import ACTIONS

MISSING = (SUCCESS, FAILURE, RUNNING, None)
"""What nodes return for which nothing is recorded; None = the run ends there."""
RUNS = os.environ.get("BTCORE_RUNS")


def outcomes(recording: RunRecording, answer: Answer, uid: int, changes: Sequence[Change]) -> list[object]:
    """Return what the node may do in the tick of *answer*, from the first tick with *changes* on."""
    ticks = [step.tick for step in recording.steps]
    end = ticks.index(answer.chain[0].tick)
    start = min([ticks.index(change.tick) for change in answer.changes], default=end)
    run = RecordedRun(Replay(recording).cut(start, end + 1))
    return [_outcome(ChangedReplay(run, changes, missing=each), end - start, uid) for each in MISSING]


def _outcome(changed: ChangedReplay, position: int, uid: int) -> object:
    while changed.position < position:
        if not changed.step():
            return "ended", changed.status if uid == 1 else None
    trace = TickTrace(changed.tree)
    changed.step()
    trace.close()
    if changed.end == "no result is recorded":
        return changed.end
    visits = trace.visits_of(uid)
    return visits[-1].result if visits else "no tick", trace.halt_of(uid) is not None


@settings(max_examples=int(RUNS) // 4 if RUNS else settings().max_examples // 4)
@given(DOCUMENTS, ACTIONS, st.integers(0, 2**32))
def test_the_smallest_set_changes_the_outcome(xml: str, actions: list[str], seed: int) -> None:
    source = Random(seed)
    run = Run(random_tree(xml, seed, SimClock()))
    for action in ["tick", *actions]:
        act(run.tree, action, source)
    recording = run.end()
    explainer = Explainer(recording)
    node = source.choice(["", *run.tree.nodes_by_path()])
    answer = explainer.why(node)
    assert 1 <= len(answer.chain) <= 10
    assert str(answer)
    uid = list(run.tree.nodes_by_path()).index(node) + 1 if node else 1
    recorded = outcomes(recording, answer, uid, ())[0]
    if not answer.changes:
        return
    assert any(each != recorded for each in outcomes(recording, answer, uid, answer.changes)), answer
    for size in range(1, len(answer.changes)):
        for part in combinations(answer.changes, size):
            assert all(each == recorded for each in outcomes(recording, answer, uid, part)), answer


@btcore.action
def knock() -> bool:
    """Fail, and say why."""
    logging.getLogger("door").warning("nobody is at %s", "home")
    return False


def test_the_link_of_a_leaf_has_its_ports_and_messages() -> None:
    nodes = Registry.standard()
    nodes.add(knock, sense, grip)
    b = btcore.Builder(nodes)
    run = Run(
        b.build(b.Sequence(b.Sense(value="{d}"), b.Grip(width="{d}"), b.Knock()), resources=[Random(1)])
    )
    run.tree.tick_exactly_once()
    explainer = Explainer(run.end())
    knocked = explainer.why("Knock::4").chain[0]
    assert knocked.because == 'returned FAILURE; it logged "nobody is at home"'
    assert re.fullmatch(r".*test_why.py:\d+ \(test_why.py:\d+\)", knocked.place)
    gripped, wrote = explainer.why("Grip::3").chain
    assert gripped.because == "returned SUCCESS, with d = 2.1"
    assert (wrote.node, wrote.because) == ("Sense::2", "wrote d = 2.1 in this tick")
    assert explainer.who_wrote("d").answer == "'Sense::2' wrote d = 2.1 in this tick."


def test_an_answer_says_that_the_time_was_over() -> None:
    nodes = Registry.standard()
    nodes.add(knock)
    b = btcore.Builder(nodes)
    run = Run(b.build(b.Inverter(b.Knock())))
    run.tree.tick_exactly_once()
    recording = run.end()
    assert Explainer(recording).why().changes
    answer = Explainer(recording, limit_s=-1).why()
    assert answer.answer == "In -1 s, no leaf result or entry was found that would change this."
    assert [link.node for link in answer.chain] == ["Inverter::1", "Knock::2"]


def test_each_question_has_its_own_bound() -> None:
    b = btcore.Builder()
    run = Run(b.build(b.Sequence(b.Script(code="n := 1"), b.Script(code="m := n"))))
    run.tree.tick_exactly_once()
    explainer = Explainer(run.end())
    answer = explainer.who_wrote("m")
    assert len(answer.chain) == 2
    for _ in range(MAX_CAUSES):
        assert explainer.who_wrote("m") == answer


def test_a_tick_that_repeats_a_node_too_often_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("btcore_recorder.causes.MAX_OBSERVATIONS", 1_000)
    repeat = '<Repeat num_cycles="1000"><AlwaysSuccess/></Repeat>'
    run = Run(btcore.loads(f'<root><BehaviorTree ID="Main">{repeat}</BehaviorTree></root>'))
    run.tree.tick_exactly_once()
    with pytest.raises(BtcoreError, match=r"^tick 1 cannot be explained: .* more than 1,000 ticks of"):
        Explainer(run.end()).why()


def test_a_recording_does_not_change_what_logging_prints(tmp_path: Path) -> None:
    code = """import logging, btcore
from btcore_recorder import record
b = btcore.Builder()
with record(b.build(b.AlwaysSuccess()), "run.btrec.txt"):
    logging.getLogger("leaf").warning("printed without a handler")
"""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stderr.splitlines()[-1] == "printed without a handler"


# --- seeded faults

KEYS = ("a", "b", "c", "d", "e", "f")
MISSION = """<root BTCPP_format="4"><BehaviorTree ID="Main">
    <Sequence name="mission">{}</Sequence></BehaviorTree></root>"""
STALE = {"old": 20.0, "low": -1.0}
"""Entries that nothing writes, with values that no leaf accepts."""


@btcore.action
def sense(value: Put[float], source: Random) -> bool:
    """Write a value that all leaves accept."""
    value(round(source.uniform(1, 9), 1))
    return True


@btcore.action
async def reach(goal: In[float]) -> bool:
    """Succeed in the second tick if the goal is near."""
    await btcore.running()
    return 0.5 <= goal <= 10.5


@btcore.action
def grip(width: In[float]) -> bool:
    """Succeed if the width fits."""
    return 0 < width <= 10


@btcore.action
def double(value: In[float], result: Put[float]) -> bool:
    """Write a result that depends on the input."""
    result(min(10.0, value * 2))
    return True


def random_stage(source: Random, number: str, depth: int = 0) -> str:
    """Return a part of a mission, whose nodes have unique names."""
    k, other = source.sample(KEYS, 2)
    stages = [
        f'<Sense name="s{number}" value="{{{k}}}"/><ScriptCondition name="c{number}" code="{k} &lt; 9.5"/>',
        f'<Reach name="r{number}" goal="{{{k}}}"/>',
        f'<Sense name="s{number}" value="{{{k}}}"/><Grip name="g{number}" width="{{{k}}}"/>',
        f'<Script name="x{number}" code="{other} := {k} + 0.5"/>'
        f'<ScriptCondition name="c{number}" code="{other} &lt;= 11"/>',
        f'<Double name="d{number}" value="{{{k}}}" result="{{{other}}}"/>'
        f'<Reach name="r{number}" goal="{{{other}}}"/>',
    ]
    if depth < 2:
        first, second = (random_stage(source, f"{number}_{i}", depth + 1) for i in (1, 2))
        stages += [
            f'<Fallback name="f{number}"><ScriptCondition name="c{number}" code="{k} &lt; 3"/>'
            f"{first}</Fallback>",
            f'<Parallel name="p{number}">{first}{second}</Parallel>',
            f'<RetryUntilSuccessful name="t{number}" num_attempts="2">{first}</RetryUntilSuccessful>',
        ]
    return f'<Sequence name="q{number}">{source.choice(stages)}</Sequence>'


def add_fault(xml: str, source: Random) -> tuple[str, set[str]] | None:
    """Return *xml* with a fault, and the names of the nodes with the fault; None if it does not fit."""
    root = etree.fromstring(xml)
    nodes = [node for node in root.iter() if node.get("name") not in (None, "mission")]
    conditions = [node for node in nodes if node.tag == "ScriptCondition"]
    inputs = [(node, port) for node in nodes for port in ("goal", "width") if node.get(port)]
    match source.choice(["threshold", "stale key", "swapped", "port"]):
        case "threshold" if conditions:
            node = source.choice(conditions)
            node.set("code", re.sub(r"[\d.]+$", source.choice(["-5", "0.1", "30"]), node.get("code")))
        case "stale key" if conditions:
            node = source.choice(conditions)
            node.set("code", re.sub(r"^\w", source.choice(list(STALE)), node.get("code")))
        case "swapped":
            parent = source.choice([node for node in root.iter("Sequence") if len(node) > 1] or [None])
            if parent is None:
                return None
            first, second = parent[:2]
            parent.insert(0, second)
            names = {node.get("name") for each in (first, second) for node in each.iter()}
            return etree.tostring(root, encoding="unicode"), names
        case "port" if inputs:
            node, port = source.choice(inputs)
            node.set(port, f"{{{source.choice([*KEYS, *STALE])}}}")
        case _:
            return None
    return etree.tostring(root, encoding="unicode"), {node.get("name")}


def run_mission(xml: str, seed: int) -> tuple[Status, RunRecording]:
    """Run a mission until it ends."""
    board = Blackboard()
    for key, value in {**dict.fromkeys(KEYS, 5.0), **STALE}.items():
        board[key] = value
    nodes = Registry.standard()
    nodes.add(sense, reach, grip, double)
    tree = btcore.loads(xml, nodes=nodes, resources=[Random(seed)], clock=SimClock(), blackboard=board)
    run = Run(tree)
    status = RUNNING
    while status is RUNNING:
        status = tree.tick_exactly_once()
    return status, run.end()


def test_the_chain_names_a_seeded_fault() -> None:
    source = Random(1)
    count = 100 if RUNS else 10
    found: list[bool] = []
    while len(found) < count:
        stages = "".join(random_stage(source, str(i)) for i in range(source.randrange(3, 7)))
        xml = MISSION.format(stages)
        seed = source.randrange(10**6)
        faulty = add_fault(xml, source)
        if faulty is None or run_mission(xml, seed)[0] is not SUCCESS:
            continue
        status, recording = run_mission(faulty[0], seed)
        if status is FAILURE:
            chain = Explainer(recording).why().chain
            found.append(bool({link.node for link in chain} & faulty[1]))
    assert sum(found) >= 0.95 * count
