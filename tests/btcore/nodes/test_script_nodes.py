"""Script, ScriptCondition and Precondition: empty scripts."""

import pytest

from btcore import NodeExecutionError, Status, TreeError
from tests.btcore.conftest import TreeFactory

S = Status.SUCCESS


def test_empty_script_succeeds_without_effect(make_tree: TreeFactory) -> None:
    assert make_tree('<Script code=""/>').tick_once() is S


@pytest.mark.parametrize(
    ("body", "port"),
    [('<ScriptCondition code=""/>', "code"), ('<Precondition if=""><AlwaysSuccess/></Precondition>', "if")],
)
def test_empty_condition_raises_when_it_is_ticked(body: str, port: str, make_tree: TreeFactory) -> None:
    tree = make_tree(body)
    with pytest.raises(NodeExecutionError, match=rf"port \[{port}\] has an empty script"):
        tree.tick_once()


def test_script_of_spaces_is_refused(make_tree: TreeFactory) -> None:
    with pytest.raises(TreeError, match="empty"):
        make_tree('<Script code=" "/>')
