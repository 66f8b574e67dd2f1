"""ManualSelector: a person chooses."""

import io
import sys

import pytest

import btcore
from btcore import NodeExecutionError, Registry, Status
from btcore.nodes.manual_selector import Prompt


class Answers(Prompt):
    """Answers from a list, and records the options of each question."""

    def __init__(self, *answers: int) -> None:
        self.answers = list(answers)
        self.asked: list[list[str]] = []

    def choose(self, question: str, options: list[str]) -> int:
        self.asked.append(options)
        return self.answers.pop(0)


def tree_of(attributes: str = "", *resources: object) -> btcore.Tree:
    return btcore.loads(
        f"""<root><BehaviorTree ID="Main"><ManualSelector {attributes}>
        <AlwaysSuccess name="yes"/><AlwaysFailure name="no"/></ManualSelector></BehaviorTree></root>""",
        nodes=Registry.standard(),
        resources=resources,
    )


def test_the_chosen_child_is_ticked() -> None:
    answers = Answers(1, 0)
    tree = tree_of("", answers)
    assert [tree.tick_once(), tree.tick_once()] == [Status.FAILURE, Status.SUCCESS]
    assert answers.asked[0] == ["yes", "no", "SUCCESS", "FAILURE", "RUNNING"]


@pytest.mark.parametrize(("answer", "status"), [(2, "SUCCESS"), (3, "FAILURE"), (4, "RUNNING")])
def test_a_result_can_be_chosen_instead(answer: int, status: str) -> None:
    assert tree_of("", Answers(answer)).tick_exactly_once() is Status[status]


def test_repeat_last_selection_prompts_only_once() -> None:
    tree = tree_of('repeat_last_selection="1"', Answers(1))
    assert [tree.tick_once(), tree.tick_once()] == [Status.FAILURE, Status.FAILURE]


def test_invalid_answer_at_the_terminal_repeats_the_question(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("7\nno\n2\n"))
    assert tree_of().tick_once() is Status.FAILURE
    message = capsys.readouterr().out
    assert "'7' is not a number from 1 to 5" in message
    assert "  2  no\n" in message


def test_end_of_input_raises_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(""))
    with pytest.raises(NodeExecutionError, match="no option was chosen"):
        tree_of().tick_once()
