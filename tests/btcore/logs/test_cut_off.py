"""A log is read as it was written; a log that is truncated at any byte is read with a warning."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from btcore import Status, Tree
from btcore.logs import BtLog, LogError, LoggedTransition, read_btlog, read_log
from btcore.logs.btlog import BtLogWriter
from btcore_monitor.logs import SqliteLog, read_sqlite
from btcore_monitor.logs.sqlite import SqliteWriter

NODES = 6
RECORD = 9
PAGE = 4096
WALL = 1_700_000_000_000_000

Written = list[tuple[int, int, Status]]
shared_folder = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])


@st.composite
def runs(draw: st.DrawFn) -> Written:
    """Draw rows of (µs since the start, uid, status) in order of time; each row is a change."""
    rows: Written = []
    since, last = 0, dict.fromkeys(range(1, NODES + 1), Status.IDLE)
    for step in draw(st.lists(st.integers(1, 10**9), max_size=40)):
        since += step
        uid = draw(st.integers(1, NODES))
        status = draw(st.sampled_from([status for status in Status if status is not last[uid]]))
        last[uid] = status
        rows.append((since, uid, status))
    return rows


@pytest.fixture
def small_tree(small: Callable[..., Tree]) -> Tree:
    leaves = "".join(f'<AlwaysSuccess name="leaf_{number}"/>' for number in range(1, NODES))
    return small(f"<Sequence>{leaves}</Sequence>")


@pytest.fixture
def xml(small_tree: Tree) -> str:
    from btcore.loading.tree_xml import tree_to_xml

    return tree_to_xml(small_tree)


def changes(rows: Written) -> list[LoggedTransition]:
    last = dict.fromkeys(range(1, NODES + 1), Status.IDLE)
    found = []
    for since, uid, status in rows:
        found.append(LoggedTransition((WALL + since) * 1000, uid, last[uid], status))
        last[uid] = status
    return found


def write_btlog(path: Path, xml: str, rows: Written) -> None:
    file = BtLogWriter(path, xml.encode(), WALL)
    file.append([(since, uid, Status.IDLE, status) for since, uid, status in rows])
    file.close()


def write_database(path: Path, xml: str, rows: Written) -> None:
    path.unlink(missing_ok=True)
    base = SqliteWriter(path, xml, [("leaf_1", 2)])
    base.begin_at(WALL)
    for change, (since, uid, status) in zip(changes(rows), rows, strict=True):
        base.add(since, uid, change.previous, status)
    base.flush()
    base.finish()
    base.close()


WRITERS = pytest.mark.parametrize(
    ("write", "name"), [(write_btlog, "run.btlog"), (write_database, "run.db3")], ids=["btlog", "sqlite"]
)


@WRITERS
@given(rows=runs())
@shared_folder
def test_written_transitions_are_read_back(
    write: Callable[..., Any], name: str, tmp_path: Path, xml: str, rows: Written
) -> None:
    write(tmp_path / name, xml, rows)
    recording = read_log(tmp_path / name)
    assert recording.transitions == changes(rows)
    assert recording.warnings == []


@given(rows=runs(), data=st.data())
@shared_folder
def test_btlog_cut_at_any_byte_is_read(tmp_path: Path, xml: str, rows: Written, data: st.DataObject) -> None:
    path = tmp_path / "run.btlog"
    write_btlog(path, xml, rows)
    whole = path.read_bytes()
    cut = data.draw(st.integers(0, len(whole) - 1))
    path.write_bytes(whole[:cut])
    head = len(whole) - RECORD * len(rows)
    if cut < head:
        with pytest.raises(LogError, match=r"this log ends in its header|this is not a \.btlog file"):
            read_btlog(path)
        return
    recording = read_btlog(path)
    count, rest = divmod(cut - head, RECORD)
    assert recording.transitions == changes(rows)[:count]
    message = f"the file is truncated within a transition, {rest} bytes after the last complete transition"
    assert recording.damage == (message if rest else "")


@pytest.fixture(scope="module")
def long_database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a database whose transitions fill many pages."""
    path = tmp_path_factory.mktemp("long") / "run.db3"
    leaf = '<AlwaysSuccess name="leaf" _uid="2"/>'
    tree = f'<BehaviorTree ID="Main" _fullpath=""><Sequence name="Sequence" _uid="1">{leaf}</Sequence>'
    xml = f'<root BTCPP_format="4">{tree}</BehaviorTree><TreeNodesModel/></root>'
    base = SqliteWriter(path, xml, [("Sequence::1", 1), ("leaf", 2)])
    base.begin_at(WALL)
    for number in range(4_000):
        status = Status.SUCCESS if number % 2 else Status.RUNNING
        base.add(number * 10, 1 + number // 2 % 2, Status.IDLE, status)
        if number % 10 == 9:
            base.flush()
    base.finish()
    base.close()
    return path


@given(millionths=st.integers(0, 999_999))
@shared_folder
def test_database_cut_at_any_byte_gives_its_beginning_or_a_log_error(
    tmp_path: Path, long_database: Path, millionths: int
) -> None:
    content, whole = long_database.read_bytes(), read_sqlite(long_database).transitions
    cut = len(content) * millionths // 1_000_000
    path = tmp_path / "cut.db3"
    path.write_bytes(content[:cut])
    if cut < 6 * PAGE:  # the first pages contain the tables and the tree
        with pytest.raises(
            LogError, match=r"this is not an SQLite|this log ends in its|the file is truncated: it has"
        ):
            read_sqlite(path)
        return
    recording = read_sqlite(path)
    assert recording.transitions == whole[: len(recording.transitions)]
    assert recording.damage == f"the file is truncated: it has {cut} of {len(content)} bytes"
    assert recording.warnings[0].endswith(f"{len(recording.transitions)} transitions are read")


def test_half_of_a_database_gives_about_half_of_its_transitions(tmp_path: Path, long_database: Path) -> None:
    content, whole = long_database.read_bytes(), read_sqlite(long_database).transitions
    path = tmp_path / "cut.db3"
    path.write_bytes(content[: len(content) // 2])
    assert 1_000 < len(read_sqlite(path).transitions) < 3_000 < len(whole)


def test_live_database_is_not_reported_as_truncated(small_tree: Tree, tmp_path: Path) -> None:
    path = tmp_path / "run.db3"
    with SqliteLog(small_tree, path):
        small_tree.tick_exactly_once()
        recording = read_sqlite(path)
        assert len(recording.transitions) > 5
        assert recording.damage == ""


def test_gaps_are_reported_for_both_formats(tmp_path: Path, xml: str) -> None:
    file = BtLogWriter(tmp_path / "run.btlog", xml.encode(), WALL)
    file.append([(1, 1, Status.IDLE, Status.RUNNING)])
    file.gap("the transitions 2\nto 9 are lost")
    file.append([(50, 1, Status.RUNNING, Status.SUCCESS)])
    file.close()
    base = SqliteWriter(tmp_path / "run.db3", xml, [])
    base.add(1, 1, Status.IDLE, Status.RUNNING)
    base.add(50, 1, Status.RUNNING, Status.SUCCESS, "gap: the transitions 2 to 9 are lost")
    base.finish()
    base.close()
    for name in ("run.btlog", "run.db3"):
        recording = read_log(tmp_path / name)
        assert recording.gaps == ((1, "the transitions 2 to 9 are lost"),)
        assert recording.warnings == [
            f"{tmp_path / name}: a gap before transition 2: the transitions 2 to 9 are lost"
        ]


def test_new_log_does_not_keep_the_gaps_of_the_previous_log(small_tree: Tree, tmp_path: Path) -> None:
    beside = tmp_path / "run.btlog.gaps"
    beside.write_text("0 something is missing\nnonsense\n9999 beyond the end\n")
    with BtLog(small_tree, tmp_path / "run.btlog"):
        pass
    assert not beside.exists()
    beside.write_text("0 something is missing\nnonsense\n9999 beyond the end\n")
    assert read_btlog(tmp_path / "run.btlog").gaps == ((0, "something is missing"),)
