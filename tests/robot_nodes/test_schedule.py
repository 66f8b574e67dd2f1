"""The clocks and schedules of robots without a world: the order of tasks, and what comes late."""

import threading
import time
from itertools import pairwise

import pytest

from btcore_robot.robot import Phase, RobotClock, Schedule
from btcore_robot.schedule import RealTime, SimulatedTime

SECOND = 10**9
NEVER = threading.Event()


@pytest.mark.parametrize("kind", [RealTime, SimulatedTime])
def test_they_are_clock_and_schedule_at_once(kind: type):
    made = kind()
    clock: RobotClock = made
    schedule: Schedule = made
    calls: list[int] = []
    schedule.every(1000.0, Phase.PROCESSES, calls.append)
    start = clock.now()
    assert clock.wait_until(start + SECOND // 50, NEVER) is False
    assert clock.now() >= start + SECOND // 50
    assert calls == sorted(calls)
    assert calls


@pytest.mark.parametrize("kind", [RealTime, SimulatedTime])
def test_a_wait_ends_when_it_is_woken(kind: type):
    made = kind()
    wake = threading.Event()
    made.every(1000.0, Phase.PROCESSES, lambda now: wake.set())
    start = time.monotonic()
    assert made.wait_until(made.now() + 60 * SECOND, wake) is True
    assert time.monotonic() - start < 30.0


@pytest.mark.parametrize("kind", [RealTime, SimulatedTime])
def test_a_frequency_of_zero_is_refused(kind: type):
    with pytest.raises(ValueError, match="never due"):
        kind().every(0.0, Phase.HEAD, print)


def test_in_simulated_time_equal_moments_go_by_rank_and_then_by_order():
    made = SimulatedTime()
    calls: list[str] = []
    for name, rank in (("b", Phase.PROCESSES), ("c", Phase.PROCESSES), ("a", Phase.SENSORS)):
        made.every(2.0, rank, lambda now, name=name: calls.append(f"{name}{now // 10**6}"))
    made.wait_until(SECOND, NEVER)
    assert calls == ["a500", "b500", "c500", "a1000", "b1000", "c1000"]


def test_in_simulated_time_no_error_piles_up():
    made = SimulatedTime()
    calls: list[int] = []
    made.every(3.0, Phase.SENSORS, calls.append)
    made.wait_until(1000 * SECOND, NEVER)
    assert len(calls) == 3000
    assert calls[-1] == 1000 * SECOND


def test_a_task_may_begin_at_once_and_may_be_ended():
    made = SimulatedTime(5 * SECOND)
    calls: list[int] = []
    end = made.every(1.0, Phase.SENSORS, calls.append, first=0)
    made.wait_until(7 * SECOND, NEVER)
    end()
    end()
    made.wait_until(9 * SECOND, NEVER)
    assert calls == [5 * SECOND, 6 * SECOND, 7 * SECOND]


def test_in_real_time_what_a_slow_task_misses_is_left_out_and_counted():
    made = RealTime()
    calls: list[int] = []

    def slow(now: int) -> None:
        calls.append(now)
        if len(calls) == 1:
            deadline = time.monotonic() + 0.1
            while time.monotonic() < deadline:
                pass

    made.every(100.0, Phase.SENSORS, slow)
    made.wait_until(made.now() + SECOND // 5, NEVER)
    assert made.missed >= 8
    assert len(calls) + made.missed >= 18
    assert all(later > earlier for earlier, later in pairwise(calls))
