"""What tags a tree may use: adding, replacing and removing nodes, and node libraries."""

import enum
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import btcore
from btcore import (
    Condition,
    In,
    Port,
    RegistrationError,
    Registry,
    SimClock,
    StatefulAction,
    Status,
    SyncAction,
    ThreadedAction,
    TreeNode,
    action,
    condition,
)
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


# --- what is built in

# BehaviorTree.CPP's own nodes, in 4.10 and in 3.8. A node that btcore adds needs no change here.
BUILTIN_NODES = Path(__file__).parents[2] / "conformance" / "data" / "builtin_nodes.json"
"""The nodes of BehaviorTree.CPP 3.8.7 (format 3) and 4.10 (format 4)."""


def test_the_standard_registry_has_the_nodes_of_both_formats() -> None:
    nodes = Registry.standard()
    for format, ids in json.loads(BUILTIN_NODES.read_text(encoding="utf-8")).items():
        assert set(ids) - nodes.manifests_of(int(format)).keys() == set()
    assert "SequenceStar" in nodes.manifests_of(3)
    assert "SequenceStar" not in nodes.manifests_of(4)
    assert nodes.libraries == ["btcore"]


def test_every_built_in_node_says_what_it_does_and_where_it_comes_from() -> None:
    nodes = Registry.standard()
    for format in (3, 4):
        for manifest in nodes.manifests_of(format).values():
            assert manifest.description, manifest.id
            assert manifest.distribution == "btcore"


def test_ports_that_exist_in_one_format_only_are_those_of_that_format() -> None:
    nodes = Registry.standard()
    assert list(nodes.manifests_of(4)["Parallel"].ports) == ["success_count", "failure_count"]
    assert list(nodes.manifests_of(3)["Parallel"].ports) == ["success_threshold", "failure_threshold"]


def test_a_new_registry_is_empty_and_two_registries_share_nothing() -> None:
    assert list(Registry()) == []
    one, other = Registry.standard(), Registry.standard()
    one.add(Wave)
    one.add_enum({"RED": 1})
    one.remove("Sequence")
    assert "Wave" not in other
    assert other.types.enums == {}
    assert "Sequence" in other


# --- adding


def test_functions_and_classes_are_added_together_and_used_in_both_formats() -> None:
    nodes = Registry.standard()
    nodes.add(Wave, bow)
    assert nodes.get("Wave", 3) is nodes.get("Wave", 4)
    assert status_of("<Sequence><Wave/><Bow/></Sequence>", nodes) is Status.SUCCESS


def test_an_id_may_be_given_when_it_is_added() -> None:
    nodes = Registry.standard()
    nodes.add(bow, ID="Curtsey")
    assert "Bow" not in nodes
    assert status_of("<Curtsey/>", nodes) is Status.SUCCESS


def test_one_id_names_one_thing() -> None:
    said = refused(Registry.standard().add, Wave, bow, ID="Both")
    assert said == "ID='Both' names one thing, but 2 are given"


def test_an_id_that_is_taken_is_refused_and_both_places_are_named() -> None:
    nodes = Registry.standard()
    nodes.add(bow)
    said = refused(nodes.add, Wave, ID="Bow")
    assert said.startswith("'Bow' is registered twice: by bow (")
    assert said.count(f"{__file__}:") == 2
    assert "Wave (" in said
    assert "replace(" in said


def test_a_built_in_id_is_taken_too_in_whichever_format_it_is() -> None:
    assert "'Sequence' is registered twice" in refused(Registry.standard().add, Wave, ID="Sequence")
    assert "'SequenceStar' is registered twice" in refused(Registry.standard().add, Wave, ID="SequenceStar")


@pytest.mark.parametrize("ID", ["two words", "a/b", "a:b", "<x>", "a.b", "tab\t", "del\x7f", "Root", "root"])
def test_an_id_that_groot_can_not_show_is_refused(ID: str) -> None:
    assert f"'{ID}'" in refused(Registry.standard().add, bow, ID=ID)


@pytest.mark.parametrize(
    ("thing", "said"),
    [
        (7, "7 is neither a function nor a node class"),
        ("Wave", "'Wave' is neither a function nor a node class"),
        (Path, "Path is not a node: derive it from StatefulAction"),
    ],
)
def test_what_is_no_node_is_refused(thing: object, said: str) -> None:
    assert said in refused(Registry.standard().add, thing)


def test_several_things_are_added_side_by_side() -> None:
    assert "is neither a function nor a node class: nodes.add(first, second)" in refused(
        Registry.standard().add, [bow, Wave]
    )


def test_an_action_that_lasts_needs_the_methods_that_its_ticks_call() -> None:
    class Wait(StatefulAction):
        def on_start(self) -> Status:
            return Status.RUNNING

    class Think(ThreadedAction):
        pass

    nodes = Registry.standard()
    assert "<Wait>: " in refused(nodes.add, Wait)
    assert "Wait is a StatefulAction, but does not implement on_running(self)" in refused(nodes.add, Wait)
    assert "Think is a ThreadedAction, but does not implement work(self)" in refused(nodes.add, Think)


def test_an_action_that_overrides_its_tick_needs_no_others() -> None:
    class Odd(StatefulAction):
        def tick(self) -> Status:
            return Status.SUCCESS

    nodes = Registry.standard()
    nodes.add(Odd)
    assert status_of("<Odd/>", nodes) is Status.SUCCESS


class Gear(enum.Enum):
    LOW = 1


WRONG: dict[str, tuple[Any, object, str]] = {
    "a text": (int, "abc", "takes int, but its default is 'abc': 'abc' is not an integer"),
    "a fraction": (int, 2.5, "takes int, but its default is 2.5: "),
    "a number for a text": (str, 5, "takes std::string, but its default is 5: it is not a text"),
    "an item": (list[int], ["a"], "takes std::vector<int>, but its default is ['a']: "),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_default_that_its_port_can_not_hold_is_refused(case: str) -> None:
    kind, default, said = WRONG[case]

    def leaf(x: Any = default) -> bool:
        return True

    leaf.__annotations__["x"] = In[kind]
    assert f"the port 'x' of <Leaf> {said}" in refused(Registry.standard().add, leaf)


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
def test_a_port_of_what_is_no_type_is_refused_where_it_is_written(form: str, written: object) -> None:
    with pytest.raises(TypeError, match=rf"{form}\[.*\] is not a type: write for example {form}\[float\]"):
        getattr(btcore, form)[written]


def test_a_port_whose_name_only_format_3_takes_is_one_of_its_trees_alone() -> None:
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


def test_the_same_thing_twice_is_told_as_such() -> None:
    nodes = Registry.standard()
    nodes.add(bow)
    said = refused(nodes.add, bow)
    assert said.startswith("'Bow' is registered already, from the same place: bow (")
    assert said.endswith("; add it once")


def test_a_built_in_node_that_a_library_brings_again_is_the_same_thing_on_both_builds() -> None:
    said = refused(Registry.standard().add_plugin, "btcore.nodes.manual_selector")
    assert said.startswith(
        "plugin 'btcore.nodes.manual_selector': 'ManualSelector' is registered already, from the same place"
    )


def test_a_library_without_a_name_is_refused() -> None:
    assert refused(Registry.standard().add_plugin, " ").startswith("a plugin has no name")


# --- what is loaded with it


@pytest.mark.parametrize("nodes", [[bow], Registry, "standard"])
def test_only_a_registry_is_one(nodes: Any) -> None:
    pattern = r"is not a Registry: nodes = Registry\.standard\(\); nodes\.add\(…\)"
    with pytest.raises(TypeError, match=pattern):
        btcore.loads('<root BTCPP_format="4"/>', nodes=nodes)


def test_an_empty_registry_does_not_know_the_built_in_nodes() -> None:
    with pytest.raises(btcore.UnknownNodeError, match=r"start with Registry\.standard\(\)"):
        status_of("<AlwaysSuccess/>", Registry())


@pytest.mark.parametrize("resources", [Wave, 7, "robot"])
def test_resources_are_a_list(resources: Any) -> None:
    with pytest.raises(TypeError, match=r"is not a list: write resources=\[…\]"):
        btcore.loads('<root BTCPP_format="4"/>', resources=resources)


def test_what_was_refused_is_not_there() -> None:
    nodes = Registry.standard()
    refused(nodes.add, bow, 7)
    assert "Bow" in nodes
    refused(nodes.add, Wave, ID="no good")
    assert "no good" not in nodes


# --- replacing and removing


def test_replace_puts_a_thing_in_the_place_of_another() -> None:
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


def test_what_is_not_there_is_not_replaced_nor_removed_and_the_nearest_is_named() -> None:
    nodes = Registry.standard()
    assert (
        refused(nodes.remove, "Sequense") == "no node is registered as 'Sequense'; did you mean 'Sequence'?"
    )
    assert "did you mean 'Fallback'?" in refused(nodes.replace, Falback=bow)


def test_a_replacement_that_is_refused_leaves_what_was_there() -> None:
    nodes = Registry.standard()
    nodes.add(bow)
    refused(nodes.replace, Bow=7)
    assert status_of("<Bow/>", nodes) is Status.SUCCESS


def test_what_was_removed_is_no_node_any_more() -> None:
    nodes = Registry.standard()
    nodes.add(bow)
    nodes.remove("Bow")
    with pytest.raises(btcore.UnknownNodeError):
        status_of("<Bow/>", nodes)
    nodes.add(bow)
    assert status_of("<Bow/>", nodes) is Status.SUCCESS


# --- types and enums


def test_a_type_with_a_text_form_may_be_written_in_the_xml() -> None:
    class Pose:
        def __init__(self, x: float) -> None:
            self.x = x

    @condition
    def is_at(pose: In[Pose]) -> bool:
        return pose.x == 2.5

    nodes = Registry.standard()
    nodes.add_type(Pose, lambda text: Pose(float(text)))
    nodes.add(is_at)
    assert status_of('<IsAt pose="2.5"/>', nodes) is Status.SUCCESS


def test_the_names_of_an_enum_are_known_to_ports_and_scripts() -> None:
    class Gear(enum.Enum):
        PARK = 0
        DRIVE = 3

    @condition
    def in_gear(gear: In[Gear]) -> bool:
        return gear is Gear.DRIVE

    nodes = Registry.standard()
    nodes.add_enum(Gear)
    nodes.add(in_gear)
    assert status_of('<InGear gear="DRIVE"/>', nodes) is Status.SUCCESS
    assert status_of('<InGear gear="3"/>', nodes) is Status.SUCCESS
    assert status_of('<InGear gear="PARK"/>', nodes) is Status.FAILURE
    assert (
        status_of('<Sequence><Script code="g:=DRIVE"/><InGear gear="{g}"/></Sequence>', nodes)
        is Status.SUCCESS
    )


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

MINE = {"FlagRaised", "Salute", "Linger"}


@pytest.fixture
def library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The file of a library that can be imported as `gestures`."""
    file = tmp_path / "gestures.py"
    file.write_text(LIBRARY, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    yield file
    for name in [name for name in sys.modules if name.startswith(("gestures", "btcore_plugin_"))]:
        del sys.modules[name]


def mine(nodes: Registry) -> set[str]:
    return set(nodes.manifests) - set(Registry.standard().manifests)


def test_a_library_is_found_by_the_name_of_its_module(library: Path) -> None:
    nodes = Registry.standard()
    nodes.add_plugin("gestures")
    assert mine(nodes) == MINE
    assert nodes.libraries == ["btcore", "gestures"]
    assert nodes.manifests["FlagRaised"].distribution == "gestures"


def test_add_plugin_accepts_a_file_path(library: Path) -> None:
    nodes = Registry.standard()
    nodes.add_plugin(library)
    assert mine(nodes) == MINE
    assert nodes.libraries == ["btcore", "gestures"]
    other = Registry.standard()
    other.add_plugin(str(library), name="my gestures")
    assert other.libraries == ["btcore", "my gestures"]


def test_add_plugin_accepts_a_module(library: Path) -> None:
    module = ModuleType("handmade")
    exec("from btcore import Condition\nclass IsHandmade(Condition): pass", vars(module))
    nodes = Registry.standard()
    nodes.add_plugin(module)
    assert mine(nodes) == {"IsHandmade"}


def test_what_a_library_imports_is_not_what_it_brings(library: Path) -> None:
    library.with_name("gestures_more.py").write_text(
        "from gestures import *\nfrom gestures import flag_raised\n", encoding="utf-8"
    )
    nodes = Registry.standard()
    assert "plugin 'gestures_more': it has no nodes" in refused(nodes.add_plugin, "gestures_more")
    assert mine(nodes) == set()


def test_a_library_may_register_its_nodes_itself(library: Path) -> None:
    library.write_text(
        LIBRARY
        + "\ndef register(nodes):\n    nodes.add(Linger, ID='Pause')\n    nodes.add_enum({'RED': 1})\n",
        encoding="utf-8",
    )
    nodes = Registry.standard()
    nodes.add_plugin("gestures")
    assert mine(nodes) == {"Pause"}
    assert nodes.types.enums == {"RED": 1}


def installed(home: Path, name: str, points: str) -> None:
    """Make *home* look as if the distribution *name* was installed into it."""
    meta = home / f"{name}-1.0.dist-info"
    meta.mkdir()
    (meta / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n", encoding="utf-8")
    (meta / "entry_points.txt").write_text(f"[btcore.nodes]\n{points}\n", encoding="utf-8")


def test_add_plugins_finds_installed_entry_points(library: Path) -> None:
    installed(library.parent, "polite-robot", "gestures = gestures")
    nodes = Registry.standard()
    nodes.add_plugins()
    assert mine(nodes) >= MINE
    assert "polite-robot" in nodes.libraries
    assert nodes.manifests["Linger"].distribution == "polite-robot"


def test_an_installed_library_gives_way_to_what_a_user_registers(library: Path) -> None:
    installed(library.parent, "polite-robot", "gestures = gestures")
    nodes = Registry.standard()
    nodes.add_plugins()

    class Linger(SyncAction):
        def tick(self) -> bool:
            return True

    nodes.add(Linger)
    assert nodes.manifests["Linger"].cls is Linger
    assert [(old.distribution, new.cls) for old, new in nodes.overridden_nodes] == [("polite-robot", Linger)]
    assert "registered already" in refused(nodes.add, Linger)


def test_a_tree_may_be_called_as_a_node_of_an_installed_library(library: Path) -> None:
    installed(library.parent, "polite-robot", "gestures = gestures")
    text = """<root BTCPP_format="4" main_tree_to_execute="Main">
        <BehaviorTree ID="Main"><SubTree ID="Linger"/></BehaviorTree>
        <BehaviorTree ID="Linger"><AlwaysSuccess/></BehaviorTree></root>"""
    nodes = Registry.standard()
    nodes.add_plugins()
    assert btcore.loads(text, nodes=nodes).tick_once() is Status.SUCCESS


def test_two_libraries_that_bring_the_same_id_are_both_named(library: Path) -> None:
    second = library.with_name("gestures_again.py")
    second.write_text(LIBRARY, encoding="utf-8")
    nodes = Registry.standard()
    nodes.add_plugin("gestures")
    said = refused(nodes.add_plugin, "gestures_again")
    assert said.startswith("plugin 'gestures_again': 'FlagRaised' is registered twice")
    assert f"{library}:5" in said
    assert f"{second}:5" in said


@pytest.mark.parametrize(
    ("text", "place", "cause"),
    [
        ("x = 1\nraise ValueError('out of luck')\n", 2, "ValueError: out of luck"),
        ("\n\nimport gestures_of_nobody\n", 3, "No module named 'gestures_of_nobody'"),
        ("def half(\n", 1, "SyntaxError"),
        ("raise SystemExit(3)\n", 1, "SystemExit: 3"),
    ],
)
def test_a_library_that_raises_when_it_is_imported_is_named_with_the_line_and_what_it_raised(
    text: str, place: int, cause: str, library: Path
) -> None:
    library.write_text(text, encoding="utf-8")
    for given in ("gestures", str(library)):
        said = refused(Registry.standard().add_plugin, given)
        assert said.startswith(f"plugin '{given}' raised while it was imported: {library}:{place}: ")
        assert cause in said


def test_a_library_whose_register_raises_is_named_in_the_same_way(library: Path) -> None:
    library.write_text("def register(nodes):\n    return 1 / 0\n", encoding="utf-8")
    said = refused(Registry.standard().add_plugin, "gestures")
    assert said.startswith(f"plugin 'gestures' raised while its register() was called: {library}:2: ")
    assert "ZeroDivisionError" in said


def test_a_library_with_a_leaf_that_can_not_be_registered_is_named(library: Path) -> None:
    library.write_text("from btcore import action\n@action\ndef drive(speed): ...\n", encoding="utf-8")
    said = refused(Registry.standard().add_plugin, "gestures")
    assert said.startswith("plugin 'gestures': parameter 'speed' of drive has no annotation")


def test_a_library_that_is_not_there_is_named(library: Path) -> None:
    assert "plugin 'gestured' is not found" in refused(Registry.standard().add_plugin, "gestured")
    missing = str(library.with_name("nothing.py"))
    assert refused(Registry.standard().add_plugin, missing) == (
        f"plugin '{missing}' is not found: there is no such file"
    )


def test_a_broken_entry_point_names_its_distribution(library: Path) -> None:
    library.write_text("raise ValueError('out of luck')\n", encoding="utf-8")
    installed(library.parent, "broken-robot", "gestures = gestures")
    said = refused(Registry.standard().add_plugins)
    assert "broken-robot" in said
    assert "out of luck" in said


def test_an_installed_library_that_lacks_a_module_is_left_out_and_told_of(library: Path) -> None:
    library.write_text("import no_such_camera\n", encoding="utf-8")
    installed(library.parent, "seeing-robot", "gestures = gestures")
    (told,) = [fault for fault in Registry.standard().add_plugins() if "seeing-robot" in str(fault)]
    assert "ModuleNotFoundError: No module named 'no_such_camera'" in str(told)


def test_an_entry_point_may_name_a_function_of_a_module(library: Path) -> None:
    library.write_text(LIBRARY + "\ndef bring(nodes):\n    nodes.add(Linger, ID='Pause')\n", encoding="utf-8")
    installed(library.parent, "polite-robot", "gestures = gestures:bring")
    nodes = Registry.standard()
    nodes.add_plugins()
    assert "Pause" in mine(nodes)


def test_a_function_that_the_module_does_not_have_is_named(library: Path) -> None:
    said = refused(Registry.standard().add_plugin, "gestures:brung")
    assert said == "plugin 'gestures': gestures has no function 'brung'"


def test_the_classes_of_the_engine_are_no_nodes_of_their_own() -> None:
    for kind in (TreeNode, btcore.ControlNode, btcore.DecoratorNode, SyncAction, Condition):
        assert kind.__name__ not in Registry.standard()
