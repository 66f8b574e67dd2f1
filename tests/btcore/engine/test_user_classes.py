"""User-defined classes are ordinary Python classes, with the compiled and the pure build."""

import abc
import copy
import gc
import inspect
import pickle
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, ClassVar, Generic, Protocol, TypeVar

import pytest

import btcore
from btcore import (
    Blackboard,
    In,
    NodeError,
    NodeExecutionError,
    NodeType,
    Observer,
    Put,
    RegistrationError,
    Registry,
    SimClock,
    StatefulAction,
    Status,
    SyncAction,
    Transition,
    Tree,
    TreeError,
    action,
    builds,
)
from btcore.values import ValueType
from tests.btcore.conftest import TreeFactory

T = TypeVar("T")


class Robot:
    """A resource."""

    speed = 3


class Yes(SyncAction):
    """Always succeeds."""

    def tick(self) -> bool:
        return True


# --- creating a node


@pytest.mark.parametrize("calls_super", [False, True])
def test_super_init_is_optional(calls_super: bool, make_tree: TreeFactory) -> None:
    class Fast(SyncAction):
        def __init__(self, robot: Robot) -> None:
            if calls_super:
                super().__init__()
            self.robot = robot

        def tick(self) -> bool:
            return self.robot.speed == 3

    assert make_tree("<Fast/>", Fast, resources=[Robot()]).tick_once() is Status.SUCCESS


def test_assigning_an_attribute_of_the_engine_raises(make_tree: TreeFactory) -> None:
    class Bold(Yes):
        def __init__(self) -> None:
            self.status = Status.SUCCESS  # type: ignore[misc]

    with pytest.raises(
        TreeError, match=r"E115 <Bold> raised while it was created: AttributeError: .*'status'"
    ):
        make_tree("<Bold/>", Bold)


@pytest.mark.parametrize("options", [{}, {"eq": False}, {"slots": True}, {"kw_only": True}, {"order": True}])
def test_dataclass_with_any_options_is_a_leaf(options: dict[str, bool], make_tree: TreeFactory) -> None:
    @dataclass(**options)
    class Drive(SyncAction):
        robot: Robot
        speed: In[int]
        turn: In[int] = 5

        def tick(self) -> bool:
            return (self.speed, self.turn) == (self.robot.speed, 5)

    assert make_tree('<Drive speed="3"/>', Drive, resources=[Robot()]).tick_once() is Status.SUCCESS


def test_a_frozen_dataclass_is_rejected() -> None:
    @dataclass(frozen=True)
    class Ice(SyncAction):
        robot: Robot

    with pytest.raises(RegistrationError, match=r"<Ice>: .*Ice is a frozen dataclass, but a node changes"):
        Registry.standard().add(Ice)


# --- base classes


class Remembers:
    """A mixin with state, whose tick calls the next class."""

    def __init__(self) -> None:
        self.ticks: list[str] = []

    def tick(self) -> Any:
        self.ticks.append(type(self).__name__)
        return super().tick()  # type: ignore[misc]


class HasLimit:
    """A mixin with a port."""

    limit: In[int]


def test_a_mixin_may_have_an_init_a_tick_and_ports(make_tree: TreeFactory) -> None:
    class Both(Remembers, HasLimit, Yes):
        pass

    tree = make_tree('<Both limit="4"/>', Both)
    assert tree.tick_once() is Status.SUCCESS
    (node,) = tree.find(Both)
    assert (node.ticks, node.limit) == (["Both"], 4)


def test_a_leaf_may_be_generic(make_tree: TreeFactory) -> None:
    class Compare(SyncAction, Generic[T]):
        expected: ClassVar[Any]

        def same(self, value: T) -> bool:
            return bool(value == self.expected)

    class CompareInt(Compare[int]):
        expected = 3
        value: In[int]

        def tick(self) -> bool:
            return self.same(self.value)

    assert make_tree('<CompareInt value="3"/>', CompareInt).tick_once() is Status.SUCCESS


class Sensor(SyncAction, abc.ABC):
    """Requires derived classes to define a method."""

    @abc.abstractmethod
    def measure(self) -> int: ...

    def tick(self) -> bool:
        return self.measure() > 1


class Made(SyncAction):
    made: int

    def __new__(cls) -> "Made":
        one = super().__new__(cls)
        one.made = 1
        return one

    def tick(self) -> bool:
        return self.made == 1


class Narrow(SyncAction):
    __slots__ = ("left",)

    def __init__(self) -> None:
        self.left = 1

    def tick(self) -> bool:
        self.left -= 1
        return self.left == 0


class MixinBehind(SyncAction, Remembers):
    def tick(self) -> bool:
        return not self.ticks


class Measures(Protocol):
    def measured(self) -> int: ...


class Gauge(SyncAction, Measures):
    def measured(self) -> int:
        return 2

    def tick(self) -> bool:
        return self.measured() == 2


class Sonar(Sensor):
    def measure(self) -> int:
        return 2


@pytest.mark.parametrize("leaf", [Made, Narrow, MixinBehind, Gauge, Sonar], ids=lambda leaf: leaf.__name__)
def test_class_with_an_own_new_slots_a_mixin_a_protocol_or_an_abstract_base_is_a_leaf(
    leaf: type[SyncAction], make_tree: TreeFactory
) -> None:
    assert make_tree(f"<{leaf.__name__}/>", leaf).tick_once() is Status.SUCCESS


def test_abstract_leaf_is_refused_with_its_missing_methods() -> None:
    with pytest.raises(RegistrationError, match=r"<Sensor>: Sensor is abstract: .* implements measure\(\)"):
        Registry.standard().add(Sensor)


def test_leaf_may_use_init_subclass_and_a_metaclass(make_tree: TreeFactory) -> None:
    class Kind(type(SyncAction)):  # type: ignore[misc]
        pass

    class Flavoured(Yes, metaclass=Kind):
        flavours: ClassVar[list[str]] = []

        def __init_subclass__(cls, flavour: str) -> None:
            super().__init_subclass__()
            cls.flavours.append(flavour)

    class Sweet(Flavoured, flavour="sweet"):
        pass

    assert make_tree("<Sweet/>", Sweet).tick_once() is Status.SUCCESS
    assert Flavoured.flavours == ["sweet"]


def test_every_built_in_node_can_be_subclassed() -> None:
    built_in = {
        manifest.cls for format in (3, 4) for manifest in Registry.standard().manifests_of(format).values()
    }
    assert len(built_in) > 42
    for cls in built_in:
        derived = type("Own" + cls.__name__, (cls,), {})
        assert issubclass(derived, cls)


# --- overriding


def test_a_property_of_the_engine_may_be_overridden(make_tree: TreeFactory) -> None:
    class Renamed(SyncAction):
        @property
        def name(self) -> str:
            return "mine"

        def tick(self) -> bool:
            return self.name == "mine"

    tree = make_tree("<Renamed/>", Renamed)
    assert tree.tick_once() is Status.SUCCESS
    assert (tree.root.name, tree.root.path) == ("mine", "Renamed::1")


def test_execute_tick_may_be_overridden(make_tree: TreeFactory) -> None:
    class Contrary(Yes):
        def execute_tick(self) -> Status:
            super().execute_tick()
            return Status.FAILURE

    assert make_tree("<Sequence><Contrary/></Sequence>", Contrary).tick_once() is Status.FAILURE


def test_halt_may_be_overridden(make_tree: TreeFactory) -> None:
    class Careful(StatefulAction):
        halts = 0

        def on_start(self) -> Status:
            return Status.RUNNING

        def on_running(self) -> Status:
            return Status.RUNNING

        def halt(self) -> None:
            self.halts += 1
            super().halt()

    tree = make_tree("<Careful/>", Careful)
    tree.tick_once()
    tree.root.halt()
    assert (tree.find(Careful)[0].halts, tree.root.status) == (1, Status.IDLE)


def test_a_method_may_be_replaced_while_the_tree_runs(make_tree: TreeFactory) -> None:
    class Changing(Yes):
        pass

    tree = make_tree("<Changing/>", Changing)
    assert tree.tick_once() is Status.SUCCESS
    Changing.tick = lambda self: False  # type: ignore[method-assign]
    assert tree.tick_once() is Status.FAILURE
    tree.root.tick = lambda: True  # type: ignore[method-assign]
    assert tree.tick_once() is Status.SUCCESS


def test_attributes_may_be_computed_on_access(make_tree: TreeFactory) -> None:
    class Lazy(SyncAction):
        @cached_property
        def half(self) -> int:
            return 21

        def __getattr__(self, name: str) -> int:
            if name == "double":
                return 2 * self.half
            raise AttributeError(name)

        def tick(self) -> bool:
            return bool(self.double == 42)

    tree = make_tree("<Lazy/>", Lazy)
    assert tree.tick_once() is Status.SUCCESS
    assert not hasattr(tree.root, "triple")


# --- the engine's other classes


def test_clock_observer_and_tree_can_be_subclassed() -> None:
    class Stopped(SimClock):
        def now(self) -> int:
            return 7

    class Listens(Observer):
        def __init__(self) -> None:
            self.received: list[Transition] = []

        def transition(self, change: Transition) -> None:
            self.received.append(change)

    class Own(Tree):
        pass

    listener = Listens()
    tree = btcore.loads(
        '<root BTCPP_format="4"><BehaviorTree ID="Main"><AlwaysSuccess/></BehaviorTree></root>',
        clock=Stopped(),
    )
    tree.subscribe(listener)
    tree.tick_once()
    assert [(change.stamp, change.status) for change in listener.received] == [
        (7, Status.SUCCESS),
        (7, Status.IDLE),
    ]
    assert issubclass(Own, Tree)


def test_port_type_can_be_subclassed(make_tree: TreeFactory) -> None:
    class Names(ValueType):
        def __init__(self) -> None:
            super().__init__("std::vector<Name>", list)

        def from_text(self, text: str, format: int = 4) -> list[str]:
            return text.split("|")

        def accepts(self, value: object) -> bool:
            return isinstance(value, list)

    @action
    def greet(names: In[Annotated[list[str], Names()]], message: Put[str]) -> bool:
        message(", ".join(names))
        return True

    tree = make_tree(
        '<Sequence><Greet names="Ada|Bob" message="{a}"/><Greet names="{n}" message="{b}"/></Sequence>', greet
    )
    tree.blackboard["n"] = ["Cy"]
    assert tree.tick_once() is Status.SUCCESS
    assert (tree.blackboard["a"], tree.blackboard["b"]) == ("Ada, Bob", "Cy")


# --- garbage collection, copies and pickles


def test_unreferenced_tree_is_collected_with_its_leaves(make_tree: TreeFactory) -> None:
    class Selfish(Yes):
        def __init__(self) -> None:
            self.me = self

    tree = make_tree("<Sequence><Selfish/></Sequence>", Selfish)
    tree.tick_once()
    leaf = weakref.ref(tree.find(Selfish)[0])
    assert leaf() is not None
    del tree
    gc.collect()
    assert leaf() is None


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, pickle.dumps])
def test_tree_and_nodes_cannot_be_copied_or_pickled(
    copied: Callable[[Any], Any], make_tree: TreeFactory
) -> None:
    tree = make_tree("<Sequence><Yes/></Sequence>", Yes)
    for thing in (tree, tree.root, tree.find(Yes)[0]):
        with pytest.raises(TypeError, match="load"):
            copied(thing)


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, pickle.dumps])
def test_blackboard_cannot_be_copied_but_cloned_into_another(copied: Callable[[Any], Any]) -> None:
    board, other = Blackboard(), Blackboard()
    board["x"] = 1
    with pytest.raises(TypeError, match=r"clone_into\(\) copies its entries"):
        copied(board)
    board.clone_into(other)
    other["x"] = 2
    assert (board["x"], other["x"]) == (1, 2)


def test_results_and_errors_can_be_pickled(make_tree: TreeFactory) -> None:
    def broken() -> bool:
        raise ValueError("out of reach")

    with pytest.raises(NodeExecutionError) as raised:
        make_tree("<Broken/>", broken).tick_once()
    change = Transition(1, 2, 3, 4, Status.IDLE, Status.SUCCESS)
    fault = NodeError("no such thing")
    again = pickle.loads(pickle.dumps([Status.SUCCESS, NodeType.CONTROL, change, fault, raised.value]))
    assert again[0] is Status.SUCCESS
    assert again[1] is NodeType.CONTROL
    assert again[2] == change
    assert [str(one) for one in again[3:]] == [str(fault), str(raised.value)]


# --- help()

requires_source = pytest.mark.skipif(
    builds.active_build() == "compiled", reason="mypyc leaves docstrings out of compiled code"
)


@requires_source
@pytest.mark.parametrize("name", [name for name in btcore.__all__ if callable(getattr(btcore, name))])
def test_every_public_callable_has_a_docstring(name: str) -> None:
    thing = getattr(btcore, name)
    message = inspect.getdoc(thing)
    assert message
    assert "mypyc" not in message


@requires_source
def test_help_shows_methods_with_their_parameters() -> None:
    assert str(inspect.getdoc(Tree.tick_while_running)).startswith(
        "Tick until the root is no longer RUNNING, and wait"
    )
    assert list(inspect.signature(Tree.tick_while_running).parameters) == ["self", "period"]
    assert list(inspect.signature(btcore.load).parameters)[:4] == ["path", "more", "nodes", "tree"]
    assert str(inspect.getdoc(StatefulAction.on_halted)).startswith("Clean up.")
