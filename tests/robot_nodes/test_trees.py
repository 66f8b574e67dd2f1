"""The trees that come with btcore."""

from pathlib import Path

from lxml import etree

from btcore import Diagnostic, Registry
from btcore.lint.validate import validate_document
from btcore.xml.read.read import parse_file
from btcore_studio.schema import write_schema

TREES = sorted((Path(__file__).parents[2] / "trees").rglob("*.xml"))
GIVEN = {"navigation": ("goal", "goals", "waypoint_statuses")}
"""The blackboard entries that callers of the trees in a folder provide."""


def palette() -> Registry:
    nodes = Registry.standard()
    assert nodes.add_installed_libraries() == []
    return nodes


def diagnostics(path: Path) -> list[Diagnostic]:
    return validate_document(parse_file(path), nodes=palette(), given=GIVEN.get(path.parent.name, ()))


def test_shipped_trees_have_no_diagnostics() -> None:
    assert TREES
    assert [diagnostic for path in TREES for diagnostic in diagnostics(path)] == []


def test_shipped_trees_are_valid_by_the_schema_for_editors() -> None:
    nodes = palette()
    schemas = {
        format: etree.XMLSchema(etree.fromstring(write_schema(nodes, format).encode())) for format in (3, 4)
    }
    for path in TREES:
        document = etree.parse(path)
        schema = schemas[4 if document.getroot().get("BTCPP_format") == "4" else 3]
        assert schema.validate(document), (path, schema.error_log.last_error)
