"""A tree in two files, whose names are hostile and not ASCII, and its preview."""

from collections.abc import Iterator
from pathlib import Path
from threading import Thread

import pytest

from btcore.registry.registry import Registry
from btcore_studio.preview.server import PreviewServer
from btcore_studio.preview.session import PreviewSession
from btcore_studio.preview.tree_reading import TreeFile

TREE = """<root BTCPP_format="4" main_tree_to_execute="Rounds">
  <include path="part.xml"/>
  <BehaviorTree ID="Rounds">
    <Sequence name="Küche &lt;img src=x onerror=alert(1)&gt;">
      <Rover speed="{tempo}"/>
      <Script code="tempo := 3"/>
      <SubTree ID="Visit"/>
      <SubTree ID="Visit"/>
    </Sequence>
  </BehaviorTree>
</root>
"""
PART = """<root BTCPP_format="4">
  <BehaviorTree ID="Visit">
    <Inverter><Sleep name="&lt;/script&gt;" msec="5"/></Inverter>
  </BehaviorTree>
</root>
"""


@pytest.fixture
def tree_file(tmp_path: Path) -> TreeFile:
    (tmp_path / "part.xml").write_text(PART, encoding="utf-8")
    path = tmp_path / "tree.xml"
    path.write_text(TREE, encoding="utf-8")
    return TreeFile(path, lambda document: Registry.standard())


@pytest.fixture
def server(tree_file: TreeFile) -> Iterator[PreviewServer]:
    session = PreviewSession(tree_file)
    with PreviewServer(session) as server:
        Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        yield server
        server.shutdown()
    session.close()
