"""`btcore bench`: listing and running benchmarks, output, and missing libraries."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result

from btcore import builds
from btcore_bench import command

Cli = Callable[..., Result]
EXAMPLE_BENCHMARK = '''
"""Tells what it is asked to tell."""

import json, sys

rows = [{"what": "ours / theirs", "median": 3.0, "low": 2.9, "high": 3.25, "target": "≥ 2", "met": True}]
with open(sys.argv[2], "w") as file:
    json.dump({"benchmark": "telling", "build": "pure", "rows": rows, "options": sys.argv[3:]}, file)
'''


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Replace the project's benchmarks by a folder with three benchmarks."""
    made = tmp_path / "benchmarks"
    made.mkdir()
    (made / "telling.py").write_text(EXAMPLE_BENCHMARK.lstrip(), encoding="utf-8")
    (made / "lacking.py").write_text('"""Lacks something."""\nimport no_such_thing.inside\n')
    (made / "broken.py").write_text('"""Is broken."""\nraise ValueError("the scale is bent")\n')
    monkeypatch.setattr(command, "data_folder", lambda name: made)
    return made


def words(result: Result) -> str:
    return re.sub(r"\s+", " ", result.output)


def test_benchmarks_of_the_project_run_and_write_their_results(cli: Cli, tmp_path: Path) -> None:
    result = cli("bench", "observers", "--quick", "--pairs", "1", "--json", tmp_path / "all.json")
    assert result.exit_code == 0, result.output
    [told] = json.loads((tmp_path / "all.json").read_text(encoding="utf-8"))
    assert told["benchmark"] == "observers"
    assert told["build"] == builds.active_build()
    assert "no status changes" in words(result)


def test_list_shows_every_benchmark_with_its_description(cli: Cli) -> None:
    listed = dict(line.split(maxsplit=1) for line in cli("bench", "--list").output.splitlines())
    assert {"ticking", "features", "observers", "load", "growth", "publishing"} <= listed.keys()
    assert listed["growth"].startswith("How costs grow")


def test_unknown_benchmark_is_refused_with_a_suggestion(cli: Cli) -> None:
    result = cli("bench", "tickng")
    assert result.exit_code == 2
    assert "Did you mean 'ticking'?" in result.output


@pytest.mark.usefixtures("folder")
def test_options_are_passed_to_the_benchmark(cli: Cli, tmp_path: Path) -> None:
    cli("bench", "telling", "--pairs", "3", "--quick", "--json", tmp_path / "all.json")
    [told] = json.loads((tmp_path / "all.json").read_text(encoding="utf-8"))
    assert told["options"] == ["--pairs", "3", "--quick"]


@pytest.mark.usefixtures("folder")
def test_benchmark_without_its_library_is_skipped_and_the_others_run(cli: Cli) -> None:
    result = cli("bench", "lacking", "telling")
    assert result.exit_code == 0
    assert "'lacking' was not run: the module 'no_such_thing' is not installed" in words(result)
    assert "telling: ours / theirs 3 2.9 – 3.25 ≥ 2 ✓" in words(result)


@pytest.mark.usefixtures("folder")
def test_failing_benchmark_is_reported_after_the_others(cli: Cli, tmp_path: Path) -> None:
    result = cli("bench", "broken", "telling", "--json", tmp_path / "all.json")
    assert result.exit_code == 2
    assert "'broken' failed: " in words(result)
    assert "the scale is bent" in result.output
    [told] = json.loads((tmp_path / "all.json").read_text(encoding="utf-8"))
    assert told["benchmark"] == "telling"


@pytest.mark.usefixtures("folder")
def test_beside_shows_the_results_of_another_run_by_build(cli: Cli, tmp_path: Path) -> None:
    row = {"what": "ours / theirs", "median": 24.5, "low": 24.0, "high": 25.0, "target": "≥ 30", "met": False}
    other = [{"benchmark": "telling", "build": "compiled", "rows": [row]}]
    (tmp_path / "other.json").write_text(json.dumps(other), encoding="utf-8")
    result = cli("bench", "telling", "--beside", tmp_path / "other.json")
    assert "ratios with targets compiled spread target pure spread target" in words(result)
    assert "ours / theirs 24.5 24 – 25 ≥ 30 ✗ 3 2.9 – 3.25 ≥ 2 ✓" in words(result)


@pytest.mark.usefixtures("folder")
def test_beside_refuses_a_file_that_bench_did_not_write(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "other.json").write_text("[1, 2]", encoding="utf-8")
    result = cli("bench", "telling", "--beside", tmp_path / "other.json")
    assert result.exit_code == 2
    assert "was not written by 'btcore bench --json'" in words(result)
