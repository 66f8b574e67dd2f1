"""The table of a sweep, its statistics and its report."""

import csv
import io
import json
import math
import re
from pathlib import Path
from typing import Any

import pytest

from btcore.script.program import compile_script
from btcore_sweep import charts, table
from btcore_sweep.definition import SweepDefinition
from btcore_sweep.parameters import ParameterOptions
from btcore_sweep.report import ReportData, render_report
from btcore_sweep.sweep_folder import SweepFolder
from btcore_sweep.sweep_statistics import SuccessRate, compute_statistics, wilson

SWEEP = SweepDefinition(
    "walk", (), {"bb.x": ("1", "2.5")}, ParameterOptions({}, {}), tuple(range(4)), {}, "1"
)


def record(number: int, status: str = "SUCCESS", **more: Any) -> dict[str, Any]:
    report = {
        "status": status,
        "ticks": 3,
        "time_s": 0.5 * number,
        "real_time_factor": 8.0,
        "nodes": {"a": {"failure": number}, "b": {"failure": 0}},
        "robot": {"distance_m": 1.5, "pose": {"x": 2}, "visited": ["wp1", "wp2"]},
    }
    code = 1 if status == "FAILURE" else 0
    return {"episode": number, "code": code, "report": report, "failed_at": None, "fault": None, **more}


def test_a_row_is_flat_and_has_no_wall_time() -> None:
    row = table.create_row(SWEEP.episode(3), record(3), None)
    assert row == {
        "episode": 3,
        "seed": 1,
        "param.bb.x": 2.5,
        "success": True,
        "status": "SUCCESS",
        "code": 0,
        "time_s": 1.5,
        "ticks": 3,
        "failed_at": None,
        "error": None,
        "robot.distance_m": 1.5,
        "robot.pose.x": 2,
        "robot.visited": '["wp1", "wp2"]',
        "failures": '{"a": 3}',
    }


def test_rows_without_a_run_contain_the_reason() -> None:
    refused = table.create_row(
        SWEEP.episode(0), {"episode": 0, "code": 2, "report": None, "fault": "no room"}, None
    )
    broken = table.create_row(
        SWEEP.episode(0), {"episode": 0, "code": 70, "report": None, "fault": "KeyError: 1"}, None
    )
    killed = table.create_row(
        SWEEP.episode(0), {"episode": 0, "code": None, "report": None, "killed": 3}, None
    )
    assert [(row["status"], row["error"]) for row in (refused, broken, killed)] == [
        ("REFUSED", "no room"),
        ("BROKEN", "KeyError: 1"),
        ("KILLED", "its worker died 3 times"),
    ]


def rows(count: int = 8) -> list[table.Row]:
    found = []
    for number in range(count):
        failed = number % 4 == 3
        kept = record(number, "FAILURE" if failed else "SUCCESS", failed_at="a" if failed else None)
        found.append(table.create_row(SWEEP.episode(number), kept, None))
    return found


def test_csv_and_parquet_are_read_back_as_written(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    names = table.list_columns(rows(), SWEEP)
    assert names[:4] == ["episode", "seed", "param.bb.x", "success"]
    assert names[-1] == "failures"
    for suffix in ("csv", "parquet"):
        table.write_table(tmp_path / f"results.{suffix}", rows(), names)
    read = parquet.read_table(tmp_path / "results.parquet").to_pylist()
    assert read == [{name: row[name] for name in names} for row in rows()]
    lines = list(csv.DictReader(io.StringIO((tmp_path / "results.csv").read_text(encoding="utf-8"))))
    assert [int(row["episode"]) for row in lines] == list(range(8))
    assert [row["success"] for row in lines] == ["true", "true", "true", "false"] * 2
    assert [float(row["time_s"]) for row in lines] == [row["time_s"] for row in rows()]
    assert lines[3]["failures"] == '{"a": 3}'


def test_mixed_column_is_stored_as_texts_in_parquet(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    table.write_table(tmp_path / "a.parquet", [{"x": 1, "y": 1}, {"x": "house", "y": 0.5}, {}], ["x", "y"])
    assert parquet.read_table(tmp_path / "a.parquet").to_pydict() == {
        "x": ["1", "house", None],
        "y": [1.0, 0.5, None],
    }


@pytest.mark.parametrize(("good", "count"), [(0, 1), (0, 20), (7, 10), (93, 100), (50, 50)])
def test_wilson_interval_matches_scipy(good: int, count: int) -> None:
    stats = pytest.importorskip("scipy.stats")
    theirs = stats.binomtest(good, count).proportion_ci(0.95, "wilson")
    assert wilson(good, count) == pytest.approx((theirs.low, theirs.high))


def test_rate_of_no_episodes_is_unknown() -> None:
    assert wilson(0, 0) == (0.0, 1.0)
    assert math.isnan(SuccessRate(0, 0, 0.0, 1.0).share)
    assert charts.percent(math.nan) == "–"


def test_statistics_contain_rates_by_parameter_and_failing_nodes() -> None:
    found = compute_statistics(rows(), SWEEP)
    assert (found.rate.good, found.rate.count) == (6, 8)
    assert {value: (share.good, share.count) for value, share in found.by["bb.x"].items()} == {
        "1": (4, 4),
        "2.5": (2, 4),
    }
    assert found.statuses == {"SUCCESS": 6, "FAILURE": 2}
    (node,) = found.failing
    assert (node.node, node.ended, node.failed, node.times) == ("a", 2, 7, 28)
    assert [episode["episode"] for episode in found.failed] == [3, 7]
    names = {spread.name for spread in found.spreads}
    assert names == {"time_s", "ticks", "robot.distance_m", "robot.pose.x"}


def test_success_may_be_a_script_over_the_columns() -> None:
    row = table.create_row(SWEEP.episode(3), record(3), None)
    assert table.is_success(row, compile_script("status == 'SUCCESS' && robot_distance_m > 1"))
    assert not table.is_success(row, compile_script("param_bb_x < 2"))
    assert not table.is_success(row, compile_script("failed_at == 'a'")), "a missing value does not match"
    killed = table.create_row(
        SWEEP.episode(0), {"episode": 0, "code": None, "report": None, "killed": 3}, None
    )
    assert not table.is_success(killed, compile_script("seed < 100"))


def test_histogram_counts_every_value() -> None:
    times = [(0.1 * number, number % 3 > 0) for number in range(100)]
    picture = charts.histogram(times, "s")
    titles = set(re.findall(r"<title>([^<]*)</title>", picture))
    assert len(titles) == 20, "every 0.5 s of 10"
    assert sum(int(count) for title in titles for count in re.findall(r"(\d+) [✔✘]", title)) == 100


def test_report_names_varied_parameters_and_escapes_user_texts() -> None:
    found = compute_statistics(rows(), SWEEP)
    text = render_report(ReportData(SWEEP, found, "1 < 2 && '<b>' != ''", (0.5,) * 8))
    assert "75.0 %" in text
    assert "bb.x" in text
    assert "&lt;b&gt;" in text
    assert "<b>'" not in text
    assert "btcore run walk --set x=2.5 --fast --seed 1" in text.replace("</span>", "")


def test_journal_with_an_old_name_of_a_key_is_read(tmp_path: Path) -> None:
    with SweepFolder(tmp_path, SWEEP):
        pass
    old = record(0, "FAILURE", blamed="a")
    del old["failed_at"]
    (tmp_path / "journal.jsonl").write_text(json.dumps(old) + "\n", encoding="utf-8")
    with SweepFolder(tmp_path, SWEEP) as folder:
        assert table.create_row(SWEEP.episode(0), folder.done[0], None)["failed_at"] == "a"
