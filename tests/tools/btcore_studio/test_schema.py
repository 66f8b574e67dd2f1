"""The XML schema: it accepts trees that can be loaded, and refuses errors that an editor should underline."""

import enum
import gzip
import json
from pathlib import Path

import pytest
from lxml import etree

import btcore
from btcore import In, Put, Registry, action
from btcore.loading.tree_xml import tree_to_xml
from btcore_studio.schema import write_schema
from tests.conformance.recorded_cases import CallLog, conformance_registry

ROOT = Path(__file__).parents[3]
RECORDED = ROOT / "tests" / "conformance" / "data"
XS = "{http://www.w3.org/2001/XMLSchema}"


class Gear(enum.Enum):
    LOW = 1
    HIGH = 2


@action
def drive(gear: In[Gear], speed: In[float] = 0.5, *, distance: Put[float]) -> bool:
    """Drive, *speed* in m/s."""
    return True


def schema_of(nodes: Registry, format: int = 4) -> etree.XMLSchema:
    return etree.XMLSchema(etree.fromstring(write_schema(nodes, format).encode()))


@pytest.fixture(scope="module")
def schema() -> etree.XMLSchema:
    nodes = conformance_registry()
    nodes.add(drive)
    return schema_of(nodes)


def accepts(schema: etree.XMLSchema, body: str) -> bool:
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    return bool(schema.validate(etree.fromstring(text)))


@pytest.mark.parametrize(
    ("name", "format"), [("v4_full", 4), ("v4_control", 4), ("v4_once", 4), ("v3_full", 3)]
)
def test_every_recorded_tree_is_valid(name: str, format: int) -> None:
    schema = schema_of(conformance_registry(), format)
    with gzip.open(RECORDED / f"{name}.jsonl.gz", "rt", encoding="utf-8") as lines:
        for line in lines:
            case = json.loads(line)
            assert schema.validate(etree.fromstring(case["xml"])), (case["id"], schema.error_log.last_error)


def test_xml_of_a_running_tree_is_valid(schema: etree.XMLSchema) -> None:
    nodes = conformance_registry()
    nodes.add(drive)
    text = (
        '<root BTCPP_format="4" main_tree_to_execute="A"><BehaviorTree ID="A"><Sequence _skipIf="late">'
        '<SubTree ID="B" goal="{g}"/><PlanSync plan="S" _onSuccess="x := 1"/></Sequence></BehaviorTree>'
        '<BehaviorTree ID="B"><AlwaysSuccess/></BehaviorTree></root>'
    )
    written = tree_to_xml(btcore.loads(text, nodes=nodes, resources=[CallLog()]))
    assert schema.validate(etree.fromstring(written.encode())), schema.error_log.last_error


@pytest.mark.parametrize(
    "body",
    [
        '<Repeat num_cycles="3"><AlwaysSuccess/></Repeat>',
        '<Repeat num_cycles="{n}" name="again"><AlwaysSuccess/></Repeat>',
        '<Drive gear="HIGH" distance="{d}"/>',
        '<Drive gear="2" speed="1e-3" distance="{=}"/>',
        '<RunOnce then_skip="FALSE"><AlwaysSuccess/></RunOnce>',
        '<Precondition if="a &lt; 1" else="RUNNING"><AlwaysSuccess/></Precondition>',
        '<SubTree ID="Other" _autoremap="true" anything="1"/>',
        '<Action ID="SomethingOfCpp" goal="{g}"/>',
        '<Decorator ID="OfCpp"><AlwaysSuccess/></Decorator>',
        '<Switch2 variable="{v}" case_1="a"><AlwaysSuccess/><AlwaysSuccess/><AlwaysSuccess/></Switch2>',
    ],
)
def test_loadable_tree_is_valid(schema: etree.XMLSchema, body: str) -> None:
    assert accepts(schema, body), schema.error_log.last_error


@pytest.mark.parametrize(
    "body",
    [
        "<Repeat><AlwaysSuccess/></Repeat>",
        '<Repeat num_cycles="often"><AlwaysSuccess/></Repeat>',
        '<Repeat num_cycles="3"/>',
        '<Repeat num_cycles="3"><AlwaysSuccess/><AlwaysSuccess/></Repeat>',
        '<Repeat num_cycle="3"><AlwaysSuccess/></Repeat>',
        '<Timeout msec="-1"><AlwaysSuccess/></Timeout>',
        '<Drive gear="SIDEWAYS" distance="{d}"/>',
        '<Drive gear="LOW" distance="0.5"/>',
        '<RunOnce then_skip="yes"><AlwaysSuccess/></RunOnce>',
        "<Sequence/>",
        "<AlwaysSuccess><AlwaysSuccess/></AlwaysSuccess>",
        "<Seqence><AlwaysSuccess/></Seqence>",
        "<TryCatch><AlwaysSuccess/></TryCatch>",
        "<SubTree/>",
        "<AlwaysSuccess/><AlwaysSuccess/>",
        "<Action/>",
    ],
)
def test_invalid_tree_is_refused(schema: etree.XMLSchema, body: str) -> None:
    assert not accepts(schema, body)


def test_each_format_requires_its_own_format_number() -> None:
    body = '<BehaviorTree ID="A"><AlwaysSuccess/></BehaviorTree>'
    nodes = Registry.standard()
    for format, root, valid in [(4, "4", True), (4, "3", False), (3, "3", True), (3, "4", False)]:
        document = etree.fromstring(f'<root BTCPP_format="{root}">{body}</root>')
        assert schema_of(nodes, format).validate(document) is valid
    bare = etree.fromstring(f"<root>{body}</root>")
    assert schema_of(nodes, 3).validate(bare)
    assert not schema_of(nodes, 4).validate(bare)


def test_schema_documents_nodes_and_ports() -> None:
    nodes = Registry.standard()
    nodes.add(drive)
    schema = etree.fromstring(write_schema(nodes).encode())
    kind = next(element for element in schema.iter(f"{XS}complexType") if element.get("name") == "DriveType")
    shown = [str(element.text) for element in kind.iter(f"{XS}documentation")]
    assert shown[0] == "Drive, *speed* in m/s."
    assert "input, double, default '0.500000'" in shown


def test_id_that_cannot_be_a_tag_is_omitted() -> None:
    nodes = Registry.standard()
    nodes.add(drive, ID="2fast")
    assert "2fast" not in write_schema(nodes)
