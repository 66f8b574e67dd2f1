"""The choice of the build: compiled or pure, and never a mixture of both."""

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
loaded = sys.modules.items()
files = [module.__file__ for name, module in loaded if name.startswith(("btcore.", "btcore_batch."))]
print(*sorted({pathlib.Path(file).suffix for file in files}))
print(btcore.builds.active_build())
"""

only_compiled = pytest.mark.skipif(builds.active_build() == "pure", reason="nothing here is compiled")


def setup_script() -> ModuleType:
    """Import the setup.py of the checkout, which lists the modules to compile."""
    spec = importlib.util.spec_from_file_location("setup_script", Path(__file__).parents[2] / "setup.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def hot_modules() -> set[str]:
    """Return the names of the modules that setup.py compiles."""
    script = setup_script()
    files = [Path(file) for group in script.GROUPS for file in script.hot_modules(group)]
    return {
        ".".join(file.relative_to("tools" if file.parts[0] == "tools" else "").with_suffix("").parts)
        for file in files
    }


def run_python(*arguments: str, home: Path | None = None, **environment: str) -> str:
    """Return the output of a new Python with the btcore in *home*, or with the installed btcore."""
    chosen = ("BTCORE_PURE", "BTCORE_COMPILED")
    inherited = {key: value for key, value in os.environ.items() if key not in chosen}
    where = {} if home is None else {"PYTHONPATH": str(home)}
    # -P: do not import btcore from the current folder.
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
    """Copy btcore with its compiled files into a folder, and return the folder."""
    shutil.copytree(PACKAGE, tmp_path / "btcore")
    for library in PACKAGE.parent.glob(builds.library_of("btcore") + ".*"):
        shutil.copy2(library, tmp_path)
    return tmp_path


def break_modules(*modules: Path) -> None:
    """Put an unloadable extension module beside each module; Python prefers it to the source."""
    for module in modules:
        module.with_name(module.stem + SUFFIX).write_text("compiled from another source")


# --- choosing


@pytest.mark.skipif("BTCORE_EXPECT" not in os.environ, reason="BTCORE_EXPECT names no build to expect")
def test_build_under_test_is_the_expected_build() -> None:
    expected = os.environ["BTCORE_EXPECT"]
    assert builds.active_build() == expected
    assert f"({expected} build, Python " in run_python("-m", "btcore", "--version")


def test_btcore_pure_selects_the_source_of_any_install() -> None:
    assert run_python("-c", FILES, *hot_modules(), BTCORE_PURE="1").split() == [".py", "pure"]


@only_compiled
def test_version_reports_unused_compiled_files() -> None:
    version = run_python("-m", "btcore", "--version", BTCORE_PURE="1")
    assert "(pure build, " in version
    assert version.endswith("are not used: BTCORE_PURE is set\n")


def test_empty_or_zero_btcore_pure_changes_nothing() -> None:
    as_installed = run_python("-c", FILES)
    assert run_python("-c", FILES, BTCORE_PURE="") == as_installed
    assert run_python("-c", FILES, BTCORE_PURE="0") == as_installed


# --- complete installs


@only_compiled
def test_every_hot_module_is_compiled() -> None:
    hot = hot_modules()
    assert {"btcore.engine.node", "btcore.tree.tree", "btcore.nodes.parallel", "btcore_batch.node"} <= hot
    assert {*builds.compiled_modules("btcore"), *builds.compiled_modules("btcore_batch")} == hot
    files = [str(importlib.import_module(name).__file__) for name in hot]
    assert [file for file in files if not file.endswith(SUFFIX)] == []


@only_compiled
def test_incomplete_install_runs_its_source(home: Path) -> None:
    (home / "btcore" / "tree" / ("tree" + SUFFIX)).unlink()
    first, second = run_python("-m", "btcore", "--version", home=home).splitlines()
    assert "(pure build, " in first
    assert second.endswith(": btcore.tree.tree is missing among them; reinstall btcore")


def test_compiled_files_without_their_library_are_not_used(home: Path) -> None:
    for library in home.glob(builds.library_of("btcore") + ".*"):
        library.unlink()
    break_modules(home / "btcore" / "engine" / "node.py", home / "btcore" / "nodes" / "sequence.py")
    first, second = run_python("-m", "btcore", "--version", home=home).splitlines()
    assert "(pure build, " in first
    assert second.endswith("are not used: btcore__mypyc, which they need, is missing")


def test_compiled_files_with_an_unloadable_library_are_not_used(home: Path) -> None:
    break_modules(home / "btcore__mypyc.py", home / "btcore" / "engine" / "node.py")
    first, second = run_python("-m", "btcore", "--version", home=home).splitlines()
    assert "(pure build, " in first
    assert "are not used: btcore__mypyc, which they need, can't be loaded (" in second


def test_checkout_runs_its_source_despite_compiled_files(home: Path) -> None:
    for name in ("setup.py", "pyproject.toml"):
        (home / name).touch()
    package = home / "btcore"
    break_modules(home / "btcore__mypyc.py", package / "engine" / "node.py", package / "script" / "lexer.py")
    assert run_python("-c", FILES, home=home).split() == [".py", "pure"]
    first, second = run_python("-m", "btcore", "--version", home=home).splitlines()
    assert "(pure build, " in first
    assert second.endswith("are not used: a checkout runs its source, unless BTCORE_COMPILED=1 is set")


@only_compiled
def test_btcore_compiled_selects_the_compiled_build_in_a_checkout(home: Path) -> None:
    for name in ("setup.py", "pyproject.toml"):
        (home / name).touch()
    assert run_python("-c", FILES, home=home).split()[-1] == "pure"
    assert run_python("-c", FILES, home=home, BTCORE_COMPILED="1").split()[-1] == "compiled"


# --- building


def test_development_install_compiles_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    script = setup_script()
    for variable in ("BTCORE_PURE", "BTCORE_COMPILED"):
        monkeypatch.delenv(variable, raising=False)
    for command, compiles in {"bdist_wheel": True, "build_ext": True, "editable_wheel": False}.items():
        monkeypatch.setattr(sys, "argv", ["setup.py", command])
        assert script.should_compile() is compiles


@pytest.mark.parametrize(("variable", "value"), [("BTCORE_PURE", "1"), ("BTCORE_COMPILED", "0")])
def test_variable_for_the_pure_build(monkeypatch: pytest.MonkeyPatch, variable: str, value: str) -> None:
    monkeypatch.setenv(variable, value)
    monkeypatch.setattr(sys, "argv", ["setup.py", "bdist_wheel"])
    assert setup_script().should_compile() is False
