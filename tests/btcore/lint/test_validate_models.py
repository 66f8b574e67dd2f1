"""Trees with C++ leaves that are known only by their models: only certain errors are reported."""

from collections.abc import Collection
from pathlib import Path

import pytest

from btcore import Registry
from btcore.lint.validate import validate_document
from btcore.xml.models.model_file import add_models
from btcore.xml.read.read import parse_file

PALETTE = """<root BTCPP_format="4"><TreeNodesModel>
  <Control ID="Alternate"/>
  <Decorator ID="AtRate"><input_port name="hz" type="double"/></Decorator>
  <Action ID="Plan">
    <input_port name="goal"/><output_port name="path"/><output_port name="code" type="int"/>
  </Action>
  <Action ID="Follow"><input_port name="path"/><input_port name="controller"/></Action>
  <Action ID="Clear"><input_port name="service"/></Action>
  <Action ID="Spin"><input_port name="angle" type="double"/></Action>
  <Condition ID="GoalMoved"/>
</TreeNodesModel></root>"""

NAVIGATE = """<root BTCPP_format="4" main_tree_to_execute="Navigate">
  <BehaviorTree ID="Navigate">
    <RetryUntilSuccessful num_attempts="6">
      <Fallback>
        <Sequence>
          <AtRate hz="1.0"><Plan goal="{goal}" path="{path}" code="{code}"/></AtRate>
          <Follow path="{path}" _onFailure="reason := NO_CONTROL"/>
        </Sequence>
        <ReactiveFallback>
          <GoalMoved/>
          <Alternate><Clear service="local"/><Spin angle="1.57"/><Clear/></Alternate>
          <SubTree ID="Recover" code="{code}" where="{path}"/>
        </ReactiveFallback>
      </Fallback>
    </RetryUntilSuccessful>
  </BehaviorTree>
  <BehaviorTree ID="Recover">
    <Sequence>
      <ScriptCondition code="code != TOO_FAR"/>
      <Follow path="{where}"/>
    </Sequence>
  </BehaviorTree>
</root>"""


class Files:
    def __init__(self, folder: Path) -> None:
        self.nodes = Registry.standard()
        (folder / "palette.xml").write_text(PALETTE, encoding="utf-8")
        add_models(self.nodes, folder / "palette.xml")
        self.tree = folder / "navigate.xml"

    def diagnostics_of(self, text: str, given: Collection[str] = ()) -> list[str]:
        self.tree.write_text(text, encoding="utf-8")
        found = validate_document(parse_file(self.tree), nodes=self.nodes, given=given)
        return [f"{one.line}:{one.column}: {one.code} {one.message}" for one in found]


@pytest.fixture
def files(tmp_path: Path) -> Files:
    return Files(tmp_path)


def test_a_navigation_tree_lacks_only_its_goal(files: Files) -> None:
    assert files.diagnostics_of(NAVIGATE) == [
        "6:40: W201 the port 'goal' of <Plan> reads {goal}, which is never written"
    ]
    assert files.diagnostics_of(NAVIGATE, given=["goal"]) == []


@pytest.mark.parametrize(
    ("written", "instead", "message"),
    [
        (
            'path="{path}" code',
            'path="path" code',
            "6:54: W211 the output port 'path' of <Plan> has no entry: 'path' is only a text",
        ),
        (
            'Follow path="{path}"',
            'Follow path="{pth}"',
            "7:25: W201 the port 'path' of <Follow> reads {pth}, which is never written",
        ),
    ],
)
def test_ports_of_a_model_are_checked(files: Files, written: str, instead: str, message: str) -> None:
    assert message in files.diagnostics_of(NAVIGATE.replace(written, instead), given=["goal"])


def test_properties_unknown_from_a_model_are_not_reported(files: Files) -> None:
    # Unknown: whether <Plan> lasts, whether <Clear> requires its service, what <GoalMoved> may return.
    body = "<ReactiveSequence><Plan/><GoalMoved/><Follow/></ReactiveSequence>"
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    assert files.diagnostics_of(text) == []
