"""The leaves of the book's patrol: the book's tests (chapter 6.3), and its tree."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from tests.robot_nodes.conftest import RecordingRobot

pytest.importorskip("pybullet")

import btcore
from btcore import Registry, Status, Tree
from btcore_navigation.action import ActionServer, GoalHandle
from btcore_robot.components.lifecycle import LifecycleState
from btcore_robot.control.head_tracker import HeadTracker
from btcore_robot.leaves.waypoint import WaypointError
from btcore_robot.perception.object_locator import ObjectLocator
from btcore_robot.robot import HeadInfo, HeadPosition, Phase, Pose2D, Waypoints
from btcore_robot.transforms import TransformTree
from btcore_sim.worlds import load_world_description

TREES = Path(__file__).parents[3] / "trees"
SECOND = 10**9

HOUSE = load_world_description("house").waypoint_poses()
RECHARGE, WP1, WP2, WP3 = (HOUSE.places[name] for name in ("recharge", "wp1", "wp2", "wp3"))


def tree_of(body: str, *resources: object) -> Tree:
    nodes = Registry.standard()
    nodes.add_plugin("btcore_robot.leaves")
    nodes.add_plugin("btcore_navigation.leaves")
    text = f'<root main_tree_to_execute="T"><BehaviorTree ID="T">{body}</BehaviorTree></root>'
    return btcore.loads(text, nodes=nodes, resources=[*resources, HOUSE])


def tick(
    tree: Tree, robot: RecordingRobot, seconds: float, *, after: Callable[..., Any] = lambda: None
) -> Status:
    """Tick at 10 Hz until the result is not RUNNING, or until the time is over."""
    status = Status.IDLE
    for _ in range(round(seconds * 10)):
        status = tree.tick_once()
        after()
        if status is not Status.RUNNING:
            break
        robot.clock.sleep(0.1)
    return status


class SlowServer(ActionServer[Pose2D, None, None]):
    """A navigator that reaches every goal in 5 s, like the book's test server."""

    def __init__(self, robot: RecordingRobot) -> None:
        super().__init__()
        self.goals: list[Pose2D] = []
        self.handles: list[GoalHandle[Pose2D, None, None]] = []
        self.began = 0
        robot.schedule.add_task(10.0, Phase.CONTROLLER, self.step)

    def go_to(self, goal: Pose2D) -> GoalHandle[Pose2D, None, None]:
        self.goals.append(goal)
        self.handles.append(self.send_goal(goal))
        return self.handles[-1]

    def start(self, handle: GoalHandle, now: int, previous: object) -> None:
        self.began = now

    def work(self, handle: GoalHandle, now: int) -> None:
        if handle.goal.x > 900.0:
            handle.abort(208, "there is no way to it")
        elif now - self.began >= 5 * SECOND:
            handle.succeed()


@pytest.fixture
def server(robot: RecordingRobot) -> SlowServer:
    return SlowServer(robot)


@pytest.fixture
def tracker(robot: RecordingRobot) -> HeadTracker:
    robot.head_limits = HeadInfo(-1.3, 1.3, -1.0, 0.7, 3.0)
    robot.head_position = HeadPosition(0.0, 0.0, 0)
    return HeadTracker(robot)


# --- recharge_btn, patrol_btn


def test_recharge_btn(robot: RecordingRobot) -> None:
    tree = tree_of('<Action ID="Recharge"/>', robot)
    tree.blackboard["battery_level"] = 3.0
    assert tick(tree, robot, 60.0) is Status.SUCCESS
    assert tree.ticks == 51
    assert tree.blackboard["battery_level"] == pytest.approx(100.0, abs=1e-7)
    assert robot.recharges == 1


def test_recharge_continues_after_a_halt(robot: RecordingRobot) -> None:
    tree = tree_of('<Action ID="Recharge"/>', robot)
    tick(tree, robot, 3.0)
    tree.halt()
    assert tick(tree, robot, 60.0) is Status.SUCCESS
    assert tree.ticks == 51


def test_patrol_btn(robot: RecordingRobot) -> None:
    tree = tree_of('<Action ID="Patrol"/>', robot)
    assert tick(tree, robot, 60.0) is Status.SUCCESS
    assert len(robot.commands) == pytest.approx(150, abs=2)
    v, w = robot.commands[0]
    assert w > 0.1
    assert v == pytest.approx(0.0, abs=1e-7)


# --- move_btn


def test_move_btn(robot: RecordingRobot, server: SlowServer) -> None:
    tree = tree_of('<Action ID="Move" goal="1;2"/>', robot, server)
    assert tick(tree, robot, 20.0) is Status.SUCCESS
    assert robot.clock.now() / SECOND == pytest.approx(5.0, abs=0.3)
    assert server.goals == [Pose2D(1.0, 2.0, 0.0)]


def test_move_cancels_its_goal_when_it_is_halted(robot: RecordingRobot, server: SlowServer) -> None:
    tree = tree_of('<Action ID="Move" goal="1;2"/>', robot, server)
    tick(tree, robot, 1.0)
    tree.halt()
    robot.clock.sleep(0.2)
    assert server.handles[0].status.name == "CANCELED"


def test_move_fails_with_the_error_of_the_navigation(
    robot: RecordingRobot, server: SlowServer, caplog: pytest.LogCaptureFixture
) -> None:
    tree = tree_of('<Action ID="Move" goal="999;0" error_code="{code}" error="{why}"/>', robot, server)
    assert tick(tree, robot, 20.0) is Status.FAILURE
    assert (tree.blackboard["code"], tree.blackboard["why"]) == (208, "there is no way to it")
    assert "can't go to (999.00, 0.00): there is no way to it" in caplog.text


def test_move_succeeds_when_another_client_cancels_goal(robot: RecordingRobot, server: SlowServer) -> None:
    tree = tree_of('<Action ID="Move" goal="1;2"/>', robot, server)
    tick(tree, robot, 1.0)
    server.handles[0].cancel()
    assert tick(tree, robot, 1.0) is Status.SUCCESS


def test_move_fails_when_the_server_accepts_no_goal_for_a_second(robot: RecordingRobot) -> None:
    class SilentServer:
        def go_to(self, goal: Pose2D) -> GoalHandle[Pose2D, None, None]:
            return GoalHandle(goal)

    tree = tree_of('<Action ID="Move" goal="1;2"/>', robot, SilentServer())
    assert tick(tree, robot, 20.0) is Status.FAILURE
    assert robot.clock.now() == pytest.approx(1.1 * SECOND)


# --- get_waypoint_btn


def entries(tree: Tree, names: Sequence[str]) -> list[Pose2D]:
    return [tree.blackboard[name] for name in names]


def test_get_waypoint_btn_recharge(robot: RecordingRobot) -> None:
    tree = tree_of('<Action ID="GetWaypoint" wp_id="recharge" waypoint="{wp}"/>')
    assert tree.tick_once() is Status.SUCCESS
    place = tree.blackboard["wp"]
    assert (place.x, place.y) == pytest.approx((3.67, -0.24), abs=1e-7)


def test_a_missing_waypoint_is_an_error_when_the_tree_is_created() -> None:
    nodes = Registry.standard()
    nodes.add_plugin("btcore_robot.leaves")
    body = '<GetWaypoint wp_id="{}" waypoint="{{wp}}"/>'
    text = f'<root BTCPP_format="4"><BehaviorTree ID="T">{body}</BehaviorTree></root>'
    places = Waypoints({"wp1": WP1}, source="the map", remedy="add '{name}' to the file")
    assert btcore.loads(text.format("{kind}"), nodes=nodes, resources=[places])
    message = "the map has no waypoint 'recharge', but GetWaypoint::1 needs it; add 'recharge' to the file"
    with pytest.raises(WaypointError, match=message):
        btcore.loads(text.format("recharge"), nodes=nodes, resources=[places])
    with pytest.raises(WaypointError, match=r"this world has no waypoints, but GetWaypoint::1 needs them$"):
        btcore.loads(text.format("next"), nodes=nodes, resources=[Waypoints({})])


SEQUENCE = (
    "<Sequence>"
    + "".join(
        f'<Action ID="GetWaypoint" {"" if wp_id is None else f"wp_id={wp_id!r}"} waypoint="{{p{number}}}"/>'
        for number, wp_id in enumerate(("next", "next", "", "recharge", "wp1", "wp2", None))
    )
    + "</Sequence>"
)


def test_get_waypoint_btn_only_recharge_is_chosen_by_name(robot: RecordingRobot) -> None:
    tree = tree_of(SEQUENCE)
    assert tree.tick_once() is Status.SUCCESS
    assert entries(tree, [f"p{number}" for number in range(7)]) == [WP1, WP2, WP3, RECHARGE, WP1, WP2, WP3]


def test_get_waypoint_counts_separately_in_each_tree() -> None:
    for _ in range(2):
        tree = tree_of('<Action ID="GetWaypoint" wp_id="next" waypoint="{wp}"/>')
        tree.tick_once()
        assert tree.blackboard["wp"] == WP1


def test_the_waypoints_of_the_house_are_the_books() -> None:
    places = {name: (place.x, place.y, place.yaw) for name, place in HOUSE.places.items() if name != "start"}
    assert places == {
        "recharge": (3.67, -0.24, 0.0),
        "wp1": (1.07, -12.38, 0.0),
        "wp2": (-5.32, -8.85, 0.0),
        "wp3": (-0.56, 0.24, 0.0),
    }


# --- battery_checker_btn


def test_battery_checker_btn(robot: RecordingRobot) -> None:
    body = '<ReactiveSequence><Condition ID="BatteryChecker"/><Action ID="Patrol"/></ReactiveSequence>'
    tree = tree_of(body, robot)
    status = tick(tree, robot, 60.0, after=lambda: robot.drive(0.8, 0.0))
    assert status is Status.SUCCESS
    assert tree.blackboard["battery_level"] == pytest.approx(94.6, abs=1.0)


@pytest.mark.parametrize(("ports", "threshold"), [("", 10.0), ('low="20"', 20.0)])
def test_battery_checker_fails_below_threshold(robot: RecordingRobot, ports: str, threshold: float) -> None:
    tree = tree_of(f'<Condition ID="BatteryChecker" {ports}/>', robot)
    tree.blackboard["battery_level"] = threshold
    assert tree.tick_once() is Status.SUCCESS
    tree.blackboard["battery_level"] = threshold - 0.001
    assert tree.tick_once() is Status.FAILURE


@pytest.mark.parametrize(("v", "w", "a_second"), [(0.0, 0.0, 0.01), (0.3, 0.0, 0.16), (0.3, 0.4, 0.26)])
def test_battery_drains_by_velocity(robot: RecordingRobot, v: float, w: float, a_second: float) -> None:
    tree = tree_of('<Condition ID="BatteryChecker"/>', robot)
    tree.tick_once()
    robot.drive(v, w)
    robot.clock.sleep(10.0)
    tree.tick_once()
    assert tree.blackboard["battery_level"] == pytest.approx(100.0 - 10 * a_second)


def test_battery_quirk_a_gap_is_charged_at_the_velocity_after_it(robot: RecordingRobot) -> None:
    tree = tree_of('<Condition ID="BatteryChecker"/>', robot)
    tree.tick_once()
    robot.clock.sleep(100.0)  # the leaf was not ticked, and the robot stood
    robot.drive(0.3, 0.0)
    tree.tick_once()
    assert tree.blackboard["battery_level"] == pytest.approx(84.0)


def test_battery_is_never_below_zero(robot: RecordingRobot) -> None:
    tree = tree_of('<Condition ID="BatteryChecker"/>', robot)
    robot.clock.sleep(1e5)
    tree.tick_once()
    assert tree.blackboard["battery_level"] == 0.0


# --- track_objects_btn


def test_track_objects_btn_1_an_unconfigured_tracker_is_not_activated(
    robot: RecordingRobot, tracker: HeadTracker
) -> None:
    assert not tracker.activate()
    tree = tree_of('<Action ID="TrackObjects"/>', tracker)
    assert tree.tick_once() is Status.RUNNING
    assert tracker.state is LifecycleState.UNCONFIGURED


def test_track_objects_btn_2_a_tick_activates_and_a_halt_deactivates(
    robot: RecordingRobot, tracker: HeadTracker
) -> None:
    tracker.configure()
    tree = tree_of('<Action ID="TrackObjects"/>', tracker)
    assert tree.tick_once() is Status.RUNNING
    assert tracker.state is LifecycleState.ACTIVE
    tree.halt()
    assert tracker.state is LifecycleState.INACTIVE


def test_track_objects_uses_the_tracker_beside_a_locator(robot: RecordingRobot, tracker: HeadTracker) -> None:
    tracker.configure()
    locator = ObjectLocator(robot, TransformTree())
    tree_of('<Action ID="TrackObjects"/>', locator, tracker).tick_once()
    assert tracker.state is LifecycleState.ACTIVE


def test_track_objects_btn_3_end_of_tree_deactivates(robot: RecordingRobot, tracker: HeadTracker) -> None:
    tracker.configure()
    tree = tree_of('<Action ID="TrackObjects"/>', tracker)
    for _ in range(10):
        assert tree.tick_once() is Status.RUNNING
        robot.clock.sleep(0.1)
    assert tracker.state is LifecycleState.ACTIVE
    tree.halt()
    del tree
    assert tracker.state is LifecycleState.INACTIVE


# --- move_track_btn


def test_move_track_btn(robot: RecordingRobot, server: SlowServer, tracker: HeadTracker) -> None:
    tracker.configure()
    body = (
        '<Parallel success_threshold="1" failure_threshold="1">'
        '<Action ID="TrackObjects"/><Action ID="Move" goal="1;2"/></Parallel>'
    )
    tree = tree_of(body, robot, server, tracker)
    assert tick(tree, robot, 1.0) is Status.RUNNING
    assert tracker.state is LifecycleState.ACTIVE
    assert tick(tree, robot, 20.0) is Status.SUCCESS
    assert tracker.state is LifecycleState.INACTIVE


# --- the whole tree


@pytest.mark.parametrize("name", ["patrolling", "patrolling_book"])
def test_the_tree_patrols_and_recharges(
    robot: RecordingRobot, server: SlowServer, tracker: HeadTracker, name: str
) -> None:
    """A waypoint costs 5 s and a patrol 15 s: 3.9 % of the battery, and 20 % or 10 % are kept."""
    nodes = Registry.standard()
    nodes.add_plugin("btcore_robot.leaves")
    nodes.add_plugin("btcore_navigation.leaves")
    tracker.configure()
    tree = btcore.load(TREES / f"{name}.xml", nodes=nodes, resources=[robot, server, tracker, HOUSE])
    states: dict[Pose2D, set[LifecycleState]] = {}
    while len(server.goals) < 40 and robot.clock.now() < 2000 * SECOND:
        assert tree.tick_once() is Status.RUNNING
        if server.is_busy:
            states.setdefault(server.goals[-1], set()).add(tracker.state)
        if robot.commands and robot.commands[-1] == (0.0, 0.5) and not server.is_busy:
            assert tracker.state is LifecycleState.INACTIVE
        robot.clock.sleep(0.1)
    assert len(server.goals) == 40
    assert robot.recharges >= 1
    assert server.goals[:3] == [WP1, WP2, WP3]
    # The waypoint that the low battery interrupted is skipped: the next waypoint follows the charger.
    stop = server.goals.index(RECHARGE)
    following = [WP1, WP2, WP3]
    before = following.index(server.goals[stop - 1])
    assert server.goals[stop + 1] == following[(before + 1) % 3]
    assert states[RECHARGE] == {LifecycleState.INACTIVE}
    assert LifecycleState.ACTIVE in states[WP1]


@pytest.mark.parametrize(
    ("unreachable", "level", "goals", "result"),
    [
        # The second round skips wp2 again: a waypoint that was reached resets the count.
        (("wp2",), 100.0, ["wp1", "wp2", "wp3", "wp1", "wp2", "wp3"], Status.RUNNING),
        (("wp1", "wp2", "wp3"), 100.0, ["wp1", "wp2", "wp3"], Status.FAILURE),
        (("recharge",), 15.0, ["recharge", "recharge"], Status.FAILURE),
    ],
    ids=["one_waypoint", "all_waypoints", "charger"],
)
def test_the_skipping_tree_skips_a_waypoint_and_ends_when_it_can_reach_nothing(
    robot: RecordingRobot,
    server: SlowServer,
    tracker: HeadTracker,
    unreachable: Sequence[str],
    level: float,
    goals: list[str],
    result: Status,
) -> None:
    places = dict(HOUSE.places)
    for number, name in enumerate(unreachable):
        places[name] = Pose2D(1000.0 + number, 0.0, 0.0)
    nodes = Registry.standard()
    nodes.add_plugin("btcore_robot.leaves")
    nodes.add_plugin("btcore_navigation.leaves")
    tracker.configure()
    tree = btcore.load(
        TREES / "patrolling_skipping.xml", nodes=nodes, resources=[robot, server, tracker, Waypoints(places)]
    )
    tree.blackboard["battery_level"] = level
    assert tick(tree, robot, 120.0) is result
    names = {pose: name for name, pose in places.items()}
    visited = [names[goal] for goal in server.goals]
    assert visited[: len(goals)] == goals
    assert result is Status.RUNNING or len(visited) == len(goals)
