"""W110: loops that never end a tick."""

import pytest

from tests.btcore.lint.conftest import Checker
from tests.btcore.lint.documents import tree

REPEAT = '<Repeat num_cycles="-1">{}</Repeat>'
RETRY = '<RetryUntilSuccessful num_attempts="-1">{}</RetryUntilSuccessful>'


@pytest.mark.parametrize("format", [3, 4])
@pytest.mark.parametrize(
    ("body", "message"),
    [
        (REPEAT.format("<AlwaysSuccess/>"), "<Repeat> never ends a tick: it repeats <AlwaysSuccess> forever"),
        (RETRY.format("<BatteryOk/>"),
         "<RetryUntilSuccessful> does not end a tick until <BatteryOk> succeeds"),
        (REPEAT.format("<BatteryOk/>"), "<Repeat> does not end a tick until <BatteryOk> fails"),
        (f"<Inverter><Sequence>{REPEAT.format('<AlwaysSuccess/>')}</Sequence></Inverter>",
         "<Repeat> never ends a tick: it repeats <AlwaysSuccess> forever"),
        (REPEAT.format('<Repeat num_cycles="3"><ForceSuccess><BatteryOk/></ForceSuccess></Repeat>'),
         "<Repeat> does not end a tick until <Repeat> is skipped"),
    ],
)  # fmt: skip
def test_loop_that_never_ends_tick_is_reported(check: Checker, body: str, message: str, format: int) -> None:
    found = check(body, format=format)
    assert f"W110 {message}, and no node below it can be RUNNING" in found
    assert found.count("W110") == 1


def test_loop_that_never_ends_a_tick_is_reported_in_a_subtree(check: Checker) -> None:
    inner = tree("Inner", REPEAT.format("<AlwaysSuccess/>"))
    assert check('<Sequence><SubTree ID="Inner"/></Sequence>', more=inner).count("W110") == 1


@pytest.mark.parametrize(
    "body",
    [
        '<Repeat num_cycles="1000"><AlwaysSuccess/></Repeat>',
        '<Repeat num_cycles="-2"><AlwaysSuccess/></Repeat>',
        "<KeepRunningUntilFailure><AlwaysSuccess/></KeepRunningUntilFailure>",
        REPEAT.format("<KeepRunningUntilFailure><BatteryOk/></KeepRunningUntilFailure>"),
        REPEAT.format("<Drive/>"),
        REPEAT.format("<Sequence><BatteryOk/><Drive/></Sequence>"),
        REPEAT.format('<Delay delay_msec="100"><AlwaysSuccess/></Delay>'),
        # A while loop: the script may end it.
        REPEAT.format("<Sequence><BatteryOk/><Script code='x:=1'/></Sequence>"),
        REPEAT.format("<Sequence _skipIf='x>9'><Script code='x+=1'/></Sequence>"),
        # Another node may halt the loop between two repetitions.
        f'<Timeout msec="100">{REPEAT.format("<AlwaysSuccess/>")}</Timeout>',
        f"<ReactiveSequence><BatteryOk/>{REPEAT.format('<AlwaysSuccess/>')}</ReactiveSequence>",
        f'<Sequence _while="x==1">{REPEAT.format("<AlwaysSuccess/>")}</Sequence>',
    ],
)
def test_loop_that_may_end_a_tick_is_not_reported(check: Checker, body: str) -> None:
    assert "W110" not in check(body, given=["x"])


@pytest.mark.parametrize("format", [3, 4])
def test_timeout_cannot_halt_a_loop_of_format_3(check: Checker, format: int) -> None:
    found = check(f'<Timeout msec="100">{REPEAT.format("<AlwaysSuccess/>")}</Timeout>', format=format)
    assert ("W110" in found) is (format == 3)
