"""Mistakes of users who know BehaviorTree.CPP or py_trees: the messages name the solution in btcore."""

import enum
from typing import Any

import pytest

import btcore
from btcore import BtcoreError, Registry, SimClock, StatefulAction, Status, SyncAction, action


def message_of(leaf: Any, **options: Any) -> str:
    """Return the message of the error that the leaf causes at its registration, loading or tick."""
    with pytest.raises(BtcoreError) as failed:
        run(leaf, **options)
    return str(failed.value)


def run(leaf: Any, **options: Any) -> None:
    nodes = Registry.standard()
    nodes.add(leaf, ID="Leaf")
    text = '<root BTCPP_format="4"><BehaviorTree ID="Main"><Leaf/></BehaviorTree></root>'
    btcore.loads(text, nodes=nodes, clock=SimClock(), **options).tick_once()


class Ready(SyncAction):
    def tick(self) -> Status:
        return Status.SUCCESS


def test_an_object_instead_of_its_class_is_explained() -> None:
    assert "an object of the class Ready is given: register the class, nodes.add(Ready);" in message_of(
        Ready()
    )


class ForeignStatus(enum.Enum):
    """As in py_trees."""

    FAILURE = "FAILURE"


class Texts(StatefulAction):
    def on_start(self) -> Any:
        return "running"

    def on_running(self) -> Any:
        return None


def succeed() -> Any:
    return "SUCCESS"


def fail() -> Any:
    return ForeignStatus.FAILURE


def think() -> Any:
    return "thinking"


@pytest.mark.parametrize(
    ("leaf", "hint"),
    [
        (action(succeed), "not 'SUCCESS'; write btcore.Status.SUCCESS\n"),
        (Texts, "not 'running'; write btcore.Status.RUNNING\n"),
        (action(fail), "; write btcore.Status.FAILURE\n"),
        (action(think), "not 'thinking'\n"),
    ],
)
def test_the_name_of_a_status_and_the_status_of_another_library_are_explained(leaf: Any, hint: str) -> None:
    assert hint in message_of(leaf)


class WithoutAnnotations(SyncAction):
    def __init__(self, name, config) -> None:  # type: ignore[no-untyped-def]
        super().__init__(name, config)


class WithAnnotations(SyncAction):
    def __init__(self, name: str, config: dict[str, str]) -> None:
        super().__init__(name, config)  # type: ignore[call-arg]


class WithDefault(SyncAction):
    def __init__(self, name: str = "leaf") -> None:
        super().__init__(name=name)  # type: ignore[call-arg]


@pytest.mark.parametrize(
    ("cls", "hint"),
    [
        (WithoutAnnotations, "has no annotation: remove 'name' and 'config', also from super().__init__()"),
        (WithAnnotations, "for its parameter 'name': remove 'name' and 'config'"),
        (WithDefault, "call super().__init__() without arguments: a node has its name and config already"),
    ],
)
def test_a_constructor_with_name_and_config_is_explained(cls: type, hint: str) -> None:
    assert hint in message_of(cls)


def test_a_file_instead_of_the_id_of_a_tree_is_explained() -> None:
    hint = "--tree, or tree=… in Python, takes the ID of a <BehaviorTree>; the trees are: Main"
    assert hint in message_of(Ready, tree="patrol.xml")
