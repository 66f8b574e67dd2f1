"""The models of btcore's own leaves, which proofs assume, hold for the code of these leaves.

Every leaf and decorator with a model runs in the simulator, and in random schedules with random robots and
servers. A result, a write or a use of the robot that its model excludes is a fault. Inputs are always
written, except for those that the model calls optional. The leaves that need a ROS session run in
tests/ros2/leaves/test_leaf_models.py, with the same checks.
"""

import random
import threading
from collections.abc import Callable, Iterator, Mapping
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

import btcore
from btcore import NodeSpec, Registry, Status
from btcore.bundled_trees import folder
from btcore.engine.control import ControlNode, DecoratorNode
from btcore.engine.node import TreeNode
from btcore.errors import NodeExecutionError
from btcore.registry.manifest import Manifest
from btcore.status import NodeType
from btcore_navigation.action import GoalHandle
from btcore_navigation.controller import FollowPathFeedback
from btcore_navigation.leaves.explore import Explorer, MapFile
from btcore_navigation.leaves.navigate import PoseNavigator
from btcore_navigation.navigate_goal import WaypointStatus
from btcore_navigation.navigation_servers import (
    Battery,
    CheckPath,
    GetCosts,
    NavigationServers,
    PathCheck,
    SmoothedPath,
    SmoothPathGoal,
)
from btcore_navigation.path import NavPath
from btcore_proof.leaf_models import LeafModel, model_of, resources_of
from btcore_robot.components.lifecycle import LifecycleState
from btcore_robot.leaves.lifecycle_leaves import HeadTrackerProtocol, ObjectLocatorProtocol
from btcore_robot.robot import Odometry, Pose2D, Twist2D, Waypoints

IDLE, RUNNING, SUCCESS, FAILURE = Status.IDLE, Status.RUNNING, Status.SUCCESS, Status.FAILURE
DRIVING = ("follow_path", "spin", "backup", "drive_on_heading", "navigate_to_pose", "navigate_through_poses")
WHEELS = frozenset({"Robot", "base"})
"""What a leaf uses that drives."""
ROS = frozenset({"RosSession"})


def shipped() -> dict[str, Manifest]:
    """Return what a proof replaces by models: leaves that are not built in, and decorators with resources."""
    nodes = Registry.standard()
    nodes.add_installed_libraries()
    leaves = (NodeType.ACTION, NodeType.CONDITION)
    return {
        id: manifest
        for id, manifest in nodes.manifests_of(4).items()
        if manifest.library != "btcore"
        and (manifest.type in leaves or (manifest.type is NodeType.DECORATOR and resources_of(manifest)))
    }


SHIPPED = shipped()
IDS = sorted(id for id, manifest in SHIPPED.items() if not resources_of(manifest) & ROS)


# --- what a model excludes


class Watch(ControlNode):
    """Ticks or halts a child in each tick, as *choose* decides, and checks what the child does."""

    spec = NodeSpec(state_fields=())
    choose: ClassVar[Callable[[int], str]]
    resource: ClassVar[frozenset[str]] = WHEELS
    used: ClassVar[list[str]]
    """What uses the resource, such as a command, or the action of a goal."""
    faults: ClassVar[list[str]]
    seen: ClassVar[set[tuple[str, str]]]

    def tick(self) -> Status:
        """Tick and halt some children."""
        for index, child in enumerate(self.children):
            do = type(self).choose(index)
            before = child.status
            writes = self.writes()
            self.used.clear()
            if do == "halt":
                self.halt_child(index)
                if before is RUNNING:
                    self.check(child, before, IDLE, writes)
            elif do == "tick":
                if before not in (IDLE, RUNNING):
                    self.halt_child(index)
                    before = IDLE
                try:
                    result = child.execute_tick()
                except NodeExecutionError:
                    self.halt_child(index)
                    continue
                self.check(child, before, result, writes)
        return RUNNING

    def writes(self) -> dict[str, int]:
        """Return the number of writes of each entry."""
        return {key: entry.sequence_id for key, entry in self.blackboard.local_entries().items()}

    def check(self, child: TreeNode, before: Status, result: Status, earlier: Mapping[str, int]) -> None:
        """Report what the model of *child* excludes."""
        written = {key for key, count in self.writes().items() if count != earlier.get(key, 0)}
        model = model_of(SHIPPED[child.id])
        self.seen.add((child.id, result.name))
        found = list(problems(child, model, before, result, written, earlier))
        if self.used and not model.uses & self.resource:
            found.append(f"uses {sorted(self.resource)}: {self.used}")
        self.faults += [f"{child.id} {before.name} → {result.name}: {problem}" for problem in found]


def problems(
    node: TreeNode,
    model: LeafModel,
    before: Status,
    result: Status,
    written: set[str],
    earlier: Mapping[str, int],
) -> Iterator[str]:
    """Return results and writes that a model excludes in a tick, or in a halt (*result* is IDLE)."""
    keys = {name: output.key or "" for name, output in node.config.outputs.items()}
    free = {keys.get(name, name) for name in model.writes}
    all_outputs = set(keys.values()) - free
    if written - free - all_outputs:
        yield f"writes {sorted(written - free - all_outputs)}"
    written = written & all_outputs
    if result is IDLE:
        if written != {keys[name] for name in model.on_halt if name in keys}:
            yield f"writes {sorted(written)} at a halt"
        return
    if isinstance(node, DecoratorNode):
        # The child always succeeds, so that any other result is the decorator's own.
        if result is FAILURE and FAILURE not in model.results:
            yield "fails without its child"
        if result is RUNNING and not model.lasts:
            yield "holds its child back"
        return
    if result is RUNNING:
        if not model.lasts:
            yield "lasts"
        if written and not (model.early and written == all_outputs):
            yield f"writes {sorted(written)} while it is RUNNING"
        return
    if result not in model.results:
        yield "returns this result"
    if before is IDLE and not model.at_once:
        yield "completes in its first tick"
    is_written = model.early and not written and all(earlier.get(key) for key in all_outputs)
    if written != all_outputs and not (result is FAILURE and not written) and not is_written:
        yield f"writes {sorted(written)} of {sorted(all_outputs)}"


# --- inputs

PATH = NavPath(np.array([[0.0, 0.0, 0.0], [0.5, 0.1, 0.0], [1.5, 0.2, 0.0]]), 0, "map")


def values_of(name: str, kind: str) -> list[object]:
    """Return the values that an input may have."""
    poses = [Pose2D(0.0, 0.0, 0.0), Pose2D(1.0, 0.5, 1.0)]
    if "path" in name and "type" not in name and "plan" not in name and "handler" not in name:
        return [PATH, NavPath(np.zeros((0, 3)), 0, "map")]
    if name == "tracking_feedback":
        return [FollowPathFeedback()]
    if kind == "Route":
        from btcore_ros2.nav2.nodes import Route

        return [Route(), Route((Pose2D(0.0, 0.0, 0.0),))]
    if name == "input_waypoint_statuses":
        return [[WaypointStatus(poses[0], 0)]]
    if kind.startswith(("list", "Poses")) or name in ("viapoints", "goals", "input_goals"):
        return [[205], []] if "codes" in name else [poses, poses[:1]]
    return poses if "Pose2D" in kind else []


def elements_of(ids: list[str]) -> list[str]:
    """Return the elements of nodes."""
    return [_element(SHIPPED[id], number) for number, id in enumerate(ids)]


def _element(manifest: Manifest, number: int) -> str:
    """Return the element of a node: its inputs are entries with values if values are known."""
    attributes = [f'name="n{number}"']
    for port in manifest.ports.values():
        if port.writes:
            attributes.append(f'{port.name}="{{{port.name}_{number}}}"')
        elif values_of(port.name, port.type.name) or port.name == "error_code":
            attributes.append(f'{port.name}="{{in_{port.name}}}"')
        elif port.default is None or manifest.id == "TransformAvailable":
            text = {"bool": "true", "std::string": "next"}.get(port.type.name, "1")
            attributes.append(f'{port.name}="{text}"')
    child = "<AlwaysSuccess/>" if manifest.type is NodeType.DECORATOR else ""
    return f"<{manifest.id} {' '.join(attributes)}>{child}</{manifest.id}>"


def tree_of(elements: list[str], resources: list[object], clock: Any, watch: type[Watch]) -> btcore.Tree:
    """Return a tree in which *watch* ticks the nodes with these elements."""
    nodes = Registry.standard()
    nodes.add_installed_libraries()
    nodes.add(watch, ID="Watch")
    inside = "".join(elements)
    text = f'<root BTCPP_format="4"><BehaviorTree ID="T"><Watch>{inside}</Watch></BehaviorTree></root>'
    return btcore.loads(text, nodes=nodes, resources=resources, clock=clock)


def write_inputs(tree: btcore.Tree, ids: list[str], rng: random.Random) -> None:
    """Write values to the entries that inputs read; an optional input may remain unwritten."""
    for id in ids:
        model = model_of(SHIPPED[id])
        for port in SHIPPED[id].ports.values():
            values = values_of(port.name, port.type.name) or ([205] if port.name == "error_code" else [])
            if not port.writes and values and (port.name not in model.optional or rng.random() < 0.5):
                tree.blackboard[f"in_{port.name}"] = rng.choice(values)


# --- random schedules: robots and servers that may do anything


class RandomGoal(GoalHandle[Any, Any, Any]):
    """A goal that is accepted and ends at random."""

    def __init__(self, goal: object, rng: random.Random) -> None:
        super().__init__(goal)
        self._draw = rng
        self._fate = rng.choice(["ends", "ends", "ends", "silent", "forever"])

    def poll(self) -> bool:
        """Return whether the goal has ended; it may end at this call."""
        if not self.done and self._fate != "silent":
            self.status = type(self.status).EXECUTING
            self.feedback = FollowPathFeedback()
            if self._fate == "ends" and self._draw.random() < 0.4:
                self._draw.choice([self._succeed, self._abort, self.canceled])()
        return self.done

    def _succeed(self) -> None:
        kinds: dict[type, object] = {CheckPath: PathCheck(self._draw.random() < 0.5, (Pose2D(0, 0, 0),))}
        if isinstance(self.goal, SmoothPathGoal):
            self.succeed(SmoothedPath(PATH, 0.1, True))
        elif isinstance(self.goal, GetCosts):
            self.succeed(tuple(self._draw.choice([0, 254, 255]) for _ in self.goal.poses))
        else:
            self.succeed(kinds.get(type(self.goal), self._draw.choice([PATH, None])))

    def _abort(self) -> None:
        self.abort(205, "it was aborted")


def random_servers(rng: random.Random, used: list[str]) -> Any:
    """Return a navigation whose goals and readings are random."""

    def send(goal: object, action: str, server_name: str = "") -> RandomGoal:
        if action in DRIVING or server_name in DRIVING:
            used.append(action)
        return RandomGoal(goal, rng)

    def maybe(value: object) -> Callable[..., object]:
        return lambda *_: rng.choice([value, None])

    def pose() -> Pose2D | None:
        return rng.choice([None, Pose2D(rng.uniform(-2, 2), 0.0, 0.0)])

    names = {name: maybe(None) for name in dir(NavigationServers) if not name.startswith("_")}
    twists = [Twist2D(0.0, 0.0), Twist2D(0.0, 0.0), Twist2D(0.4, 0.0)]
    members = {
        **{name: staticmethod(value) for name, value in names.items()},
        "goal_tolerance": 0.25,
        "is_recovering": False,
        "is_pose_contradicted": False,
        "send_goal": staticmethod(send),
        "cancel_goals": staticmethod(lambda action, name="": RandomGoal(None, rng)),
        "request": staticmethod(lambda request, name="": RandomGoal(request, rng)),
        "pose": staticmethod(pose),
        "distance_to": staticmethod(lambda place: rng.choice([0.1, 5.0])),
        "remaining": staticmethod(lambda path: rng.choice([0.1, 5.0])),
        "odometry": staticmethod(lambda: Odometry(Pose2D(0, 0, 0), rng.choice(twists), rng.getrandbits(40))),
        "battery": staticmethod(maybe(Battery(0.1, 12.0, True))),
        "latest": staticmethod(lambda topic, kind: rng.choice([None, "x"]) if kind is str else None),
        "can_transform": staticmethod(lambda target, source: rng.random() < 0.5),
        "last_goals": staticmethod(lambda: {"spin": RandomGoal(None, rng)}),
    }
    return type("RandomServers", (), members)()


def random_resources(robot: Any, rng: random.Random, used: list[str], tmp_path: Any) -> list[object]:
    """Return resources for every leaf."""

    def go_to(goal: Pose2D) -> RandomGoal:
        used.append("go_to")
        return RandomGoal(goal, rng)

    def maybe(value: object) -> Callable[..., object]:
        return lambda *_: rng.choice([value, None])

    explorer = SimpleNamespace(
        go_to=go_to,
        must_wait=lambda: rng.random() < 0.3,
        keep_waiting=lambda began: rng.choice([None, (1, "no scan")]),
        goals_wait=lambda: rng.random() < 0.3,
        estimate=lambda: Pose2D(0, 0, 0),
        next_goal=maybe(Pose2D(1, 1, 0)),
        is_goal_unknown=lambda: rng.random() < 0.5,
        is_goal_free=lambda: rng.random() < 0.5,
        exclude_goal=lambda: None,
        save=lambda path: None,
    )
    server = SimpleNamespace(
        state=LifecycleState.INACTIVE,
        activate=lambda: True,
        deactivate=lambda: True,
        boxes=[1],
        detection=None,
    )
    places = Waypoints({"recharge": Pose2D(0, 0, 0), "wp1": Pose2D(1, 1, 0)}, "here")
    original, scan = robot.drive, robot.scan

    def drive(v: float, w: float, **priority: int) -> None:
        used.append(f"drive {v:g} {w:g}")
        original(v, w, **priority)

    robot.drive = drive
    robot.scan = lambda: rng.choice([None, scan()])
    servers = random_servers(rng, used)
    assert isinstance(explorer, Explorer)
    assert isinstance(explorer, PoseNavigator)
    assert isinstance(server, HeadTrackerProtocol)
    assert isinstance(server, ObjectLocatorProtocol)
    assert isinstance(servers, NavigationServers)
    return [robot, servers, explorer, server, places, MapFile(tmp_path / "map.yaml")]


def watch_of(rng: random.Random, tick: float, halt: float) -> type[Watch]:
    """Return a class that ticks and halts each child with these probabilities."""

    def choose(index: int) -> str:
        return rng.choices(["tick", "halt", ""], [tick, halt, 1 - tick - halt])[0]

    members = {"choose": staticmethod(choose), "used": [], "faults": [], "seen": set()}
    return type("Watch", (Watch,), members)


def test_leaves_follow_their_models_in_random_schedules(robot: Any, tmp_path: Any) -> None:
    rng = random.Random(1)
    watch = watch_of(rng, 0.6, 0.15)
    robot.see(*([3.0] * 5))
    resources = random_resources(robot, rng, watch.used, tmp_path)
    for _ in range(4):
        tree = tree_of(elements_of(IDS), resources, robot.clock, watch)
        write_inputs(tree, IDS, rng)
        for _ in range(150):
            robot.see(*[rng.choice([0.3, 1.5, 5.0]) for _ in range(5)])
            tree.tick_exactly_once()
            robot.clock.sleep(rng.choice([0.0, 0.05, 0.1, 1.2, 8.0]))
    assert sorted(set(watch.faults)) == []
    # Every node has completed, or is endless.
    never = {id for id in IDS if not model_of(SHIPPED[id]).endless} - {
        id for id, result in watch.seen if result in ("SUCCESS", "FAILURE")
    }
    assert never == set()


# --- the simulator


@pytest.mark.parametrize("explores", [False, True], ids=["navigation", "exploration"])
def test_leaves_follow_their_models_in_the_simulator(explores: bool, tmp_path: Any) -> None:
    pytest.importorskip("pybullet")
    from btcore_navigation.mapping.exploration import Exploration
    from btcore_navigation.stack import Navigation
    from btcore_robot.control.head_tracker import HeadTracker
    from btcore_robot.perception.object_locator import ObjectLocator
    from btcore_sim.map_rasteriser import rasterise
    from btcore_sim.simulated_robot import SimulatedRobot
    from btcore_sim.world import World
    from btcore_sim.worlds import load_world_description

    description = load_world_description("arena")
    world = World(description, seed=1)
    robot = SimulatedRobot(world)
    random_numbers = np.random.default_rng(1)
    stack: Any
    if explores:
        stack = Exploration(robot, random_numbers, folder())
    else:
        stack = Navigation(robot, rasterise(description), random_numbers, folder())
    tracker, locator = HeadTracker(robot), ObjectLocator(robot, stack.servers.transforms)
    for server in (tracker, locator):
        server.configure()
    wheels: list[str] = []
    records(robot, "drive", wheels, lambda *given: f"drive {given}")
    records(stack, "go_to", wheels, lambda *given: "go_to")
    records(stack.servers, "send_goal", wheels, lambda goal, action, name="": action * (action in DRIVING))
    places = Waypoints({"recharge": Pose2D(0, 0, 0), "wp1": Pose2D(1, 1, 0)}, "here")
    resources = [robot, stack, stack.servers, tracker, locator, places, MapFile(tmp_path / "map.yaml")]
    ids = [id for id in IDS if explores or id not in ("Explore", "SaveMap")]
    rng = random.Random(2)
    watch = watch_of(rng, 0.9, 0.02)
    watch.used = wheels
    tree = tree_of(elements_of(ids), resources, world, watch)
    write_inputs(tree, ids, rng)
    try:
        for _ in range(60):
            tree.tick_exactly_once()
            world.wait_until(world.now() + 100_000_000, threading.Event())
    finally:
        for server in (tracker, locator):
            server.shutdown()
        world.close()
    assert sorted(set(watch.faults)) == []


def records(owner: Any, name: str, calls: list[str], text: Callable[..., str]) -> None:
    """Record the calls of a method whose text is not empty."""
    original = getattr(owner, name)

    def method(*given: Any, **options: Any) -> Any:
        what = text(*given)
        if what:
            calls.append(what)
        return original(*given, **options)

    setattr(owner, name, method)
