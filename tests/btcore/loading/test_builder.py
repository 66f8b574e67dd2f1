"""Trees built in code: equal to trees written in XML, with errors reported at the lines of the code."""

import enum
import inspect

import pytest

import btcore
from btcore import (
    Builder,
    In,
    Put,
    Registry,
    SimClock,
    Status,
    TreeError,
    UnknownNodeError,
    action,
    blackboard_key,
    condition,
)
from btcore.loading.builder import NodeDraft
from btcore.loading.tree_xml import tree_to_xml
from btcore.xml.read.read import parse_text


class Gear(enum.Enum):
    LOW = 1
    HIGH = 2


@condition
def near(distance: In[float], limit: In[float] = 1.0) -> bool:
    return distance < limit


@action
def measure(distance: Put[float]) -> bool:
    distance(0.5)
    return True


@action
def shift(gear: In[Gear], steps: In[list[int]], quiet: In[bool] = False) -> bool:
    return gear is Gear.HIGH and steps == [1, 2] and quiet


@pytest.fixture
def nodes() -> Registry:
    made = Registry.standard()
    made.add(near, measure, shift)
    return made


@pytest.fixture
def b(nodes: Registry) -> Builder:
    return Builder(nodes)


def test_built_tree_is_written_as_readable_xml(b: Builder) -> None:
    look = b.Sequence(b.Measure(distance=blackboard_key("d")), b.Near(distance="{d}", limit=0.8), name="look")
    assert b.xml(b.Fallback(look, b.Repeat(b.AlwaysFailure(), num_cycles=3)), "Watch") == (
        '<root BTCPP_format="4" main_tree_to_execute="Watch">\n'
        '    <BehaviorTree ID="Watch">\n'
        "        <Fallback>\n"
        '            <Sequence name="look">\n'
        '                <Measure distance="{d}"/>\n'
        '                <Near distance="{d}" limit="0.8"/>\n'
        "            </Sequence>\n"
        '            <Repeat num_cycles="3">\n'
        "                <AlwaysFailure/>\n"
        "            </Repeat>\n"
        "        </Fallback>\n"
        "    </BehaviorTree>\n"
        "</root>\n"
    )


def test_builder_without_a_registry_uses_the_built_in_nodes() -> None:
    b = btcore.Builder()
    main = b.Sequence(
        b.Script(code="n := 1"), b.Repeat(b.AlwaysSuccess(), num_cycles=btcore.blackboard_key("n"))
    )
    assert b.build(main, clock=SimClock()).tick_while_running() is Status.SUCCESS


def test_built_tree_equals_the_loaded_tree(b: Builder, nodes: Registry) -> None:
    main = b.Sequence(
        b.SubTree("Look", d="{distance}", _autoremap=True), b.Sleep(msec=50), _skipIf="a < b && c"
    )
    look = b.Measure(distance="{d}")
    built = b.build(main, clock=SimClock(), Look=look)
    loaded = btcore.loads(b.xml(main, Look=look), nodes=nodes, clock=SimClock())
    assert tree_to_xml(built) == tree_to_xml(loaded)


def test_values_are_written_in_the_text_form_of_the_port(b: Builder) -> None:
    twig = b.Shift(gear=Gear.HIGH, steps=[1, 2], quiet=True)
    assert twig.attributes == {"gear": "HIGH", "steps": "1;2", "quiet": "true"}
    assert b.build(twig).tick_exactly_once() is Status.SUCCESS


def test_python_keyword_takes_a_trailing_underscore(b: Builder) -> None:
    twig = b.Precondition(b.AlwaysFailure(), if_="false", else_=Status.SUCCESS)
    assert twig.attributes == {"if": "false", "else": "SUCCESS"}
    assert b.build(twig).tick_exactly_once() is Status.SUCCESS


def test_function_can_name_its_node(b: Builder) -> None:
    assert b.node(near, distance=0.5).id == "Near"
    assert b["Near"](distance=0.5).id == "Near"


def test_node_spec_may_be_used_in_several_places(b: Builder) -> None:
    look = b.Measure(distance="{d}")
    tree = b.build(b.Sequence(look, look))
    assert [node.path for node in tree] == ["Sequence::1", "Measure::2", "Measure::3"]


def test_special_characters_are_escaped(b: Builder) -> None:
    text = b.xml(b.Script(code="a := 'x' .. \"<&\n\"", name="<é>"))
    script = next(parse_text(text).root.iter("Script"))
    assert (script.get("code"), script.get("name")) == ("a := 'x' .. \"<&\n\"", "<é>")


def this_line() -> int:
    frame = inspect.currentframe()
    assert frame is not None
    assert frame.f_back is not None
    return int(frame.f_back.f_lineno)


def test_all_errors_are_reported_with_the_lines_of_the_code(b: Builder) -> None:
    start = this_line()
    main = b.Sequence(
        b.Near(distnace=1),
        b.Repeat(b.AlwaysSuccess(), b.AlwaysSuccess(), num_cycles="often"),
    )
    with pytest.raises(TreeError) as caught:
        b.build(main)
    told = [(one.code, one.file.rsplit("/")[-1], one.line - start) for one in caught.value.diagnostics]
    assert sorted(told) == [
        ("E104", "test_builder.py", 3),
        ("E201", "test_builder.py", 2),
        ("E202", "test_builder.py", 3),
    ]


def test_runtime_error_names_the_line_of_the_code(b: Builder) -> None:
    tree = b.build(b.Sequence(b.Near(distance="{never}")))
    line = this_line() - 1
    with pytest.raises(btcore.NodeExecutionError, match=rf"test_builder\.py:{line}: node 'Near::2'"):
        tree.tick_exactly_once()


def test_unknown_node_is_refused_immediately(b: Builder) -> None:
    with pytest.raises(
        UnknownNodeError, match=r"test_builder\.py:\d+: E101 unknown node Sequnce\n +did you mean Sequence"
    ):
        b.Sequnce()
    with pytest.raises(UnknownNodeError, match="'print' is not registered"):
        b.node(print)


def test_invalid_child_and_invalid_value_are_refused(b: Builder) -> None:
    with pytest.raises(TreeError, match="invalid child 3 of <Near>"):
        b.Near(3)
    value = "<object object at 0x[0-9a-f]+>"
    with pytest.raises(TreeError, match=f"invalid value {value} of the port 'distance' of <Near>"):
        b.Near(distance=object())


def chain(b: Builder, levels: int) -> NodeDraft:
    twig = b.AlwaysSuccess()
    for _ in range(levels - 1):
        twig = b.ForceFailure(twig)
    return twig


def test_built_tree_may_be_two_thousand_levels_deep(b: Builder) -> None:
    tree = b.build(chain(b, 2_000))
    assert len(tree.nodes) == 2_000
    assert tree.tick_exactly_once() is Status.FAILURE
    assert {node.status for node in tree} == {Status.IDLE}
    with pytest.raises(TreeError, match=r"test_builder\.py:\d+: E006 nodes are nested more than 2,000 deep"):
        b.build(chain(b, 2_001))


def test_loaded_tree_may_be_only_256_levels_deep(b: Builder) -> None:
    with pytest.raises(TreeError, match="E006 elements are nested more than 256 deep"):
        btcore.loads(b.xml(chain(b, 257)))
