"""The schedule of a world: first calls, ends, and rates that meet."""

import pytest

from btcore_robot.robot import Phase
from btcore_sim.schedule import TaskSchedule

SECOND = 1_000_000_000


def run(schedule: TaskSchedule, until: int) -> None:
    while (due := schedule.next_due()) is not None and due <= until:
        schedule.run_next()


def test_the_first_call_comes_a_period_from_now():
    schedule = TaskSchedule(start=5 * SECOND)
    times: list[int] = []
    schedule.every(4, Phase.CONTROLLER, times.append)
    run(schedule, 6 * SECOND)
    assert times == [5 * SECOND + k * SECOND // 4 for k in (1, 2, 3, 4)]


def test_tasks_of_all_rates_meet_at_whole_seconds():
    schedule = TaskSchedule()
    done: list[tuple[str, int]] = []
    schedule.every(7, Phase.JUDGE, lambda now: done.append(("judge", now)))
    schedule.every(120, Phase.PHYSICS, lambda now: done.append(("physics", now)))
    schedule.every(3, Phase.LOCALISER, lambda now: done.append(("localiser", now)))
    run(schedule, SECOND)
    assert [name for name, now in done if now == SECOND] == ["physics", "localiser", "judge"]


def test_a_task_can_be_ended_even_by_itself():
    schedule = TaskSchedule()
    times: list[int] = []

    def task(now: int) -> None:
        times.append(now)
        if len(times) == 3:
            end()

    end = schedule.every(10, Phase.PLANNER, task)
    run(schedule, SECOND)
    end()
    assert times == [SECOND // 10, SECOND // 5, 3 * SECOND // 10]
    assert schedule.next_due() is None


def test_one_task_ends_and_the_others_go_on():
    schedule = TaskSchedule()
    times: list[int] = []
    end = schedule.every(10, Phase.PLANNER, times.append)
    schedule.every(5, Phase.PLANNER, times.append)
    end()
    run(schedule, SECOND)
    assert times == [k * SECOND // 5 for k in (1, 2, 3, 4, 5)]


def test_a_task_begun_by_a_task_is_not_late():
    schedule = TaskSchedule()
    times: list[int] = []
    end = schedule.every(
        1, Phase.HEAD, lambda now: end() or schedule.every(2, Phase.HEAD, times.append, first=0)
    )
    run(schedule, 2 * SECOND)
    assert times == [SECOND, 3 * SECOND // 2, 2 * SECOND]


def test_a_rate_of_nothing_is_refused():
    with pytest.raises(ValueError, match="a frequency is above 0"):
        TaskSchedule().every(0.0, Phase.HEAD, print)
