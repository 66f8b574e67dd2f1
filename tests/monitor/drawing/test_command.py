"""`btcore show`: a tree in the terminal or as SVG, and its data flow."""

import json
from pathlib import Path
from xml.etree import ElementTree

import pytest
from click.testing import CliRunner

from btcore.cli.main import main
from tests.btcore.cli.conftest import Cli


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "patrol.xml"
    path.write_text(
        """<root BTCPP_format="4" main_tree_to_execute="Rounds">
  <BehaviorTree ID="Rounds">
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


def test_minus_reads_the_tree_from_stdin(cli: Cli, file: Path) -> None:
    text = file.read_bytes()
    assert cli("show", "-", input=text).stdout == cli("show", file.name).stdout.replace(file.name, "-")
    assert cli("validate", "-", input=text).exit_code == 0
    wrong = cli("validate", "-", input=text.replace(b"Sleep", b"Slep"))
    assert "<stdin>:9:5: E101 unknown node <Slep>" in wrong.stdout
    always = b'<root BTCPP_format="4"><BehaviorTree ID="T"><AlwaysSuccess/></BehaviorTree></root>'
    run = cli("run", "-", "--fast", input=always)
    assert run.exit_code == 0
    assert "SUCCESS  stdin" in run.stderr
    assert cli("show", "-", input=b"\xff").exit_code == 2
    assert "--watch needs a file" in cli("run", "-", "--watch", input=always).stderr


def test_tree_is_drawn_with_symbols_names_ids_numbers_and_ports(cli: Cli, file: Path) -> None:
    assert cli("show", file.name).stdout == (
        "Rounds  patrol.xml  format 4\n"
        "└── → round  Sequence  1\n"
        "    ├── ▣ hello  SubTree  2  who={guest}\n"
        "    │   └── ◷ bow  Sleep  3  msec=200\n"
        "    └── ¬ Inverter  4\n"
        "        └── ⊥ AlwaysFailure  5  _skipIf=late\n"
    )


def test_drawing_consists_of_ascii_characters_where_the_terminal_lacks_unicode(file: Path) -> None:
    assert CliRunner(charset="ascii").invoke(main, ["show", "--no-ports", str(file)]).stdout.split("\n")[
        1:
    ] == [
        "`-- round  Sequence  1",
        "    |-- hello  SubTree  2",
        "    |   `-- bow  Sleep  3",
        "    `-- Inverter  4",
        "        `-- AlwaysFailure  5",
        "",
    ]


def test_tree_option_selects_the_tree(cli: Cli, file: Path) -> None:
    assert cli("show", file.name, "--tree", "Greet").stdout == (
        "Greet  patrol.xml  format 4\n└── ◷ bow  Sleep  1  msec=200\n"
    )


def test_numbers_are_the_uids_of_a_run(cli: Cli, file: Path) -> None:
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


def test_leaf_that_requires_a_robot_is_drawn_without_a_robot(cli: Cli, tmp_path: Path) -> None:
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


FLOW = """<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <Sequence>
      <Script code="guest := 'Ada'"/>
      <SubTree ID="Greet" name="hello" who="{guest}"/>
    </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="Greet">
    <ScriptCondition name="known" code="who == 'Ada'"/>
  </BehaviorTree>
</root>
"""


@pytest.fixture
def flow(tmp_path: Path) -> Path:
    path = tmp_path / "flow.xml"
    path.write_text(FLOW, encoding="utf-8")
    return path


def test_data_lists_writers_and_readers_of_each_entry(cli: Cli, flow: Path) -> None:
    (row,) = [line for line in cli("show", "--data", flow).stdout.splitlines() if line.startswith(" guest")]
    assert row.split() == ["guest", "Script", "code", "hello/known", "code", "as", "who"]


def test_data_json_lists_writers_and_readers(cli: Cli, flow: Path) -> None:
    (row,) = json.loads(cli("show", "--data", "--json", flow.name).stdout)
    assert (row["scope"], row["key"]) == ("", "guest")
    assert row["writers"] == [{"node": "Script", "attribute": "code", "key": "guest", "where": "flow.xml:4"}]
    assert [reader["key"] for reader in row["readers"]] == ["who"]


def test_data_of_a_tree_without_entries_is_reported_as_empty(cli: Cli, tmp_path: Path) -> None:
    file = tmp_path / "plain.xml"
    file.write_text('<root BTCPP_format="4"><BehaviorTree ID="Go"><AlwaysSuccess/></BehaviorTree></root>')
    assert cli("show", "--data", file).stdout == "no node uses the blackboard\n"
    assert json.loads(cli("show", "--data", "--json", file).stdout) == []


def test_format_of_a_file_without_it_can_be_given(cli: Cli, file: Path) -> None:
    file.write_text('<root><BehaviorTree ID="Go"><AlwaysSuccess _skipIf="late"/></BehaviorTree></root>')
    assert "format 4" in cli("show", file, "--format", "4").stdout
    assert "E201 <AlwaysSuccess> has no" in cli("show", file).stderr


def test_svg_is_written_to_a_file_and_stdout_is_empty(cli: Cli, file: Path, tmp_path: Path) -> None:
    result = cli("show", file, "--svg", "tree.svg")
    assert (result.exit_code, result.stdout) == (0, "")
    drawing = ElementTree.parse(tmp_path / "tree.svg")
    texts = {text for element in drawing.iter() for text in element.itertext()}
    assert {"Rounds", "round", "hello", "bow"} <= texts


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--svg", "no/such/folder.svg"], "cannot write 'no/such/folder.svg'"),
        (["--svg", "tree.svg", "--json"], "--svg and --json cannot be used together"),
        (["--png", "tree.png", "--data"], "--png and --data cannot be used together"),
        (["--svg", "."], "is a directory"),
    ],
)
def test_invalid_options_are_refused(cli: Cli, file: Path, options: list[str], message: str) -> None:
    result = cli("show", file, *options)
    assert result.exit_code == 2
    assert message in result.stderr
