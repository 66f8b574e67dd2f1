"""Keys that are read but never written, and assignments to entries that are never created."""

from dataclasses import replace

import pytest

from btcore import Registry
from tests.btcore.lint.conftest import Checker
from tests.btcore.lint.documents import dedented, sequence, tree

REPEAT = '<Repeat num_cycles="{n}"><AlwaysSuccess/></Repeat>'


FINE = {
    "written by a port": sequence('<Look found="{door}"/>', '<Say text="{door}"/>'),
    "written later": sequence('<Say text="{door}" _skipIf="true"/>', '<Look found="{door}"/>'),
    "created by a script": sequence('<Script code="n := 3; n += 1"/>', REPEAT),
    "created by the script of a condition": sequence('<AlwaysSuccess _onSuccess="n := 3"/>', REPEAT),
    "created by a port, assigned to": sequence('<Count start="1" result="{n}"/>', '<Script code="n = 2"/>'),
    "set by name": sequence('<SetBlackboard value="3" output_key="n"/>', REPEAT),
    "written under the port's own name": sequence('<Look found="{=}"/>', '<Say text="{found}"/>'),
    "written by a loop": '<LoopInt queue="1;2" value="{n}"><Script code="m := n"/></LoopInt>',
    "written somewhere by a leaf that has the blackboard": sequence("<Tidy/>", '<Say text="{door}"/>'),
}


@pytest.mark.parametrize("name", FINE)
def test_valid_keys_are_not_reported(check: Checker, name: str) -> None:
    assert check(FINE[name]) == ""


def test_key_written_by_a_subtree_is_known_to_its_caller(check: Checker) -> None:
    body = sequence('<SubTree ID="Inner" place="{door}"/>', '<Say text="{door}"/>')
    assert check(body, tree("Inner", '<Look found="{place}"/>')) == ""


def test_given_keys_are_not_reported(check: Checker) -> None:
    body = sequence('<Say text="{goal}"/>', '<Script code="x += 1"/>')
    assert check(body, given=["goal", "x"]) == ""
    assert "W201" in check(body, given=["x"])


def test_script_on_the_blackboard_must_exist_when_the_tree_is_built(check: Checker) -> None:
    # The writes of the script are unknown, so {door} is not reported.
    body = sequence('<Script code="{code}"/>', '<Say text="{door}"/>')
    assert check(body, given=["code"]) == ""
    assert check(body) == dedented(
        """
        t.xml:4:21: W201 <Script> reads its script from {code}, which is empty when the tree is built
           4 |        <Script code="{code}"/>
             |                      ^^^^^^
              load the tree with a blackboard that holds the script: load(…, blackboard=…)
        """
    )


def test_given_keys_are_unknown_in_a_subtree(check: Checker) -> None:
    assert check('<SubTree ID="Inner"/>', tree("Inner", '<Say text="{goal}"/>'), given=["goal"]) == dedented(
        """
        t.xml:6:16: W201 the port 'text' of <Say> reads {goal}, which is never written
           6 |      <Say text="{goal}"/>
             |                 ^^^^^^
              a subtree has a blackboard of its own: in the SubTree of 'Inner' in line 3 write goal="{goal}"
        """
    )


def test_subtree_model_provides_its_ports(check: Checker) -> None:
    text = (
        '<root BTCPP_format="4">'
        '<TreeNodesModel><SubTree ID="Greet"><input_port name="who"/></SubTree></TreeNodesModel>'
        '<BehaviorTree ID="Greet"><Sequence><Say text="{who}"/><Say text="{what}"/></Sequence></BehaviorTree>'
        "</root>"
    )
    assert [one.message for one in check.found_in(text)] == [
        "the port 'text' of <Say> reads {what}, which is never written"
    ]


def test_tree_that_is_called_twice_is_reported_once(check: Checker) -> None:
    found = check.found(
        sequence('<SubTree ID="Inner"/>', '<SubTree ID="Inner"/>'), tree("Inner", '<Say text="{door}"/>')
    )
    assert [one.code for one in found] == ["W201"]


def test_tree_with_unknown_nodes_may_use_any_key(check: Checker) -> None:
    found = check.found('<SubTree ID="Inner" door="shut"/>', tree("Inner", '<Knock on="{door}"/>'))
    assert [one.code for one in found] == ["E101"]


def test_warning_names_the_call_that_lacks_a_key(check: Checker) -> None:
    body = sequence('<SubTree ID="Inner" door="shut"/>', '<SubTree ID="Inner"/>')
    assert "in the SubTree of 'Inner' in line 5 write door=" in check(
        body, tree("Inner", '<Say text="{door}"/>')
    )


def test_key_not_passed_in_format_3_is_reported(check: Checker) -> None:
    found = check(
        sequence('<Look found="{door}"/>', '<SubTree ID="Inner"/>'),
        tree("Inner", '<Say text="{door}"/>'),
        format=3,
    )
    assert found.endswith("in the SubTree of 'Inner' in line 5 write door=\"door\"\n")


def test_leaf_with_the_whole_blackboard_hides_no_warning_if_it_declares_what_it_writes(
    check: Checker, palette: Registry
) -> None:
    body = sequence("<Tidy/>", '<Say text="{level}"/>', '<Say text="{lvl}"/>')
    assert check(body) == ""
    manifest = palette.manifests["Tidy"]
    manifest.spec = replace(manifest.spec, writes=("level", "x"))
    assert [item.message for item in check.found(body)] == [
        "the port 'text' of <Say> reads {lvl}, which is never written"
    ]
