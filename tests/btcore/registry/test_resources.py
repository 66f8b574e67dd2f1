"""The resources of leaves, such as those that a node class declares as annotated attributes."""

from enum import Enum
from typing import ClassVar

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
    mode: Mode = Mode.FAST
    shared: ClassVar[Lamp]
    own: Lamp
    renamed: Lamp
    _hidden: Lamp

    def __init__(self) -> None:
        assert not self.lamp.lit
        self.own = Lamp()
        setattr(self, "renamed", Lamp())  # noqa: B010

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
    assert first.own is not lamp is not first.renamed
    assert not any(hasattr(first, name) for name in ("speed", "names", "shared", "_hidden"))
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
        "<Leaf> needs a Lamp for its attribute 'lamp': pass it in resources=[…], or assign it; "
        "if it is a port, mark it: lamp: In[Lamp]"
    )
    lamp = Lamp()
    for node in tree.find(Switch):
        node.lamp = lamp
    assert tree.tick_once() is Status.FAILURE


def test_attributes_that_a_base_class_assigns_are_not_resources() -> None:
    class Base(SyncAction):
        def __init__(self) -> None:
            def switch() -> None:
                self.lamp = Lamp()

            switch()

    class Derived(Base):
        lamp: Lamp

        def tick(self) -> Status:
            return Status.SUCCESS

    assert tree_of(Derived).tick_once() is Status.SUCCESS
