"""Which build runs, how to choose it, and that there is nothing between the two."""

import importlib.util
import os
import shutil
import subprocess
import sys
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from types import ModuleType

import pytest

import btcore
from btcore import builds

PACKAGE = Path(btcore.__file__).parent
SUFFIX = EXTENSION_SUFFIXES[0]
FILES = """
import importlib, pathlib, sys
import btcore
for name in sys.argv[1:]:
    importlib.import_module(name)
files = [one.__file__ for name, one in sys.modules.items() if name.startswith("btcore.")]
print(*sorted({pathlib.Path(file).suffix for file in files}))
print(btcore.builds.active_build())
"""

only_compiled = pytest.mark.skipif(builds.active_build() == "pure", reason="nothing here is compiled")


def setup_script() -> ModuleType:
    """The checkout's setup.py, which knows what is to be compiled."""
    spec = importlib.util.spec_from_file_location("setup_script", Path(__file__).parents[2] / "setup.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def said_by(*arguments: str, home: Path | None = None, **environment: str) -> str:
    """What a new Python says, with the btcore in *home*, or the one that is installed."""
    chosen = ("BTCORE_PURE", "BTCORE_COMPILED")
    inherited = {key: value for key, value in os.environ.items() if key not in chosen}
    where = {} if home is None else {"PYTHONPATH": str(home)}
    # -P: not with the btcore of the folder that the tests are run in.
    done = subprocess.run(
        [sys.executable, "-P", *arguments],
        env=inherited | where | environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.replace(str(home), "HOME")


@pytest.fixture
def home(tmp_path: Path) -> Path:
    """A folder with a copy of btcore in it, compiled files and all."""
    shutil.copytree(PACKAGE, tmp_path / "btcore")
    for library in PACKAGE.parent.glob(builds.LIBRARY + ".*"):
        shutil.copy2(library, tmp_path)
    return tmp_path


def compile_badly(*modules: Path) -> None:
    """Put something beside each module that Python would load in its place, and fail."""
    for module in modules:
        module.with_name(module.stem + SUFFIX).write_text("compiled from another source")


# --- choosing


@pytest.mark.skipif("BTCORE_EXPECT" not in os.environ, reason="BTCORE_EXPECT names no build to expect")
def test_the_build_under_test_is_the_one_that_is_meant_to_be() -> None:
    expected = os.environ["BTCORE_EXPECT"]
    assert builds.active_build() == expected
    assert f"({expected} build, Python " in said_by("-m", "btcore", "--version")


def test_btcore_pure_takes_the_source_of_any_install() -> None:
    hot = setup_script().hot_modules()
    names = [".".join(Path(file).with_suffix("").parts) for file in hot]
    assert said_by("-c", FILES, *names, BTCORE_PURE="1").split() == [".py", "pure"]


@only_compiled
def test_it_says_so_where_there_is_something_compiled() -> None:
    version = said_by("-m", "btcore", "--version", BTCORE_PURE="1")
    assert "(pure build, " in version
    assert version.endswith("are not used: BTCORE_PURE is set\n")


def test_btcore_pure_set_to_nothing_or_0_changes_nothing() -> None:
    as_installed = said_by("-c", FILES)
    assert said_by("-c", FILES, BTCORE_PURE="") == as_installed
    assert said_by("-c", FILES, BTCORE_PURE="0") == as_installed


# --- whole


@only_compiled
def test_every_hot_module_is_compiled() -> None:
    hot = {".".join(Path(file).with_suffix("").parts) for file in setup_script().hot_modules()}
    assert {"btcore.engine.node", "btcore.tree.tree", "btcore.nodes.parallel", "btcore.script.program"} <= hot
    assert set(builds.compiled_modules()) == hot
    files = [str(importlib.import_module(name).__file__) for name in hot]
    assert [file for file in files if not file.endswith(SUFFIX)] == []


@only_compiled
def test_an_install_that_lacks_a_part_runs_its_source(home: Path) -> None:
    (home / "btcore" / "tree" / ("tree" + SUFFIX)).unlink()
    first, second = said_by("-m", "btcore", "--version", home=home).splitlines()
    assert "(pure build, " in first
    assert second.endswith(": btcore.tree.tree is missing among them; reinstall btcore")


def test_compiled_files_without_their_library_are_not_used(home: Path) -> None:
    for library in home.glob(builds.LIBRARY + ".*"):
        library.unlink()
    compile_badly(home / "btcore" / "engine" / "node.py", home / "btcore" / "nodes" / "sequence.py")
    first, second = said_by("-m", "btcore", "--version", home=home).splitlines()
    assert "(pure build, " in first
    assert second.endswith("are not used: btcore__mypyc, which they need, is missing")


def test_compiled_files_with_an_unloadable_library_are_not_used(home: Path) -> None:
    compile_badly(home / "btcore__mypyc.py", home / "btcore" / "engine" / "node.py")
    first, second = said_by("-m", "btcore", "--version", home=home).splitlines()
    assert "(pure build, " in first
    assert "are not used: btcore__mypyc, which they need, can't be loaded (" in second


def test_a_checkout_runs_its_source_whatever_was_compiled_in_it(home: Path) -> None:
    for name in ("setup.py", "pyproject.toml"):
        (home / name).touch()
    package = home / "btcore"
    compile_badly(home / "btcore__mypyc.py", package / "engine" / "node.py", package / "script" / "lexer.py")
    assert said_by("-c", FILES, home=home).split() == [".py", "pure"]
    first, second = said_by("-m", "btcore", "--version", home=home).splitlines()
    assert "(pure build, " in first
    assert second.endswith("are not used: a checkout runs its source, unless BTCORE_COMPILED=1 is set")


@only_compiled
def test_who_works_on_the_compiled_build_may_run_it_in_a_checkout(home: Path) -> None:
    for name in ("setup.py", "pyproject.toml"):
        (home / name).touch()
    assert said_by("-c", FILES, home=home).split()[-1] == "pure"
    assert said_by("-c", FILES, home=home, BTCORE_COMPILED="1").split()[-1] == "compiled"


# --- making


def test_the_commands_of_a_development_install_compile_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    script = setup_script()
    monkeypatch.delenv("BTCORE_PURE", raising=False)
    for command, compiles in {"bdist_wheel": True, "build_ext": True, "editable_wheel": False}.items():
        monkeypatch.setattr(sys, "argv", ["setup.py", command])
        assert script.should_compile() is compiles
    monkeypatch.setenv("BTCORE_PURE", "1")
    monkeypatch.setattr(sys, "argv", ["setup.py", "bdist_wheel"])
    assert script.should_compile() is False
