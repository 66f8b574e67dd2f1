"""Models may write outputs in any tick or at a halt, and entries without a port."""

from typing import Annotated

import pytest

from btcore import In, NodeSpec, Out
from btcore_proof.prover import PROVED, REFUTED
from tests.tools.btcore_proof.trees import ConditionLeaf, LastingLeaf, answers_of, prover_of


class Follow(LastingLeaf):
    result: Annotated[Out[str], "The result."]
    progress: Annotated[Out[str], "The progress."]


class Check(ConditionLeaf):
    """Reads an entry that need not be written."""

    value: Annotated[In[str], "The entry."]

    spec = NodeSpec(optional_inputs=("value",))


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
def test_writes_not_depending_on_result(entry: str, declared: dict[str, object], refuted: set[str]) -> None:
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
    questions = {
        "SUCCESS": "never Check is SUCCESS & Follow is SUCCESS",
        "RUNNING": "never Check is SUCCESS & Follow",
        "IDLE": "never After is SUCCESS & Follow halted",
    }
    prover = prover_of(body, *questions.values(), leaves=(Follow, Check), declared={"Follow": declared})
    answers = answers_of(prover)
    found = {name: answers[text].answer for name, text in questions.items()}
    assert found == {name: REFUTED if name in refuted else PROVED for name in found}
