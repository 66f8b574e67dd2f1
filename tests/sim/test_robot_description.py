"""Robot descriptions: another robot than the Tiago, and errors in descriptions."""

import json
import math
import re
from pathlib import Path
from typing import Any

import pytest

from btcore_sim.errors import SimError
from btcore_sim.robot_description import TIAGO, load_robot_description


def write(folder: Path, change: Any = None) -> Path:
    data = json.loads(TIAGO.read_text())
    data["urdf"] = str(TIAGO.with_name("tiago.urdf"))
    if change is not None:
        change(data)
    path = folder / "mine.json"
    path.write_text(json.dumps(data))
    return path


def test_the_tiago_has_the_figures_of_its_data_sheet() -> None:
    tiago = load_robot_description()
    assert (tiago.base.v_min, tiago.base.v_max, tiago.base.w_max) == (-0.2, 1.0, 2.09)
    assert (tiago.base.command_timeout, tiago.base.radius) == (0.25, 0.27)
    laser = tiago.laser.info
    assert (laser.rays, laser.range_min, laser.range_max, laser.rate) == (666, 0.05, 25.0, 10.0)
    assert math.degrees(laser.angle_increment) == pytest.approx(0.3308, abs=1e-4)
    assert tiago.camera is not None
    assert math.degrees(tiago.camera.fov) == pytest.approx(63.0)


def test_another_robot_has_limits_of_own_description(tmp_path: Path, robot_at: Any, steer: Any) -> None:
    def slow(data: dict[str, Any]) -> None:
        data["base"]["v_max"] = 0.1
        del data["camera"]

    body = robot_at(description=load_robot_description(write(tmp_path, slow)))
    steer(body, 2.0, (0.5, 0.0))
    assert body.true_pose().x == pytest.approx(0.2, abs=0.02)
    assert body.camera() is None


def test_a_minimal_description_gives_a_robot_without_optional_parts(tmp_path: Path, robot_at: Any) -> None:
    def bare(data: dict[str, Any]) -> None:
        for part in ("head", "torso", "camera", "sonars", "frames", "odometry"):
            del data[part]

    body = robot_at(description=load_robot_description(write(tmp_path, bare)))
    body.lift(0.3)
    assert (body.torso_info, body.torso_height(), body.camera_info, body.camera()) == (None, None, None, None)
    assert body.sonars() == ()
    assert body.description.odometry.scale_sigma == 0.0
    names = {frame.child for frame in body.frames()}
    assert {"base_link", "base_laser_link", "head_2_link"} <= names
    assert not [name for name in names if "sonar" in name or "camera" in name]


def test_a_robot_without_joints_except_its_wheels_has_fixed_frames(tmp_path: Path, robot_at: Any) -> None:
    urdf = TIAGO.with_name("tiago.urdf").read_text()
    (tmp_path / "rigid.urdf").write_text(re.sub(r'type="(revolute|prismatic)"', 'type="fixed"', urdf))

    def rigid(data: dict[str, Any]) -> None:
        data["urdf"] = "rigid.urdf"
        for part in ("head", "torso"):
            del data[part]

    body = robot_at(description=load_robot_description(write(tmp_path, rigid)))
    assert {"base_link", "base_laser_link", "head_2_link"} <= {frame.child for frame in body.frames()}


def test_a_description_without_a_head_gives_a_robot_without_a_head(tmp_path: Path, robot_at: Any) -> None:
    body = robot_at(description=load_robot_description(write(tmp_path, lambda data: data.pop("head"))))
    body.move_head(0.3, 0.0)
    assert body.head_info is None
    assert body.head() is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.update(urdf="nowhere.urdf"), "'urdf' names .*nowhere.urdf, but there is no such file"),
        (lambda d: d["wheels"].update(raduis=1), "'wheels.raduis' is unknown: .*; did you mean 'radius'"),
        (
            lambda d: d["laser"].update(angle_max=-3.0),
            "'laser.angle_max' is -3, and .* greater than 'angle_min'",
        ),
        (lambda d: d["torso"].update(limits=[0.3, 0.1]), r"'torso.limits' is \[0.3, 0.1\], and the second"),
        (lambda d: d["laser"]["outliers"].update(short=2), "'laser.outliers.short' is 2, and a number of at"),
        (
            lambda d: d["laser"].update(latency=3),
            "'laser.latency' is 3, and a number of at least 0 and of at",
        ),
        (lambda d: d["sonars"][1].update(range_min=2.0), r"'sonars\[1\].range_max' is 1, and it has to be"),
        (lambda d: d["shells"][0].update(sections=[[0, 0, 0, 1, 2]] * 2), r"sections\[0\]\[2\]' is 0"),
        (lambda d: d["shells"][0].update(sections=[]), "sections' is .*, and a list of at least 2 lists"),
    ],
)
def test_an_error_in_a_description_raises(tmp_path: Path, change: Any, message: str) -> None:
    with pytest.raises(SimError, match=message) as caught:
        load_robot_description(write(tmp_path, change))
    assert "mine.json:1: " in str(caught.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda d: d["wheels"].update(left="wheel_lift_joint"),
            "no joint 'wheel_lift_joint': .*; did you mean 'wheel_left",
        ),
        (lambda d: d["laser"].update(link="base"), "no link 'base': .*; did you mean 'base_link'"),
    ],
)
def test_name_missing_in_the_urdf_raises(tmp_path: Path, robot_at: Any, change: Any, message: str) -> None:
    with pytest.raises(SimError, match=message):
        robot_at(description=load_robot_description(write(tmp_path, change)))


def test_a_urdf_that_the_engine_cannot_read_raises(tmp_path: Path, robot_at: Any) -> None:
    (tmp_path / "broken.urdf").write_text("<robot name='x'></robot>")
    path = write(tmp_path, lambda data: data.update(urdf="broken.urdf"))
    with pytest.raises(SimError, match=r"broken.urdf: the physics engine cannot read this URDF"):
        robot_at(description=load_robot_description(path))


def test_a_missing_description_raises() -> None:
    with pytest.raises(SimError, match=r"nowhere\.json: no such file"):
        load_robot_description(Path("nowhere.json"))
