"""Drawings of a tree with the last results of its nodes."""

import io
import os
import pty
import sys

import pytest

from btcore import SimClock, Status, Tree, loads
from btcore.testing import Trace
from btcore.tree.drawing import shows_colours

XML = """<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <Fallback>
      <Sequence name="first">
        <AlwaysSuccess/>
        <SubTree ID="Fail" name="tür"/>
      </Sequence>
      <Sequence>
        <AlwaysSuccess/>
        <Sleep name="rest" msec="1000"/>
        <AlwaysSuccess _skipIf="true"/>
      </Sequence>
    </Fallback>
  </BehaviorTree>
  <BehaviorTree ID="Fail"> <AlwaysFailure/> </BehaviorTree>
</root>"""
RUNNING = """\
Main  1 tick
└── ? Fallback  ▶ RUNNING
    ├── → first  Sequence  ✘ FAILURE
    │   ├── ⊤ AlwaysSuccess  (✔ SUCCESS)
    │   └── ▣ tür  SubTree  (✘ FAILURE)
    │       └── ⊥ AlwaysFailure  (✘ FAILURE)
    └── → Sequence  ▶ RUNNING
        ├── ⊤ AlwaysSuccess  ✔ SUCCESS
        ├── ◷ rest  Sleep  ▶ RUNNING
        └── ⊤ AlwaysSuccess  ○ IDLE"""


@pytest.fixture
def tree() -> Tree:
    tree = loads(XML, clock=SimClock())
    tree.tick_once()
    return tree


@pytest.fixture(autouse=True)
def _plain(monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(variable, raising=False)


def drawing(tree: Tree) -> list[str]:
    """Return the lines of a drawing without the branches, and without the line of the title."""
    return [line.lstrip("└├─│ ") for line in str(tree).split("\n")[1:]]


def test_printed_tree_shows_statuses_and_last_results(tree: Tree, capsys: pytest.CaptureFixture[str]) -> None:
    print(tree)
    assert capsys.readouterr().out == RUNNING + "\n"
    tree.draw()
    assert capsys.readouterr().out == RUNNING + "\n"


def test_completed_tree_shows_the_last_results(tree: Tree) -> None:
    assert tree.tick_while_running() is Status.SUCCESS
    assert drawing(tree) == [
        "? Fallback  (✔ SUCCESS)",
        "→ first  Sequence  (✘ FAILURE)",
        "⊤ AlwaysSuccess  (✔ SUCCESS)",
        "▣ tür  SubTree  (✘ FAILURE)",
        "⊥ AlwaysFailure  (✘ FAILURE)",
        "→ Sequence  (✔ SUCCESS)",
        "⊤ AlwaysSuccess  (✔ SUCCESS)",
        "◷ rest  Sleep  (✔ SUCCESS)",
        "⊤ AlwaysSuccess  ○ IDLE",
    ]


def test_halted_nodes_are_marked(tree: Tree) -> None:
    tree.halt()
    assert [line for line in drawing(tree) if line.endswith("(halted)")] == [
        "? Fallback  (halted)",
        "→ Sequence  (halted)",
        "◷ rest  Sleep  (halted)",
    ]


@pytest.mark.parametrize("observed", [False, True])
def test_last_results_of_many_children_are_shown(observed: bool) -> None:
    element = "<Sequence>" + "<AlwaysSuccess/>" * 40 + "</Sequence>"
    tree = loads(f'<root BTCPP_format="4"><BehaviorTree ID="Main">{element}</BehaviorTree></root>')
    if observed:
        tree.start_tick_counts()
        Trace(tree)
    tree.tick_once()
    assert str(tree).count("AlwaysSuccess  (✔ SUCCESS)") == 40


def test_file_of_ascii_characters_gets_an_ascii_drawing(tree: Tree) -> None:
    file = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    tree.draw(file)
    file.seek(0)
    assert (
        file.read()
        == """\
Main  1 tick
`-- Fallback  RUNNING
    |-- first  Sequence  FAILURE
    |   |-- AlwaysSuccess  (SUCCESS)
    |   `-- t\\xfcr  SubTree  (FAILURE)
    |       `-- AlwaysFailure  (FAILURE)
    `-- Sequence  RUNNING
        |-- AlwaysSuccess  SUCCESS
        |-- rest  Sleep  RUNNING
        `-- AlwaysSuccess  IDLE
"""
    )


def test_print_on_ascii_standard_output_does_not_raise(tree: Tree, monkeypatch: pytest.MonkeyPatch) -> None:
    file = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr(sys, "stdout", file)
    print(tree)
    file.seek(0)
    assert "`-- t\\xfcr  SubTree  (FAILURE)" in file.read()


def read_drawing(screen: io.FileIO) -> str:
    """Return what the terminal shows, up to the end of the last line, whose node is IDLE."""
    shown = b""
    while b"IDLE" not in shown or not shown.endswith(b"\n"):  # it arrives in parts
        shown += screen.read(10_000)
    return shown.decode()


def test_terminal_gets_colours_unless_they_are_disabled(tree: Tree, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    master, slave = pty.openpty()
    with os.fdopen(slave, "w", encoding="utf-8") as terminal, os.fdopen(master, "rb", 0) as screen:
        tree.draw(terminal)
        terminal.flush()
        assert "\x1b[1;33m▶ RUNNING\x1b[0m" in read_drawing(screen)
        monkeypatch.setenv("NO_COLOR", "1")
        tree.draw(terminal)
        terminal.flush()
        assert read_drawing(screen).replace("\r\n", "\n") == RUNNING + "\n"


def test_only_new_consoles_of_windows_show_colours(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("TERM", "NO_COLOR", "FORCE_COLOR", "WT_SESSION"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "win32")
    master, slave = pty.openpty()
    with os.fdopen(slave, "w", encoding="utf-8") as terminal, os.fdopen(master, "rb"):
        assert not shows_colours(terminal)
        monkeypatch.setenv("WT_SESSION", "f4b2")
        assert shows_colours(terminal)


def test_deep_tree_is_drawn() -> None:
    depth = 200
    element = "<Inverter>" * depth + "<AlwaysSuccess/>" + "</Inverter>" * depth
    tree = loads(f'<root BTCPP_format="4"><BehaviorTree ID="Main">{element}</BehaviorTree></root>')
    assert len(str(tree).split("\n")) == depth + 2
