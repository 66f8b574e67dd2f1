"""A robot as ROS packages describe it: the root is `base_footprint`, and the meshes are in packages."""

import json
import logging
from pathlib import Path
from typing import Any

import pytest

from btcore_robot.errors import RobotError
from btcore_robot.robot import BASE_FRAME
from btcore_robot.testing import wait
from btcore_sim.errors import SimError
from btcore_sim.kinematics import complete_urdf
from btcore_sim.robot_description import RobotDescription, load_robot_description

HAT = b"v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
WHEEL = """
  <link name="{side}_wheel">
    <inertial>
      <mass value="0.6"/> <inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <collision> <geometry> <sphere radius="0.06"/> </geometry> </collision>
  </link>
  <joint name="{side}_joint" type="continuous">
    <parent link="base_link"/> <child link="{side}_wheel"/> <origin xyz="0 {y} 0"/> <axis xyz="0 1 0"/>
  </joint>"""
URDF = f"""<robot name="trolley">
  <link name="base_footprint"/>
  <joint name="base_joint" type="fixed">
    <parent link="base_footprint"/> <child link="base_link"/> <origin xyz="0 0 0.06"/>
  </joint>
  <link name="base_link">
    <inertial>
      <mass value="12"/> <inertia ixx="0.2" iyy="0.2" izz="0.3" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <visual> <geometry> <mesh filename="package://trolley/meshes/hat.obj"/> </geometry> </visual>
    <collision>
      <origin xyz="0 0 0.06"/> <geometry> <cylinder radius="0.2" length="0.1"/> </geometry>
    </collision>
  </link>
  {WHEEL.format(side="left", y="0.15")}
  {WHEEL.format(side="right", y="-0.15")}
  <link name="caster">
    <collision> <geometry> <sphere radius="0.02"/> </geometry> </collision>
  </link>
  <joint name="caster_joint" type="fixed">
    <parent link="base_link"/> <child link="caster"/> <origin xyz="-0.15 0 -0.04"/>
  </joint>
</robot>
"""
DESCRIPTION = {
    "name": "trolley",
    "urdf": "trolley.urdf",
    "wheels": {
        "left": "left_joint", "right": "right_joint", "radius": 0.06, "separation": 0.3, "torque": 3.0,
        "ground": ["left_wheel", "right_wheel", "caster"], "sliding": ["caster"],
    },
    "base": {
        "v_min": -0.3, "v_max": 0.8, "w_max": 2.0, "v_rate": 1.0, "w_rate": 3.0, "command_timeout": 0.25,
        "radius": 0.2,
    },
    "laser": {
        "link": "base_link", "position": [0.1, 0, 0.16], "frame": "laser", "rays": 19, "angle_min": -1.5,
        "angle_max": 1.5, "range_min": 0.05, "range_max": 10.0, "rate": 10,
    },
}  # fmt: skip


def trolley(folder: Path, **changes: Any) -> RobotDescription:
    """Return the description of a trolley, whose files are in *folder*."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "trolley.urdf").write_text(URDF)
    (folder / "trolley.json").write_text(json.dumps({**DESCRIPTION, **changes}))
    return load_robot_description(folder / "trolley.json")


def mesh_in(package: Path) -> None:
    (package / "meshes").mkdir(parents=True)
    (package / "meshes/hat.obj").write_bytes(HAT)


def test_root_stands_on_floor_and_base_link_at_joint(tmp_path: Path, robot_at: Any, capfd: Any) -> None:
    mesh_in(tmp_path / "trolley")
    robot = robot_at(description=trolley(tmp_path / "trolley/urdf"))
    heights = {frame.child: frame.position[2] for frame in robot.frames() if frame.parent == BASE_FRAME}
    assert heights == {"base_link": pytest.approx(0.06)}
    assert robot.physics_body.pose()[0][2] == pytest.approx(0.0, abs=0.005)
    start = robot.true_pose()
    for _ in range(20):
        robot.drive(0.5, 0.0)
        wait(robot, 0.1)
    assert robot.true_pose().x - start.x == pytest.approx(0.9, abs=0.15)
    assert robot.physics_body.pose()[0][2] == pytest.approx(0.0, abs=0.005)
    assert complete_urdf(robot.description).count(f'name="{BASE_FRAME}"') == 1
    assert "inertial" not in capfd.readouterr().out


@pytest.mark.parametrize("height", [0.06, 0.3])
def test_a_height_above_a_footprint_is_an_error(tmp_path: Path, robot_at: Any, height: float) -> None:
    mesh_in(tmp_path / "trolley")
    with pytest.raises(SimError, match=r"'height' is .*, and the root link is 'base_footprint': write"):
        robot_at(description=trolley(tmp_path / "trolley/urdf", height=height))


@pytest.mark.parametrize(
    ("variable", "value", "package"),
    [
        ("ROS_PACKAGE_PATH", "src", "src/trolley"),
        ("ROS_PACKAGE_PATH", "other:src/trolley", "src/trolley"),
        ("AMENT_PREFIX_PATH", "other:install", "install/share/trolley"),
    ],
)
def test_a_mesh_is_found_in_its_package(
    tmp_path: Path,
    robot_at: Any,
    monkeypatch: pytest.MonkeyPatch,
    caplog: Any,
    *,
    variable: str,
    value: str,
    package: str,
) -> None:
    mesh_in(tmp_path / package)
    monkeypatch.setenv(variable, ":".join(str(tmp_path / part) for part in value.split(":")))
    robot = robot_at(description=trolley(tmp_path / "elsewhere"))
    with caplog.at_level(logging.WARNING):
        (mesh,) = robot.static_scene().meshes
    assert (mesh.name, mesh.frame) == ("trolley/base_link/hat.obj", "base_link")
    assert not caplog.text


def test_a_mesh_of_an_unknown_package_is_an_error(tmp_path: Path, robot_at: Any) -> None:
    with pytest.raises(
        RobotError,
        match=r"there is no file 'package://trolley/.*'; source the setup file .* 'trolley', or set",
    ):
        robot_at(description=trolley(tmp_path / "elsewhere"))
