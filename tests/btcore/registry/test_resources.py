"""The resources of leaves, such as those that a node class declares as annotated attributes."""

from collections import deque
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, ClassVar, Protocol

import pytest

import btcore
from btcore import Blackboard, Clock, In, Registry, SimClock, Status, SyncAction, Tree, TreeNode, TreeResource


class Lamp:
    lit = False


class Count(TreeResource):
    def __init__(self) -> None:
        self.value = 0


class Mode(Enum):
    FAST = 1


class Flashing(SyncAction):
    lamp: Lamp


class Flash(Flashing):
    count: Count
    clock: Clock
    board: "Blackboard"
    times: In[int] = 2
    # Not resources:
    speed: float
    names: list[str]
    recent: deque  # type: ignore[type-arg]
    anything: Any
    mode: Mode = Mode.FAST
    shared: ClassVar[Lamp]
    maybe: Lamp | None = None
    _hidden: Lamp

    def __init__(self) -> None:
        assert not self.lamp.lit
        self.own = Lamp()

    def tick(self) -> Status:
        self.lamp.lit = True
        self.count.value += self.times
        self.board["at"] = self.clock.now()
        return Status.SUCCESS


def tree_of(leaf: type[TreeNode], *resources: object) -> Tree:
    nodes = Registry.standard()
    nodes.add(leaf, ID="Leaf")
    body = "<Sequence><Leaf/><Leaf/></Sequence>"
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    return btcore.loads(text, nodes=nodes, resources=resources, clock=SimClock())


def test_annotated_attributes_without_a_value_are_filled_by_their_types() -> None:
    lamp = Lamp()
    tree = tree_of(Flash, lamp)
    assert tree.tick_once() is Status.SUCCESS
    first, second = tree.find(Flash)
    assert lamp.lit
    assert first.count is second.count
    assert (first.count.value, tree.blackboard["at"]) == (4, 0)
    assert first.own is not lamp
    assert first.maybe is None
    own_names = ("speed", "names", "recent", "anything", "shared", "_hidden")
    assert not any(hasattr(first, name) for name in own_names)
    manifest = tree.registry.get("Leaf")
    assert manifest is not None
    assert manifest.required_resources == [Lamp]


def test_a_missing_resource_of_an_attribute_is_reported_when_it_is_read() -> None:
    class Switch(Flashing):
        def tick(self) -> Status:
            return Status.SUCCESS if self.lamp.lit else Status.FAILURE

    tree = tree_of(Switch)
    assert not hasattr(tree.nodes[1], "lamp")
    with pytest.raises(btcore.NodeExecutionError) as failed:
        tree.tick_once()
    assert str(failed.value.cause) == (
        "<Leaf> needs a Lamp for its attribute 'lamp': pass it in resources=[…]; if it is a port, "
        "mark it: lamp: In[Lamp]; if it is the leaf's own state, give it a value in the class, such as "
        "lamp: Lamp | None = None"
    )
    lamp = Lamp()
    for node in tree.find(Switch):
        node.lamp = lamp
    assert tree.tick_once() is Status.FAILURE


def test_a_protocol_of_own_state_is_reported_when_the_leaf_is_created() -> None:
    class Handle(Protocol): ...

    class Wait(SyncAction):
        handle: Handle

        def tick(self) -> Status:
            return Status.SUCCESS

    with pytest.raises(btcore.TreeError) as failed:
        tree_of(Wait, Lamp())
    assert "the attribute 'handle' of <Leaf> has the type Handle" in str(failed.value)
    assert "give it a value in the class, such as handle: Handle | None = None" in str(failed.value)


def test_parameters_of_init_and_fields_of_a_dataclass_are_not_attributes() -> None:
    class Given(SyncAction):
        lamp: Lamp

        def __init__(self, lamp: Lamp) -> None:
            self.lamp = lamp

        def tick(self) -> Status:
            return Status.SUCCESS

    @dataclass
    class Fields(SyncAction):
        lamp: Lamp
        own: Lamp = field(init=False)

        def tick(self) -> Status:
            return Status.FAILURE if hasattr(self, "own") else Status.SUCCESS

    for leaf in (Given, Fields):
        tree = tree_of(leaf, Lamp())
        assert tree.tick_once() is Status.SUCCESS
        manifest = tree.registry.get("Leaf")
        assert manifest is not None
        assert [parameter.name for parameter in manifest.resource_parameters] == ["lamp"]
