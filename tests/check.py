"""Check some files: their style, the types of all packages, and the tests that belong to the files.

`make check FILES="…"` runs this script. Without FILES it checks the files that differ from the main branch.
These tests belong to a file:

- a test file: itself; the conftest.py of a subfolder of tests/: the tests in its folder;
- a Python file of a package: of the folder in tests/ that corresponds to its own folder, or of the nearest
  parent folder that exists, first the tests with the module's name (test_NAME.py, test_NAME_….py), then the
  tests that import the module or use the functions and classes that it defines. Without any, tests in other
  folders that import or use it, or the tests of the modules that import it. The recorded cases of built-in
  nodes come first for a node without tests of its name;
- a page of the documentation, an example or a benchmark: its parametrised tests;
- any other file: the tests that contain its name, first the tests with this name.

The tests of ROS 2 run in .venv-ros if `make test-ros2` has made it. Otherwise tests that need it are skipped.

At most AT_MOST of these test files are run. No test is started later than LIMIT seconds after the first test,
except those of the closest test file, which always runs. `make check LIMIT=0` runs all these tests.

Exit codes:
  0  nothing failed; the last line begins with "incomplete" if some of the tests were not started
  1  a check failed
  2  a file does not exist, or LIMIT is not a number
"""

import argparse
import ast
import os
import re
import subprocess
import sys
import tempfile
import time
from functools import cache
from itertools import chain
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# The folders of the packages, and the folders of their tests.
PACKAGES = {
    "btcore": "tests/btcore",
    "monitor/btcore_drawing": "tests/monitor/drawing",
    "monitor/btcore_monitor": "tests/monitor",
    "monitor/btcore_scene": "tests/monitor",
    "robot_nodes/btcore_navigation": "tests/robot_nodes/navigation",
    "robot_nodes/btcore_robot": "tests/robot_nodes",
    "ros2/btcore_ros2": "tests/ros2",
    "sim/btcore_sim": "tests/sim",
    "tools/btcore_bags": "tests/tools/btcore_bags",
    "tools/btcore_batch": "tests/tools/btcore_batch",
    "tools/btcore_proof": "tests/tools/btcore_proof",
    "tools/btcore_recorder": "tests/tools/btcore_recorder",
    "tools/btcore_studio": "tests/tools/btcore_studio",
    "tools/btcore_sweep": "tests/tools/btcore_sweep",
}
# Built-in nodes and everything that they run on behave as in BehaviorTree.CPP.
NODES = "btcore/nodes/"
RECORDED = ("btcore/blackboard/", "btcore/engine/", NODES, "btcore/script/")
ROS2_TESTS = "tests/ros2"
ROS2_PYTHON = ROOT / ".venv-ros/bin/python"
RECORDED_TESTS = "tests/conformance/test_recorded_trees.py"
SITE_TESTS = "tests/docs/test_site.py"
TREE_TESTS = "tests/robot_nodes/test_trees.py"
PAGE_TESTS = (
    "tests/docs/test_docs.py::test_the_examples_of_a_page_run",
    "tests/docs/test_docs.py::test_every_block_of_a_page_is_of_a_known_kind",
    "tests/docs/test_docs.py::test_files_that_a_page_links_to_exist",
)
# Tests that contain the names of files, but do not test their content.
INCIDENTAL = {"tests/docs/test_docs.py", "tests/test_check.py"}
AT_MOST = 40  # test files, because pytest would need the time to import more
START_LIMIT = 12.0  # s after the first test
MANY = 3  # test files; more are tested in several processes


def changed_files() -> list[str]:
    """Return the files that differ from the main branch, including new files."""
    base = git("merge-base", "HEAD", "origin/main") or git("merge-base", "HEAD", "main") or ["HEAD"]
    changed = git("diff", "--name-only", "--no-renames", "--diff-filter=d", *base)
    return sorted({*changed, *git("ls-files", "--others", "--exclude-standard")})


def git(*arguments: str) -> list[str]:
    """Return the lines that a git command prints, or an empty list if it fails."""
    done = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=False)
    return done.stdout.splitlines() if done.returncode == 0 else []


def tests_of(file: str) -> list[str]:
    """Return the tests that belong to *file*, as arguments of pytest, the closest first."""
    path = Path(file)
    if path.name.startswith("test_") and path.suffix == ".py" and path.parts[0] == "tests":
        return [file]
    if path.name == "conftest.py" and len(path.parts) > 2:
        return [path.parent.as_posix()]
    if is_source(file):
        found = tests_of_source(file)
        if not file.startswith(RECORDED):
            return found
        first = file.startswith(NODES) and not any(has_name_of(test, file) for test in found[:1])
        return [RECORDED_TESTS, *found] if first else [*found, RECORDED_TESTS]
    if path.is_relative_to("docs/site"):
        return [SITE_TESTS]
    if path.suffix == ".md" and path.parts[0] in ("docs", path.name) and path.name != "README.md":
        return [*(f"{test}[{file}]" for test in PAGE_TESTS), *tests_with_name(path)]
    if path.is_relative_to("trees"):
        return list(dict.fromkeys([TREE_TESTS, *tests_with_name(path)]))
    if path.parent == Path("examples"):
        return [f"tests/test_examples.py::test_example_prints_the_expected_lines[{path.name}]"]
    if path.parent == Path("benchmarks") and path.suffix == ".py":
        return [f"tests/test_benchmarks.py::test_a_benchmark_runs[{path.stem}]"]
    return tests_with_name(path)


def is_source(file: str) -> bool:
    """Return whether *file* is a Python file of a package."""
    return file.endswith(".py") and file.startswith(tuple(f"{package}/" for package in PACKAGES))


def tests_of_source(file: str) -> list[str]:
    """Return the tests that belong to a Python file of a package."""
    package = package_of(file)
    path = Path(file).relative_to(package)
    folder = Path(PACKAGES[package], path.parent)
    while not (ROOT / folder).is_dir():
        folder = folder.parent
    found = tests_that_use(file, folder.as_posix(), by_name=True)
    if found:
        return found
    # In another folder, a test with the same name is that of another module.
    found = tests_that_use(file, "tests", by_name=False)
    if found:
        return found
    # A module that only its neighbours use: their tests, and those of the folder.
    whole = folder.as_posix() == PACKAGES[package]
    importers = [other for other in sources() if other != file and module_name(file) in words(other)]
    where = "tests" if whole else folder.as_posix()
    closest = [tests_that_use(other, where, by_name=True)[:1] for other in importers]
    others = [] if whole and any(closest) else test_files(folder.as_posix())
    return list(dict.fromkeys([*chain.from_iterable(closest), *others]))


@cache
def tests_that_use(file: str, folder: str, by_name: bool) -> list[str]:
    """Return the tests in *folder* that use a module or, if *by_name*, have its name, the closest first."""
    module = module_name(file)
    names = {module, *definitions(file)}
    ranked = []
    for test in test_files(folder):
        named = by_name and has_name_of(test, file)
        found = names & words(test)
        if named or found:
            ranked.append((not named, module not in found, -len(found), test))
    return [test for *_, test in sorted(ranked)]


def has_name_of(test: str, file: str) -> bool:
    """Return whether *test* is named after the module *file*."""
    return re.match(rf"test_{Path(file).stem}s?(_|$)", Path(test).stem) is not None


def package_of(file: str) -> str:
    """Return the folder of the package of a Python file."""
    return next(package for package in PACKAGES if file.startswith(f"{package}/"))


@cache
def module_name(file: str) -> str:
    """Return the name by which a Python file of a package is imported."""
    return ".".join(Path(file).relative_to(Path(package_of(file)).parent).with_suffix("").parts).removesuffix(
        ".__init__"
    )


@cache
def sources() -> list[str]:
    """Return the Python files of the packages."""
    return sorted(
        path.relative_to(ROOT).as_posix() for package in PACKAGES for path in (ROOT / package).rglob("*.py")
    )


@cache
def definitions(file: str) -> list[str]:
    """Return the public functions and classes that a Python file defines."""
    return [
        statement.name
        for statement in ast.parse(text(file)).body
        if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)
        and not statement.name.startswith("_")
    ]


def tests_with_name(path: Path) -> list[str]:
    """Return the tests that contain the name of a file, or, except for a page, the name without its suffix.

    Tests whose own name contains the name come first.
    """
    name = rf"(?<!\w){re.escape(path.name)}\b"
    if path.suffix != ".md":
        name += rf"|[\"']{re.escape(path.stem)}[\"']"
    ranked = sorted(
        (path.stem.lower() not in Path(test).stem, -count, test)
        for test in test_files("tests")
        if path.stem in text(test) and (count := len(re.findall(name, text(test))))
    )
    return [test for *_, test in ranked]


@cache
def test_files(folder: str) -> list[str]:
    """Return the test files in *folder* and its subfolders, except INCIDENTAL."""
    found = sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / folder).rglob("test_*.py"))
    return [test for test in found if test not in INCIDENTAL]


@cache
def words(file: str) -> set[str]:
    """Return the names in *file*: with their dots, and their last parts."""
    names = set(re.findall(r"[\w.]+", text(file)))
    names |= {
        ".".join(pair) for pair in re.findall(r"^from ([\w.]+) import (\w+)$", text(file), re.MULTILINE)
    }
    return names | {name.rpartition(".")[2] for name in names}


@cache
def text(file: str) -> str:
    """Return the content of *file*."""
    return (ROOT / file).read_text(encoding="utf-8")


def all_tests_of(files: list[str]) -> list[str]:
    """Return the tests of all *files* without duplicates, the closest tests of each file first."""
    lists = [tests_of(file) for file in files]
    longest = max(map(len, lists), default=0)
    found = dict.fromkeys(tests[rank] for rank in range(longest) for tests in lists if rank < len(tests))
    return [test for test in found if not any(test != other and inside(test, other) for other in found)]


def inside(test: str, other: str) -> bool:
    """Return whether pytest runs *test* already when it runs *other*."""
    return test.startswith((f"{other}/", f"{other}::"))


def main(arguments: list[str]) -> int:
    """Check files, print what was run and skipped, and return the exit code.

    Args:
        arguments: The arguments of the command line.
    """
    start = time.time()
    parser = argparse.ArgumentParser(allow_abbrev=False)
    parser.add_argument("files", nargs="*")
    parser.add_argument("--limit", type=float, default=START_LIMIT)
    chosen_options = parser.parse_args(arguments)
    limit: float = chosen_options.limit
    files = [Path(file).resolve() for file in chosen_options.files]
    wrong = [str(file) for file in files if not file.exists() or not file.is_relative_to(ROOT)]
    if wrong:
        print(f"error: not a file of this repository: {', '.join(wrong)}", file=sys.stderr)
        return 2
    names = [file.relative_to(ROOT).as_posix() for file in files]
    chosen = (
        [file for name in names for file in git("ls-files", "-co", "--exclude-standard", "--", name)]
        if names
        else changed_files()
    )
    if not chosen:
        print('no file differs from the main branch; FILES="…" selects files')
        return 0
    # mypy runs while the tests do.
    mypy = (
        subprocess.Popen([sys.executable, "-m", "mypy"], cwd=ROOT, stdout=subprocess.PIPE, text=True)
        if any(map(is_source, chosen))
        else None
    )
    failed = check_style([file for file in chosen if file.endswith(".py")])
    tests = all_tests_of(chosen)
    left_out = tests[AT_MOST:] if limit else []
    not_started = 0
    if tests:
        for interpreter, chosen_tests in by_interpreter(tests[: len(tests) - len(left_out)]):
            code, skipped = run_tests(interpreter, chosen_tests, limit, tests[0])
            not_started += skipped
            if code != 0 and "tests" not in failed:
                failed.append("tests")
    else:
        print("· tests: skipped, none belongs to these files")
    if mypy is not None:
        print("· types of all packages")
        print(mypy.communicate()[0], end="")
        if mypy.returncode != 0:
            failed.append("types (`mypy`)")
    else:
        print("· types: skipped, no Python file of a package")
    missing = [f"{counted(not_started, 'test')} not started"] if not_started else []
    missing += [f"{counted(len(left_out), 'test file')} left out"] if left_out else []
    results = [f"failed: {', '.join(failed)}"] if failed else []
    results += [f"incomplete: {', '.join(missing)}; LIMIT=0 runs all"] if missing else []
    print(f"{'; '.join(results) or 'passed'} ({time.time() - start:.0f} s)")
    return 1 if failed else 0


def check_style(files: list[str]) -> list[str]:
    """Check the style of Python *files*, and return which checks failed."""
    if not files:
        print("· style: skipped, no Python file")
        return []
    print(f"· style of {counted(len(files), 'Python file')}")
    commands = (["check", "--quiet"], ["format", "--check"])
    return [
        f"style (`ruff {command[0]}`)"
        for command in commands
        if run([sys.executable, "-m", "ruff", *command, *files]) != 0
    ]


def by_interpreter(tests: list[str]) -> list[tuple[str, list[str]]]:
    """Return which Python runs which of *tests*, without empty lists."""
    ros2 = str(ROS2_PYTHON) if ROS2_PYTHON.exists() else sys.executable
    found: dict[str, list[str]] = {}
    for test in tests:
        found.setdefault(ros2 if Path(test).is_relative_to(ROS2_TESTS) else sys.executable, []).append(test)
    return list(found.items())


def run_tests(interpreter: str, tests: list[str], limit: float, closest: str) -> tuple[int, int]:
    """Run *tests*, and print them before.

    Args:
        interpreter: The Python that runs pytest.
        tests: The tests.
        limit: The time (s) after the first test after which no test is started; 0 = no limit.
        closest: The test to which the limit does not apply.

    Returns:
        pytest's exit code, and the number of tests that were not started.
    """
    place = "" if interpreter == sys.executable else "in .venv-ros: "
    print(f"· tests: {place}pytest", *tests)
    # One test at a time is sent to a process, in the order of the files.
    several = ["-n", str(os.cpu_count() or 1), "--maxschedchunk=1"]
    processes = several if len(tests) > MANY else ["-p", "no:xdist"]
    with tempfile.TemporaryDirectory() as folder:
        count = Path(folder, "not_started")
        environment = dict(os.environ)
        if limit:
            environment |= {
                "BTCORE_TEST_START_LIMIT": str(limit),
                "BTCORE_TEST_WITHOUT_LIMIT": str(ROOT / closest.partition("::")[0]),
                "BTCORE_TEST_NOT_STARTED": str(count),
            }
        code = run([interpreter, "-m", "pytest", "-q", *processes, *tests], environment)
        return code, int(count.read_text()) if count.exists() else 0


def counted(number: int, noun: str) -> str:
    """Return *number* with *noun*."""
    return f"{number} {noun}{'s' * (number != 1)}"


def run(command: list[str], environment: dict[str, str] | None = None) -> int:
    """Run *command* in the root folder, and return its exit code."""
    sys.stdout.flush()
    return subprocess.run(command, cwd=ROOT, env=environment, check=False).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
