"""`btcore nodes`: the available nodes as a table, as a TreeNodesModel, and as JSON."""

import json
from pathlib import Path
from xml.etree import ElementTree

import pytest

from btcore import Registry
from btcore.cli import node_libraries
from btcore.documentation_site import FIRST_PAGE
from tests.btcore.cli.conftest import Cli


def test_table_shows_the_description_ports_and_origin_of_a_node(cli: Cli, library: Path) -> None:
    shown = cli("nodes", "--plugin", library).stdout
    assert "Ticks its children in order while they succeed." in shown
    row = shown.index("◦ BatteryOk")
    assert "The battery holds more than" in shown[row:]
    assert "→\u00a0minimum\u00a0double\u00a0=\u00a00.2" in shown[row:]
    assert "robot_things" in shown[row:]


@pytest.mark.parametrize("format_", ["4", "3"])
def test_each_format_has_the_built_in_nodes_of_the_registry(cli: Cli, format_: str) -> None:
    palette = json.loads(cli("nodes", "--format", format_, "--json").stdout)
    built_in = [id for id, node in palette.items() if node["library"] == "btcore"]
    assert built_in == list(Registry.standard().manifests_of(int(format_)))


def test_xml_is_a_model_that_groot_imports(cli: Cli, library: Path) -> None:
    root = ElementTree.fromstring(cli("nodes", "--xml", "--plugin", library).stdout)
    assert root.tag == "root"
    greet = root.find("TreeNodesModel/Action[@ID='Greet']")
    assert greet is not None
    assert [(port.tag, port.get("name")) for port in greet] == [
        ("input_port", "who"),
        ("output_port", "greeting"),
    ]


def test_mistyped_id_is_refused_with_a_suggestion(cli: Cli) -> None:
    result = cli("nodes", "Sequnce")
    assert result.exit_code == 2
    assert "; did you mean 'Sequence'?" in result.stderr


def test_json_describes_a_port(cli: Cli) -> None:
    found = json.loads(cli("nodes", "Delay", "Sequence", "--json").stdout)
    assert list(found) == ["Delay", "Sequence"]
    delay = found["Delay"]
    assert delay["type"] == "DECORATOR"
    assert delay["ports"]["delay_msec"]["direction"] == "input"
    assert delay["ports"]["delay_msec"]["type"] == "unsigned int"


def test_json_has_the_address_of_a_nodes_page(cli: Cli, library: Path) -> None:
    palette = json.loads(cli("nodes", "--json", "--plugin", library).stdout)
    assert palette["Delay"]["url"] == f"{FIRST_PAGE}reference/nodes/Delay.html"
    assert palette["RosTopicRead"]["url"] == f"{FIRST_PAGE}reference/nodes/RosTopicRead.html"
    assert palette["Greet"]["url"] is None


def test_nodes_of_a_model_are_exported_with_their_metadata(cli: Cli, tmp_path: Path) -> None:
    fields = "<MetadataFields><Metadata author='Ada'/></MetadataFields>"
    model = tmp_path / "palette.xml"
    model.write_text(f"<root><TreeNodesModel><Action ID='Move'>{fields}</Action></TreeNodesModel></root>")
    text = cli("nodes", "--model", model, "--xml", "Move").stdout
    assert '<Metadata author="Ada"/>' in text
    model.write_text(text)
    assert cli("nodes", "--model", model, "--xml", "Move").stdout == text
    assert json.loads(cli("nodes", "--model", model, "--json", "Move").stdout)["Move"]["metadata"] == {
        "author": "Ada"
    }


def test_environment_variable_limits_installed_libraries(cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "RosTopicPublish" in json.loads(cli("nodes", "--json").stdout)
    monkeypatch.setattr(node_libraries, "installed_once", node_libraries.load_installed)
    monkeypatch.setenv("BTCORE_ENTRY_POINTS", "robot_nodes sim")
    limited = json.loads(cli("nodes", "--json").stdout)
    assert "IsObstacle" in limited
    assert "RosTopicPublish" not in limited
    assert "--ros2" not in cli("run", "--help").stdout
