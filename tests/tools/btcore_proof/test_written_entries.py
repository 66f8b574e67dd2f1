"""Models may write outputs in any tick or at a halt, and entries without a port."""

from typing import Annotated

import pytest

from btcore import Condition, In, Out, Registry, StatefulAction, Status, loads
from btcore.clock import Clock
from btcore.tree.tree import Tree
from btcore_proof.model_leaves import Choices, with_model_leaves
from btcore_proof.propositions import parse_question
from btcore_proof.prover import PROVED, REFUTED, Prover


class Follow(StatefulAction):
    """Writes a result and, in between, its progress."""

    result: Annotated[Out[str], "The result."]
    progress: Annotated[Out[str], "The progress."]

    def on_start(self) -> Status:
        """Never called in a proof."""
        raise AssertionError

    on_running = on_start


class Check(Condition):
    """Reads an entry that need not be written."""

    value: Annotated[In[str], "The entry."]

    @staticmethod
    def metadata() -> dict[str, str]:
        """Return that the entry need not be written."""
        return {"optional": "value"}

    def tick(self) -> bool:
        """Never called in a proof."""
        raise AssertionError


@pytest.mark.parametrize(
    ("entry", "declared", "refuted"),
    [
        ("progress", {}, {"SUCCESS"}),
        ("progress", {"writes": ["progress"]}, {"SUCCESS", "RUNNING", "IDLE"}),
        ("result", {"writes": ["progress"]}, {"SUCCESS"}),
        ("count", {}, set()),
        ("count", {"writes": ["count"]}, {"SUCCESS", "RUNNING", "IDLE"}),
        ("result", {"on_halt": ["result"], "results": ["SUCCESS"]}, {"SUCCESS", "IDLE"}),
        ("result", {"on_halt": ["progress"], "results": ["SUCCESS"]}, {"SUCCESS"}),
    ],
)
def test_writes_that_do_not_depend_on_the_result(entry: str, declared: dict[str, object], refuted: set[str]):
    nodes = Registry.standard()
    nodes.add(Follow)
    nodes.add(Check)
    models = with_model_leaves(nodes, {"Follow": declared})
    # The Timeout halts Follow.
    body = f"""<Sequence>
      <ForceSuccess><Timeout msec="9">
        <Parallel success_count="-1" failure_count="-1">
          <Follow result="{{result}}" progress="{{progress}}"/>
          <ForceSuccess><Check name="Check" value="{{{entry}}}"/></ForceSuccess>
        </Parallel>
      </Timeout></ForceSuccess>
      <Check name="After" value="{{{entry}}}"/>
    </Sequence>"""
    xml = f'<root BTCPP_format="4"><BehaviorTree ID="T">{body}</BehaviorTree></root>'

    def make(choices: Choices, clock: Clock) -> Tree:
        return loads(xml, nodes=models, resources=[choices], clock=clock)

    questions = {
        "SUCCESS": "never Check is SUCCESS & Follow is SUCCESS",
        "RUNNING": "never Check is SUCCESS & Follow",
        "IDLE": "never After is SUCCESS & Follow halted",
    }
    prover = Prover(make, [parse_question(text) for text in questions.values()])
    answers = {answer.question: answer.answer for answer in prover.answer().answers}
    found = {name: answers[text] for name, text in questions.items()}
    assert found == {name: REFUTED if name in refuted else PROVED for name in found}
