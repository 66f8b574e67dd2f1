"""The tags that a tree may use: adding, replacing and removing nodes, and node libraries."""

import enum
import importlib
import json
import re
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import btcore
from btcore import (
    Condition,
    In,
    Port,
    Put,
    RegistrationError,
    Registry,
    SimClock,
    StatefulAction,
    Status,
    SyncAction,
    ThreadedAction,
    TreeNode,
    action,
)
from btcore.cli import node_libraries
from btcore.entry_points import EntryPoint
from btcore.values import DOUBLE


class Wave(SyncAction):
    def tick(self) -> Status:
        return Status.SUCCESS


@action
def bow() -> bool:
    return True


def refused(function: Any, *arguments: Any, **more: Any) -> str:
    with pytest.raises(RegistrationError) as caught:
        function(*arguments, **more)
    return str(caught.value)


def status_of(body: str, nodes: Registry) -> Status:
    xml = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    return btcore.loads(xml, nodes=nodes, clock=SimClock()).tick_once()


# --- built-in nodes

# BehaviorTree.CPP's own nodes, in 4.10 and in 3.8. A node that btcore adds needs no change here.
BUILTIN_NODES = Path(__file__).parents[2] / "conformance" / "data" / "builtin_nodes.json"
"""The nodes of BehaviorTree.CPP 3.8.7 (format 3) and 4.10 (format 4)."""


def test_the_standard_registry_has_the_nodes_of_both_formats() -> None:
    nodes = Registry.standard()
    ids = {int(key): set(value) for key, value in json.loads(BUILTIN_NODES.read_text("utf-8")).items()}
    for format in (3, 4):
        assert ids[format] - nodes.manifests_of(format).keys() == set()
        assert (ids[7 - format] - ids[format]) & nodes.manifests_of(format).keys() == set()
    assert nodes.libraries == ["btcore"]


def test_every_built_in_node_has_a_description_and_a_distribution() -> None:
    nodes = Registry.standard()
    for format in (3, 4):
        for manifest in nodes.manifests_of(format).values():
            assert manifest.description, manifest.id
            assert manifest.library == "btcore"


def test_ports_of_a_single_format_are_missing_in_the_other_format() -> None:
    nodes = Registry.standard()
    assert list(nodes.manifests_of(4)["Parallel"].ports) == ["success_count", "failure_count"]
    assert list(nodes.manifests_of(3)["Parallel"].ports) == ["success_threshold", "failure_threshold"]


def test_new_registry_is_empty_and_registries_share_nothing() -> None:
    assert list(Registry()) == []
    first, second = Registry.standard(), Registry.standard()
    first.add(Wave)
    first.add_enum({"RED": 1})
    first.remove("Sequence")
    assert "Wave" not in second
    assert second.types.enums == {}
    assert "Sequence" in second


# --- adding


def test_functions_and_classes_are_added_together_and_used_in_both_formats() -> None:
    nodes = Registry.standard()
    nodes.add(Wave, bow)
    assert nodes.get("Wave", 3) is nodes.get("Wave", 4)
    assert status_of("<Sequence><Wave/><Bow/></Sequence>", nodes) is Status.SUCCESS


def test_id_may_be_given_to_add() -> None:
    nodes = Registry.standard()
    nodes.add(bow, ID="Curtsey")
    assert "Bow" not in nodes
    assert status_of("<Curtsey/>", nodes) is Status.SUCCESS


def test_id_for_several_nodes_is_refused() -> None:
    expected_message = refused(Registry.standard().add, Wave, bow, ID="Both")
    assert expected_message == "ID='Both' names one node, but 2 are given"


def test_duplicate_id_is_refused_with_both_places() -> None:
    nodes = Registry.standard()
    nodes.add(bow)
    expected_message = refused(nodes.add, Wave, ID="Bow")
    assert expected_message.startswith("'Bow' is registered twice: by bow (")
    assert expected_message.count(f"{__file__}:") == 2
    assert "Wave (" in expected_message
    assert "replace(" in expected_message


def test_id_of_a_built_in_node_of_any_format_is_refused() -> None:
    assert "'Sequence' is registered twice" in refused(Registry.standard().add, Wave, ID="Sequence")
    assert "'SequenceStar' is registered twice" in refused(Registry.standard().add, Wave, ID="SequenceStar")


@pytest.mark.parametrize("id", ["two words", "a/b", "a:b", "<x>", "a.b", "tab\t", "del\x7f", "Root", "root"])
def test_id_that_groot_cannot_show_is_refused(id: str) -> None:
    assert f"'{id}'" in refused(Registry.standard().add, bow, ID=id)


@pytest.mark.parametrize(
    ("value", "expected_message"),
    [
        (7, "7 is neither a function nor a node class"),
        ("Wave", "'Wave' is neither a function nor a node class"),
        (Path, "Path is not a node: derive it from StatefulAction"),
        ([bow, Wave], "is neither a function nor a node class: nodes.add(first, second)"),
    ],
)
def test_object_that_is_not_a_node_is_refused(value: object, expected_message: str) -> None:
    assert expected_message in refused(Registry.standard().add, value)


def test_stateful_and_threaded_actions_require_their_methods() -> None:
    class Wait(StatefulAction):
        def on_start(self) -> Status:
            return Status.RUNNING

    class Think(ThreadedAction):
        pass

    nodes = Registry.standard()
    assert "<Wait>: " in refused(nodes.add, Wait)
    assert "Wait is a StatefulAction, but does not implement on_running(self)" in refused(nodes.add, Wait)
    assert "Think is a ThreadedAction, but does not implement work(self)" in refused(nodes.add, Think)


def test_action_that_overrides_its_tick_requires_no_other_method() -> None:
    class Odd(StatefulAction):
        def tick(self) -> Status:
            return Status.SUCCESS

    nodes = Registry.standard()
    nodes.add(Odd)
    assert status_of("<Odd/>", nodes) is Status.SUCCESS


class Gear(enum.Enum):
    LOW = 1


INVALID_DEFAULTS: dict[str, tuple[Any, object, str]] = {
    "a text": (int, "abc", "takes int, but its default is 'abc': 'abc' is not an integer"),
    "a fraction": (int, 2.5, "takes int, but its default is 2.5: "),
    "a number for a text": (str, 5, "takes std::string, but its default is 5: it is not a text"),
    "an item": (list[int], ["a"], "takes std::vector<int>, but its default is ['a']: "),
}


@pytest.mark.parametrize("case", INVALID_DEFAULTS)
def test_default_that_its_port_cannot_hold_is_refused(case: str) -> None:
    kind, default, expected_message = INVALID_DEFAULTS[case]

    def leaf(x: Any = default) -> bool:
        return True

    leaf.__annotations__["x"] = In[kind]
    assert f"the port 'x' of <Leaf> {expected_message}" in refused(Registry.standard().add, leaf)


@pytest.mark.parametrize(
    ("kind", "default"),
    [(int, "3"), (int, "{n}"), (int, None), (float, 1), (bool, "true"), (list[int], "1;2"), (Gear, Gear.LOW),
     (Path, "a text that a converter may read, once there is one")],
)  # fmt: skip
def test_a_default_may_be_a_value_its_text_an_entry_or_nothing(kind: Any, default: object) -> None:
    def leaf(x: Any = default) -> bool:
        return True

    leaf.__annotations__["x"] = In[kind]
    Registry.standard().add(leaf)


@pytest.mark.parametrize("form", ["In", "Out", "InOut", "Put"])
@pytest.mark.parametrize("written", [3, 2.5, ("int", "str")])
def test_port_annotation_that_is_not_a_type_is_refused(form: str, written: object) -> None:
    with pytest.raises(TypeError, match=rf"{form}\[.*\] is not a type: write for example {form}\[float\]"):
        getattr(btcore, form)[written]


def test_port_name_valid_only_in_format_3_can_be_added_for_format_3() -> None:
    class Measure(SyncAction):
        @staticmethod
        def provided_ports() -> list[Port]:
            return [Port("laser.range", type=DOUBLE)]

        def tick(self) -> bool:
            return bool(self.get_input("laser.range") == 0.5)

    nodes = Registry.standard()
    message = refused(nodes.add, Measure)
    assert "it contains '.'; BehaviorTree.CPP 3 accepts it: nodes.add(…, format=3)" in message
    nodes.add(Measure, format=3)
    assert (nodes.get("Measure", 3) is None, nodes.get("Measure", 4) is None) == (False, True)
    xml = '<root><BehaviorTree ID="Main"><Measure laser.range="0.5"/></BehaviorTree></root>'
    assert btcore.loads(xml, nodes=nodes).tick_once() is Status.SUCCESS
    with pytest.raises(btcore.UnknownNodeError, match="belongs to format 3"):
        status_of("<Measure/>", nodes)
    assert "format=5 is not supported: use 3 or 4" in refused(nodes.add, Wave, format=5)


def test_adding_the_same_node_twice_is_refused() -> None:
    nodes = Registry.standard()
    nodes.add(bow)
    expected_message = refused(nodes.add, bow)
    assert expected_message.startswith("'Bow' is registered already, from the same place: bow (")
    assert expected_message.endswith("; add it once")


# --- loading with a registry


@pytest.mark.parametrize("nodes", [[bow], Registry, "standard"])
def test_nodes_must_be_a_registry(nodes: Any) -> None:
    pattern = r"is not a Registry: nodes = Registry\.standard\(\); nodes\.add\(…\)"
    with pytest.raises(TypeError, match=pattern):
        btcore.loads('<root BTCPP_format="4"/>', nodes=nodes)


def test_empty_registry_lacks_the_built_in_nodes() -> None:
    with pytest.raises(btcore.UnknownNodeError, match=r"start with Registry\.standard\(\)"):
        status_of("<AlwaysSuccess/>", Registry())


@pytest.mark.parametrize("resources", [Wave, 7, "robot"])
def test_resources_must_be_a_list(resources: Any) -> None:
    with pytest.raises(TypeError, match=r"is not a list: write resources=\[…\]"):
        btcore.loads('<root BTCPP_format="4"/>', resources=resources)


def test_refused_node_is_not_registered() -> None:
    nodes = Registry.standard()
    refused(nodes.add, bow, 7)
    assert "Bow" in nodes
    refused(nodes.add, Wave, ID="no good")
    assert "no good" not in nodes


# --- replacing and removing


def test_replace_substitutes_a_node() -> None:
    def refuse() -> bool:
        return False

    nodes = Registry.standard()
    nodes.add(bow)
    nodes.replace(Bow=refuse)
    assert status_of("<Bow/>", nodes) is Status.FAILURE


def test_a_built_in_node_can_be_replaced() -> None:
    class Sequence(btcore.ControlNode):
        def tick(self) -> Status:
            return Status.FAILURE

    nodes = Registry.standard()
    nodes.replace(Sequence=Sequence)
    assert status_of("<Sequence><AlwaysSuccess/></Sequence>", nodes) is Status.FAILURE


def test_unknown_id_cannot_be_replaced_or_removed_and_gets_a_suggestion() -> None:
    nodes = Registry.standard()
    assert (
        refused(nodes.remove, "Sequense") == "no node is registered as 'Sequense'; did you mean 'Sequence'?"
    )
    assert "did you mean 'Fallback'?" in refused(nodes.replace, Falback=bow)


def test_refused_replacement_keeps_the_old_node() -> None:
    nodes = Registry.standard()
    nodes.add(bow)
    refused(nodes.replace, Bow=7)
    assert status_of("<Bow/>", nodes) is Status.SUCCESS


def test_removed_node_is_unknown() -> None:
    nodes = Registry.standard()
    nodes.add(bow)
    nodes.remove("Bow")
    with pytest.raises(btcore.UnknownNodeError):
        status_of("<Bow/>", nodes)
    nodes.add(bow)
    assert status_of("<Bow/>", nodes) is Status.SUCCESS


# --- types and enums


# --- node libraries


LIBRARY = '''
"""A library."""
from btcore import Condition, StatefulAction, SyncAction, Status, action, condition

@condition
def flag_raised() -> bool:
    """The flag is up."""
    return True

@action(ID="Salute")
def salute_it() -> bool:
    return True

def no_leaf(x):
    return x

class Linger(SyncAction):
    def tick(self):
        return Status.SUCCESS

class _Private(SyncAction):
    pass
'''

LIBRARY_IDS = {"FlagRaised", "Salute", "Linger"}


@pytest.fixture
def library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Provide the file of a library that can be imported as `gestures`."""
    file = tmp_path / "gestures.py"
    file.write_text(LIBRARY, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    yield file
    for name in [name for name in sys.modules if name.startswith(("gestures", "btcore_plugin_"))]:
        del sys.modules[name]


def added_ids(nodes: Registry) -> set[str]:
    return set(nodes.manifests) - set(Registry.standard().manifests)


def test_plugin_is_found_by_its_module_name(library: Path) -> None:
    nodes = Registry.standard()
    nodes.add_plugin("gestures")
    assert added_ids(nodes) == LIBRARY_IDS
    assert nodes.libraries == ["btcore", "gestures"]
    assert nodes.manifests["FlagRaised"].library == "gestures"


def test_add_plugin_accepts_a_file_path(library: Path) -> None:
    nodes = Registry.standard()
    nodes.add_plugin(library)
    assert added_ids(nodes) == LIBRARY_IDS
    assert nodes.libraries == ["btcore", "gestures"]
    other = Registry.standard()
    other.add_plugin(str(library), name="my gestures")
    assert other.libraries == ["btcore", "my gestures"]


def test_add_plugin_accepts_a_module(library: Path) -> None:
    module = ModuleType("handmade")
    exec("from btcore import Condition\nclass IsHandmade(Condition): pass", vars(module))
    nodes = Registry.standard()
    nodes.add_plugin(module)
    assert added_ids(nodes) == {"IsHandmade"}


def test_imported_nodes_are_not_added_by_a_plugin(library: Path) -> None:
    library.with_name("gestures_more.py").write_text(
        "from gestures import *\nfrom gestures import flag_raised\n", encoding="utf-8"
    )
    nodes = Registry.standard()
    assert "plugin 'gestures_more': it has no nodes" in refused(nodes.add_plugin, "gestures_more")
    assert added_ids(nodes) == set()


def test_plugin_may_register_its_nodes_itself(library: Path) -> None:
    library.write_text(
        LIBRARY
        + "\ndef register(nodes):\n    nodes.add(Linger, ID='Pause')\n    nodes.add_enum({'RED': 1})\n",
        encoding="utf-8",
    )
    nodes = Registry.standard()
    nodes.add_plugin("gestures")
    assert added_ids(nodes) == {"Pause"}
    assert nodes.types.enums == {"RED": 1}


def install_metadata(home: Path, name: str, points: str) -> None:
    """Create the metadata of the distribution *name* in *home*."""
    meta = home / f"{name}-1.0.dist-info"
    meta.mkdir()
    (meta / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n", encoding="utf-8")
    (meta / "entry_points.txt").write_text(f"[btcore.nodes]\n{points}\n", encoding="utf-8")


def test_add_installed_libraries_finds_installed_entry_points(library: Path) -> None:
    install_metadata(library.parent, "polite-robot", "gestures = gestures")
    nodes = Registry.standard()
    nodes.add_installed_libraries()
    assert added_ids(nodes) >= LIBRARY_IDS
    assert "polite-robot" in nodes.libraries
    assert nodes.manifests["Linger"].library == "polite-robot"


@pytest.mark.parametrize("limit", [None, "robot_nodes", ""])
def test_every_part_of_btcore_registers_the_same_installed_libraries(
    library: Path, monkeypatch: pytest.MonkeyPatch, limit: str | None
) -> None:
    """Programs, the command line and the language server."""
    worker = pytest.importorskip("btcore_studio.language.worker")
    install_metadata(library.parent, "polite-robot", "gestures = gestures")
    if limit is not None:
        monkeypatch.setenv("BTCORE_ENTRY_POINTS", limit)
    program = Registry.standard()
    ignored = program.add_installed_libraries()
    monkeypatch.setattr(node_libraries, "installed_once", node_libraries.load_installed)
    others = [node_libraries.NodeLibraries(()).nodes, worker.Libraries([], (), (), trusted=False).nodes]
    for other in others:
        assert other.libraries == program.libraries
        assert {id: manifest.library for id, manifest in other.manifests.items()} == {
            id: manifest.library for id, manifest in program.manifests.items()
        }
    assert ("polite-robot" in program.libraries) is (limit is None)
    packages = {"btcore"} if limit == "" else {"btcore", "btcore_robot"}
    if not ignored and limit is not None:
        assert set(program.libraries) == packages


@pytest.mark.parametrize("is_installed_first", [True, False])
def test_user_registration_overrides_an_installed_plugin(library: Path, is_installed_first: bool) -> None:
    install_metadata(library.parent, "polite-robot", "gestures = gestures")

    class Linger(SyncAction):
        def tick(self) -> bool:
            return True

    nodes = Registry.standard()
    if is_installed_first:
        nodes.add_installed_libraries()
        assert not nodes.is_taken("Linger")
    nodes.add(Linger)
    if not is_installed_first:
        nodes.add_installed_libraries()
    assert nodes.is_taken("Linger")
    assert nodes.manifests["Linger"].cls is Linger
    assert [(old.library, new.cls) for old, new in nodes.overridden_nodes] == [("polite-robot", Linger)]
    assert nodes.copy().overridden_nodes == nodes.overridden_nodes
    assert "registered already" in refused(nodes.add, Linger)


def test_removal_of_an_installed_node_from_a_copy_leaves_the_original_unchanged(library: Path) -> None:
    install_metadata(library.parent, "polite-robot", "gestures = gestures")
    nodes = Registry.standard()
    nodes.add_installed_libraries()
    copied = nodes.copy()
    copied.remove("Linger")
    assert "Linger" not in copied
    assert "Linger" in nodes


def test_installed_libraries_cannot_have_the_same_node(library: Path) -> None:
    library.with_name("gestures_again.py").write_text(LIBRARY, encoding="utf-8")
    install_metadata(library.parent, "polite-robot", "gestures = gestures\nagain = gestures_again")
    expected_message = refused(Registry.standard().add_installed_libraries)
    assert "'FlagRaised' is registered twice" in expected_message


def test_installed_node_with_the_id_of_a_built_in_node_is_overridden(library: Path) -> None:
    library.write_text(
        LIBRARY + "\ndef register(nodes):\n    nodes.add(Linger, ID='Sleep')\n", encoding="utf-8"
    )
    install_metadata(library.parent, "polite-robot", "gestures = gestures")
    nodes = Registry.standard()
    nodes.add_installed_libraries()
    assert nodes.manifests["Sleep"].library == "btcore"
    assert [(old.library, new.library) for old, new in nodes.overridden_nodes] == [("gestures", "btcore")]


def test_resource_of_file_loaded_twice_is_explained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "weighing.py").write_text(
        "from btcore import action\n\n\nclass Scale: ...\n\n\n"
        "@action\ndef weigh(scale: Scale) -> bool:\n    return True\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    weighing = importlib.import_module("weighing")
    nodes = Registry.standard()
    nodes.add_plugin(tmp_path / "weighing.py")
    text = '<root BTCPP_format="4"><BehaviorTree ID="Main"><Weigh/></BehaviorTree></root>'
    expected = (
        "<Weigh> needs a Scale for its parameter 'scale': resources contains a Scale of the imported module "
        "'weighing', but add_plugin loaded weighing.py a second time: write add_plugin(\"weighing\")"
    )
    with pytest.raises(btcore.TreeError, match=re.escape(expected)):
        btcore.loads(text, nodes=nodes, resources=[weighing.Scale()])

    class Scale: ...

    expected = "resources contains a Scale of the module 'other', but the leaf needs the class of 'weighing'"
    Scale.__module__, Scale.__qualname__ = "other", "Scale"
    nodes = Registry.standard()
    nodes.add_plugin("weighing")
    with pytest.raises(btcore.TreeError, match=expected):
        btcore.loads(text, nodes=nodes, resources=[Scale()])
    assert btcore.loads(text, nodes=nodes, resources=[weighing.Scale()]).tick_once() is Status.SUCCESS


def test_nodes_that_a_file_registers_itself_belong_to_the_file(tmp_path: Path) -> None:
    (tmp_path / "gripping.py").write_text(
        "from btcore import action\n\n\n@action\ndef grip() -> bool:\n    return True\n\n\n"
        "def register(nodes):\n    nodes.add(grip)\n"
    )
    nodes = Registry.standard()
    nodes.add_plugin(tmp_path / "gripping.py")
    assert nodes.manifests["Grip"].library == "gripping"


def test_an_output_of_a_function_that_is_assigned_instead_of_called_is_refused() -> None:
    async def weigh(weight: Put[float]) -> bool:
        weight = 3.0  # type: ignore[assignment]  # noqa: F841
        return True

    nodes = Registry.standard()
    assert refused(nodes.add, action(weigh)).endswith(
        "weigh assigns to its output 'weight', which writes nothing: call it with the value, weight(…)"
    )

    @action
    def count(number: In[int], result: Put[int]) -> bool:
        number += 1
        result(number)
        return True

    nodes.add(count)


def test_two_types_with_the_same_name_are_refused() -> None:
    class Pose: ...

    first, Pose.__qualname__ = Pose, "Pose"
    second = type("Pose", (), {})
    nodes = Registry.standard()
    nodes.add_type(first)
    assert refused(nodes.add_type, second) == (
        f"a type called Pose is registered already, for {__name__}.Pose; "
        f'give {__name__}.Pose another name: add_type(Pose, …, name="…")'
    )
    nodes.add_type(second, name="OtherPose")


def test_user_type_overrides_type_of_library(library: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    point = EntryPoint("gestures", "gestures", "gestures")
    monkeypatch.setattr("btcore.entry_points.find", lambda group, own: [point])
    library.write_text(
        "from dataclasses import dataclass\nfrom btcore import In, action\n"
        "@dataclass\nclass Pose2D:\n    x: float\n"
        "@action\ndef turn(goal: In[Pose2D], via: In[list[Pose2D]] = []) -> bool:\n    return goal.x == 1\n"
        "def register(nodes):\n"
        "    nodes.add_type(Pose2D, lambda text: Pose2D(float(text)))\n    nodes.add(turn)\n"
    )

    def install(nodes: Registry) -> None:
        assert nodes.add_installed_libraries() == []

    @dataclass
    class Pose2D:
        x: float
        y: float

    @action
    def go(goal: In[Pose2D], via: In[list[Pose2D]]) -> bool:
        return goal == Pose2D(1, 2) and via == [Pose2D(1, 2), Pose2D(3, 4)]

    def parse(text: str) -> Pose2D:
        return Pose2D(*map(float, text.split(",")))

    def nodes_of(*steps: Callable[[Registry], object]) -> Registry:
        nodes = Registry.standard()
        for step in steps:
            step(nodes)
        return nodes

    def add(nodes: Registry) -> None:
        nodes.add_type(Pose2D, parse, name="Pose2D")
        nodes.add(go)

    text = """<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence><Turn goal="1"/>
        <Go goal="1,2" via="1,2;3,4"/></Sequence></BehaviorTree></root>"""
    for nodes in (nodes_of(install, add), nodes_of(add, install)):
        assert btcore.loads(text, nodes=nodes).tick_once() is Status.SUCCESS
        known = nodes.types.named("Pose2D")
        assert known is not None
        assert known.python_type is Pose2D
    installed_first = nodes_of(install, add).types
    pairs = [(old.python_type.__module__, new.python_type) for old, new in installed_first.overridden]
    assert pairs == [("gestures", Pose2D)]
    mixed = text.replace('"1,2"', '"{g}"').replace('"1"', '"{g}"')
    own, installed = f"Pose2D of {__name__.partition('.')[0]}", "Pose2D of gestures"
    with pytest.raises(btcore.TreeError, match=f"has the type {own}, but its entry has the type {installed}"):
        btcore.loads(mixed, nodes=nodes)


def test_subtree_may_have_the_name_of_an_installed_node(library: Path) -> None:
    install_metadata(library.parent, "polite-robot", "gestures = gestures")
    text = """<root BTCPP_format="4" main_tree_to_execute="Main">
        <BehaviorTree ID="Main"><SubTree ID="Linger"/></BehaviorTree>
        <BehaviorTree ID="Linger"><AlwaysSuccess/></BehaviorTree></root>"""
    nodes = Registry.standard()
    nodes.add_installed_libraries()
    assert btcore.loads(text, nodes=nodes).tick_once() is Status.SUCCESS


def test_two_plugins_with_the_same_id_are_both_named(library: Path) -> None:
    second = library.with_name("gestures_again.py")
    second.write_text(LIBRARY, encoding="utf-8")
    nodes = Registry.standard()
    nodes.add_plugin("gestures")
    expected_message = refused(nodes.add_plugin, "gestures_again")
    assert expected_message.startswith("plugin 'gestures_again': 'FlagRaised' is registered twice")
    assert f"{library}:5" in expected_message
    assert f"{second}:5" in expected_message


@pytest.mark.parametrize(
    ("text", "place", "cause"),
    [
        ("x = 1\nraise ValueError('out of luck')\n", 2, "ValueError: out of luck"),
        ("\n\nimport gestures_of_nobody\n", 3, "No module named 'gestures_of_nobody'"),
        ("def half(\n", 1, "SyntaxError"),
        ("raise SystemExit(3)\n", 1, "SystemExit: 3"),
    ],
)
def test_plugin_import_error_is_named_with_line(text: str, place: int, cause: str, library: Path) -> None:
    library.write_text(text, encoding="utf-8")
    for given in ("gestures", str(library)):
        expected_message = refused(Registry.standard().add_plugin, given)
        assert expected_message.startswith(
            f"plugin '{given}' raised while it was imported: {library}:{place}: "
        )
        assert cause in expected_message


def test_plugin_whose_register_raises_is_named(library: Path) -> None:
    library.write_text("def register(nodes):\n    return 1 / 0\n", encoding="utf-8")
    expected_message = refused(Registry.standard().add_plugin, "gestures")
    assert expected_message.startswith(
        f"plugin 'gestures' raised while its register() was called: {library}:2: "
    )
    assert "ZeroDivisionError" in expected_message


def test_plugin_with_an_invalid_leaf_is_named(library: Path) -> None:
    library.write_text("from btcore import action\n@action\ndef drive(speed): ...\n", encoding="utf-8")
    expected_message = refused(Registry.standard().add_plugin, "gestures")
    assert expected_message.startswith("plugin 'gestures': parameter 'speed' of drive has no annotation")


@pytest.mark.parametrize(
    ("plugin", "expected_message"),
    [
        (" ", "a plugin has no name"),
        ("gestured", "plugin 'gestured' is not found"),
        ("nothing.py", "plugin 'nothing.py' is not found: there is no such file"),
        ("gestures:brung", "plugin 'gestures': gestures has no function 'brung'"),
        (
            "btcore.nodes.manual_selector",
            "plugin 'btcore.nodes.manual_selector': 'ManualSelector' is registered already, from the same",
        ),
    ],
)
def test_missing_or_repeated_plugin_is_named(library: Path, plugin: str, expected_message: str) -> None:
    assert refused(Registry.standard().add_plugin, plugin).startswith(expected_message)


def test_a_broken_entry_point_names_its_distribution(library: Path) -> None:
    library.write_text("raise ValueError('out of luck')\n", encoding="utf-8")
    install_metadata(library.parent, "broken-robot", "gestures = gestures")
    expected_message = refused(Registry.standard().add_installed_libraries)
    assert "broken-robot" in expected_message
    assert "out of luck" in expected_message


def test_installed_plugin_that_lacks_a_module_is_skipped_and_reported(library: Path) -> None:
    library.write_text("import no_such_camera\n", encoding="utf-8")
    install_metadata(library.parent, "seeing-robot", "gestures = gestures")
    (reported,) = [
        fault for fault in Registry.standard().add_installed_libraries() if "seeing-robot" in str(fault)
    ]
    assert "ModuleNotFoundError: No module named 'no_such_camera'" in str(reported)


def test_an_entry_point_may_name_a_function_of_a_module(library: Path) -> None:
    library.write_text(LIBRARY + "\ndef bring(nodes):\n    nodes.add(Linger, ID='Pause')\n", encoding="utf-8")
    install_metadata(library.parent, "polite-robot", "gestures = gestures:bring")
    nodes = Registry.standard()
    nodes.add_installed_libraries()
    assert "Pause" in added_ids(nodes)


def test_base_classes_of_the_engine_are_not_registered() -> None:
    for kind in (TreeNode, btcore.ControlNode, btcore.DecoratorNode, SyncAction, Condition):
        assert kind.__name__ not in Registry.standard()


def test_enum_name_is_registered_with_its_number() -> None:
    nodes = Registry.standard()
    nodes.add_enum({"RED": 1})
    nodes.add_enum({"RED": 1})
    assert status_of('<ScriptCondition code="RED == 1"/>', nodes) is Status.SUCCESS
    with pytest.raises(RegistrationError, match="RED is 1 already, not 2"):
        nodes.add_enum({"RED": 2})


def test_an_output_of_a_function_may_be_renamed() -> None:
    def weigh(weight: Put[float]) -> bool:
        write = weight
        weight = 3.0  # type: ignore[assignment]
        write(weight)  # type: ignore[arg-type]
        return True

    nodes = Registry.standard()
    nodes.add(action(weigh))
    assert "Weigh" in nodes.manifests
