"""`btcore schema`: an XSD on stdout, with the nodes of plugins and models."""

from collections.abc import Callable
from pathlib import Path

from click.testing import Result
from lxml import etree

from tests.btcore.cli.conftest import Cli


def schema_of(result: Result) -> etree.XMLSchema:
    assert result.exit_code == 0, result.output
    return etree.XMLSchema(etree.fromstring(result.stdout.encode()))


def test_schema_accepts_nodes_of_plugins(cli: Cli, library: Path, tree_file: Callable[..., Path]) -> None:
    path = tree_file('<Walk steps="3"/>')
    assert schema_of(cli("schema", "--plugin", library)).validate(etree.parse(path))
    assert not schema_of(cli("schema")).validate(etree.parse(path))


def test_schema_accepts_nodes_of_models(cli: Cli, tmp_path: Path, tree_file: Callable[..., Path]) -> None:
    model = tmp_path / "model.xml"
    model.write_text('<root><TreeNodesModel><Action ID="Haul"/></TreeNodesModel></root>')
    path = tree_file("<Haul/>")
    assert schema_of(cli("schema", "--model", model)).validate(etree.parse(path))


def test_each_format_has_its_own_schema(cli: Cli) -> None:
    old = etree.fromstring(
        "<root><BehaviorTree><SequenceStar><AlwaysSuccess/></SequenceStar></BehaviorTree></root>"
    )
    assert schema_of(cli("schema", "--format", "3")).validate(old)
    assert not schema_of(cli("schema")).validate(old)
