"""The models that leaves have without a declaration."""

from pathlib import Path

from btcore.registry.registry import Registry
from btcore.xml.models.model_file import add_models
from btcore_proof.leaf_models import model_of

MODELS = """<root BTCPP_format="4"><TreeNodesModel>
<Action ID="Move"/><Condition ID="Ready"/>
</TreeNodesModel></root>"""


def test_leaves_that_only_a_model_declares_share_no_resource(tmp_path: Path) -> None:
    (tmp_path / "models.xml").write_text(MODELS)
    nodes = Registry.standard()
    add_models(nodes, tmp_path / "models.xml")
    for id in ("Move", "Ready"):
        assert model_of(nodes.manifests_of(4)[id]).uses == frozenset()
