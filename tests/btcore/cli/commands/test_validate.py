"""`btcore validate`: all errors with their places, as text and as JSON."""

import json
from pathlib import Path

import pytest

from tests.btcore.cli.conftest import Cli, TreeFile


def test_valid_tree_exits_with_0(cli: Cli, tree_file: TreeFile) -> None:
    result = cli("validate", tree_file("<AlwaysSuccess/>"))
    assert result.exit_code == 0
    assert "1 file, no errors, no warnings" in result.stdout


def test_every_error_is_reported_with_position_line_and_carets(cli: Cli, tree_file: TreeFile) -> None:
    file = tree_file('<Sequense>\n      <Delay delay_mesc="5"><AlwaysSuccess/></Delay>\n    </Sequense>')
    result = cli("validate", file.name)
    assert result.exit_code == 2
    assert result.stdout.splitlines()[:4] == [
        "tree.xml:3:5: E101 unknown node <Sequense>",
        "   3 |      <Sequense>",
        "     |      ^^^^^^^^^^",
        "      did you mean <Sequence>?",
    ] or result.stdout.splitlines()[:3] == [
        "tree.xml:3:5: E101 unknown node <Sequense>",
        "   3 |      <Sequense>",
        "     |      ^^^^^^^^^^",
    ]
    assert "tree.xml:4:14: E201 <Delay> has no port 'delay_mesc'" in result.stdout
    assert "1 file, 2 errors" in result.stdout


def test_folders_are_searched_for_xml_files(cli: Cli, tmp_path: Path, tree_file: TreeFile) -> None:
    (tmp_path / "deep").mkdir()
    tree_file("<AlwaysSuccess/>", "good.xml")
    tree_file("<Nonsense/>", "deep/bad.xml")
    result = cli("validate", tmp_path)
    assert result.exit_code == 2
    assert "bad.xml:3:5: E101" in result.stdout
    assert "2 files, 1 error" in result.stdout


def test_folder_without_trees_is_refused(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    result = cli("validate", "empty")
    assert result.exit_code == 2
    assert "contains no XML file" in result.stderr


def test_warning_is_an_error_only_in_strict_mode(cli: Cli, tree_file: TreeFile) -> None:
    file = tree_file('<AlwaysSuccess _skipIf="1 < 2"/>')
    lenient = cli("validate", file)
    assert lenient.exit_code == 0
    assert "W101" in lenient.stdout
    assert "&lt;" in lenient.stdout
    assert "1 warning" in lenient.stdout
    assert cli("validate", "--strict", file).exit_code == 2


def test_given_option_suppresses_warnings_for_its_keys(cli: Cli, tree_file: TreeFile) -> None:
    file = tree_file('<Sequence><Sleep msec="{pause}"/><ScriptCondition code="goal == 1"/></Sequence>')
    assert cli("validate", "--strict", file).stdout.count("W201") == 2
    assert cli("validate", "--strict", "--given", "goal", file).stdout.count("W201") == 1
    result = cli("validate", "--strict", "--given", "goal", "--given", "{pause}", file)
    assert (result.exit_code, result.stdout) == (0, "✔ 1 file, no errors, no warnings\n")


def test_format_option_overrides_the_format_of_the_file(cli: Cli, tmp_path: Path) -> None:
    file = tmp_path / "tree.xml"
    file.write_text('<root><BehaviorTree ID="Main"><Script code="a := 1"/></BehaviorTree></root>')
    assert "<Script> belongs to format 4" in cli("validate", file).stdout
    assert cli("validate", "--format", "4", file).exit_code == 0
    assert cli("run", "--format", "4", "--fast", file).exit_code == 0
    assert cli("run", "--fast", file).exit_code == 2
    assert "--format" in cli("validate", "--format", "5", file).stderr


def test_tree_option_selects_the_main_tree(cli: Cli, tmp_path: Path) -> None:
    file = tmp_path / "tree.xml"
    file.write_text(
        '<root BTCPP_format="4" main_tree_to_execute="A">'
        '<BehaviorTree ID="A"><SubTree ID="B" goal="1"/></BehaviorTree>'
        '<BehaviorTree ID="B"><ScriptCondition code="goal == 1"/></BehaviorTree></root>'
    )
    assert cli("validate", "--strict", file).exit_code == 0
    assert "W201" in cli("validate", "--tree", "B", file).stdout
    assert cli("validate", "--strict", "--tree", "B", "--given", "goal", file).exit_code == 0
    assert "E108 unknown main tree 'C'" in cli("validate", "--tree", "C", file).stdout


def test_validate_reports_errors_that_run_finds_only_at_first_tick(cli: Cli, tree_file: TreeFile) -> None:
    file = tree_file("<IfThenElse><AlwaysSuccess/></IfThenElse>")
    validated = cli("validate", file)
    assert validated.exit_code == 2
    assert "tree.xml:3:5: E119 <IfThenElse> has 1 child; it needs 2 or 3" in validated.stdout
    assert cli("run", "--fast", file).exit_code == 3


def test_json_lists_the_diagnostics(cli: Cli, tree_file: TreeFile) -> None:
    data = json.loads(cli("validate", "--json", tree_file("<Nonsense/>")).stdout)
    assert data["ok"] is False
    assert data["files"] == 1
    (only,) = data["diagnostics"]
    assert (only["code"], only["line"], only["column"]) == ("E101", 3, 5)
    assert only["file"].endswith("tree.xml")
    assert only["url"].endswith("reference/errors.html#e101--unknown-node")


def test_hundred_diagnostics_of_file_are_shown_and_others_counted(cli: Cli, tree_file: TreeFile) -> None:
    tree = tree_file("<Sequence>" + "<Nonsense/><Sleep/>" * 120 + "</Sequence>")
    result = cli("validate", tree)
    assert result.stdout.count("E101") == 100
    assert "W202" not in result.stdout
    assert f"{tree}: 20 more errors and 120 more warnings" in result.stdout
    assert "1 file, 120 errors, 120 warnings" in result.stdout
    data = json.loads(cli("validate", "--json", tree).stdout)
    assert len(data["diagnostics"]) == 100
    assert data["omitted"] == 140


def test_a_run_shows_a_hundred_warnings(cli: Cli, tree_file: TreeFile) -> None:
    tree = tree_file("<Sequence>" + '<Script code="1 &lt; 2"name="s"/>' * 120 + "</Sequence>")
    result = cli("run", tree)
    assert result.stderr.count("W109") == 100
    assert f"{tree}: 20 more warnings" in result.stderr


def test_bundled_trees_are_valid_without_their_libraries(cli: Cli) -> None:
    result = cli("validate", "bumpgo", "bumpgo_wide")
    # Without the robot's node library the nodes are unknown, and a note names the missing library.
    assert result.exit_code == 0 or "the node library 'robot_nodes', which" in result.stderr


BROKEN = (
    '\ufeff<root BTCPP_format="4">\r\n  <BehaviorTree ID="A">\r\n    <SequenceStar> <!-- ä -->\r\n'
    '      < Sleep msec="1" name="a & b"/>\r\n      <Slep/>\r\n    </SequenceStar>\r\n'
    "  </BehaviorTree>\r\n</root>"
)
FIXED = (
    BROKEN.replace("SequenceStar", "SequenceWithMemory")
    .replace("< Sleep", "<Sleep")
    .replace("a & b", "a &amp; b")
)


def test_fix_changes_only_what_needs_no_decision(cli: Cli, tmp_path: Path) -> None:
    path = tmp_path / "broken.xml"
    path.write_bytes(BROKEN.encode())
    result = cli("validate", "broken.xml")
    assert "--fix corrects what needs no decision" in result.stdout
    (tmp_path / "outer.xml").write_text('<root BTCPP_format="4"><include path="broken.xml"/></root>')
    assert "--fix" not in cli("validate", "outer.xml").stdout
    result = cli("validate", "--diff", "broken.xml")
    assert path.read_bytes() == BROKEN.encode()
    assert result.exit_code == 2
    assert "did you mean <Sleep>" in result.stderr
    removed, added = (
        [line[1:] for line in result.stdout.splitlines() if line[0] == sign and line[1] != sign]
        for sign in "-+"
    )
    assert removed == [line for line in BROKEN.splitlines() if line not in FIXED]
    assert added == [line for line in FIXED.splitlines() if line not in BROKEN]
    result = cli("validate", "--fix", "broken.xml")
    assert path.read_bytes() == FIXED.encode()
    assert result.exit_code == 2
    assert "1 error, no warnings, 3 problems fixed" in result.stdout
    assert "did you mean <Sleep>" in result.stdout
    result = cli("validate", "--diff", "broken.xml")
    assert (result.exit_code, result.stdout) == (2, "")
    assert "1 error, no warnings" in result.stderr


def test_fixes_are_data(cli: Cli, tree_file: TreeFile) -> None:
    file = tree_file('<Sleep mesc="1"/>')
    (error,) = json.loads(cli("validate", "--json", file).stdout)["diagnostics"]
    edit = {"start": [3, 12], "end": [3, 16], "text": "msec"}
    assert error["fixes"] == [{"title": "Change to 'msec'", "safe": False, "edits": [edit]}]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--fix", "-"], "--fix needs a file, not stdin"),
        (["--diff", "-"], "--diff needs a file, not stdin"),
        (["--diff", "--json", "."], "--json and --diff cannot be used together"),
        (["--diff", "--fix", "."], "--fix and --diff cannot be used together"),
    ],
)
def test_options_that_exclude_each_other_are_refused(options: list[str], message: str, cli: Cli) -> None:
    result = cli("validate", *options)
    assert (result.exit_code, result.stdout) == (2, "")
    assert message in result.stderr
