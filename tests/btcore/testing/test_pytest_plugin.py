"""The pytest plugin, in separate runs of pytest."""

import importlib
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import btcore

HOME = Path(btcore.__file__).parent.parent

TREE = """
XML = '''<root BTCPP_format="4"><BehaviorTree ID="Main">
  <Sequence name="all"><Drive name="out"/><Sleep name="rest" msec="100"/></Sequence>
</BehaviorTree></root>'''

from btcore import Status, action

@action
def drive() -> bool:
    return True
"""


def run(folder: Path, test: str, *options: str, without: str = "") -> subprocess.CompletedProcess[str]:
    """Run pytest on *test* with only the plugin; the module *without* cannot be imported."""
    (folder / "test_it.py").write_text(TREE + test, encoding="utf-8")
    if without:
        blocked = folder / "blocked"
        blocked.mkdir()
        message = f"No module named '{without}'"
        (blocked / f"{without}.py").write_text(
            f"raise ModuleNotFoundError({message!r}, name={without!r})\n", encoding="utf-8"
        )
    paths = [str(folder / "blocked")] * bool(without) + [str(HOME)]
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "btcore.testing.pytest_plugin", "-W", "error", *options],
        cwd=folder,
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join(paths),
            "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
            "PYTEST_ADDOPTS": "-p no:cacheprovider",
            "NO_COLOR": "1",
        },
        capture_output=True,
        text=True,
        check=False,
    )


def test_fixtures_build_trees_on_a_simulated_clock(tmp_path: Path) -> None:
    done = run(
        tmp_path,
        """
import sys
import pytest

def test_the_harness_takes_text_files_and_trees(btcore_registry, btcore_clock, btcore_harness, tmp_path):
    btcore_registry.add(drive)
    made = btcore_harness(XML)
    assert made.run() is Status.SUCCESS
    assert made.tree.clock is btcore_clock and btcore_clock.now() == 100_000_000
    file = tmp_path / "tree.xml"
    file.write_text(XML)
    assert btcore_harness(file).run() is Status.SUCCESS
    assert btcore_harness(made.tree).tree is made.tree

def test_each_test_has_a_registry_and_a_clock_of_its_own(btcore_registry, btcore_clock):
    assert "Drive" not in btcore_registry
    assert btcore_clock.now() == 0

def test_a_trace_follows_any_tree(btcore_registry, btcore_clock, btcore_trace):
    import btcore
    btcore_registry.add(drive)
    tree = btcore.loads(XML, nodes=btcore_registry, clock=btcore_clock)
    followed = btcore_trace(tree)
    tree.tick_once()
    assert followed.results("out") == [Status.SUCCESS]

class TestOwnFixture:
    @pytest.fixture
    def btcore_clock(self):
        return "mine"

    def test_a_users_fixture_overrides_the_fixture_of_the_same_name(self, btcore_clock):
        assert btcore_clock == "mine"

def test_the_plugin_does_not_import_hypothesis():
    assert "hypothesis" not in sys.modules
""",
    )
    assert done.returncode == 0, done.stdout
    assert "5 passed" in done.stdout


def test_only_a_failing_test_shows_the_trace_of_its_trees(tmp_path: Path) -> None:
    done = run(
        tmp_path,
        """
def test_it_passes(btcore_registry, btcore_harness):
    btcore_registry.add(drive)
    btcore_harness(XML).tick()

def test_it_fails(btcore_registry, btcore_harness):
    btcore_registry.add(drive)
    btcore_harness(XML).tick()
    assert False, "on purpose"
""",
    )
    assert "1 failed, 1 passed" in done.stdout
    assert done.stdout.count("tree 'Main'") == 1
    section = done.stdout.partition("btcore: tree 'Main'")[2].splitlines()
    assert section[1:4] == ["tick 1, at 0 s: RUNNING", "    all: IDLE → RUNNING", "    out: IDLE → SUCCESS"]
    assert "└── ◷ rest  Sleep  ▶ RUNNING  returned RUNNING" in section


def test_failed_assertion_shows_the_test_and_no_code_of_btcore(tmp_path: Path) -> None:
    done = run(
        tmp_path,
        """
from btcore.testing import assert_never_ran

def test_it_fails(btcore_registry, btcore_harness):
    btcore_registry.add(drive)
    made = btcore_harness(XML)
    made.tick()
    assert_never_ran(made, "rest")

def test_it_has_no_such_node(btcore_registry, btcore_harness):
    btcore_registry.add(drive)
    assert_never_ran(btcore_harness(XML), "nowhere")
""",
    )
    assert "2 failed" in done.stdout
    assert '>       assert_never_ran(made, "rest")' in done.stdout
    assert '>       assert_never_ran(btcore_harness(XML), "nowhere")' in done.stdout
    assert "assertions.py" not in done.stdout
    assert "trace.py" not in done.stdout


def test_failing_property_prints_the_shrunk_tree(tmp_path: Path) -> None:
    done = run(
        tmp_path,
        """
from hypothesis import Phase, given, settings
from btcore.testing import outcomes, trees

@settings(derandomize=True, database=None, phases=[Phase.generate, Phase.shrink])
@given(trees(), outcomes())
def test_no_tree_has_an_inverter(tree, plan):
    assert not [node for node in tree if node.id == "Inverter"]
""",
    )
    assert done.returncode == 1
    lines = [line.removeprefix("E").strip() for line in done.stdout.splitlines()]
    at = lines.index('<Inverter name="n1">')
    assert lines[at - 2 : at] == ['<root BTCPP_format="4">', '<BehaviorTree ID="Main">']
    assert lines[at + 1].startswith("<A")
    assert lines[at + 2 : at + 5] == ["</Inverter>", "</BehaviorTree>", "</root>"]


def test_plugin_works_without_hypothesis(tmp_path: Path) -> None:
    done = run(
        tmp_path,
        """
import pytest

def test_the_harness_works(btcore_registry, btcore_harness):
    btcore_registry.add(drive)
    assert btcore_harness(XML).run() is Status.SUCCESS

def test_a_strategy_says_what_it_needs():
    with pytest.raises(ImportError, match="trees requires hypothesis: pip install hypothesis"):
        from btcore.testing import trees
""",
        without="hypothesis",
    )
    assert done.returncode == 0, done.stdout
    assert "2 passed" in done.stdout


def test_pytest_finds_the_plugin_by_its_entry_point() -> None:
    project = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text(encoding="utf-8"))
    module = project["project"]["entry-points"]["pytest11"]["btcore"]
    assert hasattr(importlib.import_module(module), "btcore_harness")
