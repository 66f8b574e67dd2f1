"""The schedule of ticks, with both policies after a late tick."""

import pytest

from btcore.clock import TickSchedule


@pytest.mark.parametrize(
    ("keeps_multiples", "due_times", "missed"),
    [(False, [100, 350, 450, 550], 0), (True, [100, 400, 500, 500], 2)],
)
def test_due_times_after_a_late_tick(keeps_multiples: bool, due_times: list[int], missed: int) -> None:
    schedule = TickSchedule(1e-7, 0, keeps_multiples)
    assert [schedule.next(now) for now in (0, 350, 400, 450)] == due_times
    assert schedule.missed_ticks == missed
