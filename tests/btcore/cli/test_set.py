"""`btcore run --set`: blackboard entries before the first tick."""

from pathlib import Path

import pytest

from tests.btcore.cli.conftest import Cli, LastJson, TreeFile


def test_value_is_converted_to_the_type_of_the_port(
    cli: Cli, tree_file: TreeFile, library: Path, last_json: LastJson
) -> None:
    tree = tree_file('<Walk name="stroll" steps="{far}"/>')
    data = last_json(cli("run", tree, "--plugin", library, "--fast", "--set", "far=7", "--json"))
    assert data["nodes"]["stroll"]["ticks"] == 8


def test_port_may_be_in_a_subtree_under_a_remapped_key(cli: Cli, tmp_path: Path, last_json: LastJson) -> None:
    tree = tmp_path / "two.xml"
    tree.write_text(
        '<root BTCPP_format="4" main_tree_to_execute="Outer"><BehaviorTree ID="Outer">'
        '<SubTree ID="Inner" pause="{rest}"/></BehaviorTree><BehaviorTree ID="Inner">'
        '<Delay delay_msec="{pause}"><AlwaysSuccess/></Delay></BehaviorTree></root>'
    )
    assert last_json(cli("run", tree, "--fast", "--set", "rest=1500", "--json"))["time_s"] == 1.5
    wrong = cli("run", tree, "--fast", "--set", "rest=long")
    assert wrong.exit_code == 2
    assert "--set rest=long: " in wrong.stderr


@pytest.mark.parametrize(
    ("value", "code"),
    [
        ("4.5", "it == 4.5"),
        ("true", "it == true"),
        ("north", "it == 'north'"),
        ('"7"', "it == '7'"),
        ("null", "it == 'null'"),
        ("a=b", "it == 'a=b'"),
        ("", "it == ''"),
    ],
)
def test_value_without_a_type_is_json_or_text(cli: Cli, tree_file: TreeFile, value: str, code: str) -> None:
    tree = tree_file(f'<ScriptCondition code="{code}"/>')
    result = cli("run", tree, "--fast", "--set", f"it={value}")
    assert result.exit_code == 0, result.output


def test_format_3_converts_the_value_by_its_own_rules(cli: Cli, tmp_path: Path) -> None:
    tree = tmp_path / "old.xml"
    tree.write_text(
        '<root><BehaviorTree ID="Old"><BlackboardCheckInt value_A="{charge}" value_B="20" '
        'return_on_mismatch="FAILURE"><AlwaysSuccess/></BlackboardCheckInt></BehaviorTree></root>'
    )
    assert cli("run", tree, "--fast", "--set", "charge=20").exit_code == 0
    assert cli("run", tree, "--fast", "--set", "charge=21").exit_code == 1


def test_key_may_be_in_braces_and_an_unused_key_is_reported(
    cli: Cli, tree_file: TreeFile, library: Path
) -> None:
    tree = tree_file('<Walk steps="{far}"/>')
    assert cli("run", tree, "--plugin", library, "--fast", "--set", "{far}=2").exit_code == 0
    mistyped = cli("run", tree, "--plugin", library, "--fast", "--set", "fat=2")
    assert "no port or script of the tree uses 'fat'; did you mean 'far'?" in mistyped.stderr


def test_a_key_that_only_scripts_use_is_known(cli: Cli, tree_file: TreeFile) -> None:
    tree = tree_file('<ScriptCondition code="battery &lt; 0.2"/>')
    known = cli("run", tree, "--fast", "--set", "battery=0.1")
    assert (known.exit_code, "warning" in known.stderr) == (0, False)
    unknown = cli("run", tree, "--fast", "--set", "batery=0.1", "--set", "zzz=0")
    assert (
        "--set batery: no port or script of the tree uses 'batery'; did you mean 'battery'?" in unknown.stderr
    )
    assert "--set zzz: no port or script of the tree uses 'zzz'\n" in unknown.stderr
    assert "note: to set the entry before the first tick, use --set battery=VALUE" in unknown.stderr


def test_leaf_with_whole_blackboard_may_use_any_key(cli: Cli, tree_file: TreeFile, tmp_path: Path) -> None:
    (tmp_path / "boards.py").write_text(
        "from btcore import Blackboard, condition\n"
        "@condition\ndef has_key(board: Blackboard) -> bool:\n    return 'zzz' in board\n"
    )
    result = cli("run", tree_file("<HasKey/>"), "--plugin", "boards.py", "--set", "zzz=0")
    assert (result.exit_code, "warning" in result.stderr) == (0, False)


@pytest.mark.parametrize(
    ("call", "note"),
    [('<SubTree ID="Rest" pause="{time}"/>', "use --set time=VALUE"), ('<SubTree ID="Rest"/>', "")],
)
def test_a_read_of_an_entry_that_was_never_written_suggests_to_set_it(
    cli: Cli, tree_file: TreeFile, call: str, note: str
) -> None:
    inner = '<BehaviorTree ID="Rest"><Sleep msec="{pause}"/>'
    result = cli("run", tree_file(f"{call}</BehaviorTree>{inner}"), "--fast")
    assert "reads {pause}, which has never been written" in result.stderr
    assert result.stderr.count("note: ") == bool(note)
    assert note in result.stderr


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        (["far"], "write KEY=VALUE"),
        (["=3"], "write KEY=VALUE"),
        (["far=1", "{far}=2"], "'far' is set more than once"),
        (["far=soon"], "--set far=soon: 'soon' is not an integer"),
        (["other=" + "[" * 2_000 + "]" * 2_000], "the JSON is nested more than 100 levels deep"),
    ],
)
def test_invalid_values_are_refused(
    cli: Cli, tree_file: TreeFile, library: Path, texts: list[str], message: str
) -> None:
    tree = tree_file('<Walk steps="{far}"/>')
    options = [part for text in texts for part in ("--set", text)]
    result = cli("run", tree, "--plugin", library, "--fast", *options)
    assert result.exit_code == 2
    assert message in result.stderr
