"""Ports whose types are classes that derive from each other, and ports of any type."""

import pytest

from btcore import In, InOut, NodeExecutionError, Out, Registry, Status, SyncAction, Tree, TreeError, loads
from btcore.lint.validate import validate_document
from btcore.xml.read.read import parse_text


class Animal:
    pass


class Cat(Animal):
    pass


class Sphynx(Cat):
    pass


class Dog(Animal):
    pass


class MakeAnimal(SyncAction):
    pet: Out[Animal]
    made: type = Animal

    def tick(self) -> Status:
        self.pet = self.made()
        return Status.SUCCESS


class MakeCatAsAnimal(MakeAnimal):
    made = Cat


class MakeSphynx(SyncAction):
    pet: Out[Cat]

    def tick(self) -> Status:
        self.pet = Sphynx()
        return Status.SUCCESS


class FeedAnimal(SyncAction):
    pet: In[Animal]

    def tick(self) -> bool:
        return isinstance(self.pet, Animal)


class FeedCat(SyncAction):
    pet: In[Cat]

    def tick(self) -> bool:
        return isinstance(self.pet, Cat)


class FeedDog(SyncAction):
    pet: In[Dog]


class ReplaceAnimal(SyncAction):
    pet: InOut[Animal]


@pytest.fixture
def nodes() -> Registry:
    registry = Registry.standard()
    registry.add(MakeAnimal, MakeCatAsAnimal, MakeSphynx, FeedAnimal, FeedCat, FeedDog, ReplaceAnimal)
    return registry


def text_of(leaves: list[str]) -> str:
    children = "\n".join(f'<{leaf} pet="{{pet}}"/>' for leaf in leaves)
    body = f"<Sequence>\n{children}\n</Sequence>"
    return f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'


def make(leaves: list[str], nodes: Registry) -> Tree:
    return loads(text_of(leaves), nodes=nodes)


def found(leaves: list[str], nodes: Registry) -> list[str]:
    return [one.code for one in validate_document(parse_text(text_of(leaves)), nodes=nodes)]


@pytest.mark.parametrize(
    "leaves", [["MakeSphynx", "FeedCat", "FeedAnimal"], ["FeedCat", "FeedAnimal", "MakeSphynx"]]
)
def test_output_of_derived_class_connects_to_input_of_base(leaves: list[str], nodes: Registry) -> None:
    assert found(leaves, nodes) == []
    tree = make(leaves, nodes)
    tree.blackboard["pet"] = Cat()
    assert tree.tick_once() is Status.SUCCESS
    entry = tree.blackboard.find("pet")
    # The first port declares the type; an input of another class does not change it.
    assert entry is not None
    assert entry.declared.python_type is Cat
    assert type(entry.value) is Sphynx


@pytest.mark.parametrize(
    ("leaves", "declared"),
    [(["FeedAnimal", "MakeSphynx"], "Animal"), (["MakeSphynx", "ReplaceAnimal"], "Cat")],
)
def test_output_needs_exactly_class_of_entry(leaves: list[str], declared: str, nodes: Registry) -> None:
    assert found(leaves, nodes) == ["E203"]
    hint = f"an output needs exactly this type, so declare the port as {declared}"
    with pytest.raises(TreeError, match=hint):
        make(leaves, nodes)


def test_unrelated_classes_do_not_connect(nodes: Registry) -> None:
    assert found(["MakeSphynx", "FeedDog"], nodes) == ["E203"]
    with pytest.raises(TreeError, match="has the type Dog, but its entry has the type Cat"):
        make(["MakeSphynx", "FeedDog"], nodes)


def test_input_of_a_derived_class_is_checked_when_it_is_read(nodes: Registry) -> None:
    assert found(["MakeAnimal", "FeedCat"], nodes) == ["W214"]
    assert make(["MakeCatAsAnimal", "FeedCat"], nodes).tick_once() is Status.SUCCESS
    with pytest.raises(NodeExecutionError, match=r"reads \{pet\} as Cat"):
        make(["MakeAnimal", "FeedCat"], nodes).tick_once()


def test_format_3_has_no_related_classes(nodes: Registry) -> None:
    with pytest.raises(TreeError, match="has the type Animal, but its entry has the type Cat"):
        loads(text_of(["MakeSphynx", "FeedAnimal"]), nodes=nodes, format=3)


def test_number_types_are_not_related_although_bool_derives_from_int(nodes: Registry) -> None:
    class Switch(SyncAction):
        pet: Out[bool]

    class Count(SyncAction):
        pet: In[int]

    nodes.add(Switch, Count)
    assert found(["Switch", "Count"], nodes) == ["E203"]


def test_port_of_any_type_may_change_the_type_of_its_value(nodes: Registry) -> None:
    class Change(SyncAction):
        pet: Out[object]
        values: list[object]

        def __init__(self) -> None:
            self.values = [3, "text", 2.5, [1], Cat()]

        def tick(self) -> bool:
            self.pet = self.values.pop(0)
            return True

    class Read(SyncAction):
        pet: In[object]

        def tick(self) -> bool:
            return self.pet is not None

    nodes.add(Change, Read)
    tree = make(["Change", "Read"], nodes)
    for expected in (3, "text", 2.5, [1]):
        assert tree.tick_once() is Status.SUCCESS
        assert tree.blackboard["pet"] == expected
    assert tree.tick_once() is Status.SUCCESS
    assert type(tree.blackboard["pet"]) is Cat
