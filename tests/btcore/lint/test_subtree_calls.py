"""Keys that are passed to subtrees without effect, and trees that no tree calls."""

import pytest

from tests.btcore.lint.conftest import Checker
from tests.btcore.lint.documents import dedented, sequence, tree

REPEAT = '<Repeat num_cycles="{n}"><AlwaysSuccess/></Repeat>'


@pytest.mark.parametrize(
    ("call", "inner"),
    [
        ('<SubTree ID="Inner" n="3"/>', REPEAT),
        ('<SubTree ID="Inner" n="{door}"/>', '<Say text="{n}"/>'),
        ('<SubTree ID="Inner" _autoremap="true"/>', '<Say text="{door}"/>'),
        ('<SubTree ID="Inner"/>', '<Say text="{@door}"/>'),
        ('<SubTree ID="Inner" door="{=}" name="here" _skipIf="false"/>', '<Say text="{door}"/>'),
        ('<SubTree ID="Inner" door="{door}"/>', '<SubTree ID="Deep" word="{door}"/>'),
        ('<SubTree ID="Inner" word="{door}"/>', '<SubTree ID="Deep" _autoremap="true"/>'),
    ],
)
def test_keys_passed_to_subtrees_are_not_reported(check: Checker, call: str, inner: str) -> None:
    deep = tree("Deep", '<Say text="{word}"/>') if "Deep" in inner else ""
    assert check(sequence('<Look found="{door}"/>', call), tree("Inner", inner) + deep) == ""


def test_braces_in_a_subtree_of_format_3_are_reported(check: Checker) -> None:
    body = sequence('<Look found="{door}"/>', '<SubTree ID="Inner" door="{door}"/>')
    assert check(body, tree("Inner", '<Say text="{door}"/>'), format=3) == dedented(
        """
        t.xml:5:33: W205 in format 3 <SubTree ID="Inner"> takes keys without braces: 'door' has no effect
           5 |        <SubTree ID="Inner" door="{door}"/>
             |                                  ^^^^^^
              write door="door", or <SubTreePlus ID="Inner" door="{door}"/>
        """
    )


@pytest.mark.parametrize(
    "call",
    [
        '<SubTree ID="Inner" door="door"/>',
        '<SubTreePlus ID="Inner" door="{door}"/>',
        '<SubTreePlus ID="Inner" __autoremap="true"/>',
        '<SubTree ID="Inner" __shared_blackboard="true"/>',
    ],
)
def test_keys_passed_in_format_3_are_not_reported(check: Checker, call: str) -> None:
    body = sequence('<Look found="{door}"/>', call)
    assert check(body, tree("Inner", '<Say text="{door}"/>'), format=3) == ""


def test_equals_sign_as_the_default_of_a_model_is_reported(check: Checker) -> None:
    models = (
        '<TreeNodesModel><SubTree ID="Inner"><input_port name="n" default="{=}"/></SubTree></TreeNodesModel>'
    )
    found = check('<SubTree ID="Inner"/>', tree("Inner", REPEAT) + models, given=["="])
    assert "W210 the model of 'Inner' has the default '{=}' for 'n'" in found
    assert found.count("W") == 1


# --- W104: unused trees


def test_unused_tree_is_reported(check: Checker) -> None:
    assert check("<AlwaysSuccess/>", tree("Left")) == dedented(
        """
        t.xml:5:21: W104 the tree 'Left' is unused: 'Main' doesn't call it, directly or indirectly
           5 |    <BehaviorTree ID="Left">
             |                      ^^^^
              call it with <SubTree ID="Left"/>, or remove it
        """
    )


def test_first_of_unused_trees_that_call_each_other_is_reported(check: Checker) -> None:
    found = check("<AlwaysSuccess/>", tree("Left", '<SubTree ID="Right"/>') + tree("Right"))
    assert [line for line in found.splitlines() if "W104" in line] == [
        "t.xml:5:21: W104 the tree 'Left' is unused: 'Main' doesn't call it, directly or indirectly"
    ]


def test_called_trees_are_not_reported(check: Checker) -> None:
    assert check('<SubTree ID="Left"/>', tree("Left", '<SubTree ID="Right"/>') + tree("Right")) == ""


def test_library_of_trees_is_not_reported(check: Checker) -> None:
    assert check.found_in(f'<root BTCPP_format="4">\n{tree("A")}{tree("B")}</root>') == []
