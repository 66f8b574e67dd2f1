"""``--model``: trees whose leaves exist only in C++ are checked, drawn, and run with mock leaves."""

import json
from pathlib import Path

import pytest

from tests.btcore.cli.conftest import Cli, LastJson, TreeFile

BODY = (
    '<Sequence><IsOk/><Fallback name="ways"><Haul name="short" goal="a"/><Haul name="long" goal="b"/>'
    '</Fallback><Action ID="Rest"/></Sequence>'
)


@pytest.fixture
def model(tmp_path: Path) -> Path:
    path = tmp_path / "model.xml"
    path.write_text(
        '<root><TreeNodesModel><Action ID="Haul"><input_port name="goal" type="std::string"/></Action>'
        '<Condition ID="IsOk"/></TreeNodesModel></root>'
    )
    return path


def test_validate_accepts_model_nodes_and_explicit_tags(cli: Cli, tree_file: TreeFile, model: Path) -> None:
    tree = tree_file(BODY)
    assert cli("validate", tree).stdout.count("E101") == 4
    result = cli("validate", tree, "--model", model)
    assert result.exit_code == 0, result.output


def test_explicit_tag_has_only_the_ports_of_its_own_file(
    cli: Cli, tree_file: TreeFile, tmp_path: Path, model: Path
) -> None:
    (tmp_path / "trees").mkdir()
    tree_file('<Action ID="Rest" seconds="1"/>', "trees/a.xml")
    tree_file('<Action ID="Rest" minutes="1"/>', "trees/b.xml")
    result = cli("validate", "trees", "--model", model)
    assert result.exit_code == 0, result.output


def test_show_draws_nodes_of_models(cli: Cli, tree_file: TreeFile, model: Path) -> None:
    tree = tree_file(BODY)
    assert cli("show", tree).exit_code == 2
    shown = cli("show", tree, "--model", model).stdout
    assert "◦ IsOk" in shown
    assert "▪ short  Haul  4  goal=a" in shown


def test_run_uses_outcomes_by_name_and_by_id(
    cli: Cli, tree_file: TreeFile, model: Path, last_json: LastJson
) -> None:
    plans = ["--outcomes", "short=RF", "--outcomes", "Haul=RRS", "--outcomes", "IsOk=S"]
    result = cli("run", tree_file(BODY), "--model", model, *plans, "--fast", "--json")
    assert result.exit_code == 0, result.output
    nodes = last_json(result)["nodes"]
    figures = {key: (node["ticks"], node["success"], node["failure"]) for key, node in nodes.items()}
    assert figures["short"] == (2, 0, 1)
    assert figures["long"] == (3, 1, 0)
    assert figures["Rest::6"] == (1, 1, 0)


@pytest.mark.parametrize(
    ("plans", "expected_message"),
    [
        (["Hual=S"], "--outcomes: the tree has no mock leaf 'Hual'; did you mean 'Haul'?"),
        (["Sequence=S"], "it has IsOk, short, Haul, long and Rest."),
        (["Haul=Z"], "the letters are R (RUNNING)"),
        (["Haul="], "invalid outcomes ''"),
        (["Haul=S|"], "invalid outcomes 'S|'"),
        (["RRS"], "write NAME=OUTCOMES"),
        (["Haul=S", "Haul=F"], "'Haul' has outcomes more than once"),
        (["Haul=S(gaol=1)"], "--outcomes: outputs: 'Haul' has no output port 'gaol'"),
    ],
)
def test_invalid_plan_is_refused(
    cli: Cli, tree_file: TreeFile, model: Path, plans: list[str], expected_message: str
) -> None:
    options = [part for plan in plans for part in ("--outcomes", plan)]
    result = cli("run", tree_file(BODY), "--model", model, "--fast", *options)
    assert result.exit_code == 2
    assert expected_message in result.stderr


def test_plan_without_a_model_is_refused(cli: Cli, tree_file: TreeFile) -> None:
    result = cli("run", tree_file("<AlwaysSuccess/>"), "--outcomes", "AlwaysSuccess=F", "--fast")
    assert result.exit_code == 2
    message = "no mock leaf 'AlwaysSuccess'; it has none. Mock leaves are leaves from a --model."
    assert message in result.stderr


@pytest.mark.parametrize("command", ["run", "show", "validate"])
def test_file_without_models_is_refused(cli: Cli, tree_file: TreeFile, model: Path, command: str) -> None:
    model.write_text("<root/>")
    result = cli(command, tree_file("<AlwaysSuccess/>"), "--model", model)
    assert result.exit_code == 2
    assert "model.xml: E003 the file contains no model of a node" in result.stderr


def test_show_json_contains_the_drawn_nodes_and_ports(cli: Cli, tree_file: TreeFile, model: Path) -> None:
    root = json.loads(cli("show", tree_file(BODY), "--model", model, "--json").stdout)
    ways = root["children"][1]
    assert [(child["name"], child["ports"]) for child in ways["children"]] == [
        ("short", {"goal": "a"}),
        ("long", {"goal": "b"}),
    ]
