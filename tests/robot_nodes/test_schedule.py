"""The clocks and schedules of robots without a world: the order of tasks, and late tasks."""

import threading
import time
from itertools import pairwise

import pytest

from btcore_robot.robot import Phase, RobotClock, Schedule
from btcore_robot.schedule import RealTimeSchedule, SimulatedSchedule

SECOND = 10**9
NEVER = threading.Event()


@pytest.mark.parametrize("kind", [RealTimeSchedule, SimulatedSchedule])
def test_each_class_is_a_clock_and_a_schedule(kind: type) -> None:
    clock: RobotClock = kind()
    schedule: Schedule = clock
    calls: list[int] = []
    schedule.add_task(1000.0, Phase.COMPONENTS, calls.append)
    start = clock.now()
    assert clock.wait_until(start + SECOND // 50, NEVER) is False
    assert clock.now() >= start + SECOND // 50
    assert calls == sorted(calls)
    assert calls


@pytest.mark.parametrize("kind", [RealTimeSchedule, SimulatedSchedule])
def test_a_wait_ends_when_it_is_woken(kind: type) -> None:
    schedule = kind()
    wake = threading.Event()
    schedule.add_task(1000.0, Phase.COMPONENTS, lambda now: wake.set())
    start = time.monotonic()
    assert schedule.wait_until(schedule.now() + 60 * SECOND, wake) is True
    assert time.monotonic() - start < 30.0


@pytest.mark.parametrize("kind", [RealTimeSchedule, SimulatedSchedule])
def test_a_frequency_of_zero_is_refused(kind: type) -> None:
    with pytest.raises(ValueError, match="the rate of a task must be above 0 Hz"):
        kind().add_task(0.0, Phase.HEAD, print)


def test_in_simulated_time_simultaneous_tasks_run_by_rank_and_then_by_order() -> None:
    schedule = SimulatedSchedule()
    calls: list[str] = []
    for name, rank in (("b", Phase.COMPONENTS), ("c", Phase.COMPONENTS), ("a", Phase.SENSORS)):
        schedule.add_task(2.0, rank, lambda now, name=name: calls.append(f"{name}{now // 10**6}"))
    schedule.wait_until(SECOND, NEVER)
    assert calls == ["a500", "b500", "c500", "a1000", "b1000", "c1000"]


def test_in_simulated_time_rounding_errors_do_not_accumulate() -> None:
    schedule = SimulatedSchedule()
    calls: list[int] = []
    schedule.add_task(3.0, Phase.SENSORS, calls.append)
    schedule.wait_until(1000 * SECOND, NEVER)
    assert len(calls) == 3000
    assert calls[-1] == 1000 * SECOND


def test_a_task_may_begin_at_once_and_may_be_ended() -> None:
    schedule = SimulatedSchedule(5 * SECOND)
    calls: list[int] = []
    end = schedule.add_task(1.0, Phase.SENSORS, calls.append, first=0)
    schedule.wait_until(7 * SECOND, NEVER)
    end()
    end()
    schedule.wait_until(9 * SECOND, NEVER)
    assert calls == [5 * SECOND, 6 * SECOND, 7 * SECOND]


def test_in_real_time_missed_calls_of_a_slow_task_are_skipped_and_counted() -> None:
    schedule = RealTimeSchedule()
    calls: list[int] = []

    def slow(now: int) -> None:
        calls.append(now)
        if len(calls) == 1:
            deadline = time.monotonic() + 0.1
            while time.monotonic() < deadline:
                pass

    schedule.add_task(100.0, Phase.SENSORS, slow)
    schedule.wait_until(schedule.now() + SECOND // 5, NEVER)
    assert schedule.missed_calls >= 8
    assert len(calls) + schedule.missed_calls >= 18
    assert all(later > earlier for earlier, later in pairwise(calls))


def test_the_first_call_happens_after_a_period() -> None:
    schedule = SimulatedSchedule(start=5 * SECOND)
    times: list[int] = []
    schedule.add_task(4, Phase.CONTROLLER, times.append)
    schedule.wait_until(6 * SECOND, NEVER)
    assert times == [5 * SECOND + k * SECOND // 4 for k in (1, 2, 3, 4)]


def test_tasks_of_all_rates_coincide_at_whole_seconds() -> None:
    schedule = SimulatedSchedule()
    done: list[tuple[str, int]] = []
    schedule.add_task(7, Phase.EVALUATION, lambda now: done.append(("judge", now)))
    schedule.add_task(120, Phase.PHYSICS, lambda now: done.append(("physics", now)))
    schedule.add_task(3, Phase.LOCALISER, lambda now: done.append(("localiser", now)))
    schedule.wait_until(SECOND, NEVER)
    assert [name for name, now in done if now == SECOND] == ["physics", "localiser", "judge"]


def test_a_task_can_end_itself() -> None:
    schedule = SimulatedSchedule()
    times: list[int] = []

    def task(now: int) -> None:
        times.append(now)
        if len(times) == 3:
            end()

    end = schedule.add_task(10, Phase.PLANNER, task)
    schedule.wait_until(SECOND, NEVER)
    end()
    assert times == [SECOND // 10, SECOND // 5, 3 * SECOND // 10]
    assert schedule.next_due() is None


def test_the_end_of_a_task_does_not_affect_other_tasks() -> None:
    schedule = SimulatedSchedule()
    times: list[int] = []
    end = schedule.add_task(10, Phase.PLANNER, times.append)
    schedule.add_task(5, Phase.PLANNER, times.append)
    end()
    schedule.wait_until(SECOND, NEVER)
    assert times == [k * SECOND // 5 for k in (1, 2, 3, 4, 5)]


def test_a_task_that_a_task_starts_is_not_late() -> None:
    schedule = SimulatedSchedule()
    times: list[int] = []
    end = schedule.add_task(
        1, Phase.HEAD, lambda now: end() or schedule.add_task(2, Phase.HEAD, times.append, first=0)
    )
    schedule.wait_until(2 * SECOND, NEVER)
    assert times == [SECOND, 3 * SECOND // 2, 2 * SECOND]
