"""Messages of drivers with different habits become readings of the Robot protocol."""

import math
from typing import Any

import numpy as np
import pytest

pytest.importorskip("sensor_msgs")

from sensor_msgs.msg import BatteryState, Image, LaserScan, Range

from btcore_robot.rigid_transform import Transform, from_rpy
from btcore_ros2.errors import RosError
from btcore_ros2.robot.conversions import ScanConverter, battery_level, depth_of, ranges_of, rgb_of, sonar_of


def laser_scan(ranges: list[float], angle_min: float, increment: float, frame: str = "laser") -> Any:
    message = LaserScan(angle_min=angle_min, angle_increment=increment, range_min=0.1, range_max=10.0)
    message.header.frame_id = frame
    message.ranges = ranges
    return message


def test_no_echo_has_many_forms() -> None:
    message = laser_scan([math.inf, 0.0, math.nan, -1.0, 10.5, 0.05, -math.inf, 0.1, 10.0], 0.0, 0.1)
    far, near = math.inf, -math.inf
    assert ranges_of(message).tolist() == [far, far, far, far, far, near, near, pytest.approx(0.1), 10.0]


def test_laser_that_looks_forward_is_unchanged() -> None:
    message = laser_scan([1.0, 2.0, 3.0], -0.5, 0.5, "/laser")
    converter = ScanConverter(message, Transform((0.2, 0.0, 0.1)), 10.0, 0.01)
    scan = converter.convert(message, 7)
    assert converter.frame is None
    assert scan.ranges.tolist() == [1.0, 2.0, 3.0]
    assert (scan.angle_min, scan.angle_increment, scan.frame, scan.stamp) == (-0.5, 0.5, "laser", 7)


@pytest.mark.parametrize(
    ("rpy", "angle_min", "increment"),
    [
        ((0.0, 0.0, 0.0), 0.0, 1.0),
        ((0.0, 0.0, math.pi / 2), 0.0, 1.0),
        ((0.0, 0.0, -math.pi / 2), -math.pi, 1.0),
        ((math.pi, 0.0, 0.0), -math.pi, 1.0),
        ((math.pi, 0.0, 1.0), 0.0, 1.0),
        ((0.0, 0.0, math.pi), 0.0, -1.0),
    ],
)
def test_middle_ray_of_a_laser_that_sees_all_around_points_ahead(
    rpy: tuple[float, float, float], angle_min: float, increment: float
) -> None:
    count = 360
    step = increment * math.tau / count
    mount = Transform((0.0, 0.0, 0.2), from_rpy(rpy))
    # The echo of each ray is at a distance that determines its true direction in the base.
    rays = [angle_min + index * step for index in range(count)]
    directions = [mount.apply(np.array([[math.cos(a), math.sin(a), 0.0]]))[0] for a in rays]
    truth = [math.atan2(y, x) for x, y, _ in directions]
    message = laser_scan([5.0 + angle for angle in truth], angle_min, step)
    converter = ScanConverter(message, mount, 10.0, 0.0)
    scan = converter.convert(message, 0)
    assert scan.ranges[count // 2] == pytest.approx(5.0, abs=math.tau / count)
    assert scan.angle_increment > 0.0
    assert abs(scan.angle_min + math.pi) < 0.02
    frame = converter.frame
    turn = Transform() if frame is None else Transform(frame.position, frame.quaternion)
    for angle, distance in zip(scan.angles(), scan.ranges, strict=True):
        end = turn.apply(np.array([[math.cos(angle), math.sin(angle), 0.0]]))
        x, y, _ = (mount.apply(end) - np.array(mount.position))[0]
        assert math.remainder(math.atan2(y, x) - (float(distance) - 5.0), math.tau) == pytest.approx(
            0.0, abs=1e-3
        )


def test_scan_with_another_number_of_rays_is_adapted() -> None:
    first = laser_scan([1.0] * 8, 0.0, math.tau / 8)
    converter = ScanConverter(first, Transform(), 10.0, 0.0)
    other = laser_scan([2.0] * 12 + [3.0] * 12, 0.0, math.tau / 24)
    scan = converter.convert(other, 0)
    assert len(scan.ranges) == converter.info.rays == 8
    # From -180°: the right half is the second half of the message.
    assert scan.ranges.tolist() == [3.0] * 4 + [2.0] * 4


def test_laser_that_is_not_horizontal_is_refused() -> None:
    message = laser_scan([1.0, 2.0], 0.0, 0.1)
    with pytest.raises(RosError, match="'laser' is not horizontal"):
        ScanConverter(message, Transform((0.0, 0.0, 0.0), from_rpy((1.5, 0.0, 0.0))), 10.0, 0.0)
    with pytest.raises(RosError, match="a scan has 0 rays"):
        ScanConverter(laser_scan([], 0.0, 0.1), Transform(), 10.0, 0.0)


def image(encoding: str, pixel: list[int], padding: int = 0, *, big_endian: bool = False) -> Any:
    data = (pixel * 2 + [99] * padding) * 3
    return Image(
        width=2,
        height=3,
        encoding=encoding,
        step=2 * len(pixel) + padding,
        data=bytes(data),
        is_bigendian=int(big_endian),
    )


@pytest.mark.parametrize(
    ("encoding", "pixel", "rgb"),
    [
        ("rgb8", [1, 2, 3], [1, 2, 3]),
        ("bgr8", [1, 2, 3], [3, 2, 1]),
        ("rgba8", [1, 2, 3, 4], [1, 2, 3]),
        ("bgra8", [1, 2, 3, 4], [3, 2, 1]),
        ("mono8", [7], [7, 7, 7]),
    ],
)
def test_encodings_of_pictures(encoding: str, pixel: list[int], rgb: list[int]) -> None:
    for padding in (0, 3):
        pixels = rgb_of(image(encoding, pixel, padding))
        assert pixels.shape == (3, 2, 3)
        assert (pixels == rgb).all()


def test_encodings_of_depth() -> None:
    far, short = 8.0, list((1500).to_bytes(2, "little"))
    assert (depth_of(image("16UC1", short, 2), far) == 1.5).all()
    assert (depth_of(image("16UC1", short[::-1], big_endian=True), far) == 1.5).all()
    assert (depth_of(image("16UC1", [0, 0]), far) == np.inf).all()
    for value, metres in ((2.5, 2.5), (math.nan, math.inf), (9.0, math.inf), (-1.0, math.inf)):
        bits = list(np.array([value], dtype="<f4").tobytes())
        assert (depth_of(image("32FC1", bits), far) == metres).all()


def test_image_that_cannot_be_used_is_refused() -> None:
    with pytest.raises(RosError, match="encoding 'yuv422' is not supported; supported are rgb8"):
        rgb_of(image("yuv422", [1, 2]))
    with pytest.raises(RosError, match="encoding 'rgb8' is not supported; supported are 16UC1"):
        depth_of(image("rgb8", [1, 2, 3]), 8.0)
    short = image("rgb8", [1, 2, 3])
    short.data = bytes(5)
    with pytest.raises(RosError, match=r"2 x 3 pixels \(rgb8\) has only 5 bytes"):
        rgb_of(short)


def test_battery_level() -> None:
    nan = math.nan
    assert battery_level(BatteryState(percentage=0.25), 1.0) == 25.0
    assert battery_level(BatteryState(percentage=25.0), 100.0) == 25.0
    assert battery_level(BatteryState(percentage=nan, charge=1.0, capacity=2.0), 1.0) == 50.0
    assert battery_level(BatteryState(percentage=nan, charge=nan, capacity=2.0), 1.0) is None
    assert battery_level(BatteryState(percentage=nan), 1.0) is None


def test_sonar() -> None:
    for distance, expected in ((0.5, 0.5), (0.01, -math.inf), (1.5, math.inf), (math.nan, math.inf)):
        message = Range(range=distance, min_range=0.02, max_range=1.0, field_of_view=0.5)
        assert sonar_of(message, 3).range == expected
