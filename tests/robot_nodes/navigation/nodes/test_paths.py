"""Nav2's nodes for paths and goals: a test for each sentence of their documentation."""

import math

import numpy as np
import pytest

from btcore import Status, Tree
from btcore_navigation.navigate_goal import WaypointState, WaypointStatus
from btcore_robot.robot import Pose2D
from tests.robot_nodes.navigation.conftest import polyline_path, rig_on_floor
from tests.robot_nodes.navigation.nodes.conftest import NodeRig

BOX = (1.8, -0.2, 2.2, 0.2)  # m, on the line y = 0


def at(x: float, y: float = 0.0, yaw: float = 0.0) -> Pose2D:
    return Pose2D(x, y, yaw)


@pytest.fixture
def boxed() -> NodeRig:
    """A rig whose global costmap contains a box on the floor."""
    rig = NodeRig(rig_on_floor(BOX))
    rig.wait(0.2)
    scan = rig.robot.scan()
    place = rig.servers.transforms.lookup("map", scan.frame).to_pose()
    rig.costmap.observe(scan, place)
    rig.costmap.update(rig.robot.clock.now(), rig.servers.pose())
    return rig


def test_truncate_path_ends_1_m_before_goal_and_faces_it(rig: NodeRig) -> None:
    tree = rig.tree(
        '<TruncatePath input_path="{path}" output_path="{cut}"/>', path=polyline_path((0, 0), (0, 3), yaw=2)
    )
    assert rig.letters(tree, 1) == "S"
    cut = tree.blackboard["cut"]
    assert cut.goal.y == pytest.approx(2.0, abs=0.051)
    assert cut.goal.y <= 2.0 + 1e-9
    assert cut.goal.yaw == pytest.approx(math.pi / 2)
    assert cut[0] == at(0.0, 0.0, math.pi / 2)


def test_truncate_path_measures_straight_distance_to_goal(rig: NodeRig) -> None:
    there_and_back = polyline_path((0, 0), (3, 0), (3, 0.3), (2.2, 0.3))
    tree = rig.tree(
        '<TruncatePath distance="0.5" input_path="{path}" output_path="{cut}"/>', path=there_and_back
    )
    rig.letters(tree, 1)
    cut = tree.blackboard["cut"].goal
    assert (cut.x, cut.y) == (pytest.approx(2.7, abs=0.051), pytest.approx(0.3))


def test_truncate_path_keeps_two_poses_of_a_short_path(rig: NodeRig) -> None:
    tree = rig.tree(
        '<TruncatePath input_path="{path}" output_path="{cut}"/>', path=polyline_path((0, 0), (0.5, 0))
    )
    assert rig.letters(tree, 1) == "S"
    assert len(tree.blackboard["cut"]) == 2


def test_truncate_path_accepts_an_empty_path(rig: NodeRig) -> None:
    tree = rig.tree('<TruncatePath input_path="{path}" output_path="{cut}"/>')
    assert rig.letters(tree, 1) == "S"
    assert len(tree.blackboard["cut"]) == 0


LOCAL = '<TruncatePathLocal input_path="{path}" output_path="{cut}" %s/>'


def span(tree: Tree) -> tuple[float, float]:
    points = tree.blackboard["cut"].points
    return round(float(points[0, 0]), 2), round(float(points[-1, 0]), 2)


def test_truncate_path_local_keeps_8_m_ahead_and_4_back(rig: NodeRig) -> None:
    tree = rig.tree(LOCAL % "", path=polyline_path((-10, 0), (20, 0)))
    assert rig.letters(tree, 1) == "S"
    assert span(tree) == (-4.0, 8.0)


@pytest.mark.parametrize(
    ("ports", "kept"),
    [
        ('distance_forward="1" distance_backward="0"', (0.0, 1.0)),
        ('distance_forward="-1" distance_backward="0.5"', (-0.5, 20.0)),
    ],
)
def test_truncate_path_local_keeps_the_given_distances(
    rig: NodeRig, ports: str, kept: tuple[float, float]
) -> None:
    tree = rig.tree(LOCAL % ports, path=polyline_path((-10, 0), (20, 0)))
    rig.letters(tree, 1)
    assert span(tree) == kept


def test_truncate_path_local_uses_a_given_pose(rig: NodeRig) -> None:
    tree = rig.tree(LOCAL % 'pose="3;0;0" distance_backward="0"', path=polyline_path((-10, 0), (20, 0)))
    rig.localiser.is_confident = False
    assert rig.letters(tree, 1) == "S"
    assert span(tree) == (3.0, 11.0)


def test_truncate_path_local_fails_when_pose_is_unknown(rig: NodeRig) -> None:
    tree = rig.tree(LOCAL % "", path=polyline_path((-10, 0), (20, 0)))
    rig.localiser.is_confident = False
    assert rig.letters(tree, 1) == "F"


def test_truncate_path_local_accepts_an_empty_path(rig: NodeRig) -> None:
    tree = rig.tree(LOCAL % "")
    assert rig.letters(tree, 1) == "S"
    assert len(tree.blackboard["cut"]) == 0


def test_truncate_path_local_separates_legs_by_heading(rig: NodeRig) -> None:
    there_and_back = polyline_path((-3, 0), (3, 0), (3, 0.04), (-3, 0.04))
    ports = 'distance_forward="1" distance_backward="0" angular_distance_weight="%s"'
    rig.move(0.0, 0.0, math.pi)
    plain = rig.tree(LOCAL % (ports % 0), path=there_and_back)
    rig.letters(plain, 1)
    assert span(plain) == (0.0, 1.0)
    turned = rig.tree(LOCAL % (ports % 0.2), path=there_and_back)
    rig.letters(turned, 1)
    assert span(turned)[1] == pytest.approx(-1.0, abs=0.051)


def test_truncate_path_local_searches_only_given_distance(rig: NodeRig) -> None:
    loop = polyline_path((0, 0), (3, 0), (3, 2), (0, 2), (0, 0.02))
    ports = 'distance_forward="0.5" distance_backward="0" max_robot_pose_search_dist="1"'
    tree = rig.tree(LOCAL % ports, path=loop)
    rig.move(0.0, 0.1)
    rig.letters(tree, 1)
    assert span(tree) == (0.0, 0.5)


@pytest.mark.parametrize(("y", "letter"), [(0.0, "F"), (0.45, "F"), (1.0, "S")])
def test_validate_path_uses_the_obstacles_of_the_global_costmap(
    boxed: NodeRig, y: float, letter: str
) -> None:
    tree = boxed.tree(
        '<ValidatePath path="{path}" collision_poses="{bad}"/>', path=polyline_path((0, y), (4, y))
    )
    assert boxed.letters(tree, 1) == letter
    assert bool(tree.blackboard["bad"]) is (letter == "F")


def test_validate_path_reports_first_collision_or_all(boxed: NodeRig) -> None:
    text = '<ValidatePath path="{path}" collision_poses="{bad}" stop_at_first_collision="%s"/>'
    first_only = boxed.tree(text % "true", path=polyline_path((0, 0), (4, 0)))
    all_poses = boxed.tree(text % "false", path=polyline_path((0, 0), (4, 0)))
    boxed.letters(first_only, 1)
    boxed.letters(all_poses, 1)
    assert first_only.blackboard["bad"] == all_poses.blackboard["bad"][:1]
    assert first_only.blackboard["bad"][0].x == pytest.approx(1.5, abs=0.15)
    assert len(all_poses.blackboard["bad"]) > 5


def test_validate_path_checks_only_ahead_of_the_robot(boxed: NodeRig) -> None:
    tree = boxed.tree('<ValidatePath path="{path}"/>', path=polyline_path((0, 0), (4, 0)))
    boxed.robot.boxes.clear()
    boxed.move(3.0)
    assert boxed.letters(tree, 1) == "S"


def test_validate_path_checks_only_the_given_distance(boxed: NodeRig) -> None:
    tree = boxed.tree(
        '<ValidatePath path="{path}" max_lookahead_distance="1"/>', path=polyline_path((0, 0), (4, 0))
    )
    assert boxed.letters(tree, 1) == "S"


def test_validate_path_takes_unknown_cells_as_free(rig: NodeRig) -> None:
    text = '<ValidatePath path="{path}" consider_unknown_as_obstacle="%s"/>'
    unknown = polyline_path((4.2, 4.2), (4.3, 4.2))
    assert rig.letters(rig.tree(text % "false", path=unknown), 1) == "S"
    assert rig.letters(rig.tree(text % "true", path=unknown), 1) == "F"


def test_validate_path_compares_costs_with_maximum_cost(boxed: NodeRig) -> None:
    text = '<ValidatePath path="{path}" max_cost="%s"/>'
    beside = polyline_path((0, 0.6), (4, 0.6))
    assert boxed.letters(boxed.tree(text % 254, path=beside), 1) == "S"
    assert boxed.letters(boxed.tree(text % 50, path=beside), 1) == "F"


def test_validate_path_fails_without_a_path(rig: NodeRig) -> None:
    assert rig.letters(rig.tree('<ValidatePath path="{path}"/>'), 1) == "F"


@pytest.mark.parametrize(("y", "letter"), [(0.0, "F"), (1.0, "S")])
def test_is_path_valid_is_validate_path_as_a_condition(boxed: NodeRig, y: float, letter: str) -> None:
    tree = boxed.tree('<Condition ID="IsPathValid" path="{path}"/>', path=polyline_path((0, y), (4, y)))
    assert boxed.letters(tree, 1) == letter


def test_smooth_path_cuts_a_detour(rig: NodeRig) -> None:
    tree = rig.tree(
        '<SmoothPath unsmoothed_path="{path}" smoothed_path="{out}" was_completed="{done}"/>',
        path=polyline_path((0, 0), (1, 1), (2, 0)),
    )
    assert rig.run(tree, 1.0) is Status.SUCCESS
    assert tree.blackboard["done"] is True
    smooth = tree.blackboard["out"]
    assert smooth.length() == pytest.approx(2.0, abs=0.1)
    assert (smooth[0].x, smooth[0].y, smooth[-1].x, smooth[-1].y) == (0, 0, 2, 0)


@pytest.mark.parametrize(
    ("ports", "points", "code"),
    [
        ('smoother_id="other"', [(0, 0), (1, 0)], 501),
        ('check_for_collisions="true"', [(0, 0), (6, 0)], 503),
        ("", [(0, 0), (6, 0)], 0),
    ],
)
def test_smooth_path_through_obstacles_and_with_an_unknown_smoother(
    rig: NodeRig, ports: str, points: list[tuple[float, float]], code: int
) -> None:
    text = '<SmoothPath unsmoothed_path="{path}" was_completed="{done}" error_code_id="{code}" '
    tree = rig.tree(f"{text}{ports}/>", path=polyline_path(*points))
    assert rig.run(tree, 1.0) is (Status.FAILURE if code else Status.SUCCESS)
    assert tree.blackboard["code"] == code
    assert code or tree.blackboard["done"] is False


def test_smooth_path_sets_the_error_code_without_a_path(rig: NodeRig) -> None:
    tree = rig.tree('<SmoothPath unsmoothed_path="{path}" error_code_id="{code}"/>')
    assert rig.letters(tree, 1) == "F"
    assert tree.blackboard["code"] == 505


GOALS = [at(0.3), at(0.6), at(2.0)]


@pytest.mark.parametrize(
    ("radius", "left"), [(0.2, GOALS), (0.5, GOALS[1:]), (0.7, GOALS[2:]), (9.0, GOALS[2:])]
)
def test_remove_passed_goals_keeps_the_last_goal(rig: NodeRig, radius: float, left: list[Pose2D]) -> None:
    text = f'<RemovePassedGoals radius="{radius}" input_goals="{{goals}}" output_goals="{{goals}}"/>'
    tree = rig.tree(text, goals=list(GOALS))
    assert rig.letters(tree, 1) == "S"
    assert tree.blackboard["goals"] == left


def test_remove_passed_goals_stops_at_the_first_goal_that_is_not_passed(rig: NodeRig) -> None:
    goals = [at(0.3), at(2.0), at(0.2), at(3.0)]
    tree = rig.tree('<RemovePassedGoals input_goals="{goals}" output_goals="{goals}"/>', goals=goals)
    rig.letters(tree, 1)
    assert tree.blackboard["goals"] == goals[1:]


def test_remove_passed_goals_fails_when_the_pose_is_unknown(rig: NodeRig) -> None:
    tree = rig.tree('<RemovePassedGoals input_goals="{goals}" output_goals="{goals}"/>', goals=list(GOALS))
    rig.localiser.is_confident = False
    assert rig.letters(tree, 1) == "F"


STATUSES = 'input_waypoint_statuses="{how}" output_waypoint_statuses="{how}"'


def test_remove_passed_goals_marks_them_completed(rig: NodeRig) -> None:
    tree = rig.tree(
        f'<RemovePassedGoals {STATUSES} input_goals="{{goals}}" output_goals="{{goals}}"/>',
        goals=list(GOALS),
        how=[WaypointStatus(goal, index) for index, goal in enumerate(GOALS)],
    )
    rig.letters(tree, 1)
    states = [waypoint.state for waypoint in tree.blackboard["how"]]
    assert states == [WaypointState.COMPLETED, WaypointState.PENDING, WaypointState.PENDING]


def test_remove_in_collision_goals_marks_them_skipped(boxed: NodeRig) -> None:
    goals = [at(2.0), at(0.0, 2.0), at(1.5), at(4.3, 4.3)]
    tree = boxed.tree(
        f'<RemoveInCollisionGoals {STATUSES} input_goals="{{goals}}" output_goals="{{left}}"/>',
        goals=goals,
        how=[WaypointStatus(goal, index) for index, goal in enumerate(goals)],
    )
    assert boxed.letters(tree, 1) == "S"
    assert tree.blackboard["left"] == [goals[1], goals[3]]
    assert [waypoint.state.name for waypoint in tree.blackboard["how"]] == ["SKIPPED", "PENDING"] * 2


@pytest.mark.parametrize(
    ("place", "ports", "letter"),
    [
        ("1.8;0", "", "S"),
        ("1.55;0", "", "S"),
        ("1.55;0", 'use_footprint="false"', "F"),
        ("0;2", "", "F"),
        ("4.3;4.3", "", "F"),
        ("4.3;4.3", 'consider_unknown_as_obstacle="true"', "S"),
    ],
)
def test_check_pose_occupancy_finds_occupied_pose(
    boxed: NodeRig, place: str, ports: str, letter: str
) -> None:
    assert boxed.letters(boxed.tree(f'<CheckPoseOccupancy pose="{place}" {ports}/>'), 1) == letter


@pytest.mark.parametrize(("index", "x"), [(0, 0.0), (2, 0.1), (-1, 1.0), (-21, 0.0)])
def test_get_pose_from_path_counts_from_either_end(rig: NodeRig, index: int, x: float) -> None:
    tree = rig.tree(
        f'<GetPoseFromPath path="{{path}}" index="{index}" pose="{{pose}}"/>',
        path=polyline_path((0, 0), (1, 0)),
    )
    assert rig.letters(tree, 1) == "S"
    assert tree.blackboard["pose"].x == pytest.approx(x)


@pytest.mark.parametrize("index", [21, -22])
def test_get_pose_from_path_fails_if_the_path_has_no_such_pose(rig: NodeRig, index: int) -> None:
    tree = rig.tree(
        f'<GetPoseFromPath path="{{path}}" index="{index}" pose="{{pose}}"/>',
        path=polyline_path((0, 0), (1, 0)),
    )
    assert rig.letters(tree, 1) == "F"
    assert rig.letters(rig.tree('<GetPoseFromPath path="{path}" pose="{pose}"/>'), 1) == "F"


def test_get_current_pose_fails_when_the_pose_is_unknown(rig: NodeRig) -> None:
    tree = rig.tree('<GetCurrentPose current_pose="{pose}"/>')
    rig.move(1.0, 2.0, 0.5)
    assert rig.letters(tree, 1) == "S"
    pose = tree.blackboard["pose"]
    assert (pose.x, pose.y, pose.yaw) == pytest.approx((1.0, 2.0, 0.5))
    rig.localiser.is_confident = False
    assert rig.letters(tree, 1) == "F"


def test_concatenate_paths_needs_a_path_that_is_not_empty(rig: NodeRig) -> None:
    text = '<ConcatenatePaths input_path1="{a}" input_path2="{b}" output_path="{both}"/>'
    tree = rig.tree(text, a=polyline_path((0, 0), (1, 0)), b=polyline_path((1, 0), (1, 1)))
    assert rig.letters(tree, 1) == "S"
    first, second, both = (tree.blackboard[key] for key in ("a", "b", "both"))
    # As in Nav2, the pose at which the paths meet stays in both parts.
    assert np.array_equal(both.poses, np.concatenate([first.poses, second.poses]))
    assert (both.stamp, both.frame) == (first.stamp, first.frame)
    assert both.length() == pytest.approx(2.0)
    alone = rig.tree(text, b=polyline_path((1, 0), (1, 1)))
    assert rig.letters(alone, 1) == "S"
    assert np.array_equal(alone.blackboard["both"].poses, alone.blackboard["b"].poses)
    assert rig.letters(rig.tree(text), 1) == "F"


def test_append_goal_pose_to_goals(rig: NodeRig) -> None:
    text = '<AppendGoalPoseToGoals goal_pose="{goal}" input_goals="{goals}" output_goals="{all}"/>'
    tree = rig.tree(text, goal=at(3.0), goals=list(GOALS))
    assert rig.letters(tree, 1) == "S"
    assert tree.blackboard["all"] == [*GOALS, at(3.0)]


@pytest.mark.parametrize(("count", "left"), [(2, GOALS[:2]), (5, GOALS)])
def test_get_next_few_goals(rig: NodeRig, count: int, left: list[Pose2D]) -> None:
    text = f'<GetNextFewGoals num_goals="{count}" input_goals="{{goals}}" output_goals="{{few}}"/>'
    tree = rig.tree(text, goals=list(GOALS))
    assert rig.letters(tree, 1) == "S"
    assert tree.blackboard["few"] == left
    assert rig.letters(rig.tree(text, goals=[]), 1) == "F"
