"""Runs with given outcomes: how they violate questions, and which result a leaf takes that has none."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from btcore_proof import Answer, OutcomesError, assert_proved, prove
from btcore_proof.declarations import Declarations
from btcore_proof.outcome_replay import TickOutcomes, recorded_outcomes
from btcore_proof.standard_questions import ENDS
from btcore_proof.tree_files import _plans, fault_in_run, record_counterexample

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


def assert_holds(
    file: Path, question: str, ticks: Sequence[TickOutcomes], cycle: tuple[int, float] | None = None
) -> None:
    declared = Declarations()
    plans = _plans(file, None, [file], None, None, declared)
    fault = fault_in_run(plans, question, ticks, cycle, {}, declared)
    if fault is not None:
        raise AssertionError(f"{question}: {fault}")


def recorded(file: Path, answer: Answer) -> Sequence[TickOutcomes]:
    """Record the counterexample of *answer*, and return the outcomes in the recording."""
    declared, recording = Declarations(), file.with_name("run.btrec.txt")
    plans = _plans(file, None, [file], None, None, declared)
    assert record_counterexample(plans, answer, declared, recording)
    return recorded_outcomes(recording)[0]


def test_run_that_violates_the_question_fails(file: Path) -> None:
    file.write_text(SEQUENCE.format(kind="Sequence"))
    ticks = [(0.0, {"Ready": "S", "Grasp": "R"}), (0.1, {"Grasp": "S", "Lift": "R"})]
    with pytest.raises(AssertionError, match="never Lift: 'Lift' holds"):
        assert_holds(file, "never Lift", ticks)
    with pytest.raises(AssertionError, match="'Lift' does not hold within 0 ticks"):
        assert_holds(file, "Grasp leads to Lift within 0 ticks", ticks)
    assert_holds(file, "Grasp leads to Lift within 1 tick", ticks)
    assert_holds(file, "Grasp before Lift", ticks)
    with pytest.raises(AssertionError, match="'Grasp' holds before 'Lift'"):
        assert_holds(file, "Lift before Grasp", ticks)


def test_leaf_without_an_outcome_takes_its_next_result_then_repeats_the_last(file: Path) -> None:
    file.write_text(SEQUENCE.format(kind="ReactiveSequence"))
    # Ready has outcomes in the first and the third tick only.
    ticks = [(0.0, {"Ready": "S", "Grasp": "R"}), (0.1, {"Grasp": "R"}), (0.2, {"Ready": "F"})]
    with pytest.raises(AssertionError, match="'Ready is FAILURE & Grasp halted' holds"):
        assert_holds(file, "never Ready is FAILURE & Grasp halted", ticks)
    # Beyond its outcomes, Ready still succeeds, but Grasp does not run forever.
    ticks = [(0.0, {"Ready": "S", "Grasp": "R"}), (0.1, {}), (0.2, {})]
    assert_holds(file, "never Ready is FAILURE", ticks)
    with pytest.raises(AssertionError):
        assert_holds(file, "never Grasp is SUCCESS", ticks)


def test_cycle_is_repeated_until_the_tree_ends(file: Path) -> None:
    file.write_text(RETRY.format(attempts=-1))
    # No outcome lets the endless loop end.
    ticks = [(0.0, {"Ready": "S", "Grasp": "R"}), (0.1, {"Ready": "S", "Grasp": "S(object=?)"})]
    with pytest.raises(AssertionError, match="still RUNNING"):
        assert_holds(file, ENDS, ticks, cycle=(0, 0.2))
    file.write_text(RETRY.format(attempts=50))
    assert_holds(file, ENDS, ticks, cycle=(0, 0.2))


def test_action_ends_in_a_cycle_that_halted_it_before_the_tree_was_mended(file: Path) -> None:
    tree = RETRY.format(attempts=1).replace("<Sequence>", """<ReactiveSequence> <Sleep msec="1000"/>""")
    file.write_text(tree.replace("</Sequence>", "</ReactiveSequence>"))
    answer = prove(file, models=[file]).answers[0]
    run = answer.counterexample
    assert (answer.question, answer.answer) == (ENDS, "refuted")
    assert run is not None
    assert run.cycle is not None
    ticks, cycle = recorded(file, answer), run.recorded_cycle
    with pytest.raises(AssertionError, match="still RUNNING"):
        assert_holds(file, ENDS, ticks, cycle=cycle)
    file.write_text(RETRY.format(attempts=1))
    assert_holds(file, ENDS, ticks, cycle=cycle)


def test_outcomes_of_a_counterexample_repeat_it(file: Path) -> None:
    file.write_text(RETRY.format(attempts=2))
    question = "Grasp is SUCCESS leads to Ready is SUCCESS & Grasp is FAILURE"
    answer = prove(file, question, models=[file]).answers[-1]
    ticks = recorded(file, answer)
    with pytest.raises(AssertionError, match="does not follow"):
        assert_holds(file, question, ticks)


@pytest.mark.parametrize(
    ("leaves", "question", "message"),
    [
        ({"Grsp": "S"}, "never Lift", "no leaf 'Grsp'; did you mean 'Grasp'"),
        ({"Grasp": "SUCCESS"}, "never Lift", "'Grasp': invalid outcomes 'SUCCESS'"),
        ({"Grasp": "X"}, "never Lift", "'Grasp': the outcomes 'X' contain X"),
        ({}, "every leaf is ticked, and can succeed and fail", "not a question about a single run"),
    ],
)
def test_bad_outcomes_are_refused(file: Path, leaves: dict[str, str], question: str, message: str) -> None:
    file.write_text(SEQUENCE.format(kind="Sequence"))
    with pytest.raises(OutcomesError, match=message):
        assert_holds(file, question, [(0.0, leaves)])


def test_assert_proved_shows_the_counterexample(file: Path) -> None:
    file.write_text(SEQUENCE.format(kind="Sequence"))
    assert_proved(prove(file, "Grasp is SUCCESS before Lift", models=[file]))
    with pytest.raises(AssertionError) as error:
        assert_proved(prove(file, "never Lift", models=[file]))
    lines = str(error.value).splitlines()
    assert lines[:3] == [
        "not everything is proved:",
        "✘ never Lift  refuted",
        "      1     0.0 s  Ready SUCCESS, Grasp SUCCESS, Lift RUNNING  → RUNNING",
    ]
    with pytest.raises(AssertionError, match="unknown: runs of more than 1 ticks were not searched"):
        assert_proved(prove(file, models=[file], ticks=1))
    with pytest.raises(AssertionError, match="never Lift  unknown: the time limit of 1e-09 s was reached"):
        assert_proved(prove(file, "never Lift", models=[file], seconds=1e-9))


def test_ticks_repeat_the_time_that_passes_within_a_tick(file: Path) -> None:
    tree = """<root BTCPP_format="4"> <BehaviorTree ID="T"> <Parallel success_count="2">
        <Sequence> <Sleep msec="{first}"/> <Action ID="Right"/> </Sequence>
        <Sequence> <Condition ID="Ready"/> <Sleep msec="1000"/> <Action ID="Left"/> </Sequence>
    </Parallel> </BehaviorTree> </root>"""
    file.write_text(tree.format(first=1001))
    question = "never Right & !Left"
    ticks = recorded(file, prove(file, question, models=[file]).answers[-1])
    with pytest.raises(AssertionError, match="holds"):
        assert_holds(file, question, ticks)
    file.write_text(tree.format(first=2001))
    assert_holds(file, question, ticks)


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
    with pytest.raises(AssertionError, match="holds"):
        assert_holds(file, question, recorded(file, answer))
