"""The console log prints the lines of StdCoutLogger, with colours only on a terminal."""

import io
import os
import pty
import re
from collections.abc import Callable, Iterator
from typing import TextIO

import pytest

from btcore import SimClock, Tree
from btcore.logs import ConsoleLog


@pytest.fixture
def terminal() -> Iterator[tuple[TextIO, int]]:
    """A pseudo terminal: the file to write to, and the descriptor to read from."""
    looking, writing = pty.openpty()
    with os.fdopen(writing, "w", encoding="utf-8") as stream:
        yield stream, looking
    os.close(looking)


def test_line_contains_time_name_and_both_statuses(small: Callable[..., Tree]) -> None:
    clock = SimClock()
    tree = small(
        '<Inverter name="not"><AlwaysSuccess name="a name of 30 characters, so long"/></Inverter>',
        clock=clock,
    )
    stream = io.StringIO()
    with ConsoleLog(tree, stream, relative=True):
        clock.advance(12.3456)
        tree.tick_once()
    assert stream.getvalue() == (
        "[12.346]: not                       IDLE -> RUNNING\n"
        "[12.346]: a name of 30 characters, so long IDLE -> SUCCESS\n"
        "[12.346]: a name of 30 characters, so long SUCCESS -> IDLE\n"
        "[12.346]: not                       RUNNING -> FAILURE\n"
        "[12.346]: not                       FAILURE -> IDLE\n"
    )


def test_times_are_seconds_since_1970_by_default(small: Callable[..., Tree]) -> None:
    tree = small("<AlwaysSuccess/>")
    stream = io.StringIO()
    with ConsoleLog(tree, stream, idle=False) as log:
        tree.tick_once()
    assert stream.getvalue() == f"[{log.epoch / 1e9:.3f}]: AlwaysSuccess             IDLE -> SUCCESS\n"


def test_standard_output_is_default(small: Callable[..., Tree], capsys: pytest.CaptureFixture[str]) -> None:
    tree = small("<AlwaysSuccess/>")
    with ConsoleLog(tree):
        tree.tick_once()
    assert re.fullmatch(r"(\[\d+\.\d{3}\]: AlwaysSuccess .*\n){2}", capsys.readouterr().out)


def test_terminal_output_has_the_colours_of_behaviortree_cpp(
    small: Callable[..., Tree], terminal: tuple[TextIO, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    tree = small("<AlwaysFailure/>")
    stream, looking = terminal
    with ConsoleLog(tree, stream, idle=False):
        tree.tick_once()
    assert b"\x1b[36mIDLE\x1b[0m -> \x1b[31mFAILURE\x1b[0m" in os.read(looking, 1000)


def test_no_color_variable_disables_colours(
    small: Callable[..., Tree], terminal: tuple[TextIO, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    tree = small("<AlwaysFailure/>")
    stream, looking = terminal
    with ConsoleLog(tree, stream, idle=False):
        tree.tick_once()
    assert b"IDLE -> FAILURE" in os.read(looking, 1000)


def test_characters_outside_the_stream_encoding_are_escaped(small: Callable[..., Tree]) -> None:
    tree = small('<AlwaysSuccess name="Tür"/>')
    data = io.BytesIO()
    stream = io.TextIOWrapper(data, encoding="ascii")
    with ConsoleLog(tree, stream, idle=False):
        tree.tick_once()
    assert b": T\\xfcr  " in data.getvalue()
