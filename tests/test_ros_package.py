"""packaging/ros is a package of the type ament_python, which installs the same files as the wheel."""

import ast
import configparser
import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from lxml import etree

from btcore_ros2.commands import COMMANDS
from btcore_ros2.executables import command_arguments
from tests.colcon_installation import PACKAGE, install_as_by_colcon

ROOT = Path(__file__).parent.parent
MANIFEST = etree.parse(PACKAGE / "package.xml").getroot()
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
SOURCES = {
    "": (
        "btcore",
        "monitor/btcore_drawing",
        "monitor/btcore_monitor",
        "monitor/btcore_scene",
        "robot_nodes/btcore_navigation",
        "robot_nodes/btcore_robot",
        "ros2/btcore_ros2",
        "sim/btcore_sim",
        "tools/btcore_bags",
        "tools/btcore_batch",
        "tools/btcore_proof",
        "tools/btcore_recorder",
        "tools/btcore_studio",
        "tools/btcore_sweep",
    ),
    "btcore": ("docs", "trees"),
}
SUFFIXES = {
    ".action", ".json", ".md", ".msg", ".py", ".srv", ".txt", ".typed", ".urdf", ".xml", ".yaml",
}  # fmt: skip
# The keys of rosdep that are not python3-NAME. mypy_extensions has none; mypy depends on it.
ROSDEP_KEYS = {
    "mypy-extensions": "python3-mypy",
    "opencv-python-headless": "python3-opencv",
    "pyyaml": "python3-yaml",
    "scikit-image": "python3-skimage",
}
ROS_PACKAGE = re.compile(r"(?:rcl|rosidl_|ament_)\w+|\w+_(?:msgs|srvs|interfaces)")
# No release of ROS 2 contains it: the README says how to build it.
UNRELEASED = {"btcpp_ros2_interfaces"}


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


def test_manifest_has_the_dependencies_of_the_project_and_of_ros() -> None:
    declared = {key.text for key in MANIFEST.iter("exec_depend")}
    wanted = [*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["robot"]]
    names = {re.split("[>=]", requirement)[0] for requirement in wanted}
    assert {key for key in declared if key.startswith("python3-")} == {
        ROSDEP_KEYS.get(name, f"python3-{name}") for name in names
    }
    imported = {
        module.partition(".")[0]
        for file in (ROOT / "ros2/btcore_ros2").rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        for module in imports_of(node)
    }
    needed = {name for name in imported if ROS_PACKAGE.fullmatch(name)}
    assert {"rclpy", "tf2_msgs"} <= needed
    assert needed - declared - UNRELEASED == set()
    # They run the launch files and `ros2 run`.
    assert {"launch_ros", "launch_xml", "ros2launch", "ros2run"} <= declared


def imports_of(node: ast.AST) -> list[str]:
    """Return the modules that a node of a syntax tree imports, or names as in `"tf2_msgs/msg/TFMessage"`."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        return [node.module or ""]
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return re.findall(r"\A(\w+)/(?:action|msg|srv)/\w+\Z", node.value)
    return []


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ([], []),
        (["trees", "--ros-args"], ["trees"]),
        (["--ros-args", "-p", "a:=b c", "--", "trees"], ["trees", "--ros-args", "-p 'a:=b c'"]),
        (["--ros-args", "-r", "a:=b", "--ros-args", "-r", "c:=d"], ["--ros-args", "-r a:=b -r c:=d"]),
        (["trees", "--ros-args", "-p a:=1 -r b:=c"], ["trees", "--ros-args", "-p a:=1 -r b:=c"]),
        (["--arguments=", "--arguments=--world 'my world.json'"], ["--world", "my world.json"]),
        (
            ["--arguments=one two --ros-args -p a:=2", "--fast", "--ros-args", "-p", "a:=1"],
            ["--fast", "one", "two", "--ros-args", "-p a:=1 -p a:=2"],
        ),
    ],
)
def test_arguments_of_ros_programs_become_those_of_the_command(given: list[str], expected: list[str]) -> None:
    assert command_arguments(given) == expected


def test_missing_quotation_mark_in_an_argument_of_a_launch_file_is_a_usage_error() -> None:
    program = "import sys; sys.argv[0] = 'serve'; from btcore_ros2.executables import main; main()"
    command = [sys.executable, "-c", program, "--arguments=", "--arguments=--plugin 'my nodes.py"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr == "error: No closing quotation in the arguments --plugin 'my nodes.py\n"


def test_parameters_of_the_launch_file_are_the_defaults_of_the_tree_server() -> None:
    yaml = pytest.importorskip("yaml")
    (given,) = yaml.safe_load((PACKAGE / "config/tree_server.yaml").read_text(encoding="utf-8")).values()
    page = (ROOT / "docs/guides/tree_server.md").read_text(encoding="utf-8")
    section = page.partition("\n## Parameters\n")[2].partition("\n## ")[0]
    defaults = dict(re.findall(r"^\| `(\w+)`[^|]*\|[^|]*\| `?([\w.]+)`? \|", section, re.MULTILINE))
    assert {
        name: str(value).removesuffix(".0") for name, value in given["ros__parameters"].items()
    } == defaults


def test_reference_lists_the_executables_and_the_arguments_of_the_launch_files() -> None:
    page = (ROOT / "docs/reference/ros2_package.md").read_text(encoding="utf-8")
    setup = (PACKAGE / "setup.py").read_text(encoding="utf-8")
    executables = re.findall(r'"(\w+)"', setup.partition("EXECUTABLES = ")[2].partition("\n")[0])
    assert sorted(re.findall(r"^\| `ros2 run btcore (\w+)`", page, re.MULTILINE)) == sorted(executables)
    documented: dict[str, dict[str, str]] = {}
    for section in re.split(r"^(?=`\w+\.launch\.xml` )", page, flags=re.MULTILINE)[1:]:
        rows = re.findall(r"^\| `(\w+)` \|(?: `(\S+)`[^|]*?)? \| \S", section, re.MULTILINE)
        documented[section.split("`")[1]] = dict(rows)
    documented["nav2_robot.launch.xml"] |= documented["tree_server.launch.xml"]
    assert documented == {
        file.name: {
            arg.get("name"): arg.get("default").replace("$(find-pkg-share btcore)/", "")
            for arg in etree.parse(file).getroot().iterchildren("arg")
        }
        for file in (PACKAGE / "launch").iterdir()
    }


def test_colcon_installs_executables_where_ros2_run_finds_them() -> None:
    options = configparser.ConfigParser()
    options.read(PACKAGE / "setup.cfg")
    assert options["install"]["install_scripts"] == options["develop"]["script_dir"] == "$base/lib/btcore"


@pytest.mark.skipif(
    os.name == "nt" or not (ROOT / ".git").exists(), reason="needs symbolic links, which an sdist lacks"
)
def test_package_is_installed_as_by_colcon_and_runs_a_tree(tmp_path: Path) -> None:
    prefix = install_as_by_colcon(tmp_path)

    assert (prefix / "share/ament_index/resource_index/packages/btcore").exists()
    assert (prefix / "share/btcore/package.xml").read_bytes() == (PACKAGE / "package.xml").read_bytes()
    for folder in ("config", "launch"):
        files = {path.name: path.read_bytes() for path in (PACKAGE / folder).iterdir()}
        installed = prefix / "share/btcore" / folder
        assert {path.name: path.read_bytes() for path in installed.iterdir()} == files
    executables = {path.name for path in (prefix / "lib/btcore").iterdir()}
    assert executables == {"btcore", *COMMANDS} - {"messages"}  # colcon builds messages
    (site,) = prefix.glob("lib/python*/site-packages")
    for target, folders in SOURCES.items():
        for folder in map(ROOT.joinpath, folders):
            page = folder / "page"  # its sources are not installed
            files_in = (path for path in folder.rglob("*") if page not in path.parents)
            found = (path for path in files_in if path.suffix in SUFFIXES)
            wanted = {path.relative_to(folder) for path in found if path.name != "README.md"}
            installed = site / target / folder.name
            assert {path for path in wanted if not (installed / path).exists()} == set()

    # The leaves of the tree need a robot; here they follow a plan.
    tree = site / "btcore/trees/bumpgo.xml"
    options = ["--model", tree, "--outcomes", "IsObstacle=FSF", "--outcomes", "Forward=RS", "--json"]
    printed = subprocess.run(
        [sys.executable, prefix / "bin/btcore", "run", "bumpgo", *options],
        env=os.environ | {"PYTHONPATH": str(site)},
        cwd=tmp_path,
        check=True,
        capture_output=True,
    ).stdout
    assert json.loads(printed)["status"] == "SUCCESS"
