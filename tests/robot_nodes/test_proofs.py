"""The standard questions are proved for the trees of this repository; the large ones are in no sample."""

from pathlib import Path

import pytest

from btcore import Registry
from btcore.status import NodeType
from btcore_proof import assert_proved, prove
from btcore_proof.leaf_models import resources_of
from btcore_proof.prover import UNKNOWN_ANSWER

TREES = Path(__file__).parent.parent.parent / "trees"
NAMES = (
    "bumpgo",
    "bumpgo_wide",
    "mapping",
    "navigation/navigate_w_replanning_time",
    "patrolling",
    "patrolling_book",
    "patrolling_skipping",
    "tutorials/free_space",
    "tutorials/goal_or_home",
    "tutorials/patrolling_boxes",
)


@pytest.mark.parametrize("name", NAMES)
def test_the_standard_questions_are_proved(name: str) -> None:
    nodes = Registry.standard()
    assert nodes.add_installed_libraries() == []
    assert_proved(prove(TREES / f"{name}.xml", nodes=nodes))


def test_the_nodes_of_the_packages_may_run_twice_from_the_same_state(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    # As the nodes of users, so that the declarations of their states are checked.
    monkeypatch.setattr("btcore_proof.user_code._OWN_PACKAGES", ("btcore", "btcore_proof"))
    nodes = Registry.standard()
    nodes.add_installed_libraries()
    found = [
        manifest
        for manifest in nodes.manifests_of(4).values()
        if manifest.library != "btcore"
        and manifest.type in (NodeType.CONTROL, NodeType.DECORATOR)
        and not resources_of(manifest)
    ]
    assert len(found) >= 8
    for manifest in found:
        leaves = '<Action ID="Move"/>' * (2 if manifest.type is NodeType.CONTROL else 1)
        file = tmp_path / f"{manifest.id}.xml"
        names = [name for name in ("path", "current_child_idx") if name in manifest.ports]
        ports = "".join(f' {name}="{{{name}}}"' for name in names)
        file.write_text(
            f'<root BTCPP_format="4"><BehaviorTree ID="T"><Sequence>'
            '<Script code="current_child_idx := 0"/><Repeat num_cycles="-1">'
            f"<{manifest.id}{ports}>{leaves}</{manifest.id}></Repeat></Sequence></BehaviorTree>"
            '<TreeNodesModel><Action ID="Move"/></TreeNodesModel></root>'
        )
        answers = prove(file, nodes=nodes, models=[file]).answers
        assert not [answer.detail for answer in answers if answer.answer == UNKNOWN_ANSWER], manifest.id
