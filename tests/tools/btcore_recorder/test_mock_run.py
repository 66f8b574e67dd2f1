"""Runs with mock leaves: they do what mock leaves of a test do, and are recordings."""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from random import Random

import pytest

from btcore import BtcoreError, NodeExecutionError, Registry, SimClock, Status
from btcore.loading.instantiate import instantiate
from btcore.logs.moments import Moment
from btcore.registry.mock_leaves import Outcomes
from btcore.registry.outcome_grammar import Outcome
from btcore.status import FAILURE, IDLE, RUNNING, SUCCESS
from btcore.xml.models.model_file import add_document_models
from btcore.xml.plan.plan import Plans, plan_document
from btcore.xml.read.read import parse_text
from btcore_recorder import Replay, assert_runs_as_recorded, mock_leaves, mock_run
from btcore_recorder.inputs import Result
from btcore_recorder.mock_leaves import LeafPlan
from btcore_recorder.mock_run import MAX_OUTPUT, MockRun

MODELS = """
  <TreeNodesModel>
    <Condition ID="IsClosed"/>
    <Action ID="Open">
      <input_port name="door"/>
      <output_port name="angle" type="int"/>
      <output_port name="view" type="my::View"/>
      <output_port name="note"/>
    </Action>
    <Action ID="Pass"/>
    <Decorator ID="Light"/>
    <Control ID="Both"/>
  </TreeNodesModel>
</root>"""
DOOR = """
  <ReactiveSequence name="round">
    <IsClosed/>
    <Sequence name="enter">
      <Open door="front" angle="{a}" view="{v}"/> <Script code="b := a + 1"/> <Pass/>
    </Sequence>
  </ReactiveSequence>"""
CODELESS = """
  <Timeout msec="250"> <Fallback>
    <Light> <Both> <Pass name="p"/> <Light> <Open/> </Light> <Pass name="q" _skipIf="k"/> </Both> </Light>
    <Both> <IsClosed/> <Pass name="r"/> </Both>
  </Fallback> </Timeout>"""
TIMED = """
  <ReactiveFallback>
    <Timeout msec="350">
      <Sequence> <Pass name="p"/> <Sleep msec="150"/> <Pass name="q"/> </Sequence>
    </Timeout>
    <Parallel success_count="1"> <Pass name="r"/> <Delay delay_msec="200"> <IsClosed/> </Delay> </Parallel>
  </ReactiveFallback>"""
LOOPS = """
  <Sequence>
    <Repeat num_cycles="3">
      <RetryUntilSuccessful num_attempts="2"> <Pass name="p"/> </RetryUntilSuccessful>
    </Repeat>
    <SubTree ID="Sub" x="{y}"/>
  </Sequence>"""
SUB = '<Sequence> <Script code="k := true"/> <IsClosed/> <Pass name="q"/> </Sequence>'


def plans_of(tree: str, format: int = 4) -> Plans:
    trees = {"Main": tree, "Sub": SUB if format == 4 else "<Pass/>"}
    parts = [f'<BehaviorTree ID="{id}"> {root} </BehaviorTree>' for id, root in trees.items()]
    head = f'<root BTCPP_format="{format}" main_tree_to_execute="Main">'
    document = parse_text("".join([head, *parts, MODELS]), "door.xml")
    nodes = Registry.standard()
    add_document_models(nodes, document)
    return plan_document(document, nodes)


def run_of(tree: str) -> MockRun:
    return MockRun(plans_of(tree))


def names(run: MockRun, moment: Moment) -> Mapping[str, Status]:
    """Return the statuses of the moment by the names of the nodes, except IDLE."""
    nodes = Replay(run.recording).tree.nodes
    return {node.name: status for node, status in zip(nodes, moment.statuses, strict=True) if status}


def plan_all(run: MockRun, outcomes: Mapping[str, str]) -> None:
    for node in Replay(run.recording).tree.nodes:
        if node.uid in run.leaves:
            run.set_plan(node.uid, outcomes[node.name])


def random_outcomes(source: Random, name: str) -> str:
    letters = "SSFFK" if name == "IsClosed" else "RRRSSSSSFFFFKX"
    outcomes = "".join(source.choices(letters, k=source.randint(1, 9))) + "S"
    return outcomes.replace("S", "S(angle=3)") if name == "Open" else outcomes


@pytest.mark.parametrize("tree", [DOOR, CODELESS, TIMED, LOOPS])
def test_a_planned_run_does_what_mock_leaves_do(tree: str) -> None:
    source, plans = Random(tree), plans_of(tree)
    seen: set[Status] = set()
    for _ in range(8):
        expected, run = instantiate(plans, (), None, SimClock()), MockRun(plans)
        leaves = [expected.nodes[uid - 1].name for uid in run.leaves]
        outcomes = {name: random_outcomes(source, name) for name in leaves}
        Outcomes("S", outcomes).attach(expected)
        plan_all(run, outcomes)
        for tick in range(1, 16):
            root = IDLE  # after an exception
            with suppress(NodeExecutionError):
                root = expected.tick_exactly_once()
            expected.sleep(0.1)
            moment = run.advance("tick")
            assert (moment.position, moment.tick, moment.root) == (tick, tick, root), outcomes
            assert moment.statuses == tuple(node.status for node in expected.nodes), (outcomes, tick)
            seen.add(root)
        assert Replay(run.recording).verify() is None
    assert seen >= {RUNNING, SUCCESS, FAILURE}


def test_a_tick_asks_each_leaf_that_has_no_answer() -> None:
    run = run_of(DOOR)
    moment = run.advance("tick")
    assert (moment.position, moment.tick, run.count) == (0, 1, 0)
    assert run.question is not None
    assert run.question[1:] == ("IsClosed::2", {}, [], True)
    assert names(run, moment) == {"round": RUNNING}
    moment = run.answer("S", {})
    assert run.question is not None
    assert run.question[1:4] == (
        "Open::4",
        {"door": "front"},
        [("angle", "int", "a"), ("view", "my::View", "v")],
    )
    assert names(run, moment) == {"round": RUNNING, "IsClosed": SUCCESS, "enter": RUNNING}
    moment = run.answer("S", {"angle": "7", "view": "wide"})
    assert ("", "b", "8") in moment.entries  # the Script runs in the tick that waits for the next answer
    assert ("", "v", "wide (not replayable)") in moment.entries
    assert moment.leaves[1][3:5] == ({"door": "front"}, {"angle": "7", "view": "wide (not replayable)"})
    assert run.advance("tick") == moment  # without an answer, nothing happens
    moment = run.answer("R", {})
    assert (moment.position, moment.root, run.event, run.question) == (1, RUNNING, 0, None)
    assert names(run, moment)["Pass"] is RUNNING
    assert run.advance("tick").time == 100_000_000


def test_an_answer_that_is_refused_changes_nothing() -> None:
    run = run_of(DOOR)
    with pytest.raises(BtcoreError, match="no leaf waits"):
        run.answer("S", {})
    run.advance("tick")
    before = run.answer("S", {})
    question = run.question
    for letter, outputs, message in (
        ("S", {"angle": "far"}, r"port \[angle\] takes int: 'far'"),
        ("S", {"angel": "1"}, "no output port 'angel'; did you mean 'angle'"),
        ("S", {"view": "x" * (MAX_OUTPUT + 1)}, "at most 10,000 characters"),
        ("Z", {}, "'Z' is not a possible result of 'Open::4'"),
    ):
        with pytest.raises(BtcoreError, match=message):
            run.answer(letter, outputs)
        assert run.question == question
    assert run.advance("tick") == before
    run.answer("S", {"angle": "1"})
    assert run.answers[4] == [Outcome("S", (("angle", "1"),))]


def test_a_value_that_the_entry_does_not_take_is_refused() -> None:
    run = run_of('<Sequence> <Open name="a" angle="{v}"/> <Open name="b" note="{v}"/> </Sequence>')
    run.advance("tick")
    asked = run.answer("S", {"angle": "2"})
    with pytest.raises(BtcoreError, match="'far' is not an integer"):
        run.answer("S", {"note": "far"})
    assert run.question is not None
    assert run.question.path == "b"
    assert run.advance("tick") == asked
    assert run.answer("S", {"note": "5"}).entries == (("", "v", "5"),)


def test_steps_within_a_tick_lead_into_over_and_out_of_nodes() -> None:
    run = run_of(DOOR)
    plan_all(run, {"IsClosed": "S", "Open": "S(angle=1)", "Pass": "R"})
    root, closed, enter, open_, script, pass_ = range(1, 7)
    into = []
    while run.count == 0:
        moment = run.advance("into")
        into.append((run.stopped_at, run.event))
    order = [root, closed, closed, enter, open_, open_, script, script, pass_, pass_, enter, root]
    assert into == [*((uid, number) for number, uid in enumerate(order, 1)), (0, 0)]
    run.at(0)
    assert [run.advance("into") and run.stopped_at for _ in range(4)] == [root, closed, closed, enter]
    over = run.advance("over")
    assert (run.stopped_at, run.event, names(run, over)["Pass"]) == (enter, 11, RUNNING)
    moment = run.at(0, event=5)
    assert (run.stopped_at, [leaf.path for leaf in moment.leaves]) == (open_, ["IsClosed::2"])
    assert ("", "a", "–") in moment.entries
    assert run.at(0, event=6).statuses[open_ - 1] is SUCCESS
    assert run.advance("out") == over
    run.advance("out")
    assert run.stopped_at == root
    assert run.advance("out").position == 1


def test_over_and_out_continue_after_a_question() -> None:
    run = run_of(DOOR)
    for _ in range(2):
        run.advance("into")
    moment = run.advance("over")
    assert run.question is not None
    moment = run.answer("S", {})
    assert (run.stopped_at, names(run, moment)["IsClosed"]) == (2, SUCCESS)
    run.advance("into")
    run.advance("over")
    for outputs in ({"angle": "1"}, {}):
        moment = run.answer("S", outputs)
    assert (run.stopped_at, run.question, names(run, moment)["enter"]) == (3, None, SUCCESS)


def test_every_moment_can_be_visited_again_in_any_order() -> None:
    run = run_of(TIMED)
    plan_all(run, {"p": "RS|F", "q": "RRRS", "r": "RF", "IsClosed": "SF"})
    seen: dict[tuple[int, int], Moment] = {}
    for number in range(40):
        moment = run.advance("into" if number % 3 else "over")
        seen[moment.position, run.event] = moment
    recorded = run.recording
    order = list(seen)
    Random(1).shuffle(order)
    for position, event in order:
        moment = run.at(position, event=event)
        within = moment if event else moment._replace(leaves=seen[position, 0].leaves)
        assert within == seen[position, event]
    assert run.recording == recorded
    assert Replay(run.recording).verify() is None


def test_a_run_can_be_cut_and_continued_otherwise() -> None:
    run = run_of(DOOR)
    plan_all(run, {"IsClosed": "S", "Open": "RRS(angle=1)", "Pass": "S"})
    first = [run.advance("tick").root for _ in range(3)]
    assert first == [RUNNING, RUNNING, SUCCESS]
    run.at(1, event=4)
    run.forget_later_steps()
    assert run.count == 1
    run.set_plan(2, "F")
    assert run.at(1).tick == 1
    assert run.advance("tick").root is FAILURE
    run.set_plan(2, "S")
    assert [run.advance("tick").root for _ in range(3)] == first  # a new start of <Open>
    assert Replay(run.recording).verify() is None


def test_a_new_run_of_an_edited_tree_repeats_the_answers() -> None:
    run = run_of(DOOR)
    for letter, outputs in (("S", {}), ("R", {}), ("S", {}), ("S", {"angle": "3"}), ("S", {})):
        if run.question is None:
            run.advance("tick")
        run.answer(letter, outputs)
    assert (run.count, run.roots[-1]) == (2, SUCCESS)
    edited = DOOR.replace("a + 1", "a + 5").replace("<Pass/>", "<Pass/> <Pass/>")
    again = MockRun(plans_of(edited))
    for uid, answers in run.answers.items():
        again.repeat(uid, answers)
    assert again.advance("tick").root is RUNNING
    assert ("", "b", "8") in again.advance("tick").entries
    assert again.question is not None
    assert again.question.path == "Pass::7"
    assert again.answer("S", {}).root is SUCCESS


def test_a_repeated_answer_that_does_not_fit_any_more_is_a_problem() -> None:
    run = run_of('<Open angle="{x}"/>')
    run.repeat(1, [Outcome("S", (("angle", "far"),))])
    run.advance("tick")
    assert run.problem.startswith("'Open::1': port [angle] takes int")


def test_chances_depend_on_their_seed_alone() -> None:
    def results(chance: float, seed: int) -> list[Status]:
        run = run_of("<Pass/>")
        run.set_plan(1, chance=chance, seed=seed)
        for _ in range(60):
            run.advance("tick")
        run.at(20)
        run.forget_later_steps()
        for _ in range(40):
            run.advance("tick")
        assert run.leaves == {1: LeafPlan("", chance, seed)}
        return list(run.roots)

    first = results(0.7, 1)
    assert first == results(0.7, 1)
    assert first != results(0.7, 2)
    assert 30 < first.count(SUCCESS) < 55
    assert set(results(0, 1)) == {FAILURE}


def test_invalid_plans_are_refused() -> None:
    run = run_of(DOOR)
    for uid, plan, message in (
        (1, LeafPlan("S"), "no mock leaf"),
        (4, LeafPlan("SZ"), "invalid outcomes"),
        (4, LeafPlan("S(angel=1)"), "no output port 'angel'"),
        (4, LeafPlan("S(angle=far)"), "takes int"),
        (4, LeafPlan("", 1.5), "between 0 and 1"),
        (4, LeafPlan("", float("nan")), "between 0 and 1"),
    ):
        with pytest.raises(BtcoreError, match=message):
            run.set_plan(uid, *plan)
    assert set(run.leaves.values()) == {LeafPlan()}


def test_a_tick_without_an_end_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mock_leaves, "MAX_EVENTS", 200)
    run = MockRun(plans_of('<Repeat num_cycles="-1"> <Pass/> </Repeat>', format=3))
    run.set_plan(2, "S")
    moment = run.advance("tick")
    assert "the tick does not end" in run.problem
    assert (moment.position, run.count, names(run, moment)["Repeat"]) == (0, 0, RUNNING)
    assert run.at(0).statuses == (IDLE, IDLE)
    assert not run.problem


def test_the_length_of_a_run_is_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mock_run, "MAX_TICKS", 3)
    monkeypatch.setattr(mock_run, "MAX_ANSWERS", 5)
    for tree, ticks, problem in (("<Pass/>", 3, "at most 3 ticks"), (DOOR, 1, "at most 5 answers")):
        run = run_of(tree)
        plan_all(run, {"IsClosed": "S", "Open": "S(angle=1)", "Pass": "S"})
        for _ in range(5):
            run.advance("tick")
        assert run.count == ticks
        assert problem in run.problem


def test_a_run_is_saved_as_a_recording_and_as_a_test(tmp_path: Path) -> None:
    run = run_of(DOOR)
    with pytest.raises(BtcoreError, match="nothing to test"):
        run.test_text("door", "door.xml")
    plan_all(run, {"IsClosed": "SSF", "Open": "R|S(angle=2, view=wide)", "Pass": "SX"})
    for _ in range(5):
        run.advance("tick")
    file, tree = tmp_path / "door.btrec.txt", tmp_path / "door.xml"
    file.write_text(run.recording_text(), encoding="utf-8")
    tree.write_text(run.recording.head.documents[0][1], encoding="utf-8")
    replay = Replay(file)
    assert (replay.verify(), len(replay.steps)) == (None, 5)
    assert [type(event) for event in replay.steps[0].inputs] == [Result, Result]
    assert_runs_as_recorded(file, tree=tree)
    source = run.test_text("door", "door.xml")
    assert 'FOLDER / "door.btrec.txt", tree=FOLDER / "door.xml"' in source
    test: dict[str, object] = {"__file__": str(tmp_path / "test_door.py")}
    exec(compile(source, "test_door.py", "exec"), test)
    with pytest.raises(AssertionError, match="the tree fails in tick"):
        test["test_door"]()  # type: ignore[operator]
