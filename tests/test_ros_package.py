"""packaging/ros is a package of the type ament_python, which installs the same files as the wheel."""

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from lxml import etree

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "packaging" / "ros"
MANIFEST = etree.parse(PACKAGE / "package.xml").getroot()
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
SOURCES = {
    "": (
        "btcore",
        "monitor/btcore_monitor",
        "monitor/btcore_scene",
        "robot_nodes/btcore_robot",
        "sim/btcore_sim",
    ),
    "btcore": ("benchmarks", "trees"),
}
SUFFIXES = {".json", ".py", ".txt", ".typed", ".urdf", ".xml"}


def test_manifest_has_format_3_and_agrees_with_the_project() -> None:
    # The elements that format 3 requires.
    assert MANIFEST.get("format") == "3"
    for name in ("name", "version", "description", "maintainer", "license"):
        assert len(MANIFEST.findall(name)) == 1
    assert re.fullmatch(r"\d+\.\d+\.\d+", MANIFEST.findtext("version", ""))
    assert MANIFEST.find("maintainer").get("email")
    assert (PACKAGE / MANIFEST.find("license").get("file", "")).samefile(ROOT / "LICENSE")
    assert MANIFEST.findtext("export/build_type") == "ament_python"
    assert MANIFEST.findtext("name") == PROJECT["name"]
    assert MANIFEST.findtext("license") == PROJECT["license"]
    assert {url.text for url in MANIFEST.iter("url")} <= set(PROJECT["urls"].values())


def test_manifest_has_the_newest_version_of_the_changelog() -> None:
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    newest = re.search(r"^## \[?(\d+\.\d+\.\d+)", changelog, re.MULTILINE)
    assert newest is not None
    assert MANIFEST.findtext("version") == newest[1]


def test_manifest_has_the_dependencies_of_the_project() -> None:
    # rosdep has no key for mypy_extensions, which python3-mypy depends on.
    keys = {
        key.text.replace("python3-mypy", "python3-mypy-extensions") for key in MANIFEST.iter("exec_depend")
    }
    assert keys == {f"python3-{re.split('[>=]', wanted)[0]}" for wanted in PROJECT["dependencies"]}


@pytest.mark.skipif(
    os.name == "nt" or not (ROOT / ".git").exists(), reason="needs symbolic links, which an sdist lacks"
)
def test_package_is_installed_as_by_colcon_and_runs_a_tree(tmp_path: Path) -> None:
    base, prefix = tmp_path / "build", tmp_path / "install"
    base.mkdir()
    command = [
        sys.executable,
        "setup.py",
        "-q",
        "egg_info",
        "--egg-base",
        base,
        "build",
        "--build-base",
        base,
    ]
    install = ["install", "--single-version-externally-managed", "--no-compile", "--record", base / "files"]
    subprocess.run([*command, *install, "--prefix", prefix], cwd=PACKAGE, check=True, capture_output=True)

    assert (prefix / "share/ament_index/resource_index/packages/btcore").exists()
    assert (prefix / "share/btcore/package.xml").read_bytes() == (PACKAGE / "package.xml").read_bytes()
    (site,) = prefix.glob("lib/python*/site-packages")
    for target, folders in SOURCES.items():
        for folder in map(ROOT.joinpath, folders):
            wanted = {path.relative_to(folder) for path in folder.rglob("*") if path.suffix in SUFFIXES}
            installed = site / target / folder.name
            assert {path for path in wanted if not (installed / path).exists()} == set()

    # The leaves of the tree need a robot; here they follow a plan.
    tree = site / "btcore/trees/bumpgo.xml"
    options = ["--model", tree, "--plan", "IsObstacle=FSF", "--plan", "Forward=RS", "--json"]
    printed = subprocess.run(
        [prefix / "bin/btcore", "run", "bumpgo", *options],
        env=os.environ | {"PYTHONPATH": str(site)},
        cwd=tmp_path,
        check=True,
        capture_output=True,
    ).stdout
    assert json.loads(printed)["status"] == "SUCCESS"
