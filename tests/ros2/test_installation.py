"""Which ROS 2 is found: wheels, a sourced ROS 2, both or none; folders take the place of installations."""

import os
import sys
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

import pytest

from btcore_ros2.errors import RosError
from btcore_ros2.installation import check_installation, find_installation

THIS_PYTHON = EXTENSION_SUFFIXES[0]


def make_ros(
    prefix: Path, wheels: bool = False, suffix: str = THIS_PYTHON, middleware: str = "rmw_fastrtps_cpp"
) -> str:
    """Make the files of a ROS 2 by which it is recognised. Returns its folder of modules."""
    modules = prefix / "lib" / "python3.12" / "site-packages"
    (modules / "rclpy").mkdir(parents=True)
    (modules / "rclpy" / f"_rclpy_pybind11{suffix}").touch()
    for library in ("rcl", middleware, "rmw_fastrtps_shared_cpp", "rmw_dds_common__rosidl_generator_c"):
        (prefix / "lib" / f"lib{library}.so").touch()
    if wheels:
        (modules / "ros_rclpy-9.1.2.dist-info").mkdir()
    return str(modules)


def test_no_ros(tmp_path: Path) -> None:
    found = find_installation({}, [str(tmp_path)])
    assert found.kind == "none"
    assert found.problem == "ROS 2 is not installed for this Python"
    assert "pip install 'btcore[ros2]'" in found.remedy


def test_wheels(tmp_path: Path) -> None:
    modules = make_ros(tmp_path, wheels=True)
    environment = {
        "LD_LIBRARY_PATH": f"{modules}/ros_rclpy.libs:{tmp_path}/lib",
        "AMENT_PREFIX_PATH": str(tmp_path),
    }
    found = find_installation(environment, ["", modules])
    assert (found.kind, found.problem, found.sourced) == ("wheels", "", [])
    assert found.middleware == ["rmw_fastrtps_cpp"]


def test_sourced(tmp_path: Path) -> None:
    ros = tmp_path / "opt" / "ros" / "jazzy"
    modules = make_ros(ros, middleware="rmw_cyclonedds_cpp")
    environment = {
        "AMENT_PREFIX_PATH": f"{tmp_path}/workspace/install:{ros}",
        "ROS_DISTRO": "jazzy",
        "RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp",
    }
    found = find_installation(environment, [modules])
    assert (found.kind, found.distribution, found.problem) == ("sourced", "jazzy", "")
    assert found.sourced == [ros]


@pytest.mark.parametrize("variable", ["AMENT_PREFIX_PATH", "LD_LIBRARY_PATH", "PYTHONPATH"])
def test_a_mixture_is_refused(tmp_path: Path, variable: str) -> None:
    own = make_ros(tmp_path / "venv", wheels=True)
    ros = tmp_path / "jazzy"
    modules = make_ros(ros)
    environment = {
        "AMENT_PREFIX_PATH": {"AMENT_PREFIX_PATH": str(ros)},
        "LD_LIBRARY_PATH": {"LD_LIBRARY_PATH": f"{ros}/lib"},
    }.get(variable, {})
    found = find_installation(environment, [modules, own] if variable == "PYTHONPATH" else [own])
    assert found.kind == "mixed"
    assert found.problem.startswith("two ROS 2 installations are mixed")
    assert str(ros) in found.problem
    assert "no setup file was sourced" in found.remedy


def test_a_workspace_beside_the_wheels_is_no_mixture(tmp_path: Path) -> None:
    own = make_ros(tmp_path / "venv", wheels=True)
    (tmp_path / "install" / "lib").mkdir(parents=True)
    assert find_installation({"AMENT_PREFIX_PATH": f"{tmp_path}/install"}, [own]).kind == "wheels"


def test_a_ros_for_another_python_is_refused(tmp_path: Path) -> None:
    modules = make_ros(tmp_path, suffix=".cpython-39-x86_64-linux-gnu.so")
    found = find_installation({}, [modules])
    assert "is for another Python (cpython-39-x86_64-linux-gnu)" in found.problem
    assert f"this is Python {sys.version_info[0]}.{sys.version_info[1]}" in found.problem


def test_a_sourced_ros_whose_modules_are_not_searched(tmp_path: Path) -> None:
    make_ros(tmp_path)
    found = find_installation({"AMENT_PREFIX_PATH": str(tmp_path)}, [])
    assert found.kind == "none"
    assert f"{tmp_path} is sourced, but for another Python" in found.problem


def test_a_middleware_that_is_not_installed_is_refused(tmp_path: Path) -> None:
    modules = make_ros(tmp_path, wheels=True)
    found = find_installation({"RMW_IMPLEMENTATION": "rmw_zenoh_cpp"}, [modules])
    assert (
        found.problem
        == "the middleware RMW_IMPLEMENTATION=rmw_zenoh_cpp is not installed, only rmw_fastrtps_cpp"
    )


def test_session_refuses_mixture_before_loading_ros(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from btcore_ros2.session import RosSession

    own, other = make_ros(tmp_path / "venv", wheels=True), make_ros(tmp_path / "jazzy")
    monkeypatch.setattr(sys, "path", [other, own, *sys.path])
    with pytest.raises(RosError, match="two ROS 2 installations are mixed"):
        RosSession()


def test_this_environment_can_be_used() -> None:
    pytest.importorskip("rclpy")
    check_installation()
    assert find_installation(os.environ).kind in ("wheels", "sourced")
