"""`make check` finds the tests of every file, and reports what fails and what it skips."""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parent.parent
PAGE = "docs/guides/ports.md"
EXAMPLE = "tests/test_examples.py::test_example_prints_the_expected_lines[01_first_tree.py]"


@pytest.fixture(scope="module")
def check() -> ModuleType:
    spec = importlib.util.spec_from_file_location("check", ROOT / "tests/check.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_source_file_has_tests(check: ModuleType) -> None:
    found = {file: check.tests_of(file) for file in check.sources()}
    assert len(found) > 400
    assert [file for file, tests in found.items() if not tests] == []
    assert {test for tests in found.values() for test in tests if not (ROOT / test).is_file()} == set()


def test_folders_of_tests_are_those_of_the_packages(check: ModuleType) -> None:
    folders = {
        f"{tests}/{path.parent.relative_to(ROOT / package).as_posix()}".removesuffix("/.")
        for package, tests in check.PACKAGES.items()
        for path in (ROOT / package).rglob("*.py")
    }
    found = {
        Path(test).parent.as_posix() for tests in check.PACKAGES.values() for test in check.test_files(tests)
    }
    # The sources of the page are in TypeScript.
    assert found - folders == {"tests/tools/btcore_studio/page"}


def test_test_files_that_other_files_name_exist() -> None:
    files = [ROOT / "Makefile", ROOT / "pyproject.toml", ROOT / "tests/check.py"]
    files += [*(ROOT / "tests/acceptance").glob("*.py"), *ROOT.glob("*/*.md"), *ROOT.glob("*/*/*.md")]
    texts = [file.read_text(encoding="utf-8") for file in files]
    named = {name for text in texts for name in re.findall(r"\btests/[\w/]+\.py\b", text)}
    # Readers of the recipes and of the pages create these files.
    created = r"^\+\+\+ (tests/\S+)|--save-test (tests/\S+)"
    named -= {name for text in texts for names in re.findall(created, text, re.MULTILINE) for name in names}
    conftest = (ROOT / "tests/conftest.py").read_text(encoding="utf-8")
    named |= {f"tests/{name}" for name in re.findall(r'"(\w+/[\w/]+\.py)"', conftest)}
    assert len(named) > 30
    assert [name for name in sorted(named) if not (ROOT / name).is_file()] == []


def test_every_tree_and_world_has_tests(check: ModuleType) -> None:
    files = [*(ROOT / "trees").rglob("*.xml"), *(ROOT / "sim").rglob("*.json")]
    names = [path.relative_to(ROOT).as_posix() for path in files]
    assert len(names) > 10
    assert [name for name in names if not check.tests_of(name)] == []


@pytest.mark.parametrize(
    ("file", "first"),
    [
        ("btcore/nodes/timing.py", "tests/btcore/nodes/test_timing.py"),
        ("btcore/engine/coroutine.py", "tests/btcore/engine/test_coroutines.py"),
        ("monitor/btcore_drawing/data_flow.py", "tests/monitor/drawing/test_data_flow.py"),
        ("btcore/script/lexer.py", "tests/btcore/script/test_script.py"),
        ("btcore/nodes/try_catch.py", "tests/conformance/test_recorded_trees.py"),
        ("tools/btcore_studio/convert/nodes.py", "tests/tools/btcore_studio/convert/test_convert.py"),
        ("btcore/xml/plan/hints.py", "tests/btcore/xml/plan/test_messages.py"),
        ("monitor/btcore_monitor/wire/groot2.py", "tests/monitor/wire/test_groot2.py"),
        ("robot_nodes/btcore_robot/leaves/drive.py", "tests/robot_nodes/leaves/test_drive.py"),
        ("sim/btcore_sim/battery.py", "tests/sim/test_battery.py"),
        ("tests/sim/test_battery.py", "tests/sim/test_battery.py"),
        ("tests/sim/conftest.py", "tests/sim"),
        ("tests/conftest.py", "tests/test_time_limit.py"),
        (PAGE, f"tests/docs/test_docs.py::test_the_examples_of_a_page_run[{PAGE}]"),
        ("docs/site/navigation.md", "tests/docs/test_site.py"),
        ("examples/01_first_tree.py", EXAMPLE),
        ("benchmarks/startup.py", "tests/test_benchmarks.py::test_a_benchmark_runs[startup]"),
        ("trees/bumpgo.xml", "tests/robot_nodes/test_trees.py"),
        ("README.md", "tests/test_readme.py"),
    ],
)
def test_closest_test_of_a_file(check: ModuleType, file: str, first: str) -> None:
    assert (ROOT / file).is_file()
    assert check.tests_of(file)[0] == first


def test_tests_of_several_files_have_no_duplicates(check: ModuleType) -> None:
    files = ["tests/sim/test_laser.py", "sim/btcore_sim/battery.py", "tests/sim/conftest.py"]
    assert check.all_tests_of(files) == ["tests/sim"]
    assert (
        check.all_tests_of(["btcore/nodes/timing.py", "btcore/nodes/try_catch.py"]).count(
            "tests/conformance/test_recorded_trees.py"
        )
        == 1
    )


def test_parametrised_tests_are_collected_by_pytest(check: ModuleType) -> None:
    tests = check.all_tests_of([PAGE, "examples/01_first_tree.py", "benchmarks/startup.py"])
    command = [sys.executable, "-m", "pytest", "-q", "--collect-only", "-p", "no:cacheprovider", *tests]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=100)
    assert done.returncode == 0, done.stdout
    assert len(tests) == 5
    assert set(tests) <= set(done.stdout.splitlines())


# --- the command


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A repository with the script and a test."""
    for name in ("check.py", "conftest.py"):
        (tmp_path / "tests").mkdir(exist_ok=True)
        shutil.copy(ROOT / "tests" / name, tmp_path / "tests")
    script = tmp_path / "tests/check.py"
    text = script.read_text(encoding="utf-8")
    assert "START_LIMIT = 12.0 " in text
    script.write_text(text.replace("START_LIMIT = 12.0 ", "START_LIMIT = 100.0 "), encoding="utf-8")
    (tmp_path / "pyproject.toml").write_text("[tool.pytest.ini_options]\naddopts = '-ra'\n", encoding="utf-8")
    (tmp_path / ".gitignore").write_text("__pycache__/\n.*_cache/\n", encoding="utf-8")
    (tmp_path / "tests/test_it.py").write_text(TEST, encoding="utf-8")
    git = ["git", "-c", "user.name=a", "-c", "user.email=a@b.c", "-c", "init.defaultBranch=main"]
    for command in (["init", "-q"], ["add", "."], ["commit", "-qm", "Add a test"]):
        subprocess.run([*git, *command], cwd=tmp_path, check=True)
    return tmp_path


TEST = "def test_it() -> None:\n    assert True\n"


def run(project: Path, *files: str) -> tuple[int, str]:
    done = subprocess.run(
        [sys.executable, project / "tests/check.py", *files],
        cwd=project,
        # The other plugins take longer to import than these tests.
        env={**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1", "PYTEST_PLUGINS": "xdist.plugin"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
        timeout=100,
    )
    return done.returncode, done.stdout


def test_without_files_it_checks_what_differs_from_the_main_branch(project: Path) -> None:
    code, output = run(project)
    assert (code, output) == (0, 'no file differs from the main branch; FILES="…" selects files\n')
    (project / "tests/test_new.py").write_text(TEST, encoding="utf-8")
    code, output = run(project)
    assert code == 0
    assert "· style of 1 Python file" in output
    assert "· tests: pytest tests/test_new.py\n" in output
    assert "1 passed" in output
    assert "· types: skipped, no Python file of a package" in output
    assert output.splitlines()[-1].startswith("passed (")


def test_a_failure_of_each_check_is_reported(project: Path) -> None:
    test = project / "tests/test_it.py"
    test.write_text(TEST.replace("True", "undefined"), encoding="utf-8")
    code, output = run(project)
    assert code == 1
    assert "F821" in output
    assert output.splitlines()[-1].startswith("failed: style (`ruff check`), tests (")
    test.write_text(TEST.replace("    ", "  "), encoding="utf-8")
    code, output = run(project, "tests/test_it.py")
    assert code == 1
    assert output.splitlines()[-1].startswith("failed: style (`ruff format`) (")


def test_the_tests_of_ros_run_in_its_environment_if_there_is_one(project: Path) -> None:
    (project / "tests/ros2").mkdir()
    files = ["tests/ros2/test_ros.py", "tests/test_it.py"]
    (project / files[0]).write_text(
        'import os\n\n\ndef test_ros() -> None:\n    assert os.environ["IN_ROS"]\n', encoding="utf-8"
    )
    code, output = run(project, *files)
    assert code == 1
    assert "KeyError: 'IN_ROS'" in output
    python = project / ".venv-ros/bin/python"
    python.parent.mkdir(parents=True)
    python.write_text(f'#!/bin/sh\nIN_ROS=1 exec {sys.executable} "$@"\n', encoding="utf-8")
    python.chmod(0o755)
    code, output = run(project, *files)
    assert code == 0
    assert "· tests: in .venv-ros: pytest tests/ros2/test_ros.py" in output
    assert "· tests: pytest tests/test_it.py" in output


def test_a_file_without_tests_is_reported_and_an_unknown_file_is_an_error(project: Path) -> None:
    code, output = run(project, ".gitignore")
    assert code == 0
    assert "· tests: skipped, none belongs to these files" in output
    code, output = run(project, "tests/test_it.py", "missing.py")
    assert code == 2
    assert output == f"error: not a file of this repository: {project / 'missing.py'}\n"


TWO_TESTS = TEST + "\n\n" + TEST.replace("test_it", "test_two")


@pytest.mark.parametrize("has_several_processes", [False, True])
def test_tests_not_started_make_the_check_incomplete(project: Path, has_several_processes: bool) -> None:
    """The tests of the closest file are started nevertheless."""
    script = project / "tests/check.py"
    text = script.read_text(encoding="utf-8").replace("str(os.cpu_count() or 1)", '"1"')
    script.write_text(text.replace("MANY = 3 ", f"MANY = {1 if has_several_processes else 3} "))
    files = ["tests/test_it.py", "tests/test_other.py"]
    for file in files:
        (project / file).write_text(TWO_TESTS, encoding="utf-8")
    code, output = run(project, *files, "--limit", "1e-9")
    assert "2 passed, 2 skipped" in output
    assert output.splitlines()[-1].startswith("incomplete: 2 tests not started; LIMIT=0 runs all (")
    assert code == 0


def test_a_limit_of_0_starts_all_tests_and_a_failure_precedes_an_incomplete_check(project: Path) -> None:
    files = ["tests/test_it.py", "tests/test_other.py"]
    (project / files[0]).write_text(TWO_TESTS.replace("True", "False"), encoding="utf-8")
    (project / files[1]).write_text(TWO_TESTS, encoding="utf-8")
    code, output = run(project, *files, "--limit", "0")
    assert "2 failed, 2 passed" in output
    assert (code, output.splitlines()[-1][:15]) == (1, "failed: tests (")
    code, output = run(project, *files, "--limit", "1e-9")
    assert code == 1
    assert output.splitlines()[-1].startswith("failed: tests; incomplete: 2 tests not started")


def test_many_test_files_are_limited(project: Path) -> None:
    script = project / "tests/check.py"
    text = script.read_text(encoding="utf-8")
    script.write_text(text.replace("AT_MOST = 40 ", "AT_MOST = 1 "), encoding="utf-8")
    files = [f"tests/test_{number}.py" for number in range(3)]
    for file in files:
        (project / file).write_text(TEST, encoding="utf-8")
    code, output = run(project, *files)
    assert code == 0
    assert "1 passed" in output
    assert output.splitlines()[-1].startswith("incomplete: 2 test files left out; LIMIT=0 runs all (")
    code, output = run(project, *files, "--limit", "0")
    assert code == 0
    assert "3 passed" in output
