"""Models without code: trees with C++ leaves are checked, and run with mock leaves."""

from pathlib import Path

import pytest

import btcore
from btcore import Direction, NodeType, Registry, SimClock, Status, TreeError
from btcore.entry_points import EntryPoint
from btcore.errors import RegistrationError
from btcore.lint.validate import validate_document
from btcore.registry.mock_leaves import Outcomes
from btcore.xml.models.model_file import add_explicit_nodes, add_models
from btcore.xml.models.tree_nodes_model import write_models
from btcore.xml.read.read import parse_file, parse_text

MODELS = """<root BTCPP_format="4">
  <TreeNodesModel>
    <Action ID="Move"><input_port name="goal" type="geometry_msgs::Pose"/>
      <input_port name="speed" type="double" default="0.5">in m/s</input_port>
      <output_port name="left" type="int"/></Action>
    <Condition ID="DoorOpen"/>
    <Decorator ID="Guard"><inout_port name="count" type="uint32_t"/></Decorator>
    <Control ID="Shuffle"/>
    <Action ID="Sequence"/>
    <SubTree ID="Fetch"><input_port name="item"/></SubTree>
  </TreeNodesModel>
</root>"""
TREE = """<root BTCPP_format="4"><BehaviorTree ID="Main">
  <Shuffle>
    <Guard count="{n}"><Move goal="{g}" speed="0.3" left="{left}"/></Guard>
    <DoorOpen name="door"/>
  </Shuffle>
</BehaviorTree></root>"""


@pytest.fixture
def models(tmp_path: Path) -> Path:
    path = tmp_path / "palette.xml"
    path.write_text(MODELS, encoding="utf-8")
    return path


def test_the_models_of_a_file_become_nodes_with_their_ports(models: Path) -> None:
    nodes = Registry.standard()
    assert add_models(nodes, models) == ["Move", "DoorOpen", "Guard", "Shuffle"]
    kinds = {id: nodes.manifests[id].type for id in ("Move", "DoorOpen", "Guard", "Shuffle")}
    assert kinds == {
        "Move": NodeType.ACTION,
        "DoorOpen": NodeType.CONDITION,
        "Guard": NodeType.DECORATOR,
        "Shuffle": NodeType.CONTROL,
    }
    ports = nodes.manifests["Move"].ports
    assert [(one.name, one.direction, one.type.name, one.default) for one in ports.values()] == [
        ("goal", Direction.IN, "geometry_msgs::Pose", None),
        ("speed", Direction.IN, "double", "0.5"),
        ("left", Direction.OUT, "int", None),
    ]
    assert ports["speed"].description == "in m/s"
    assert {nodes.manifests[id].description for id in kinds} == {""}
    assert nodes.manifests["Guard"].ports["count"].type.name == "unsigned int"


def test_names_and_defaults_that_only_cpp_understands_are_accepted(tmp_path: Path) -> None:
    path = tmp_path / "palette.xml"
    path.write_text(
        '<root><TreeNodesModel><Action ID="Scan"><input_port name="laser.range" type="double"/>'
        '<input_port name="times" type="int" default="twice"/></Action></TreeNodesModel></root>'
    )
    nodes = Registry.standard()
    add_models(nodes, path)
    # BehaviorTree.CPP 3 accepts any port name; BehaviorTree.CPP 4 cannot have such a port.
    assert list(nodes.manifests_of(3)["Scan"].ports) == ["laser.range", "times"]
    assert list(nodes.manifests_of(4)["Scan"].ports) == ["times"]
    body = '<BehaviorTree ID="Main"><Scan laser.range="0.5"/></BehaviorTree>'
    assert btcore.loads(f"<root>{body}</root>", nodes=nodes).tick_once() is Status.SUCCESS


def test_type_of_a_model_is_not_the_type_of_an_installed_library_with_the_same_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "positions.py").write_text(
        "from btcore import In, action\nclass Position(complex): ...\n"
        "@action\ndef go(to: In[Position]) -> bool:\n    return True\n"
        "def register(nodes):\n    nodes.add_type(Position, Position)\n    nodes.add(go)\n"
    )
    model = '<Action ID="Fly"><input_port name="to" type="Position"/></Action>'
    (tmp_path / "palette.xml").write_text(f"<root><TreeNodesModel>{model}</TreeNodesModel></root>")
    nodes = Registry.standard()
    point = EntryPoint("positions", "positions", "positions")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr("btcore.entry_points.find", lambda group, own: [point])
    assert nodes.add_installed_libraries() == []
    add_models(nodes, tmp_path / "palette.xml")
    body = '<Sequence><Fly to="12 North"/><Fly to="{p}"/><Go to="{p}"/></Sequence>'
    document = parse_text(f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>')
    assert validate_document(document, nodes=nodes, given=["p"]) == []


def test_an_explicit_tag_of_format_3_may_have_any_port() -> None:
    nodes = Registry.standard()
    body = '<BehaviorTree ID="Main"><Action ID="Scan" laser.range="{r}"/></BehaviorTree>'
    add_explicit_nodes(nodes, [parse_text(f"<root>{body}</root>")])
    assert list(nodes.manifests_of(3)["Scan"].ports) == ["laser.range"]


def test_registered_node_is_not_replaced_by_a_model(models: Path) -> None:
    nodes = Registry.standard()
    add_models(nodes, models)
    assert nodes.manifests["Sequence"].type is NodeType.CONTROL
    assert add_models(nodes, models) == []


def test_exported_models_can_be_read_back(tmp_path: Path, models: Path) -> None:
    nodes = Registry.standard()
    add_models(nodes, models)
    path = tmp_path / "export.xml"
    path.write_text(write_models(nodes.manifests.values()), encoding="utf-8")
    again = Registry.standard()
    assert sorted(add_models(again, path)) == ["DoorOpen", "Guard", "Move", "Shuffle"]
    assert write_models(again.manifests.values()) == write_models(nodes.manifests.values())


def test_tree_of_modelled_nodes_is_checked_like_any_other(tmp_path: Path, models: Path) -> None:
    nodes = Registry.standard()
    add_models(nodes, models)
    good, bad = tmp_path / "good.xml", tmp_path / "bad.xml"
    good.write_text(TREE, encoding="utf-8")
    bad.write_text(TREE.replace('speed="0.3"', 'speed="fast"').replace("goal=", "gaol="), encoding="utf-8")
    assert [one for one in validate_document(parse_file(good), nodes=nodes) if one.is_error] == []
    assert [one.code for one in validate_document(parse_file(bad), nodes=nodes) if one.is_error] == [
        "E201",
        "E202",
    ]


def test_a_mock_leaf_succeeds_immediately_or_follows_its_outcomes(models: Path) -> None:
    nodes = Registry.standard()
    add_models(nodes, models)
    assert btcore.loads(TREE, nodes=nodes).tick_exactly_once() is Status.SUCCESS
    results = Outcomes(leaves={"Move": "RS|F", "door": "F"})
    tree = btcore.loads(TREE, nodes=nodes, resources=[results], clock=SimClock())
    assert [tree.tick_exactly_once().name for _ in range(4)] == ["RUNNING", "FAILURE", "FAILURE", "RUNNING"]


def test_file_of_trees_provides_its_models_and_its_explicit_tags(tmp_path: Path) -> None:
    path = tmp_path / "groot1.xml"
    path.write_text(
        """<root><BehaviorTree ID="A"><Sequence>
        <Condition ID="Ready" limit="3"/><Action ID="Act" to="{x}" how=""/>
        <Decorator ID="Twice"><Action ID="Act"/></Decorator>
        </Sequence></BehaviorTree>
        <TreeNodesModel><Condition ID="Ready"><input_port name="limit"/></Condition></TreeNodesModel>
        </root>""",
        encoding="utf-8",
    )
    nodes = Registry.standard()
    assert add_models(nodes, path) == ["Ready", "Act", "Twice"]
    assert {one.name: one.direction for one in nodes.manifests["Act"].ports.values()} == {
        "to": Direction.INOUT,
        "how": Direction.IN,
    }
    assert btcore.load(path, nodes=nodes).tick_exactly_once() is Status.SUCCESS


def test_compact_tag_without_a_model_stays_unknown() -> None:
    nodes = Registry.standard()
    text = '<root BTCPP_format="4"><BehaviorTree ID="A"><Sequense/></BehaviorTree></root>'
    assert add_explicit_nodes(nodes, [parse_text(text)]) == []
    assert "Sequense" not in nodes


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('<root BTCPP_format="4"/>', "contains no model"),
        ('<root><TreeNodesModel><Action name="x"/></TreeNodesModel></root>', "missing ID"),
        ('<root><TreeNodesModel><Action ID="a b"/></TreeNodesModel></root>', "'a b' can't be the ID"),
    ],
)
def test_file_without_valid_models_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "odd.xml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(TreeError, match=message):
        add_models(Registry.standard(), path)


# --- projects of Groot 2


@pytest.fixture
def project(tmp_path: Path) -> Path:
    (tmp_path / "trees").mkdir()
    (tmp_path / "trees" / "main.xml").write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="Main"><SubTree ID="Open"/></BehaviorTree></root>'
    )
    (tmp_path / "trees" / "open.xml").write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="Open"><Push force="3"/></BehaviorTree></root>'
    )
    path = tmp_path / "robot.btproj"
    path.write_text(
        '<?xml version="1.0" encoding="UTF-8"?>\n<root BTCPP_format="4" project_name="Robot">\n'
        '    <include path="trees/main.xml"/>\n    <include path="trees/open.xml"/>\n'
        "    <!-- Description of Node Models (used by Groot) -->\n    <TreeNodesModel>\n"
        '        <Action ID="Push"><input_port name="force" type="double"/></Action>\n'
        "    </TreeNodesModel>\n</root>\n"
    )
    return path


def test_project_contains_its_documents_and_its_models(project: Path) -> None:
    nodes = Registry.standard()
    assert add_models(nodes, project) == ["Push"]
    assert btcore.load(project, nodes=nodes, tree="Main").tick_exactly_once() is Status.SUCCESS


def test_missing_file_of_a_project_is_reported_with_its_position(project: Path) -> None:
    (project.parent / "trees" / "open.xml").unlink()
    with pytest.raises(TreeError, match=r"robot\.btproj:4:\d+: E007 the included file"):
        add_models(Registry.standard(), project)


# --- metadata

METADATA = """<root BTCPP_format="4">
    <TreeNodesModel>
        <Action ID="Move">
            <input_port name="goal" type="std::string"/>
            <MetadataFields>
                <Metadata author="Ada &amp; Bo"/>
                <Metadata max-speed="2"/>
            </MetadataFields>
        </Action>
        <Condition ID="Near">
            <MetadataFields>
                <Metadata icon="eye"/>
            </MetadataFields>
        </Condition>
    </TreeNodesModel>
</root>
"""


def test_metadata_of_a_model_is_kept_and_exported(tmp_path: Path) -> None:
    (tmp_path / "palette.xml").write_text(METADATA)
    nodes = Registry()
    add_models(nodes, tmp_path / "palette.xml")
    assert nodes.manifests["Move"].metadata == {"author": "Ada & Bo", "max-speed": "2"}
    assert write_models(nodes.manifests.values()) == METADATA
    assert "Metadata" not in write_models(nodes.manifests_of(3).values(), 3)


class Drive(btcore.SyncAction):
    """Drives."""

    @staticmethod
    def metadata() -> dict[str, str]:
        return {"author": "Ada"}

    def tick(self) -> bool:
        return True


class Inspect(btcore.SyncAction):
    """Has another attribute with the name."""

    metadata: btcore.In[str] = "text"

    def tick(self) -> bool:
        return True


class Annotate(btcore.SyncAction):
    """Has a method with the name."""

    def metadata(self) -> str:
        return "text"

    def tick(self) -> bool:
        return True


def test_class_declares_its_metadata_and_a_program_adds_some() -> None:
    nodes = Registry()
    nodes.add(Drive, Inspect, Annotate)
    nodes.manifests["Drive"].metadata["icon"] = "wheel"
    nodes.manifests["Inspect"].metadata["icon"] = "eye"
    metadata = {id: manifest.metadata for id, manifest in nodes.copy().manifests.items()}
    assert metadata == {
        "Annotate": {},
        "Drive": {"author": "Ada", "icon": "wheel"},
        "Inspect": {"icon": "eye"},
    }


def test_metadata_that_is_no_name_in_xml_is_refused() -> None:
    class Lift(Drive):
        @staticmethod
        def metadata() -> dict[str, str]:
            return {"max speed": "2"}

    with pytest.raises(RegistrationError, match=r"invalid name 'max speed' in the metadata of .*Lift"):
        Registry().add(Lift)
