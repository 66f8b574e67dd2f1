"""At a terminal, the codes of messages and the names of nodes are links; pipes and files have no links."""

import os
import sys
from pathlib import Path

import pytest

from btcore.cli import terminal
from btcore.cli.commands import nodes
from btcore.diagnostic_codes import UNKNOWN_NODE
from btcore.diagnostics import Diagnostic
from btcore.documentation_site import FIRST_PAGE

pty = pytest.importorskip("pty", reason="pseudo terminals need POSIX", exc_type=ImportError)

START, END = "\x1b]8;", "\x1b\\"


@pytest.fixture(autouse=True)
def xterm(monkeypatch: pytest.MonkeyPatch) -> None:
    """The environment of a terminal that supports colours and links."""
    for name in ("NO_COLOR", "FORCE_COLOR", "TTY_COMPATIBLE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm-256color")


def printed_at_a_terminal(monkeypatch: pytest.MonkeyPatch) -> str:
    reading, writing = pty.openpty()
    with os.fdopen(writing, "w", encoding="utf-8") as stream:
        monkeypatch.setattr(sys, "stderr", stream)
        terminal.print_diagnostics([Diagnostic(UNKNOWN_NODE, "unknown node <Move>", "tree.xml", 3, 5)])
        text = os.read(reading, 10_000).decode()
    os.close(reading)
    return text


def test_the_code_is_a_link_at_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    text = printed_at_a_terminal(monkeypatch)
    assert text.count(START) == 2  # the beginning and the end of one link
    target, _, label = text.split(START)[1].partition(END)
    assert target.endswith(f";{UNKNOWN_NODE.url}")
    assert "E101" in label
    assert text.endswith(f"{START};{END} unknown node <Move>\r\n")


def test_the_name_of_a_node_is_a_link_at_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    reading, writing = pty.openpty()
    with os.fdopen(writing, "w", encoding="utf-8") as stream:
        monkeypatch.setattr(sys, "stdout", stream)
        nodes.nodes.main(["Delay"], standalone_mode=False)
        text = os.read(reading, 10_000).decode()
    os.close(reading)
    target, _, label = text.split(START)[1].partition(END)
    assert target.endswith(f";{FIRST_PAGE}reference/nodes/Delay.html")
    assert "Delay" in label


@pytest.mark.parametrize(("name", "value"), [("NO_COLOR", "1"), ("TERM", "dumb"), ("TERM", "unknown")])
def test_no_link_where_the_user_or_the_terminal_has_no_colours(
    monkeypatch: pytest.MonkeyPatch, name: str, value: str
) -> None:
    monkeypatch.setenv(name, value)
    text = printed_at_a_terminal(monkeypatch)
    assert "tree.xml:3:5: " in text
    assert "E101" in text
    assert START not in text


def test_no_link_in_a_file(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")  # rich writes colours to the file
    file = tmp_path / "errors.txt"
    with file.open("w", encoding="utf-8") as stream:
        monkeypatch.setattr(sys, "stderr", stream)
        terminal.print_diagnostics([Diagnostic(UNKNOWN_NODE, "unknown node <Move>", "tree.xml", 3, 5)])
    text = file.read_text(encoding="utf-8")
    assert "\x1b[1;31mE101\x1b[0m" in text
    assert START not in text
