"""Nav2's decorators: a test for each sentence of their documentation."""

from pathlib import Path

import pytest

from btcore import NodeExecutionError, Status
from btcore_navigation.error_codes import Nav2ErrorCode
from btcore_navigation.navigator import (
    MAX_STALL_S,
    MIN_PROGRESS_SPEED,
    NavigateGoal,
    Navigator,
    navigation_nodes,
)
from btcore_navigation.path import NavPath
from btcore_robot.robot import Phase, Pose2D
from tests.robot_nodes.navigation.conftest import polyline_path
from tests.robot_nodes.navigation.nodes.conftest import NodeRig, act

HERE, THERE = Pose2D(1.0, 0.0, 0.0), Pose2D(2.0, 0.0, 0.0)


def take_starts(rig: NodeRig) -> int:
    """Return how often the leaf was started since the last call."""
    return rig.calls.take().count("a:start")


def test_rate_controller_ticks_child_first_and_at_rate(rig: NodeRig) -> None:
    tree = rig.tree(f'<RateController hz="2">{act("a", "S")}</RateController>')
    assert rig.letters(tree, 11, every=0.1) == "SRRRRSRRRRS"
    assert take_starts(rig) == 3


def test_rate_controller_ticks_its_child_ten_times_a_second_by_default(rig: NodeRig) -> None:
    tree = rig.tree(f"<RateController>{act('a', 'S')}</RateController>")
    assert rig.letters(tree, 5, every=0.05) == "SRSRS"


def test_rate_controller_ticks_running_child_each_tick(rig: NodeRig) -> None:
    tree = rig.tree(f'<RateController hz="1">{act("a", "RRS")}</RateController>')
    assert rig.letters(tree, 4, every=0.1) == "RRSR"
    assert rig.calls.take() == ["a:start", "a:running", "a:running"]


def test_rate_controller_counts_from_last_success(rig: NodeRig) -> None:
    tree = rig.tree(f'<RateController hz="1">{act("a", "RRRRRRS")}</RateController>')
    assert rig.letters(tree, 7, every=0.1) == "RRRRRRS"
    take_starts(rig)
    rig.letters(tree, 9, every=0.1)
    assert take_starts(rig) == 0
    rig.letters(tree, 1)
    assert take_starts(rig) == 1


def test_rate_controller_does_not_count_from_a_failure(rig: NodeRig) -> None:
    tree = rig.tree(f'<RateController hz="1">{act("a", "RF")}</RateController>')
    assert rig.letters(tree, 2, every=0.9) == "RF"
    assert rig.letters(tree, 1) == "R"
    assert take_starts(rig) == 2


def test_rate_controller_starts_again_after_a_halt(rig: NodeRig) -> None:
    tree = rig.tree(f'<RateController hz="0.1">{act("a", "S")}</RateController>')
    rig.letters(tree, 2)
    tree.halt()
    assert rig.letters(tree, 1) == "S"


def test_rate_controller_restarts_after_a_skip(rig: NodeRig) -> None:
    rated = f'<RateController hz="0.1" _skipIf="off">{act("a", "S")}</RateController>'
    tree = rig.tree(f"<Fallback>{rated}<AlwaysSuccess/></Fallback>", off=False)
    rig.letters(tree, 1)
    tree.blackboard["off"] = True
    rig.letters(tree, 1)
    tree.blackboard["off"] = False
    take_starts(rig)
    rig.letters(tree, 1)
    assert take_starts(rig) == 1


def test_distance_controller_ticks_child_per_distance(rig: NodeRig) -> None:
    tree = rig.tree(f'<DistanceController distance="0.5">{act("a", "S")}</DistanceController>')
    assert rig.letters(tree, 2) == "SR"
    rig.move(0.4)
    assert rig.letters(tree, 1) == "R"
    rig.move(0.4, 0.4)
    assert rig.letters(tree, 2) == "SR"
    rig.move(0.8, 0.4)
    assert rig.letters(tree, 1) == "R"


def test_distance_controller_ticks_child_per_metre(rig: NodeRig) -> None:
    tree = rig.tree(f"<DistanceController>{act('a', 'S')}</DistanceController>")
    assert rig.letters(tree, 1) == "S"
    rig.move(0.9)
    assert rig.letters(tree, 1) == "R"
    rig.move(1.1)
    assert rig.letters(tree, 1) == "S"


def test_distance_controller_ticks_a_running_child_in_every_tick(rig: NodeRig) -> None:
    tree = rig.tree(f"<DistanceController>{act('a', 'RRS')}</DistanceController>")
    assert rig.letters(tree, 4) == "RRSR"


def test_distance_controller_fails_with_unknown_pose(rig: NodeRig) -> None:
    tree = rig.tree(f"<DistanceController>{act('a', 'S')}</DistanceController>")
    rig.localiser.is_confident = False
    assert rig.letters(tree, 1) == "F"
    assert take_starts(rig) == 0
    rig.localiser.is_confident = True
    assert rig.letters(tree, 1) == "S"


SPEED = '<SpeedController min_rate="0.5" max_rate="2" max_speed="0.4">{}</SpeedController>'


def test_speed_controller_uses_the_shortest_period_first_and_then_the_speed(rig: NodeRig) -> None:
    tree = rig.tree(SPEED.format(act("a", "S")))
    # Standing: half a second to the second tick of the child, two seconds to the third.
    assert rig.letters(tree, 27, every=0.1) == "S" + "RRRRS" + "R" * 19 + "SR"


def test_speed_controller_uses_the_mean_speed(rig: NodeRig) -> None:
    tree = rig.tree(SPEED.format(act("a", "S")))
    found = ""
    for _ in range(40):
        rig.robot.drive(0.2, 0.0)
        found += rig.letters(tree, 1, every=0.1)
    # 0.2 of 0.4 m/s is in the middle of 0.5 and 2 Hz: 1.25 Hz, every 0.8 s.
    assert found.rstrip("R").endswith("SRRRRRRRS")


def test_speed_controller_restarts_for_another_goal(rig: NodeRig) -> None:
    tree = rig.tree(SPEED.format(act("a", "S")), goal=HERE)
    rig.letters(tree, 8, every=0.1)
    tree.blackboard["goal"] = THERE
    assert rig.letters(tree, 6, every=0.1) == "SRRRRS"


def test_speed_controller_returns_result_of_child(rig: NodeRig) -> None:
    assert rig.letters(rig.tree(SPEED.format(act("a", "RF"))), 2) == "RF"


def test_speed_controller_requires_rates_above_zero(rig: NodeRig) -> None:
    tree = rig.tree(f'<SpeedController min_rate="0">{act("a", "S")}</SpeedController>')
    with pytest.raises(NodeExecutionError, match="rates above 0"):
        tree.tick_exactly_once()


def test_goal_updated_controller_ticks_its_child_at_first_and_for_another_goal(rig: NodeRig) -> None:
    tree = rig.tree(f"<GoalUpdatedController>{act('a', 'S')}</GoalUpdatedController>", goal=HERE)
    assert rig.letters(tree, 2) == "SR"
    tree.blackboard["goal"] = THERE
    assert rig.letters(tree, 2) == "SR"
    tree.blackboard["goals"] = [HERE]
    assert rig.letters(tree, 2) == "SR"


def test_goal_updated_controller_reads_entry_of_port(rig: NodeRig) -> None:
    child = act("a", "S")
    tree = rig.tree(
        f'<GoalUpdatedController goal="{{mine}}">{child}</GoalUpdatedController>', goal=HERE, mine=HERE
    )
    rig.letters(tree, 1)
    tree.blackboard["goal"] = THERE
    assert rig.letters(tree, 1) == "R"
    tree.blackboard["mine"] = THERE
    assert rig.letters(tree, 1) == "S"


def test_goal_updated_controller_ticks_running_child(rig: NodeRig) -> None:
    tree = rig.tree(f"<GoalUpdatedController>{act('a', 'RRS')}</GoalUpdatedController>", goal=HERE)
    assert rig.letters(tree, 4) == "RRSR"


ENTRIES = 'input_goal="{goal}" output_goal="{to}" input_goals="{goals}" output_goals="{all}"'
UPDATER = f"<GoalUpdater {ENTRIES}>{{}}</GoalUpdater>"


def test_goal_updater_copies_its_inputs_to_its_outputs(rig: NodeRig) -> None:
    tree = rig.tree(UPDATER.replace("{}", act("a", "S")), goal=HERE, goals=[HERE, THERE])
    assert rig.letters(tree, 2) == "SS"
    assert tree.blackboard["to"] == HERE
    assert tree.blackboard["all"] == [HERE, THERE]


def test_goal_updater_prefers_the_goals_of_its_topics(rig: NodeRig) -> None:
    tree = rig.tree(UPDATER.replace("{}", act("a", "S")), goal=HERE, goals=[HERE])
    rig.servers.topics["goal_update"] = THERE
    rig.servers.topics["goals_update"] = [THERE]
    rig.letters(tree, 1)
    assert tree.blackboard["to"] == THERE
    assert tree.blackboard["all"] == [THERE]


def test_goal_updater_prefers_a_goal_that_is_newer_than_the_topics_goal(rig: NodeRig) -> None:
    tree = rig.tree(UPDATER.replace("{}", act("a", "S")), goal=HERE)
    rig.servers.topics["goal_update"] = THERE
    rig.letters(tree, 1)
    tree.blackboard["goal"] = newest = Pose2D(3.0, 0.0, 0.0)
    rig.letters(tree, 1)
    assert tree.blackboard["to"] == newest


def test_goal_updater_ticks_its_child_in_every_tick(rig: NodeRig) -> None:
    tree = rig.tree(f"<GoalUpdater>{act('a', 'RF')}</GoalUpdater>")
    assert rig.letters(tree, 2) == "RF"


def test_single_trigger_fails_after_child_ended_once(rig: NodeRig) -> None:
    tree = rig.tree(f"<SingleTrigger>{act('a', 'RS')}</SingleTrigger>")
    assert rig.letters(tree, 4) == "RSFF"
    assert rig.calls.take() == ["a:start", "a:running"]


def test_single_trigger_fails_after_failure_of_child(rig: NodeRig) -> None:
    assert rig.letters(rig.tree(f"<SingleTrigger>{act('a', 'F|S')}</SingleTrigger>"), 2) == "FF"


def test_single_trigger_is_ready_again_after_a_halt(rig: NodeRig) -> None:
    tree = rig.tree(f"<SingleTrigger>{act('a', 'S')}</SingleTrigger>")
    assert rig.letters(tree, 2) == "SF"
    tree.halt()
    assert rig.letters(tree, 1) == "S"


NEAR_END = '<PathLongerOnApproach path="{path}">{}</PathLongerOnApproach>'


def detour(length: float) -> NavPath:
    """Return a path of *length* (m) to the end of the straight path of 1 m."""
    return polyline_path((0, 0), (0.5, (length**2 - 1) ** 0.5 / 2), (1, 0))


def test_path_longer_on_approach_ticks_its_child_for_a_much_longer_path(rig: NodeRig) -> None:
    tree = rig.tree(NEAR_END.replace("{}", act("a", "RS")), path=polyline_path((0, 0), (1, 0)))
    assert rig.letters(tree, 2) == "SS"
    tree.blackboard["path"] = detour(3.0)
    assert rig.letters(tree, 3) == "RSS"
    assert rig.calls.take() == ["a:start", "a:running"]


def test_path_longer_on_approach_succeeds_for_less_than_twice_the_length(rig: NodeRig) -> None:
    tree = rig.tree(NEAR_END.replace("{}", act("a", "F")), path=polyline_path((0, 0), (1, 0)))
    rig.letters(tree, 1)
    tree.blackboard["path"] = detour(1.9)
    assert rig.letters(tree, 1) == "S"


def test_path_longer_on_approach_applies_only_to_the_last_three_metres(rig: NodeRig) -> None:
    tree = rig.tree(NEAR_END.replace("{}", act("a", "F")), path=polyline_path((-3, 0), (1, 0)))
    rig.letters(tree, 1)
    tree.blackboard["path"] = polyline_path((-3, 0), (-3, 4), (1, 4), (1, 0))
    assert rig.letters(tree, 1) == "S"


def test_path_longer_on_approach_does_not_compare_paths_to_different_goals(rig: NodeRig) -> None:
    tree = rig.tree(NEAR_END.replace("{}", act("a", "F")), path=polyline_path((0, 0), (1, 0)))
    rig.letters(tree, 1)
    tree.blackboard["path"] = polyline_path((0, 0), (4, 0))
    assert rig.letters(tree, 1) == "S"


def test_path_longer_on_approach_accepts_first_path(rig: NodeRig) -> None:
    tree = rig.tree(NEAR_END.replace("{}", act("a", "F")))
    assert tree.tick_exactly_once() is Status.SUCCESS


def test_path_longer_on_approach_halts_its_child_when_the_path_is_short_again(rig: NodeRig) -> None:
    tree = rig.tree(NEAR_END.replace("{}", act("a", "R")), path=polyline_path((0, 0), (1, 0)))
    rig.letters(tree, 1)
    tree.blackboard["path"] = detour(3.0)
    rig.letters(tree, 2)
    tree.blackboard["path"] = polyline_path((0, 0), (1, 0))
    assert rig.letters(tree, 1) == "S"
    assert rig.calls.take()[-1] == "a:halted"


@pytest.mark.parametrize(("tree", "ends"), [("{}", True), (UPDATER, False)], ids=["fixed", "updated"])
def test_the_navigator_expects_no_progress_towards_a_goal_that_may_move(
    rig: NodeRig, tmp_path: Path, tree: str, ends: bool
) -> None:
    plan = '<ComputePathToPose goal="{goal}" path="{path}"/><Sleep msec="1000000"/>'
    inside = tree.replace("{}", f"<Sequence>{plan}</Sequence>")
    file = tmp_path / "tree.xml"
    file.write_text(f'<root BTCPP_format="4"><BehaviorTree ID="T">{inside}</BehaviorTree></root>', "utf-8")
    navigator = Navigator(
        rig.servers, file, navigation_nodes(()), clock=rig.robot.clock, resources=[rig.robot]
    )
    rig.robot.schedule.add_task(2.0, Phase.PLANNER, navigator.step)
    handle = navigator.send_goal(NavigateGoal((THERE,)))
    rig.wait(MAX_STALL_S + 2.0 * THERE.x / MIN_PROGRESS_SPEED)
    assert handle.done == ends
    if ends:
        assert handle.result.code == Nav2ErrorCode.FAILED_TO_MAKE_PROGRESS
