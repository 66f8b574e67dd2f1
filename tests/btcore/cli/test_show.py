"""`btcore show`: a tree, drawn in the terminal."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result

Cli = Callable[..., Result]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "patrol.xml"
    path.write_text(
        """<root BTCPP_format="4" main_tree_to_execute="Patrol">
  <BehaviorTree ID="Patrol">
    <Sequence name="round">
      <SubTree ID="Greet" name="hello" who="{guest}"/>
      <Inverter><AlwaysFailure _skipIf="late"/></Inverter>
    </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="Greet">
    <Sleep name="bow" msec="200"/>
  </BehaviorTree>
</root>
""",
        encoding="utf-8",
    )
    return path


def test_the_tree_is_drawn_with_signs_names_ids_numbers_and_ports(cli: Cli, file: Path) -> None:
    assert cli("show", file.name).stdout == (
        "Patrol  patrol.xml  format 4\n"
        "└── → round  Sequence  1\n"
        "    ├── ▣ hello  SubTree  2  who={guest}\n"
        "    │   └── ◷ bow  Sleep  3  msec=200\n"
        "    └── ¬ Inverter  4\n"
        "        └── ▪ AlwaysFailure  5  _skipIf=late\n"
    )


def test_ports_can_be_left_out(cli: Cli, file: Path) -> None:
    shown = cli("show", "--no-ports", file).stdout
    assert "bow" in shown
    assert "msec" not in shown


def test_any_tree_of_the_file_can_be_shown(cli: Cli, file: Path) -> None:
    assert cli("show", file.name, "--tree", "Greet").stdout == (
        "Greet  patrol.xml  format 4\n└── ◷ bow  Sleep  1  msec=200\n"
    )


def test_the_numbers_are_those_of_a_run(cli: Cli, file: Path) -> None:
    shown = json.loads(cli("show", "--json", file).stdout)
    run = json.loads(cli("run", "--fast", "--json", file).stdout.splitlines()[-1])

    def numbers(node: dict[str, object]) -> dict[object, object]:
        found = {node["uid"]: node["id"]}
        children = node["children"]
        assert isinstance(children, list)
        for child in children:
            found |= numbers(child)
        return found

    assert numbers(shown) == dict(enumerate((node["id"] for node in run["nodes"].values()), start=1))


def test_a_leaf_that_wants_a_robot_is_drawn_without_one(cli: Cli, tmp_path: Path) -> None:
    plugin = tmp_path / "needy.py"
    plugin.write_text(
        "from btcore import action\n\nclass Robot: pass\n\n@action\ndef drive(robot: Robot) -> bool:\n"
        "    return True\n"
    )
    file = tmp_path / "drive.xml"
    file.write_text('<root BTCPP_format="4"><BehaviorTree ID="Go"><Drive/></BehaviorTree></root>')
    result = cli("show", file, "--plugin", plugin)
    assert result.exit_code == 0
    assert "Drive" in result.stdout
