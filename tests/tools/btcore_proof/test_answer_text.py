"""Answers as text: long runs and big trees are shown in part."""

from pathlib import Path

from btcore.tree.drawing import to_text
from btcore_proof import Answer, prove
from btcore_proof.answer_text import lines_of_answer

XML = """
<root BTCPP_format="4">
  <BehaviorTree ID="Main">
    <Fallback>
      <Sequence>
        <Repeat num_cycles="50"> <Delay delay_msec="10"> <Action ID="Step"/> </Delay> </Repeat>
        {}
      </Sequence>
    </Fallback>
  </BehaviorTree>
</root>"""


def shown(answer: Answer) -> str:
    return to_text(lines_of_answer(answer))


def test_long_run_shows_its_first_and_last_ticks(tmp_path: Path) -> None:
    file = tmp_path / "tree.xml"
    file.write_text(XML.format('<Action ID="Rest"/>'), encoding="utf-8")
    text = shown(prove(file, "never Rest", models=[file]).answers[-1])
    lines = text.splitlines()
    assert lines[0] == "✘ never Rest  refuted"
    ticks = [line for line in lines if " s  " in line]
    assert len(ticks) == 24
    assert "         … 27 ticks …" in lines
    assert ticks[-1].split() == ["51", "5.0", "s", "Step", "SUCCESS,", "Rest", "RUNNING", "→", "RUNNING"]


def test_nodes_of_a_big_tree_that_were_not_ticked_are_counted(tmp_path: Path) -> None:
    file = tmp_path / "tree.xml"
    more = "".join(f'<Action ID="Rest{number}"/>' for number in range(25))
    file.write_text(XML.format(more), encoding="utf-8")
    text = shown(prove(file, "never Delay", models=[file]).answers[-1])
    assert "▪ Step  ○ IDLE" not in text
    assert text.splitlines()[-1].strip() == "… 26 nodes not ticked"
