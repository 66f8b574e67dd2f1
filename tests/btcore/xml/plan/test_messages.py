"""Errors of loading: the whole messages, as a user reads them, and the types of the exceptions."""

import enum
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import btcore
from btcore import In, Registry, condition
from btcore.blackboard.blackboard import Blackboard
from btcore.entry_points import LIMIT_VARIABLE
from btcore.errors import PortError, TreeError
from btcore.lint.validate import validate_document
from btcore.loading.instantiate import instantiate
from btcore.xml.plan import hints
from btcore.xml.plan.plan import plan_document
from btcore.xml.read.read import parse_text
from tests.btcore.message_cases import read_cases

Write = Callable[..., str]
CASES = read_cases(Path(__file__).with_name("messages.txt"))
PLUGIN = "; load a plugin that provides it (--plugin, or nodes.add_plugin)"


@pytest.fixture
def no_installed_libraries(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Hide the node libraries of this environment, which hints about unknown nodes name."""
    monkeypatch.setenv(LIMIT_VARIABLE, "")
    hints._installed_nodes.cache_clear()
    yield
    hints._installed_nodes.cache_clear()


@pytest.mark.usefixtures("no_installed_libraries")
@pytest.mark.parametrize("case", CASES)
def test_error_message(case: str, nodes: Registry, document: Write) -> None:
    text, message = CASES[case]
    libraries = {one.library for one in nodes.manifests.values()} - {"btcore"}
    searched = ", ".join(["searched: btcore", *sorted(libraries)])
    if not text.startswith(("<root", "<Root", "<svg")):
        text = document(text.rstrip("\n"))
    with pytest.raises(TreeError) as caught:
        instantiate(plan_document(parse_text(text, "t.xml"), nodes), resources=[nodes])
    assert str(caught.value) == message.replace("SEARCHED", searched).replace("; PLUGIN", PLUGIN)
    assert case.endswith(f" ({type(caught.value).__name__})")


def test_port_error_in_an_unused_tree_does_not_refuse_the_main_tree(nodes: Registry, document: Write) -> None:
    text = document("<Say/>", {"Unused": '<Say txt="1"/>'})
    assert instantiate(plan_document(parse_text(text), nodes)).id == "Main"


def test_type_of_an_entry_on_a_given_blackboard_is_checked(nodes: Registry, document: Write) -> None:
    blackboard = Blackboard()
    blackboard["n"] = True
    text = document('<Repeat num_cycles="{n}"><Say/></Repeat>')
    with pytest.raises(PortError) as caught:
        instantiate(plan_document(parse_text(text, "t.xml"), nodes), blackboard=blackboard)
    assert caught.value.diagnostics[0].hint.startswith("it was on the blackboard before the tree")


def test_an_entry_that_does_not_fit_the_type_of_a_port_is_an_error_with_a_place() -> None:
    @condition
    def near(x: In[float]) -> bool:
        return x < 1

    nodes = Registry.standard()
    nodes.add(near)
    blackboard = Blackboard()
    blackboard["x"] = 2**60  # a double represents integers of at most 53 bits
    text = '<root BTCPP_format="4"><BehaviorTree ID="Main">\n<Near x="{x}"/></BehaviorTree></root>'
    with pytest.raises(PortError, match=r"2:10: E203 the port 'x' of <Near> has the type double"):
        btcore.loads(text, nodes=nodes, blackboard=blackboard)


class Color(enum.Enum):
    RED = 1
    GREEN = 2


@condition
def shows(c: In[Color] = Color.RED) -> bool:
    return c is Color.RED


def colors(xml: str) -> tuple[str, Registry]:
    nodes = Registry.standard()
    nodes.add(shows)
    return f'<root main_tree_to_execute="M"><BehaviorTree ID="M">{xml}</BehaviorTree></root>', nodes


@pytest.mark.parametrize("text", ["REDD", "3", "red"])
def test_enum_texts_are_checked_when_the_tree_is_loaded(text: str) -> None:
    xml, nodes = colors(f'<Shows c="{text}"/>')
    message = (
        f"E202 the port 'c' of <Shows> has the type .*: '{text}' is not a member of .*; use RED or GREEN"
    )
    with pytest.raises(PortError, match=message):
        btcore.loads(xml, nodes=nodes, format=4)


def test_default_of_an_enum_with_a_converter_is_not_converted() -> None:
    xml, _ = colors('<Sequence><Shows/><Shows c="rot"/></Sequence>')
    nodes = Registry.standard()
    nodes.add_type(Color, from_text=lambda text: {"rot": Color.RED}[text])
    nodes.add(shows)
    assert btcore.loads(xml, nodes=nodes, format=4).tick_once() is btcore.Status.SUCCESS


@pytest.mark.parametrize("format", [3, 4])
def test_enum_texts_are_checked_by_validate(format: int) -> None:
    xml, nodes = colors('<Shows c="REDD"/>')
    (found,) = validate_document(parse_text(xml), nodes=nodes, format=format)
    assert (found.code, found.is_error) == ("E202", True)
    assert "'REDD' is not a member of" in found.message
