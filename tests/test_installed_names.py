"""btcore works beside a user's modules of the same names, and type checkers find its types."""

import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
APP = ROOT / "tests" / "typing" / "app.py"


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """Create a user's project whose modules have the names of our top-level folders."""
    (tmp_path / "monitor.py").write_text("NAME = 'their monitor'\n", encoding="utf-8")
    for name in ("sim", "robot_nodes", "trees"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text(f"NAME = 'their {name}'\n", encoding="utf-8")
    # A clone of this repository beside a script looks like this: a folder that is not a package.
    (tmp_path / "btcore").mkdir()
    (tmp_path / "btcore" / "setup.py").write_text("raise RuntimeError('imported')\n", encoding="utf-8")
    return tmp_path


def python(project: Path, *arguments: str) -> str:
    """Run Python in *project* and return its output. A non-zero exit status fails the test."""
    done = subprocess.run(
        [sys.executable, *arguments], cwd=project, capture_output=True, text=True, timeout=100, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_user_modules_and_btcore_packages_are_imported_side_by_side(project: Path) -> None:
    (project / "main.py").write_text(
        "import monitor, robot_nodes, sim, trees\n"
        "import btcore, btcore_monitor.serve, btcore_robot.robot, btcore_sim\n"
        "print(monitor.NAME, robot_nodes.NAME, sim.NAME, trees.NAME, sep=', ')\n"
        "print(btcore.Builder().build(btcore.Builder().AlwaysSuccess()).tick_once().name)\n",
        encoding="utf-8",
    )
    printed = python(project, "main.py").splitlines()
    assert printed == ["their monitor, their robot_nodes, their sim, their trees", "SUCCESS"]


@pytest.mark.parametrize(
    "arguments",
    [
        ("run", "bumpgo", "--fast", "--duration", "2", "--seed", "1", "--json"),
        ("nodes",),
        ("show", "patrolling"),
        ("monitor", "--help"),
        ("drive", "--help"),
        ("map", "--help"),
    ],
    ids=lambda arguments: arguments[0],
)
def test_commands_run_in_a_user_project(project: Path, arguments: tuple[str, ...]) -> None:
    if arguments[0] == "run":
        pytest.importorskip("pybullet")
    assert python(project, "-m", "btcore", *arguments)


@pytest.mark.parametrize("example", ["01_first_tree.py", "04_bump_and_go.py", "05_watch_a_tree.py"])
def test_examples_run_in_a_user_project(project: Path, example: str) -> None:
    if example == "04_bump_and_go.py":
        pytest.importorskip("pybullet")
    shutil.copy(ROOT / "examples" / example, project)
    assert python(project, example)


def test_installed_command_runs_in_a_user_project(project: Path) -> None:
    command = Path(sys.executable).with_name("btcore")
    if not command.exists():
        pytest.skip("btcore isn't installed in this environment")
    done = subprocess.run([command, "nodes"], cwd=project, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.skipif(importlib.util.find_spec("mypy") is None, reason="mypy isn't installed")
def test_mypy_in_strict_mode_accepts_an_app(project: Path) -> None:
    shutil.copy(APP, project)
    printed = python(project, "-m", "mypy", "--strict", "--cache-dir", str(project / "cache"), "app.py")
    assert "Success" in printed
