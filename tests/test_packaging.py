"""The packaging metadata match the files of the repository."""

import json
import os
import re
import runpy
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

import btcore

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PARENTS = PROJECT["tool"]["setuptools"]["packages"]["find"]["where"]
PACKAGES = {
    "btcore", "btcore_bags", "btcore_batch", "btcore_drawing", "btcore_monitor", "btcore_navigation",
    "btcore_proof", "btcore_recorder", "btcore_robot", "btcore_ros2", "btcore_scene", "btcore_sim",
    "btcore_studio", "btcore_sweep",
}  # fmt: skip

DATA_SUFFIXES = {".action", ".hpp", ".json", ".msg", ".srv", ".typed", ".urdf", ".xml", ".yaml"}

PAGE = ROOT / "tools/btcore_studio/page"

PYTHONS = [
    classifier.rpartition(" ")[2]
    for classifier in PROJECT["project"]["classifiers"]
    if classifier.startswith("Programming Language :: Python :: 3.")
]
WORKFLOWS = {
    path.name: path.read_text(encoding="utf-8") for path in sorted((ROOT / ".github/workflows").glob("*.yml"))
}
PRINT_VERSION = """
import sys
sys.path.insert(0, sys.argv[1])
import btcore
assert "importlib.metadata" not in sys.modules, "import btcore is slower than needed"
print(btcore.__version__)
"""


def test_every_package_is_installed_and_named_btcore() -> None:
    found = {path.parent.name for parent in PARENTS for path in (ROOT / parent).glob("*/__init__.py")}
    assert found == PACKAGES
    for parent in PARENTS:
        for path in (ROOT / parent).glob("btcore*/**/*.py"):
            assert (path.parent / "__init__.py").exists(), f"{path.parent} has no __init__.py"


def test_engine_dependencies_exclude_the_monitor_and_the_robot() -> None:
    needed = {requirement.split(">")[0] for requirement in PROJECT["project"]["dependencies"]}
    assert needed == {"click", "lxml", "msgspec", "mypy-extensions", "rich"}


def test_every_data_file_is_installed_with_its_package() -> None:
    listed = PROJECT["tool"]["setuptools"]["package-data"]
    packages = [path for parent in PARENTS for name in PACKAGES if (path := ROOT / parent / name).is_dir()]
    installed = {path for folder in packages for name in listed[folder.name] for path in folder.glob(name)}
    there = {
        path
        for package in packages
        for path in package.rglob("*")
        # What builds the page is no data.
        if path.is_file() and path.suffix in DATA_SUFFIXES and PAGE not in path.parents
    }
    assert there <= installed


def test_trees_and_pages_of_the_documentation_are_installed() -> None:
    files = runpy.run_path(str(ROOT / "setup.py"))["data_files"]()
    suffixes = {(file.relative_to(ROOT).parts[0], file.suffix) for file in files}
    assert suffixes == {("docs", ".md"), ("trees", ".xml")}
    assert {ROOT / "docs/reference/errors.md", ROOT / "trees/bumpgo.xml"} <= set(files)


def test_built_page_is_in_the_sdist_and_in_a_wheel(tmp_path: Path) -> None:
    # A small checkout, because the whole wheel would take some 10 s.
    checkout = tmp_path / "checkout"
    for package in ("btcore", "tools/btcore_studio"):
        target = checkout / package
        target.mkdir(parents=True)
        (target / "__init__.py").write_text("", encoding="utf-8")
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy2(ROOT / name, checkout)
    for folder in PARENTS:
        (checkout / folder).mkdir(exist_ok=True)
    for name in ("page/built/index.html", "page/built/studio.js", "page/src/main.tsx", "page/package.json"):
        file = checkout / "tools/btcore_studio" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("x", encoding="utf-8")
    command = [sys.executable, "setup.py", "-q", "sdist", "bdist_wheel"]
    environment = os.environ | {"BTCORE_PURE": "1", "SETUPTOOLS_SCM_PRETEND_VERSION": "1.0"}
    subprocess.run(command, cwd=checkout, env=environment, check=True, capture_output=True)
    (sdist,) = (checkout / "dist").glob("*.tar.gz")
    (wheel,) = (checkout / "dist").glob("*.whl")
    with tarfile.open(sdist) as packed, zipfile.ZipFile(wheel) as archive:
        for names in (packed.getnames(), archive.namelist()):
            page = [name for name in names if "/page/" in name]
            assert sorted(Path(name).name for name in page if "." in Path(name).name) == [
                "index.html",
                "studio.js",
            ]


def test_wheels_are_built_for_every_python_and_tested_as_compiled_builds() -> None:
    wheels = PROJECT["tool"]["cibuildwheel"]
    assert wheels["environment"]["BTCORE_COMPILED"] == "1"
    assert wheels["test-environment"]["BTCORE_EXPECT"] == "compiled"
    tested = [Path(part.removeprefix("{project}/")) for part in wheels["test-command"].split()[1:]]
    assert [path for path in tested if not (ROOT / path).exists()] == []
    assert wheels["build"] == [f"cp{version.replace('.', '')}-*" for version in PYTHONS]
    assert PROJECT["project"]["requires-python"] == f">={PYTHONS[0]}"


def test_workflows_test_every_python_in_folders_that_exist() -> None:
    workflow = WORKFLOWS["tests.yml"]
    matrices = re.findall(r"python: \[(.*)\]", workflow)
    assert [re.findall(r"[\d.]+", matrix) for matrix in matrices] == [PYTHONS, PYTHONS]
    folders = re.findall(r"\btests/\S+", workflow)
    assert {"tests/btcore/engine", "tests/conformance"} <= set(folders)
    assert [folder for folder in folders if not (ROOT / folder).exists()] == []


@pytest.mark.parametrize("name", WORKFLOWS)
def test_workflows_pin_actions_and_have_no_permissions_by_default(name: str) -> None:
    assert "\npermissions: {}\n" in WORKFLOWS[name]
    actions = re.findall(r"uses: (.*)", WORKFLOWS[name])
    assert actions
    assert [action for action in actions if not re.fullmatch(r"\S+@[0-9a-f]{40} # v[\d.]+", action)] == []


def test_version_is_the_installed_version_and_is_looked_up_when_used(tmp_path: Path) -> None:
    def version() -> str:
        command = [sys.executable, "-I", "-S", "-c", PRINT_VERSION, str(tmp_path)]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    package = tmp_path / "btcore"
    package.mkdir()
    for name in ("__init__.py", "builds.py"):
        shutil.copy2(Path(btcore.__file__).with_name(name), package)
    assert version() == "0+unknown"  # a checkout that is not installed
    metadata = tmp_path / "btcore-1.2.3.dist-info" / "METADATA"
    metadata.parent.mkdir()
    metadata.write_text("Metadata-Version: 2.4\nName: btcore\nVersion: 1.2.3\n", encoding="utf-8")
    assert version() == "1.2.3"


@pytest.mark.skipif(shutil.which("git") is None, reason="git is not installed")
def test_version_comes_from_the_git_tag(tmp_path: Path) -> None:
    def git(*arguments: str) -> None:
        author = ["-c", "user.name=Ada", "-c", "user.email=ada@example.org", "-c", "commit.gpgsign=false"]
        subprocess.run(["git", *author, *arguments], cwd=tmp_path, check=True, capture_output=True)

    def version() -> str:
        command = [sys.executable, "-m", "setuptools_scm"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
        return done.stdout.strip()

    shutil.copy2(ROOT / "pyproject.toml", tmp_path)
    assert version() == "0.0"  # a downloaded archive of the sources
    git("init")
    git("add", ".")
    git("commit", "--message", "first")
    assert version().startswith("0.1.dev1+g")  # a clone without tags
    git("tag", "v1.2.0")
    assert version() == "1.2.0"
    git("commit", "--allow-empty", "--message", "second")
    assert version().startswith("1.2.1.dev1+g")


def test_links_of_the_readme_are_absolute_on_pypi() -> None:
    text = runpy.run_path(str(ROOT / "setup.py"))["readme_with_absolute_links"]()
    links = re.findall(r"""\]\(([^)\s]+)|(?:src|srcset|href)=["']([^"']+)""", text)
    assert [link for link in map("".join, links) if not link.startswith(("https://", "#"))] == []
    repository = PROJECT["project"]["urls"]["Repository"]
    assert f"({repository}/raw/main/" + "docs/images/monitor.png)" in text
    assert f"({repository}/blob/main/" + "docs/guides/installing.md)" in text


def test_lower_bounds_have_no_known_vulnerabilities(
    acceptance_script: Callable[[str], ModuleType],
) -> None:
    script = acceptance_script("lower_bounds")
    bounds = script.lower_bounds()
    assert script.FIXED.keys() <= {*bounds, "setuptools"}
    assert bounds["lxml"]
    assert list(script.vulnerable(bounds)) == []
    assert list(script.vulnerable({"lxml": "6.0.4"})) == ["lxml 6.0.4: CVE-2026-41066, fixed in 6.1.0"]
    requirements = PROJECT["build-system"]["requires"]
    builds = {text.split(">=")[1] for text in requirements if "setuptools>" in text}
    assert list(script.vulnerable(dict.fromkeys(["setuptools"], *builds))) == []


def test_the_bill_of_materials_lists_every_dependency() -> None:
    bill_of_materials = runpy.run_path(str(ROOT / "packaging/sbom.py"))["bill_of_materials"]
    command = [sys.executable, "-m", "pip", "inspect", "--disable-pip-version-check"]
    done = subprocess.run(command, capture_output=True, check=True)
    bill = bill_of_materials("btcore", json.loads(done.stdout)["installed"])
    assert (bill["bomFormat"], bill["specVersion"]) == ("CycloneDX", "1.6")
    assert bill["metadata"]["component"]["name"] == "btcore"
    components = {component["name"]: component for component in bill["components"]}
    assert "btcore" not in components
    assert components["lxml"]["purl"] == f"pkg:pypi/lxml@{components['lxml']['version']}"
    required = {dependency["ref"]: dependency["dependsOn"] for dependency in bill["dependencies"]}
    references = {component["bom-ref"] for component in (bill["metadata"]["component"], *bill["components"])}
    assert required.keys() == references
    assert {reference for ones in required.values() for reference in ones} <= references
    engine = {components[name]["purl"] for name in ("click", "lxml", "msgspec", "mypy-extensions", "rich")}
    assert engine <= set(required[bill["metadata"]["component"]["purl"]])
