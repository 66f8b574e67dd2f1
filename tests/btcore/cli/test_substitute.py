"""``btcore run --substitute``: nodes are replaced by substitution rules in JSON."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.btcore.cli.conftest import Cli, LastJson, TreeFile


@pytest.fixture
def rules(tmp_path: Path) -> Callable[..., Path]:
    """Return a function that writes substitution rules into a file."""

    def write(of: dict[str, str], configs: dict[str, Any] | None = None, name: str = "rules.json") -> Path:
        path = tmp_path / name
        path.write_text(json.dumps({"SubstitutionRules": of, "TestNodeConfigs": configs or {}}))
        return path

    return write


def test_nodes_are_replaced_by_test_nodes_and_by_other_nodes(
    cli: Cli, tree_file: TreeFile, library: Path, last_json: LastJson, rules: Callable[..., Path]
) -> None:
    tree = tree_file('<Fallback><Explode/><Walk name="far"/><AlwaysFailure/></Fallback>')
    given = rules(
        {"Explode": "fails", "far": "AlwaysSuccess"},
        {"fails": {"return_status": "FAILURE", "async_delay": 300, "post_script": "n := 1"}},
    )
    result = cli("run", tree, "--plugin", library, "--fast", "--substitute", given, "--json")
    report = last_json(result)
    assert (result.exit_code, report["status"], report["time_s"]) == (0, "SUCCESS", 0.3)
    assert report["nodes"]["Explode::2"]["failure"] == 1
    assert result.stderr.count("warning") == 0


def test_several_files_are_combined_and_the_first_matching_rule_applies(
    cli: Cli, tree_file: TreeFile, rules: Callable[..., Path]
) -> None:
    tree = tree_file('<Sequence><AlwaysFailure name="a"/></Sequence>')
    first, second = rules({"a": "AlwaysSuccess"}), rules({"AlwaysFailure": "AlwaysFailure"}, name="2.json")
    assert cli("run", tree, "--substitute", first, "--substitute", second).exit_code == 0
    assert cli("run", tree, "--substitute", second, "--substitute", first).exit_code == 1


def test_rule_matching_no_node_is_reported(cli: Cli, tree_file: TreeFile, rules: Callable[..., Path]) -> None:
    result = cli("run", tree_file('<AlwaysSuccess name="home"/>'), "--substitute", rules({"hom": "Sleep"}))
    assert result.exit_code == 0
    assert result.stderr.startswith(
        "warning: --substitute: the rule 'hom' matches no node; did you mean 'home'?\n"
    )


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (None, "rules.json: cannot read the file: No such file or directory."),
        (b"{}", "rules.json: the substitution rules: 'SubstitutionRules' is missing."),
    ],
)
def test_invalid_rules_file_is_refused(
    cli: Cli, tree_file: TreeFile, tmp_path: Path, data: bytes | None, message: str
) -> None:
    file = tmp_path / "rules.json"
    if data is not None:
        file.write_bytes(data)
    result = cli("run", tree_file("<AlwaysSuccess/>"), "--substitute", file)
    assert result.exit_code == 2
    assert message in result.stderr


def test_rule_with_an_unknown_node_is_reported_at_the_replaced_node(
    cli: Cli, tree_file: TreeFile, rules: Callable[..., Path]
) -> None:
    result = cli("run", tree_file("<AlwaysFailure/>"), "--substitute", rules({"*": "AlwaysSucess"}))
    assert result.exit_code == 2
    assert "tree.xml:3:5: E118" in result.stderr
    assert "did you mean 'AlwaysSuccess'?" in result.stderr
