"""The differences between two versions of a document."""

from pathlib import Path
from typing import Any

import pytest

from btcore_studio.compare.comparison import Difference, compare
from btcore_studio.language.project import Project, SourceDocument

SCRIPT = '<Script code="lap := 3"/>'
SLEEP = '<Sleep msec="10"/>'
DOOR = '<Fallback name="door"><AlwaysFailure/><Sleep name="open" msec="5"/></Fallback>'
TREE = f"""<root BTCPP_format="4" main_tree_to_execute="Rounds">
  <include path="part.xml"/>
  <BehaviorTree ID="Rounds">
    <Sequence name="round">
      {SCRIPT}{SLEEP}{SLEEP}{DOOR}
      <Inverter><AlwaysFailure/></Inverter>
      <SubTree ID="Visit"/>
      <SubTree ID="Dock"/>
    </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="Visit">
    <Sequence><Sleep name="turn" msec="6"/><Sleep name="scan" msec="9"/></Sequence>
  </BehaviorTree>
  <TreeNodesModel><Action ID="Go"><input_port name="goal" type="int"/></Action></TreeNodesModel>
</root>
"""
PART = '<root BTCPP_format="4"><BehaviorTree ID="Dock"><Sleep msec="1"/></BehaviorTree></root>'


def differences(old: str, new: str, **options: Any) -> list[Difference]:
    versions = SourceDocument("untitled:old.xml", old), SourceDocument("untitled:new.xml", new)
    return compare(Project(), *versions, **options).differences


def brief(found: list[Difference]) -> list[str]:
    """Return the differences as texts."""
    texts = []
    for item in found:
        attributes = "".join(f" {name or 'type'}: {old} → {new}" for name, old, new in item.attributes)
        spots = (
            "" if item.spots is None else " {0.parent} {0.number} → {1.parent} {1.number}".format(*item.spots)
        )
        count = f" ({item.count})" if item.count != 1 else ""
        texts.append(f"{' '.join(item.changes)} {item.name or item.id}{count}{spots}{attributes}")
    return texts


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        (SCRIPT, '<!-- x --><Script   code="lap := 3" ></Script>', []),
        (SCRIPT, '<Script code="lap := 4"/>', ["changed Script code: lap := 3 → lap := 4"]),
        ('name="open" msec="5"', 'name="open"', ["changed open msec: 5 → None"]),
        (DOOR, "", ["removed door (3)"]),
        (SCRIPT, f"{SCRIPT}<A><B/><C/></A>", ["added A (3)"]),
        # One of two equal nodes, around a node, and from around it.
        (f"{SLEEP}{DOOR}", DOOR, ["removed Sleep"]),
        (f"{SLEEP}{DOOR}", f'<Delay delay_msec="1">{SLEEP}</Delay>{DOOR}', ["added Delay"]),
        (DOOR, f"<Inverter>{DOOR}</Inverter>", ["added Inverter"]),
        ("<Inverter><AlwaysFailure/></Inverter>", "<AlwaysFailure/>", ["removed Inverter"]),
        ("Fallback", "Sequence", ["changed door type: Fallback → Sequence"]),
        ("Inverter", "ForceSuccess", ["changed ForceSuccess type: Inverter → ForceSuccess"]),
        # Outside of the trees, and the names of trees.
        (
            "Rounds",
            "Lap",
            ["changed root main_tree_to_execute: Rounds → Lap", "changed Lap ID: Rounds → Lap"],
        ),
        ('type="int"', 'type="double"', ['changed Go input_port goal: type="int" → type="double"']),
        ('<include path="part.xml"/>', "", ["removed part.xml"]),
    ],
)
def test_an_edit_is_the_expected_difference(before: str, after: str, expected: list[str]) -> None:
    assert before in TREE
    new = TREE.replace(before, after)
    assert brief(differences(TREE, new)) == expected
    assert len(differences(new, TREE)) == len(expected)


def test_moved_nodes() -> None:
    moved = TREE.replace(DOOR, "").replace("<Script ", f"{DOOR}<Script ")
    assert brief(differences(TREE, moved)) == ["moved door round 4 → round 1"]
    into = TREE.replace(DOOR, "").replace("<Inverter><AlwaysFailure/>", f"<Inverter>{DOOR}")
    assert brief(differences(TREE, into)) == [
        "removed AlwaysFailure",
        "moved door round 4 → Inverter 1",
    ]
    both = TREE.replace('<Sleep name="open" msec="5"/>', "").replace(
        '<Sleep name="turn" msec="6"/>', '<Sleep name="turn" msec="6"/><Sleep name="open" msec="7"/>'
    )
    assert brief(differences(TREE, both)) == ["moved changed open door 2 → Sequence 2 msec: 5 → 7"]
    # A branch that becomes a tree is moved there.
    extracted = TREE.replace(DOOR, '<SubTree ID="Door"/>').replace(
        "<TreeNodesModel>", f'<BehaviorTree ID="Door">{DOOR}</BehaviorTree><TreeNodesModel>'
    )
    assert brief(differences(TREE, extracted)) == [
        "added Door",
        "added Door (0)",
        "moved door round 4 → Door 1",
    ]


def test_files_with_includes_no_file_and_a_broken_version(tmp_path: Path) -> None:
    project = Project()

    def source(name: str, text: str) -> SourceDocument:
        file = tmp_path / name
        file.parent.mkdir(exist_ok=True)
        file.write_text(text, encoding="utf-8")
        found = project.file(file)
        assert found is not None
        return found

    old = source("old/tree.xml", TREE)
    # An include that a version lacks, as a temporary file of Git does, is no difference.
    new = source("new/tree.xml", TREE.replace('msec="9"', 'msec="8"'))
    source("new/part.xml", PART)
    found = compare(project, old, new)
    assert brief(found.differences) == ["changed scan msec: 9 → 8"]
    assert found.trees == ["Rounds", "Visit"]
    assert found.old is not None
    assert found.new is not None
    # The main tree shows the difference in a called tree, at the indices of both drawings.
    assert found.tree == "Rounds"
    (scan,) = found.differences
    assert [found.old.nodes[scan.old[0]].name, found.new.nodes[scan.new[0]].name] == ["scan", "scan"]
    assert (scan.old[0], scan.new[0]) in found.pairs
    assert len(found.pairs) == len(found.old.nodes) == len(found.new.nodes) - 1  # without the node of Dock
    # With both files, their trees are compared, too.
    source("old/part.xml", PART.replace('"1"', '"2"'))
    assert "changed Sleep msec: 2 → 1" in brief(
        compare(project, source("old/tree.xml", TREE), new).differences
    )

    nothing = compare(project, SourceDocument("untitled:none", ""), new)
    assert brief(nothing.differences)[-2:] == ["added Rounds (11)", "added Visit (3)"]
    assert nothing.old is None
    broken = compare(project, old, SourceDocument("untitled:new.xml", TREE[: TREE.index("<Inverter")]))
    assert broken.broken[0] == ""
    assert "line" in broken.broken[1]
    assert "removed Inverter (2)" in brief(broken.differences)
    # The tree to show can be chosen.
    assert compare(project, old, new, "Visit").tree == "Visit"
