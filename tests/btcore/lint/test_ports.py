"""Ports: numbers read in part, missing braces, literals that a class refuses, constants of SubTrees."""

import enum
from collections.abc import Callable, Iterator, Mapping

import pytest

import btcore
from btcore import NodeExecutionError, NodeType, Port, Registry
from btcore.registry.nodes_without_code import create_mock_class
from btcore.values import INT
from tests.btcore.lint.conftest import Checker
from tests.btcore.lint.documents import dedented

REPEAT = "<AlwaysSuccess/></Repeat>"


@pytest.mark.parametrize(
    "body",
    [
        "<BatteryOk/>",
        '<Count start="1" result="{n}"/>',
        '<Switch2 variable="{x}" case_1="1"><Drive/><Drive/><Drive/></Switch2>',
        f'<Repeat num_cycles="3">{REPEAT}',
        '<Repeat num_cycles="-1"><Sleep msec="1"/></Repeat>',
        f'<Repeat num_cycles="3.0">{REPEAT}',
        f'<Repeat num_cycles="{{x}}">{REPEAT}',
        '<BatteryOk minimum="1e-3"/>',
        '<BatteryOk minimum="inf"/>',
        '<LoopDouble queue="1;2.5;3;"><AlwaysSuccess/></LoopDouble>',
        '<LoopInt queue="{x}"><AlwaysSuccess/></LoopInt>',
        '<Say text="3.7"/>',
        '<Say text="{x}"/>',
        '<Say text="{ x"/>',
        '<Say text="a}, b"/>',
        '<Look found="{=}"/>',
        '<Look found="="/>',
        '<SetBlackboard value="1" output_key="n"/>',
    ],
)
def test_valid_texts_are_not_reported(check: Checker, body: str) -> None:
    assert check(body, given=["x"]) == ""


@pytest.mark.parametrize(
    "body",
    [
        f'<Repeat num_cycles=" +3">{REPEAT}',
        '<BatteryOk minimum="0x1p-2"/>',
        '<Look found="door"/>',
        '<Say text="${x}"/>',
    ],
)
def test_valid_texts_are_not_reported_in_format_3(check: Checker, body: str) -> None:
    assert check(body, format=3, given=["x"]) == ""


def test_fraction_for_an_integer_is_reported_in_format_3(check: Checker) -> None:
    assert "only '3' of '3.7' is read" in check(f'<Repeat num_cycles="3.7">{REPEAT}', format=3)


def test_constant_with_a_missing_brace_is_reported(check: Checker) -> None:
    more = '  <BehaviorTree ID="Inner"><Say text="{word}"/></BehaviorTree>\n'
    assert check('<SubTree ID="Inner" word="door}"/>', more) == dedented(
        """
        t.xml:3:31: W210 'word' of <SubTree ID="Inner"> is the text 'door}', not an entry
           3 |      <SubTree ID="Inner" word="door}"/>
             |                                ^^^^^
              to use the entry, write {door}
        """
    )


# --- E202 in format 3, whose loader accepts every text


def test_text_that_a_leaf_of_format_3_cannot_read_is_an_error(
    check: Checker, palette: Registry, document: Callable[..., str]
) -> None:
    body = '<Repeat num_cycles="many"><AlwaysSuccess/></Repeat>'
    assert check(body, format=3) == dedented(
        """
        t.xml:3:25: E202 the port 'num_cycles' of <Repeat> has the type int: 'many' is not an integer
           3 |      <Repeat num_cycles="many"><AlwaysSuccess/></Repeat>
             |                          ^^^^
              to use the blackboard entry, write {many}
        """
    )
    tree = btcore.loads(document(body), nodes=palette, format=3)
    with pytest.raises(NodeExecutionError, match="'many' is not an integer"):
        tree.tick_once()


def test_texts_valid_only_in_format_3_are_not_reported(check: Checker) -> None:
    assert check('<BatteryOk minimum=" +0x1p-1"/>', format=3) == ""


def test_keys_are_checked_after_an_error_too(check: Checker) -> None:
    body = '<Sequence><BatteryOk minimum="low"/><Say text="{nobody}"/></Sequence>'
    assert [line[:4] for line in check(body, format=3).split() if line[:2] in ("E2", "W2")] == [
        "E202",
        "W201",
    ]


# --- E202 and W215 of the class of a leaf


class Fetch(btcore.SyncAction):
    """A leaf whose ports depend on each other."""

    room: btcore.In[str] = "hall"
    item: btcore.In[str]

    @classmethod
    def check_literals(cls, literals: Mapping[str, str]) -> Iterator[btcore.LiteralProblem]:
        room, item = literals.get("room"), literals.get("item", "")
        if room == "attic":
            yield btcore.LiteralProblem("room", "the attic is not installed", "install it", is_unchecked=True)
        elif room is not None and "?" in item:
            start = item.index("?") + 1
            yield btcore.LiteralProblem("item", f"invalid in the {room}", "remove it", start, width=2)

    def tick(self) -> bool:
        return bool(self.item)


def test_problem_found_by_the_class_points_to_a_part_of_the_text(check: Checker, palette: Registry) -> None:
    palette.add(Fetch)
    assert check('<Fetch item="a &lt; ??"/>') == dedented(
        """
        t.xml:3:25: E202 the port 'item' of <Fetch>: invalid in the hall
           3 |      <Fetch item="a &lt; ??"/>
             |                          ^^
              remove it
        """
    )


def test_literal_that_cannot_be_checked_is_a_warning(check: Checker, palette: Registry) -> None:
    palette.add(Fetch)
    assert check('<Fetch room="attic" item="??"/>') == dedented(
        """
        t.xml:3:18: W215 the port 'room' of <Fetch>: the attic is not installed
           3 |      <Fetch room="attic" item="??"/>
             |                   ^^^^^
              install it
        """
    )


@pytest.mark.parametrize("body", ['<Fetch room="{room}" item="??"/>', '<Fetch item="{item?}"/>'])
def test_entries_are_not_literals(check: Checker, palette: Registry, body: str) -> None:
    palette.add(Fetch)
    assert check(body, given=["room", "item?"]) == ""


# --- constants of SubTree elements


class Gear(enum.Enum):
    DRIVE = 1


@btcore.action
def shift(gear: btcore.In[Gear]) -> bool:
    return gear is Gear.DRIVE


@pytest.mark.parametrize(
    ("value", "body", "format", "codes"),
    [
        ("soon", '<Sleep msec="{n}"/>', 4, ["E202"]),
        ("5", '<Sleep msec="{n}"/>', 4, []),
        ("DRIV", '<Shift gear="{n}"/>', 4, ["E202"]),
        ("DRIVE", '<Shift gear="{n}"/>', 4, []),
        ("??", '<Fetch item="{n}"/>', 4, ["E202"]),
        ("cup", '<Fetch item="{n}"/>', 4, []),
        ("soon", '<SubTree ID="Inner2" n="{n}"/>', 4, ["E202"]),
        # A value that may be replaced, or read by code that is unknown:
        ("soon", '<Sequence><Tidy/><Sleep msec="{n}"/></Sequence>', 4, ["W206"]),
        ("soon", '<Fly speed="{n}"/>', 4, ["W206"]),
        ("soon", '<Sequence><Script code="n := \'5\'"/><Sleep msec="{n}"/></Sequence>', 4, []),
        # Format 3 reads a number with a plus sign.
        ("+5", '<Repeat num_cycles="{n}"><AlwaysSuccess/></Repeat>', 3, []),
    ],
)
def test_constant_that_a_leaf_certainly_rejects_is_an_error(
    check: Checker, palette: Registry, value: str, body: str, format: int, codes: list[str]
) -> None:
    palette.add(Fetch, shift)
    palette.add(create_mock_class("Fly", NodeType.ACTION, [Port("speed", type=INT)], "", "models"), ID="Fly")
    call = f'<SubTree{"Plus" if format == 3 else ""} ID="Inner" n="{value}"/>'
    inner2 = '<BehaviorTree ID="Inner2"><Sleep msec="{n}"/></BehaviorTree>' if "Inner2" in body else ""
    more = f'<BehaviorTree ID="Inner">{body}</BehaviorTree>{inner2}'
    assert [line.split()[1] for line in check(call, more, format).splitlines() if "t.xml:3:" in line] == codes
