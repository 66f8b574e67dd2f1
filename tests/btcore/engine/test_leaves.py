"""Leaves as functions and classes: the meaning of their annotations and return values."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Annotated, Any, Protocol, runtime_checkable

import numpy as np
import pytest

from btcore import (
    Blackboard,
    Clock,
    Direction,
    In,
    InOut,
    NodeExecutionError,
    NodeType,
    Out,
    Port,
    Put,
    RegistrationError,
    Registry,
    SimClock,
    StatefulAction,
    Status,
    SyncAction,
    ThreadedAction,
    Tree,
    TreeError,
    TreeResource,
    action,
    condition,
)
from btcore.engine.functions import camel_case
from btcore.values import INT64, STRING, Int64
from tests.btcore.conftest import TreeFactory


class Robot:
    def __init__(self, name: str = "tiago") -> None:
        self.name = name
        self.driven: list[float] = []


# --- functions


def test_bool_results_become_success_and_failure_and_a_status_is_kept(make_tree: TreeFactory) -> None:
    @action
    def yes() -> bool:
        return True

    @action
    def no() -> bool:
        return False

    @action
    def skips() -> Status:
        return Status.SKIPPED

    assert make_tree("<Yes/>", yes).tick_once() is Status.SUCCESS
    assert make_tree("<No/>", no).tick_once() is Status.FAILURE
    assert make_tree("<Skips/>", skips).tick_once() is Status.SKIPPED


def test_tag_is_the_camel_case_name_or_the_given_id() -> None:
    @condition
    def battery_ok() -> bool:
        return True

    @action(ID="Recharge")
    def charge_the_battery() -> bool:
        return True

    nodes = Registry.standard()
    nodes.add(battery_ok, charge_the_battery)
    assert nodes.manifests["BatteryOk"].type is NodeType.CONDITION
    assert nodes.manifests["Recharge"].type is NodeType.ACTION
    assert "ChargeTheBattery" not in nodes


def test_decorated_function_can_still_be_called() -> None:
    @action
    def double(value: In[int]) -> int:
        return 2 * value

    assert double(21) == 42


def test_input_is_read_at_every_tick_as_its_annotated_type(make_tree: TreeFactory) -> None:
    seen: list[object] = []

    @action
    def look(number: In[int], real: In[float], text: In[str], truth: In[bool], many: In[list[int]]) -> bool:
        seen.append((number, real, text, truth, many))
        return True

    tree = make_tree('<Look number="7" real="{x}" text="7" truth="true" many="1;2"/>', look)
    tree.blackboard["x"] = 0.5
    tree.tick_once()
    tree.blackboard["x"] = 1.5
    tree.tick_once()
    assert seen == [(7, 0.5, "7", True, [1, 2]), (7, 1.5, "7", True, [1, 2])]
    assert type(seen[0][0]) is int  # type: ignore[index]


def test_list_input_is_a_copy_that_a_leaf_may_change(make_tree: TreeFactory) -> None:
    lengths: list[int] = []

    @action
    def consume(many: In[list[int]]) -> bool:
        lengths.append(len(many))
        many.clear()
        return True

    tree = make_tree('<Consume many="1;2;3"/>', consume)
    tree.tick_once()
    tree.tick_once()
    assert lengths == [3, 3]


def test_parameter_default_is_the_default_of_the_port(make_tree: TreeFactory) -> None:
    seen: list[object] = []

    @action
    def look(minimum: In[float] = 0.2, key: In[str] = "{name}", pose: In[Robot | None] = None) -> bool:
        seen.append((minimum, key, pose))
        return True

    tree = make_tree("<Look/>", look)
    tree.blackboard["name"] = "Ada"
    tree.tick_once()
    assert seen == [(0.2, "Ada", None)]
    port = tree.registry.manifests["Look"].ports["minimum"]
    assert (port.direction, port.type.name, port.default) == (Direction.IN, "double", "0.200000")


def test_default_may_be_a_value_without_a_text_form(make_tree: TreeFactory) -> None:
    home = Robot("home")
    seen: list[Robot] = []

    @action
    def look(where: In[Robot] = home) -> bool:
        seen.append(where)
        return True

    make_tree("<Look/>", look).tick_once()
    assert seen == [home]


def test_the_default_of_an_output_names_an_entry(make_tree: TreeFactory) -> None:
    @action
    def measure(distance: Put[float] = "{nearest}") -> bool:  # type: ignore[assignment]
        distance(1.0)
        return True

    tree = make_tree("<Measure/>", measure)
    tree.tick_once()
    assert tree.blackboard["nearest"] == 1.0


def test_any_other_parameter_is_a_resource_filled_by_type(make_tree: TreeFactory) -> None:
    @action
    def drive(robot: Robot, speed: In[float]) -> bool:
        robot.driven.append(speed)
        return True

    class Tiago(Robot):
        pass

    tiago = Tiago()
    make_tree('<Drive speed="0.3"/>', drive, resources=["no robot", tiago, Robot()]).tick_once()
    assert tiago.driven == [0.3]


def test_resource_may_be_requested_by_a_protocol(make_tree: TreeFactory) -> None:
    @runtime_checkable
    class Horn(Protocol):
        def honk(self) -> str: ...

    class Klaxon:
        def honk(self) -> str:
            return "ahooga"

    @action
    def warn(horn: Horn, expected_message: Put[str]) -> bool:
        expected_message(horn.honk())
        return True

    tree = make_tree('<Warn expected_message="{expected_message}"/>', warn, resources=[Klaxon()])
    tree.tick_once()
    assert tree.blackboard["expected_message"] == "ahooga"


def test_clock_and_blackboard_are_always_available_resources(make_tree: TreeFactory, clock: SimClock) -> None:
    given: list[object] = []

    @action
    def look(clock: Clock, blackboard: Blackboard) -> bool:
        given.extend([clock, blackboard])
        return True

    tree = make_tree("<Look/>", look)
    tree.tick_once()
    assert given == [clock, tree.blackboard]
    assert tree.registry.manifests["Look"].required_resources == []


def test_tree_state_is_shared_within_a_tree_and_separate_between_trees(make_tree: TreeFactory) -> None:
    class Laps(TreeResource):
        def __init__(self) -> None:
            self.count = 0

    @action
    def lap(laps: Laps, number: Put[int]) -> bool:
        laps.count += 1
        number(laps.count)
        return True

    text = '<Sequence><Lap number="{first}"/><Lap number="{second}"/></Sequence>'
    for _ in range(2):
        tree = make_tree(text, lap)
        tree.tick_once()
        assert (tree.blackboard["first"], tree.blackboard["second"]) == (1, 2)
    assert tree.registry.manifests["Lap"].required_resources == []


def test_resource_with_a_default_is_optional(make_tree: TreeFactory) -> None:
    @action
    def greet(robot: Robot = Robot("nobody"), *, expected_message: Put[str]) -> bool:  # noqa: B008
        expected_message(robot.name)
        return True

    tree = make_tree('<Greet expected_message="{expected_message}"/>', greet)
    tree.tick_once()
    assert tree.blackboard["expected_message"] == "nobody"


def test_missing_resource_is_named_when_the_tree_is_built(make_tree: TreeFactory) -> None:
    @action
    def drive(robot: Robot) -> bool:
        return True

    with pytest.raises(TreeError, match=r"<Drive> needs a Robot for its parameter 'robot'"):
        make_tree("<Drive/>", drive)


def test_two_resources_of_one_type_raise_when_the_tree_is_built(make_tree: TreeFactory) -> None:
    @action
    def drive(robot: Robot) -> bool:
        robot.driven.append(1.0)
        return True

    message = "2 resources of the class Robot fit the parameter 'robot' of <Drive>: pass only one of them"
    with pytest.raises(TreeError, match=message):
        make_tree("<Drive/>", drive, resources=[Robot("left"), Robot("right")])
    robot = Robot()
    assert make_tree("<Drive/>", drive, resources=[robot, robot]).tick_once() is Status.SUCCESS
    assert robot.driven == [1.0]


def test_two_resources_that_no_leaf_takes_are_accepted(make_tree: TreeFactory) -> None:
    assert make_tree("<AlwaysSuccess/>", resources=[Robot(), Robot()]).tick_once() is Status.SUCCESS


def test_docstring_describes_the_leaf_and_annotation_text_the_port() -> None:
    @action
    def drive(speed: Annotated[float, *In[float].__metadata__, "how fast (m/s)"]) -> bool:
        """Drive on.

        Until told otherwise.
        """
        return True

    class Wait(SyncAction):
        """Wait a bit."""

    nodes = Registry.standard()
    nodes.add(drive, Wait)
    assert nodes.manifests["Drive"].description == "Drive on.\n\nUntil told otherwise."
    assert nodes.manifests["Drive"].ports["speed"].description == "how fast (m/s)"
    assert nodes.manifests["Wait"].description == "Wait a bit."


def test_int64_is_a_valid_port_annotation(make_tree: TreeFactory) -> None:
    @action
    def note(stamp: In[Int64], kept: Put[Int64]) -> bool:
        kept(stamp)
        return True

    nodes = Registry.standard()
    nodes.add(note)
    assert {port.type for port in nodes.manifests["Note"].ports.values()} == {INT64}
    tree = make_tree('<Note stamp="1700000000000000000" kept="{last}"/>', note)
    assert tree.tick_once() is Status.SUCCESS
    assert tree.blackboard["last"] == 1_700_000_000_000_000_000


# --- classes


class Approach(StatefulAction):
    """Drive towards *goal* until closer than *reach*."""

    goal: In[float]
    reach: In[float] = 0.3
    remaining: Out[float]

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.halts = 0

    def on_start(self) -> Status:
        self.left = self.goal
        return self.on_running()

    def on_running(self) -> Status:
        self.left -= 0.5
        self.robot.driven.append(0.5)
        self.remaining = self.left
        return Status.SUCCESS if self.left < self.reach else Status.RUNNING

    def on_halted(self) -> None:
        self.halts += 1


def test_stateful_action_starts_continues_and_is_reset_when_done(make_tree: TreeFactory) -> None:
    robot = Robot()
    tree = make_tree('<Approach goal="1.5" remaining="{left}"/>', Approach, resources=[robot])
    assert tree.tick_once() is Status.RUNNING
    assert tree.blackboard["left"] == 1.0
    assert "remaining" not in vars(tree.root)
    assert [tree.tick_once(), tree.tick_once()] == [Status.RUNNING, Status.SUCCESS]
    assert tree.blackboard["left"] == 0.0
    assert tree.root.status is Status.IDLE
    assert tree.tick_once() is Status.RUNNING
    assert len(robot.driven) == 4


def test_on_halted_is_called_only_while_the_action_runs(make_tree: TreeFactory) -> None:
    tree = make_tree('<Approach goal="1.5" remaining="{left}"/>', Approach, resources=[Robot()])
    tree.halt()
    assert tree.find(Approach)[0].halts == 0
    tree.tick_once()
    tree.halt()
    assert tree.find(Approach)[0].halts == 1


def test_completed_stateful_action_keeps_its_result_until_reset(make_tree: TreeFactory) -> None:
    starts: list[str] = []

    class Once(StatefulAction):
        def on_start(self) -> Status:
            starts.append(self.name)
            return Status.FAILURE

        def on_running(self) -> Status:
            return Status.FAILURE

    node = make_tree("<Sequence><Once/></Sequence>", Once).find(Once)[0]
    assert node.execute_tick() is Status.FAILURE
    assert node.execute_tick() is Status.FAILURE
    assert len(starts) == 1


def test_input_cannot_be_assigned_and_output_cannot_be_read(make_tree: TreeFactory) -> None:
    class Muddle(SyncAction):
        given: In[int]
        made: Out[int]

        def tick(self) -> Status:
            with pytest.raises(AttributeError, match="is an input: it can be read, but not assigned"):
                self.given = 1
            hint = r"to read and assign it, annotate it with InOut\[…\]"
            with pytest.raises(
                AttributeError, match=f"is an output: it can be assigned, but not read; {hint}"
            ):
                print(self.made)
            return Status.SUCCESS

    assert make_tree('<Muddle given="1" made="{m}"/>', Muddle).tick_once() is Status.SUCCESS


def test_ports_and_resources_are_inherited(make_tree: TreeFactory) -> None:
    class Careful(Approach):
        """Keep a larger distance."""

        reach = 0.9
        margin: In[float] = 0.1

    tree = make_tree('<Careful goal="1.5" remaining="{left}"/>', Approach, Careful, resources=[Robot()])
    assert tree.tick_once() is Status.RUNNING
    assert tree.tick_once() is Status.SUCCESS
    careful = tree.registry.manifests["Careful"]
    assert list(careful.ports) == ["goal", "reach", "remaining", "margin"]
    assert careful.ports["reach"].default == "0.900000"
    assert tree.registry.manifests["Approach"].ports["reach"].default == "0.300000"


def test_subclass_may_change_the_direction_of_an_inherited_port(make_tree: TreeFactory) -> None:
    class Reads(SyncAction):
        counter: In[int]

        def tick(self) -> Status:
            return Status.SUCCESS

    class Writes(Reads):
        counter: InOut[int]

        def tick(self) -> Status:
            self.counter = 5
            return Status.SUCCESS

    tree = make_tree('<Writes counter="{n}"/>', Reads, Writes)
    tree.tick_once()
    assert tree.blackboard["n"] == 5


def test_a_leaf_may_be_a_dataclass(make_tree: TreeFactory) -> None:
    @dataclass
    class Greet(SyncAction):
        robot: Robot
        who: In[str]
        word: In[str] = "Hello"
        greeting: Out[str] = field(kw_only=True)
        spoken: list[str] = field(default_factory=list, init=False)

        def tick(self) -> Status:
            self.spoken.append(self.who)
            self.greeting = f"{self.word}, {self.who}"
            return Status.SUCCESS

    tree = make_tree('<Greet who="Ada" greeting="{g}"/>', Greet, resources=[Robot()])
    assert tree.tick_once() is Status.SUCCESS
    assert tree.blackboard["g"] == "Hello, Ada"
    assert tree.find(Greet)[0].spoken == ["Ada"]
    assert list(tree.registry.manifests["Greet"].ports) == ["who", "word", "greeting"]


def test_leaf_attributes_are_available_in_its_init(make_tree: TreeFactory) -> None:
    class Curious(SyncAction):
        level: In[int]

        def __init__(self) -> None:
            self.known = (self.name, self.path, self.uid, self.id, self.level, self.status)

        def tick(self) -> Status:
            return Status.SUCCESS

    tree = make_tree('<Sequence><Curious name="who" level="3"/></Sequence>', Curious)
    assert tree.find(Curious)[0].known == ("who", "who", 2, "Curious", 3, Status.IDLE)


def test_exception_in_init_is_a_tree_error_with_its_position(make_tree: TreeFactory) -> None:
    class Broken(SyncAction):
        def __init__(self) -> None:
            raise ValueError("out of luck")

    with pytest.raises(TreeError, match=r"<text>:1:.*<Broken> raised .*ValueError: out of luck"):
        make_tree("<Broken/>", Broken)


# --- errors at a tick


def raised(tree: Tree) -> str:
    with pytest.raises(NodeExecutionError) as caught:
        tree.tick_once()
    return str(caught.value)


def forgets() -> None:
    pass


def forgets_at_the_end() -> Iterator[None]:
    yield


class Forgets(SyncAction):
    def tick(self) -> None:  # type: ignore[override]
        pass


class ForgetsLater(StatefulAction):
    def on_start(self) -> Status:
        return Status.RUNNING

    def on_running(self) -> None:
        pass


class ForgetsInAThread(ThreadedAction):
    def work(self) -> None:
        pass


@pytest.mark.parametrize(
    ("leaf", "function"),
    [
        (forgets, forgets),
        (forgets_at_the_end, forgets_at_the_end),
        (Forgets, Forgets.tick),
        (ForgetsLater, ForgetsLater.on_running),
        (ForgetsInAThread, ForgetsInAThread.work),
    ],
)
def test_leaf_returning_none_is_named_with_file(make_tree: TreeFactory, leaf: Any, function: Any) -> None:
    tree = make_tree(f"<{camel_case(leaf.__name__)}/>", leaf)
    with pytest.raises(NodeExecutionError) as caught:
        tree.tick_while_running()
    name, line = function.__qualname__, function.__code__.co_firstlineno
    expected = f"or SKIPPED, not None: did {name}() in {__file__}:{line} forget `return`?"
    assert str(caught.value).splitlines()[0].endswith(expected)


@pytest.mark.parametrize("number", [0.5, 1.5])
def test_numpy_bool_counts_as_a_bool(make_tree: TreeFactory, number: float) -> None:
    @condition
    def is_near() -> object:
        return np.float64(number) < 1.0

    tree = make_tree("<IsNear/>", is_near)
    assert type(np.float64(number) < 1.0) is not bool
    assert tree.tick_once() is (Status.SUCCESS if number < 1.0 else Status.FAILURE)


def test_a_condition_may_return_running(make_tree: TreeFactory) -> None:
    @condition
    def unsure() -> Status:
        return Status.RUNNING

    assert make_tree("<Unsure/>", unsure).tick_once() is Status.RUNNING


def test_missing_mandatory_port_raises_at_the_tick(make_tree: TreeFactory) -> None:
    def look(level: In[float], distance: Put[float]) -> bool:
        distance(level)
        return True

    assert "<Look> has no value for port [level]: set it in the tree" in raised(make_tree("<Look/>", look))
    expected_message = raised(make_tree('<Look level="1"/>', look))
    assert "<Look> has no entry for port [distance]: set it in the tree" in expected_message


def test_an_entry_that_was_never_written_is_named(make_tree: TreeFactory) -> None:
    class Look(SyncAction):
        level: In[float]

        def tick(self) -> bool:  # type: ignore[override]
            return self.level > 0

    assert "port [level] reads {battery}, which has never been written" in raised(
        make_tree('<Look level="{battery}"/>', Look)
    )


def test_value_of_a_wrong_type_is_reported_with_its_port(make_tree: TreeFactory) -> None:
    def measure(distance: Put[float]) -> bool:
        distance(object())  # type: ignore[arg-type]
        return True

    assert "port [distance] takes double" in raised(make_tree('<Measure distance="{d}"/>', measure))


def test_output_that_is_not_a_key_is_reported(make_tree: TreeFactory) -> None:
    def note(text: Put[str]) -> bool:
        text("one")
        return True

    assert "write the key in braces, {like_this}" in raised(make_tree('<Note text="t"/>', note))


# --- errors at registration


def registration_error(*things: Any) -> str:
    with pytest.raises(RegistrationError) as caught:
        Registry.standard().add(*things)
    return str(caught.value)


def unannotated(speed):  # type: ignore[no-untyped-def]
    return True


def variadic(*speeds: float) -> bool:
    return True


def variadic_by_name(**angles: float) -> bool:
    return True


def has_output(n: Out[int]) -> bool:
    return True


def has_inout(n: InOut[int]) -> bool:
    return True


async def yields():  # type: ignore[no-untyped-def]
    yield


@pytest.mark.parametrize(
    ("function", "expected_message"),
    [
        (
            unannotated,
            "parameter 'speed' of unannotated has no annotation: annotate a port with In[…] or Put[…]",
        ),
        (variadic, "has the variadic parameter *speeds, for which a tree has no arguments"),
        (variadic_by_name, "angles, for which a tree has no arguments"),
        (has_output, "has_output can't be assigned: annotate an output with Put[…]"),
        (has_inout, "has_inout can't be assigned: annotate an output with Put[…]"),
        (yields, "async def"),
    ],
)
def test_function_that_cannot_be_a_leaf_is_refused(function: Any, expected_message: str) -> None:
    assert expected_message in registration_error(function)


def test_a_port_of_a_function_may_be_of_any_type(make_tree: TreeFactory) -> None:
    def copy(source: In, target: Put) -> bool:
        target(source)
        return True

    tree = make_tree('<Copy source="{a}" target="{b}"/>', copy)
    tree.blackboard["a"] = [1, 2]
    assert tree.tick_once() is Status.SUCCESS
    assert tree.blackboard["b"] == [1, 2]


@pytest.mark.parametrize("name", ["config", "halt", "tick"])
def test_port_that_would_hide_an_attribute_of_the_engine_is_refused(name: str) -> None:
    follow = type("Follow", (SyncAction,), {"__annotations__": {name: In[str]}, "__module__": __name__})
    assert f"port '{name}' of Follow would hide the attribute" in registration_error(follow)


def test_port_in_provided_ports_may_have_the_name_of_an_attribute(make_tree: TreeFactory) -> None:
    class Follow(SyncAction):
        @staticmethod
        def provided_ports() -> list[Port]:
            return [Port("path", type=STRING), Port("status", Direction.OUT, type=STRING)]

        def tick(self) -> Status:
            self.set_output("status", f"at the end of {self.get_input('path')}")
            return Status.SUCCESS

    tree = make_tree('<Follow path="the road" status="{s}"/>', Follow)
    tree.tick_once()
    assert tree.blackboard["s"] == "at the end of the road"


@pytest.mark.parametrize("name", ["name", "ID", "_private", "7th", "with space", "a.b", "a:b", ""])
def test_invalid_port_name_is_refused(name: str) -> None:
    class Odd(SyncAction):
        @staticmethod
        def provided_ports() -> list[Port]:
            return [Port(name)]

    assert f"<Odd> can't have a port called '{name}'" in registration_error(Odd)


def test_port_name_may_contain_non_ascii_letters() -> None:
    def drive(größe: In[float]) -> bool:
        return True

    nodes = Registry.standard()
    nodes.add(drive)
    assert list(nodes.manifests["Drive"].ports) == ["größe"]


def test_protocol_without_runtime_checkable_is_refused(make_tree: TreeFactory) -> None:
    class Horn(Protocol):
        def honk(self) -> str: ...

    def warn(horn: Horn) -> bool:
        return True

    with pytest.raises(TreeError, match="marked @runtime_checkable"):
        make_tree("<Warn/>", warn)
