"""The work of a validation is proportional to the size of the document, not to its square."""

import sys
from collections.abc import Callable
from types import FrameType

import pytest

from btcore import Registry
from btcore.lint.validate import validate_document
from btcore.xml.read.read import parse_text

SMALL, LARGE = 100, 800  # elements
MOST = 16  # times the calls of SMALL: linear checks make 8 times the calls, quadratic checks 64 times


def document(main: str, trees: str = "", root: str = 'BTCPP_format="4"') -> str:
    """Return a document with the main tree Main and further *trees*."""
    return (
        f'<root {root} main_tree_to_execute="Main"><BehaviorTree ID="Main">\n{main}\n</BehaviorTree>\n'
        f"{trees}</root>"
    )


def lines(count: int, pattern: str, separator: str = "\n") -> str:
    """Return *count* copies of *pattern*, with their numbers for "#"."""
    return separator.join(pattern.replace("#", str(index)) for index in range(count))


def sequence(inside: str, tag: str = "Sequence") -> str:
    return f"<{tag}>\n{inside}\n</{tag}>"


def chain(levels: int, pattern: str) -> list[str]:
    """Return trees of which each calls the next: *pattern* with the called tree for "#"."""
    trees = [
        f'<BehaviorTree ID="T{level}">{pattern.replace("#", f"T{level + 1}")}</BehaviorTree>\n'
        for level in range(levels)
    ]
    return [*trees, f'<BehaviorTree ID="T{levels}"><AlwaysSuccess/></BehaviorTree>\n']


def memory_of_many(size: int) -> str:
    children = lines(size, '<AlwaysSuccess name="#"/>')
    return document(sequence(f"{sequence(children, 'SequenceWithMemory')}<AlwaysSuccess/>"))


def nested_loops(size: int) -> str:
    trees = chain(size // 3, '<Repeat num_cycles="-1"><SubTree ID="#"/></Repeat>')
    return document('<SubTree ID="T0"/>', "".join(trees))


def callers_after_called(size: int) -> str:
    trees = chain(size // 3, '<Inverter><SubTree ID="#"/></Inverter>')
    return document("<AlwaysSuccess/>", "".join(reversed(trees)))


def mistakes_in_one_script(size: int) -> str:
    return document(f'<Script code="{lines(size, "a# = #", "; ")}"/>')


def writes_in_one_script(size: int) -> str:
    script = lines(size, "goal := 'x#'", "; ")
    return document(sequence(f'<Sleep msec="{{goal}}"/><Script code="{script}"/>'))


def comments_in_values(size: int) -> str:
    return document(sequence(lines(size, '<AlwaysSuccess name="&lt;!-- <!-- #"/>')))


def calls_on_one_blackboard(size: int) -> str:
    call = '<SubTree ID="T" __shared_blackboard="true"/>' * 3 + '<SetBlackboard output_key="k#" value="#"/>'
    tree = '<BehaviorTree ID="T"><AlwaysSuccess/></BehaviorTree>'
    return document(sequence(lines(size, call)), tree, 'BTCPP_format="3"')


def mixed(size: int) -> str:
    part = (
        '<Script code="x_# := #"/><Fallback name="f #"><ScriptCondition code="x_# > y" _skipIf="y == #"/>'
        '<Repeat num_cycles="{x_#}"><Sleep msec="{unwritten_#}"/></Repeat></Fallback>'
    )
    return document(sequence(lines(size // 5, part)))


@pytest.mark.parametrize(
    "text_of",
    [
        memory_of_many,
        nested_loops,
        callers_after_called,
        mistakes_in_one_script,
        writes_in_one_script,
        comments_in_values,
        calls_on_one_blackboard,
        mixed,
    ],
)
def test_work_grows_linearly(text_of: Callable[[int], str]) -> None:
    assert calls(text_of(LARGE)) < MOST * calls(text_of(SMALL))


def calls(text: str) -> int:
    """Return the number of function calls in a validation."""
    nodes = Registry.standard()
    count = 0

    def add(frame: FrameType, event: str, argument: object) -> None:
        nonlocal count
        count += 1

    sys.setprofile(add)
    try:
        validate_document(parse_text(text), nodes=nodes)
    finally:
        sys.setprofile(None)
    return count


def test_each_tree_below_a_loop_is_visited_once() -> None:
    def doubling(levels: int) -> str:
        trees = chain(levels, sequence('<SubTree ID="#"/><SubTree ID="#"/>'))
        # After an error there is no dry run, which visits every node.
        wrong = '<BehaviorTree ID="Wrong"><Unknown/></BehaviorTree>'
        return document('<Repeat num_cycles="-1"><SubTree ID="T0"/></Repeat>', "".join(trees) + wrong)

    calls(doubling(1))  # the first unknown node lets the names of installed nodes be read
    # The larger tree has a thousand times more nodes.
    assert calls(doubling(14)) < MOST * calls(doubling(4))


def test_tree_that_is_too_deep_is_a_single_error() -> None:
    trees = chain(50, f'{"<Inverter>" * 200}<SubTree ID="#"/>{"</Inverter>" * 200}')
    text = document('<Repeat num_cycles="-1"><SubTree ID="T0"/></Repeat>', "".join(trees))
    [error] = validate_document(parse_text(text), nodes=Registry.standard())
    assert error.message == "with all its subtrees the tree is more than 10,000 levels deep"


def test_trees_that_many_uncalled_trees_call_are_checked_a_limited_number_of_times() -> None:
    large = f'<BehaviorTree ID="Large">{sequence("<AlwaysSuccess/>" * 9_999)}</BehaviorTree>'
    calls = sequence('<SubTree ID="Large"/><SubTree ID="Own#"/>')
    caller = f'<BehaviorTree ID="T#">{calls}</BehaviorTree>'
    own = '<BehaviorTree ID="Own#"><Sleep msec="{k}"/></BehaviorTree>'
    text = f'<root BTCPP_format="4">{large}{lines(9, caller)}{lines(9, own)}</root>'
    found = validate_document(parse_text(text), nodes=Registry.standard())
    # 65,535 nodes are checked again.
    assert [item.code for item in found] == ["W201"] * 7
