"""A .db3 is SqliteLogger's database: its tables, sessions and stamps."""

import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from btcore import SimClock, Status, Transition, Tree
from btcore.loading.tree_xml import tree_to_xml
from btcore.logs import LogError, read_btlog, read_log
from btcore_monitor.logs import Session, SqliteLog, read_sqlite, sessions


def rows(path: Path, query: str) -> list[Any]:
    with closing(sqlite3.connect(path)) as base:
        return base.execute(query).fetchall()


@pytest.fixture
def writer(tmp_path: Path) -> Iterator[sqlite3.Connection]:
    """Another program that writes into run.db3."""
    with closing(sqlite3.connect(tmp_path / "run.db3", isolation_level=None)) as base:
        yield base


def test_the_recorded_file_is_read(captures: Path) -> None:
    recording = read_sqlite(captures / "v4_sample.db3")
    same_run = read_btlog(captures / "v4_sample.btlog")
    assert [change[1:] for change in recording.transitions] == [change[1:] for change in same_run.transitions]
    assert recording.nodes == same_run.nodes
    assert recording.start == 1795223146853974_000
    assert recording.damage == ""
    assert sessions(captures / "v4_sample.db3") == [Session(5, "2026-11-21 01:05:46", 57)]


def test_paths_are_read_as_behaviortree_cpp_wrote_them(captures: Path) -> None:
    written = rows(captures / "v4_sample.db3", "SELECT node_uid, fullpath FROM Nodes")
    nodes = read_sqlite(captures / "v4_sample.db3").nodes
    assert {node.uid: node.path for node in nodes.values()} == dict(written)


def test_tables_match_those_of_behaviortree_cpp(captures: Path, sample: Tree, tmp_path: Path) -> None:
    SqliteLog(sample, tmp_path / "run.db3").close()
    for table in ("Definitions", "Nodes", "Transitions"):
        query = f"PRAGMA table_info({table})"
        assert rows(tmp_path / "run.db3", query) == rows(captures / "v4_sample.db3", query)
    assert rows(
        tmp_path / "run.db3", "SELECT name FROM sqlite_master WHERE type = 'table' ORDER BY name"
    ) == (
        rows(captures / "v4_sample.db3", "SELECT name FROM sqlite_master WHERE type = 'table' ORDER BY name")
    )
    assert read_sqlite(tmp_path / "run.db3").xml == tree_to_xml(sample)
    nodes = "SELECT fullpath, node_uid FROM Nodes ORDER BY rowid"
    assert rows(tmp_path / "run.db3", nodes) == rows(captures / "v4_sample.db3", nodes)


def test_equal_transitions_at_equal_times_are_written_as_equal_rows(
    captures: Path, sample: Tree, tmp_path: Path
) -> None:
    recording = read_sqlite(captures / "v4_sample.db3")
    with SqliteLog(sample, tmp_path / "run.db3") as log:
        log.write(
            [
                Transition(
                    number, change.stamp - recording.start, 1, change.uid, change.previous, change.status
                )
                for number, change in enumerate(recording.transitions, 1)
            ]
        )
    query = (
        "SELECT timestamp - (SELECT min(timestamp) FROM Transitions), node_uid, duration, state, extra_data"
        " FROM Transitions ORDER BY timestamp"
    )
    assert rows(tmp_path / "run.db3", query) == rows(captures / "v4_sample.db3", query)


def test_stamps_increase_strictly_while_the_clock_stands_still(sample: Tree, tmp_path: Path) -> None:
    with SqliteLog(sample, tmp_path / "run.db3") as log:
        sample.tick_exactly_once()
    stamps = [stamp for (stamp,) in rows(tmp_path / "run.db3", "SELECT timestamp FROM Transitions")]
    assert stamps == [log.epoch // 1000 + index for index in range(5)]


def test_new_session_replaces_older_sessions_and_continues_the_numbers(sample: Tree, tmp_path: Path) -> None:
    for _ in range(2):
        with SqliteLog(sample, tmp_path / "run.db3"):
            sample.tick_exactly_once()
            sample.halt()
    assert [session.number for session in sessions(tmp_path / "run.db3")] == [2]
    assert {session for (session,) in rows(tmp_path / "run.db3", "SELECT session_id FROM Transitions")} == {2}
    assert rows(tmp_path / "run.db3", "SELECT count(*) FROM Nodes") == [(10,)]


def test_appended_session_keeps_the_previous_sessions(small: Callable[..., Tree], tmp_path: Path) -> None:
    path = tmp_path / "run.db3"
    for body in ("<AlwaysSuccess/>", "<AlwaysFailure/>"):
        tree = small(body)
        with SqliteLog(tree, path, append=True):
            tree.tick_once()
    assert [(session.number, session.transitions) for session in sessions(path)] == [(1, 2), (2, 2)]
    assert read_sqlite(path).nodes[1].id == "AlwaysFailure"
    first = read_sqlite(path, session=1)
    assert first.nodes[1].id == "AlwaysSuccess"
    assert [change.status for change in first.transitions] == [Status.SUCCESS, Status.IDLE]
    assert read_log(f"{path}#1").transitions == first.transitions
    for read in (lambda: read_sqlite(path, session=3), lambda: read_log(f"{path}#3")):
        with pytest.raises(LogError, match="has no session 3; it has 1 and 2"):
            read()


def test_session_after_simulated_time_starts_right_after_the_previous_session(
    small: Callable[..., Tree], tmp_path: Path
) -> None:
    path = tmp_path / "run.db3"
    for _ in range(2):
        clock = SimClock()
        tree = small("<AlwaysSuccess/>", clock=clock)
        with SqliteLog(tree, path, append=True):
            tree.tick_once()
            clock.advance(3600.0)
            tree.tick_once()
    first, second = (read_sqlite(path, session=number).transitions for number in (1, 2))
    assert second[0].stamp == first[-1].stamp + 1_000
    assert second[2].stamp - second[0].stamp == 3600 * 10**9


def test_row_contains_the_running_time_of_its_node(small: Callable[..., Tree], tmp_path: Path) -> None:
    tree = small('<Sequence><Sleep msec="250"/><Sleep msec="1000"/></Sequence>')
    with SqliteLog(tree, tmp_path / "run.db3"):
        tree.tick_while_running(period=0.05)
        tree.tick_once()
        tree.sleep(0.1)
        tree.halt()
    found = rows(tmp_path / "run.db3", "SELECT node_uid, state, duration FROM Transitions WHERE duration > 0")
    assert [(uid, state, round(duration, -4)) for uid, state, duration in found] == [
        (2, 2, 250_000),
        (3, 2, 1_000_000),
        (1, 2, 1_250_000),
        (2, 0, 100_000),
        (1, 0, 100_000),
    ]


def test_extra_data_comes_from_a_function(sample: Tree, tmp_path: Path) -> None:
    path = tmp_path / "run.db3"
    with SqliteLog(sample, path, idle=False, extra=lambda node, change: f"{node.path} {change.status.name}"):
        sample.tick_while_running()
    found = rows(path, "SELECT extra_data FROM Transitions ORDER BY timestamp")
    assert [message for (message,) in found][:3] == [
        "root_seq RUNNING",
        "Script::2 SUCCESS",
        "Fallback::3 RUNNING",
    ]
    assert not [message for (message,) in found if message.endswith("IDLE")]


def test_another_program_can_read_while_the_tree_runs(sample: Tree, tmp_path: Path) -> None:
    path = tmp_path / "run.db3"
    with SqliteLog(sample, path), closing(sqlite3.connect(path)) as reader:
        for expected in (5, 5, 13):
            sample.tick_exactly_once()
            cursor = reader.execute("SELECT node_uid FROM Transitions")
            assert len(cursor.fetchall()) == expected


def test_open_read_transaction_does_not_delay_rows(sample: Tree, tmp_path: Path) -> None:
    path = tmp_path / "run.db3"
    with SqliteLog(sample, path), closing(sqlite3.connect(path, isolation_level=None)) as reader:
        reader.execute("BEGIN")
        reader.execute("SELECT node_uid FROM Transitions").fetchall()
        sample.tick_exactly_once()
        assert rows(path, "SELECT count(*) FROM Transitions") == [(5,)]


def test_rows_wait_while_another_program_writes(
    sample: Tree, tmp_path: Path, writer: sqlite3.Connection
) -> None:
    path = tmp_path / "run.db3"
    with SqliteLog(sample, path):
        writer.execute("BEGIN IMMEDIATE")
        sample.tick_exactly_once()
        assert rows(path, "SELECT count(*) FROM Transitions") == [(0,)]
        writer.execute("COMMIT")
        sample.tick_exactly_once()
        sample.tick_exactly_once()
        assert rows(path, "SELECT count(*) FROM Transitions") == [(13,)]


def test_closed_log_is_a_single_file(sample: Tree, tmp_path: Path) -> None:
    with SqliteLog(sample, tmp_path / "run.db3"):
        sample.tick_once()
    assert [path.name for path in tmp_path.iterdir()] == ["run.db3"]


def test_database_locked_by_another_program_is_reported(
    sample: Tree, tmp_path: Path, writer: sqlite3.Connection
) -> None:
    writer.execute("PRAGMA locking_mode = EXCLUSIVE")
    writer.execute("CREATE TABLE Mine (number)")
    with pytest.raises(LogError, match="database is locked; another program is writing to it"):
        SqliteLog(sample, tmp_path / "run.db3")


def test_file_that_is_not_a_log_database_is_refused(sample: Tree, tmp_path: Path) -> None:
    text, empty = tmp_path / "text.db3", tmp_path / "empty.db3"
    text.write_text("no database, but a text that is long enough to have a header" * 10)
    empty.touch()
    with pytest.raises(
        LogError, match="this is not an SQLite database, it does not begin with the header of a database"
    ):
        read_sqlite(text)
    with pytest.raises(LogError, match="this is not an SQLite database, it is empty"):
        read_sqlite(empty)
    with pytest.raises(LogError, match="cannot read this log: no such file"):
        sessions(tmp_path / "missing.db3")
    with pytest.raises(LogError, match="cannot write a log here: file is not a database"):
        SqliteLog(sample, text)


def test_row_with_an_invalid_status_ends_the_reading(sample: Tree, tmp_path: Path) -> None:
    path = tmp_path / "run.db3"
    with SqliteLog(sample, path):
        sample.tick_exactly_once()
    with closing(sqlite3.connect(path)) as base, base:
        base.execute("UPDATE Transitions SET state = 9 WHERE node_uid = 3")
    recording = read_sqlite(path)
    assert len(recording.transitions) == 2
    assert recording.damage.endswith("unknown status 9")
