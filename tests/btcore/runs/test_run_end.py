"""The table "How a run ends" of docs/architecture.md, and which of several events counts."""

from collections.abc import Callable
from signal import SIGHUP, SIGINT, SIGTERM

import pytest

from btcore.errors import BtcoreError, NodeExecutionError, OutputError, ProviderError
from btcore.runs.run_end import RunEnd
from btcore.status import FAILURE, RUNNING, SUCCESS, Status

Event = Callable[[RunEnd], None]

LEAF_ERROR = NodeExecutionError("Leaf", "leaf", OSError("no power"))
PROVIDER_ERROR, OUTPUT_ERROR = ProviderError("no power"), OutputError("disk full")


def done(end: RunEnd) -> None:
    end.loop_end = "done"


def over(end: RunEnd) -> None:
    end.loop_end = "duration"


def leaf(end: RunEnd) -> None:
    end.error = LEAF_ERROR


def replaced(end: RunEnd) -> None:
    end.error = None


def again(end: RunEnd) -> None:
    end.signal, end.loop_end = 0, None


def signal(number: int) -> Event:
    def event(end: RunEnd) -> None:
        end.signal = number

    return event


def left(error: BaseException | None = None, signal: int = 0) -> Event:
    return lambda end: end.note_exit(error, signal)


@pytest.mark.parametrize(
    ("events", "status", "closing_errors", "reason", "code"),
    [
        # The rows of the table.
        ([done, left()], SUCCESS, [], "done", 0),
        ([done, left()], FAILURE, [], "done", 1),
        ([over, left()], RUNNING, [], "duration", 0),
        ([leaf, left(LEAF_ERROR)], SUCCESS, [], "raised", 3),
        ([signal(SIGINT), left()], RUNNING, [], "interrupted", 130),
        ([signal(SIGTERM), left()], RUNNING, [], "interrupted", 143),
        ([signal(SIGHUP), left()], RUNNING, [], "interrupted", 129),
        ([done, left(), signal(SIGTERM)], FAILURE, [], "interrupted", 143),
        ([left(KeyboardInterrupt(), SIGTERM)], RUNNING, [], "interrupted", 143),
        ([done, left()], FAILURE, [OUTPUT_ERROR, OUTPUT_ERROR], "done", 4),
        ([done, left()], FAILURE, [OUTPUT_ERROR, PROVIDER_ERROR], "done", 2),
        # A block that is left without a loop, or by an exception.
        ([left()], RUNNING, [], "done", 0),
        ([left(ValueError())], RUNNING, [], "program_error", 0),
        ([left(SystemExit())], RUNNING, [], "interrupted", 0),
        # Several events.
        ([leaf, left(LEAF_ERROR), signal(SIGINT)], RUNNING, [OUTPUT_ERROR], "raised", 3),
        ([signal(SIGINT), leaf, left()], RUNNING, [], "raised", 3),
        ([left(), leaf], RUNNING, [], "raised", 3),
        ([left(KeyboardInterrupt(), SIGINT), leaf], RUNNING, [], "interrupted", 3),
        ([leaf, left(ValueError())], RUNNING, [], "program_error", 3),
        ([signal(SIGINT), left(ValueError())], RUNNING, [], "program_error", 130),
        ([signal(SIGINT), left()], RUNNING, [OUTPUT_ERROR], "interrupted", 4),
        # Events that continue the run.
        ([leaf, replaced, done, left()], FAILURE, [], "done", 1),
        ([signal(SIGINT), again, done, left()], SUCCESS, [], "done", 0),
    ],
)
def test_how_a_run_ends(
    events: list[Event], status: Status, closing_errors: list[BtcoreError], reason: str, code: int
) -> None:
    end = RunEnd()
    assert end.reason is None
    for event in events:
        event(end)
    assert (end.reason, end.exit_code(status, closing_errors)) == (reason, code)
