"""Stamps of another machine's clock are related to ours, and jumps are found."""

import random

import pytest

from btcore.clock import NS_PER_S
from btcore_ros2.robot.stamps import WINDOW, ClockJumpError, LateMessageError, StampConverter

OFFSET = 1_700_000_000 * NS_PER_S
MS = NS_PER_S // 1000


def test_offset_is_that_of_the_shortest_delay() -> None:
    stamps, numbers = StampConverter(), random.Random(1)
    newest = 0
    for number in range(1000):
        measured = number * 20 * MS
        arrival = measured + numbers.randint(2, 40) * MS
        converted = stamps.convert("odom", measured + OFFSET, arrival)
        assert newest <= converted <= arrival
        newest = converted
        if number > 500:
            assert 0 <= converted - measured <= 3 * MS


def test_topics_share_the_offset() -> None:
    stamps = StampConverter()
    stamps.convert("odom", OFFSET, 5 * MS)
    assert stamps.convert("scan", OFFSET, 105 * MS) == 5 * MS


def test_drift_of_the_clocks_is_followed() -> None:
    stamps, drift = StampConverter(), 1e-4
    for number in range(10 * WINDOW // NS_PER_S):
        measured = number * NS_PER_S
        converted = stamps.convert("odom", OFFSET + round(measured * (1.0 - drift)), measured + MS)
    # The robot's clock is slower than ours: within two windows it loses 6 ms.
    assert measured - 6 * MS <= converted <= measured + MS


def test_stamp_that_is_not_set_is_the_arrival() -> None:
    stamps = StampConverter()
    stamps.convert("odom", OFFSET, MS)
    assert stamps.convert("battery", 0, 7 * MS) == 7 * MS


@pytest.mark.parametrize(("change", "message"), [(60, "ahead by 60.0 s"), (-60, "back by 59.9 s")])
def test_jump_of_the_robots_clock_is_an_error(change: int, message: str) -> None:
    stamps = StampConverter()
    for number in range(50):
        stamps.convert("odom", OFFSET + number * 100 * MS, number * 100 * MS + MS)
    with pytest.raises(ClockJumpError, match=message):
        stamps.convert("odom", OFFSET + change * NS_PER_S + 5000 * MS, 5001 * MS)


def test_late_first_message_is_no_jump() -> None:
    stamps = StampConverter()
    stamps.convert("odom", OFFSET, 3 * NS_PER_S)
    assert stamps.convert("odom", OFFSET + 3 * NS_PER_S, 3 * NS_PER_S + MS) == 3 * NS_PER_S + MS


def test_stamps_of_simulated_time_are_kept() -> None:
    stamps = StampConverter(shared=True)
    assert stamps.convert("odom", 5 * NS_PER_S, 6 * NS_PER_S) == 5 * NS_PER_S
    assert stamps.convert("scan", 7 * NS_PER_S, 6 * NS_PER_S) == 6 * NS_PER_S


def test_message_that_arrives_after_a_newer_one_is_late() -> None:
    stamps = StampConverter()
    newest = stamps.convert("scan", 5 * NS_PER_S, 100 * NS_PER_S)
    with pytest.raises(LateMessageError, match=r"0\.500 s older than the newest"):
        stamps.convert("scan", 5 * NS_PER_S - NS_PER_S // 2, 100 * NS_PER_S)
    assert stamps.convert("scan", 5 * NS_PER_S, 101 * NS_PER_S) == newest  # a repetition
    assert stamps.convert("odom", 4 * NS_PER_S, 101 * NS_PER_S) < newest  # another source
