"""What is installed is what is here."""

import tomllib
from pathlib import Path

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
TREES = {"btcore.trees", "btcore.trees.navigation", "btcore.trees.tutorials"}
DATA_FOLDERS = TREES | {"sim.scenes", "btcore.benchmarks"}


def test_every_package_of_the_checkout_is_installed() -> None:
    found = {
        ".".join(path.parent.relative_to(ROOT).parts).replace("benchmarks.", "btcore.benchmarks.")
        for name in ("btcore", "monitor", "robot_nodes", "sim", "benchmarks")
        for path in (ROOT / name).rglob("__init__.py")
    }
    assert found | DATA_FOLDERS == set(PROJECT["tool"]["setuptools"]["packages"])


def test_the_engine_alone_asks_for_no_screen_and_no_robot() -> None:
    needed = {requirement.split(">")[0] for requirement in PROJECT["project"]["dependencies"]}
    assert needed == {"click", "lxml", "mypy-extensions", "rich"}


def test_every_file_that_a_package_reads_is_installed_with_it() -> None:
    listed = PROJECT["tool"]["setuptools"]["package-data"]
    folders = {name: ROOT.joinpath(*name.split(".")[1:]) for name in TREES}
    installed = {
        path
        for package, patterns in listed.items()
        for pattern in patterns
        for path in folders.get(package, ROOT.joinpath(*package.split("."))).glob(pattern)
    }
    there = {
        path
        for name in ("btcore", "monitor", "robot_nodes", "sim", "trees")
        for path in (ROOT / name).rglob("*")
        if path.is_file() and path.suffix in {".xml", ".json", ".urdf", ".yaml", ".typed"}
    }
    assert there <= installed


def test_wheels_are_built_for_every_python_and_system_and_tested_as_compiled_ones() -> None:
    wheels = PROJECT["tool"]["cibuildwheel"]
    assert wheels["environment"]["BTCORE_COMPILED"] == "1"
    assert wheels["test-environment"]["BTCORE_EXPECT"] == "compiled"
    tested = [Path(part.removeprefix("{project}/")) for part in wheels["test-command"].split()[1:]]
    assert [path for path in tested if not (ROOT / path).exists()] == []
    assert {"x86_64", "aarch64"} == set(wheels["linux"]["archs"])
    least = PROJECT["project"]["requires-python"].removeprefix(">=").replace(".", "")
    assert wheels["build"][0] == f"cp{least}-*"
