"""The packaging metadata match the files of the repository."""

import tomllib
from pathlib import Path

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PARENTS = PROJECT["tool"]["setuptools"]["packages"]["find"]["where"]
PACKAGES = {"btcore", "btcore_monitor", "btcore_robot", "btcore_scene", "btcore_sim"}


def test_every_package_is_installed_and_named_btcore() -> None:
    found = {path.parent.name for parent in PARENTS for path in (ROOT / parent).glob("*/__init__.py")}
    assert found == PACKAGES
    for parent in PARENTS:
        for path in (ROOT / parent).glob("btcore*/**/*.py"):
            assert (path.parent / "__init__.py").exists(), f"{path.parent} has no __init__.py"


def test_engine_dependencies_exclude_the_monitor_and_the_robot() -> None:
    needed = {requirement.split(">")[0] for requirement in PROJECT["project"]["dependencies"]}
    assert needed == {"click", "lxml", "mypy-extensions", "rich"}


def test_every_data_file_is_installed_with_its_package() -> None:
    listed = PROJECT["tool"]["setuptools"]["package-data"]
    packages = [path for parent in PARENTS for name in PACKAGES if (path := ROOT / parent / name).is_dir()]
    installed = {path for package in packages for one in listed[package.name] for path in package.glob(one)}
    there = {
        path
        for package in packages
        for path in package.rglob("*")
        if path.is_file() and path.suffix in {".xml", ".json", ".urdf", ".yaml", ".typed"}
    }
    assert there <= installed


def test_wheels_are_built_for_every_python_and_tested_as_compiled_builds() -> None:
    wheels = PROJECT["tool"]["cibuildwheel"]
    assert wheels["environment"]["BTCORE_COMPILED"] == "1"
    assert wheels["test-environment"]["BTCORE_EXPECT"] == "compiled"
    tested = [Path(part.removeprefix("{project}/")) for part in wheels["test-command"].split()[1:]]
    assert [path for path in tested if not (ROOT / path).exists()] == []
    assert {"x86_64", "aarch64"} == set(wheels["linux"]["archs"])
    least = PROJECT["project"]["requires-python"].removeprefix(">=").replace(".", "")
    assert wheels["build"][0] == f"cp{least}-*"
