"""Runs with planned results: `assert_holds_in_run`, and which result a leaf takes that has no plan."""

from pathlib import Path

import pytest

from btcore_proof import PlanError, assert_holds_in_run, assert_proved, prove
from btcore_proof.planned_run import planned_ticks
from btcore_proof.standard_questions import ENDS

RETRY = """
<root BTCPP_format="4">
  <BehaviorTree ID="Main">
    <RetryUntilSuccessful num_attempts="{attempts}">
      <Sequence> <Condition ID="Ready"/> <Action ID="Grasp" object="{{object}}"/> <AlwaysFailure/> </Sequence>
    </RetryUntilSuccessful>
  </BehaviorTree>
  <TreeNodesModel> <Action ID="Grasp"> <output_port name="object"/> </Action> </TreeNodesModel>
</root>"""
SEQUENCE = """
<root BTCPP_format="4">
  <BehaviorTree ID="Main">
    <{kind}> <Condition ID="Ready"/> <Action ID="Grasp"/> <Action ID="Lift"/> </{kind}>
  </BehaviorTree>
</root>"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "tree.xml"


def test_run_that_violates_the_question_fails(file: Path) -> None:
    file.write_text(SEQUENCE.format(kind="Sequence"))
    plan = [(0.0, {"Ready": "SUCCESS", "Grasp": "RUNNING"}), (0.1, {"Grasp": "SUCCESS", "Lift": "RUNNING"})]
    with pytest.raises(AssertionError, match="never Lift: 'Lift' holds"):
        assert_holds_in_run(file, "never Lift", plan, models=[file])
    with pytest.raises(AssertionError, match="'Lift' does not hold within 0 ticks"):
        assert_holds_in_run(file, "Grasp leads to Lift within 0 ticks", plan, models=[file])
    assert_holds_in_run(file, "Grasp leads to Lift within 1 tick", plan, models=[file])
    assert_holds_in_run(file, "Grasp before Lift", plan, models=[file])
    with pytest.raises(AssertionError, match="'Grasp' holds before 'Lift'"):
        assert_holds_in_run(file, "Lift before Grasp", plan, models=[file])


def test_leaf_without_a_plan_takes_its_next_result_then_repeats_the_last(file: Path) -> None:
    file.write_text(SEQUENCE.format(kind="ReactiveSequence"))
    # Ready is planned for the first and the third tick only.
    plan = [
        (0.0, {"Ready": "SUCCESS", "Grasp": "RUNNING"}),
        (0.1, {"Grasp": "RUNNING"}),
        (0.2, {"Ready": "FAILURE"}),
    ]
    with pytest.raises(AssertionError, match="'Ready is FAILURE & Grasp halted' holds"):
        assert_holds_in_run(file, "never Ready is FAILURE & Grasp halted", plan, models=[file])
    # Beyond its plan, Ready still succeeds, but Grasp does not run forever.
    plan = [(0.0, {"Ready": "SUCCESS", "Grasp": "RUNNING"}), (0.1, {}), (0.2, {})]
    assert_holds_in_run(file, "never Ready is FAILURE", plan, models=[file])
    with pytest.raises(AssertionError):
        assert_holds_in_run(file, "never Grasp is SUCCESS", plan, models=[file])


def test_cycle_is_repeated_until_the_tree_ends(file: Path) -> None:
    file.write_text(RETRY.format(attempts=-1))
    # Nothing that is planned lets the endless loop end.
    plan = [
        (0.0, {"Ready": "SUCCESS", "Grasp": "RUNNING"}),
        (0.1, {"Ready": "SUCCESS", "Grasp": ("SUCCESS", {"object": "?"})}),
    ]
    with pytest.raises(AssertionError, match="still RUNNING"):
        assert_holds_in_run(file, ENDS, plan, cycle=(0, 0.2), models=[file])
    file.write_text(RETRY.format(attempts=50))
    assert_holds_in_run(file, ENDS, plan, cycle=(0, 0.2), models=[file])


def test_action_ends_in_a_cycle_that_halted_it_before_the_tree_was_mended(file: Path) -> None:
    tree = RETRY.format(attempts=1).replace("<Sequence>", """<ReactiveSequence> <Sleep msec="1000"/>""")
    file.write_text(tree.replace("</Sequence>", "</ReactiveSequence>"))
    answer = prove(file, models=[file]).answers[0]
    run = answer.counterexample
    assert (answer.question, answer.answer) == (ENDS, "refuted")
    assert run is not None
    assert run.cycle is not None
    plan, cycle = planned_ticks(run), (run.cycle, run.period)
    with pytest.raises(AssertionError, match="still RUNNING"):
        assert_holds_in_run(file, ENDS, plan, cycle=cycle, models=[file])
    file.write_text(RETRY.format(attempts=1))
    assert_holds_in_run(file, ENDS, plan, cycle=cycle, models=[file])


def test_plan_of_a_counterexample_repeats_it(file: Path) -> None:
    file.write_text(RETRY.format(attempts=2))
    question = "Grasp is SUCCESS leads to Ready is SUCCESS & Grasp is FAILURE"
    answer = prove(file, question, models=[file]).answers[-1]
    assert answer.counterexample is not None
    plan = planned_ticks(answer.counterexample)
    with pytest.raises(AssertionError, match="does not follow"):
        assert_holds_in_run(file, question, plan, models=[file])


@pytest.mark.parametrize(
    ("plan", "question", "message"),
    [
        ({"Grsp": "SUCCESS"}, "never Lift", "no such leaf; did you mean 'Grasp'"),
        ({"Grasp": "SUCESS"}, "never Lift", "'SUCESS' is not a result"),
        ({"Grasp": []}, "never Lift", "the plan of 'Grasp' is empty"),
        ({}, "every leaf is ticked, and can succeed and fail", "not a question about a single run"),
    ],
)
def test_errors_in_plans(file: Path, plan: dict[str, str], question: str, message: str) -> None:
    file.write_text(SEQUENCE.format(kind="Sequence"))
    with pytest.raises(PlanError, match=message):
        assert_holds_in_run(file, question, [(0.0, plan)], models=[file])


def test_assert_proved_shows_the_counterexample(file: Path) -> None:
    file.write_text(SEQUENCE.format(kind="Sequence"))
    assert_proved(file, "Grasp is SUCCESS before Lift", models=[file])
    with pytest.raises(AssertionError) as error:
        assert_proved(file, "never Lift", models=[file])
    lines = str(error.value).splitlines()
    assert lines[:3] == [
        f"not everything is proved about '{file}':",
        "✘ never Lift  refuted",
        "      1     0.0 s  Ready SUCCESS, Grasp SUCCESS, Lift RUNNING  → RUNNING",
    ]
    with pytest.raises(AssertionError, match="unknown: runs of more than 1 ticks were not searched"):
        assert_proved(file, models=[file], ticks=1)
    with pytest.raises(AssertionError, match="never Lift  unknown: the time limit of 1e-09 s was reached"):
        assert_proved(file, "never Lift", models=[file], seconds=1e-9)


def test_plan_repeats_the_time_that_passes_within_a_tick(file: Path) -> None:
    tree = """<root BTCPP_format="4"> <BehaviorTree ID="T"> <Parallel success_count="2">
        <Sequence> <Sleep msec="{first}"/> <Action ID="Right"/> </Sequence>
        <Sequence> <Condition ID="Ready"/> <Sleep msec="1000"/> <Action ID="Left"/> </Sequence>
    </Parallel> </BehaviorTree> </root>"""
    file.write_text(tree.format(first=1001))
    question = "never Right & !Left"
    run = prove(file, question, models=[file]).answers[-1].counterexample
    assert run is not None
    plan = planned_ticks(run)
    with pytest.raises(AssertionError, match="holds"):
        assert_holds_in_run(file, question, plan, models=[file])
    file.write_text(tree.format(first=2001))
    assert_holds_in_run(file, question, plan, models=[file])


COUNTED = """
<root BTCPP_format="4">
  <BehaviorTree ID="Main">
    <Sequence>
      <CW x="{{x}}"/> <Script code="n := 0"/>
      <Repeat num_cycles="2">
        <ForceSuccess> <{control}>
          <Script code="n += 1"/>
          <ForceSuccess>
            <Sequence> <ScriptCondition code="n == 2"/> <CW2 x="{{x}}"/> </Sequence>
          </ForceSuccess>
          <SkipUnlessUpdated entry="{entry}">
            <IfThenElse> <ScriptCondition code="n == 1"/> <Left/> <Right/> </IfThenElse>
          </SkipUnlessUpdated>
        </{control}> </ForceSuccess>
      </Repeat>
    </Sequence>
  </BehaviorTree>
  <TreeNodesModel>
    <Action ID="CW"> <output_port name="x"/> </Action>
    <Action ID="CW2">
      <output_port name="x"/> <MetadataFields> <Metadata early="true"/> </MetadataFields>
    </Action>
    <Action ID="Left"/> <Action ID="Right"/>
  </TreeNodesModel>
</root>"""


@pytest.mark.parametrize("entry", ["{x}", "x"])
@pytest.mark.parametrize(
    ("control", "question"),
    [
        ("Sequence", "never CW2 is FAILURE & Right"),
        # The decorator checks the entry while CW2 is RUNNING.
        ("ParallelAll", "never CW2 & Right"),
    ],
)
def test_an_unknown_value_that_is_written_again_counts_as_an_update(
    file: Path, entry: str, control: str, question: str
) -> None:
    file.write_text(COUNTED.format(control=control, entry=entry))
    answer = prove(file, question, models=[file]).answers[-1]
    assert answer.answer == "refuted"
    run = answer.counterexample
    assert run is not None
    with pytest.raises(AssertionError, match="holds"):
        assert_holds_in_run(file, question, planned_ticks(run), models=[file])
