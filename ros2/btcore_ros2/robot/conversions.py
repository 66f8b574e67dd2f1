"""Conversion of sensor messages to the data types of the `Robot` protocol."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from btcore_robot.rigid_transform import Transform, wrap_angle
from btcore_robot.robot import CameraInfo, LaserInfo, LaserScan, SonarReading, TransformStamped
from btcore_ros2.errors import RosError
from btcore_ros2.robot.description import CameraSource

_ALIGNED = 1e-3  # rad of rotation up to which a laser counts as mounted straight
_LEVEL = 0.95  # cosine of the tilt up to which a laser counts as horizontal

CHANNELS = {"rgb8": (0, 1, 2), "bgr8": (2, 1, 0), "8UC3": (2, 1, 0), "rgba8": (0, 1, 2), "bgra8": (2, 1, 0)}
"""The places of red, green and blue in a pixel, by encoding."""
GREY = ("mono8", "8UC1")


def ranges_of(message: Any) -> NDArray[np.float32]:
    """Return the ranges of a `sensor_msgs/LaserScan` by REP 117.

    Drivers report "no echo" as +inf, 0, NaN, a negative number or a number above `range_max`: all become
    +inf. An echo below `range_min` becomes -inf.
    """
    ranges = np.array(message.ranges, dtype=np.float32)
    near = (ranges > 0.0) & (ranges < message.range_min) | (ranges == -np.inf)
    ranges[~((ranges > 0.0) & (ranges <= np.float32(message.range_max)))] = np.inf
    ranges[near] = -np.inf
    return ranges


class ScanConverter:
    """Converts scans, so that the middle ray of a scan points ahead as far as possible.

    Leaves assume that a laser looks forward. A laser that is mounted rotated about the vertical, or upside
    down, is described by a frame of its own, whose name ends in `_forward`. The rays of a laser that sees all
    around are rotated, so that the first ray points backwards. Scans with another number of rays than the
    first, which some drivers send, are adapted to the first.

    Args:
        first: The first scan, a `sensor_msgs/LaserScan`.
        mount: The pose of the laser's frame in the frame of the base.
        rate: The rate of scans (Hz).
        sigma: The standard deviation of the noise (m).
        range_noise: The standard deviation of the noise that grows with the range, as a fraction of it.

    Attributes:
        info: The properties of the converted scans.
        frame: The additional frame, or None for a laser that looks forward; its stamp is 0.

    Raises:
        RosError: The scan has no rays, or the laser is not horizontal.
    """

    def __init__(
        self, first: Any, mount: Transform, rate: float, sigma: float, range_noise: float = 0.0
    ) -> None:
        count, increment = len(first.ranges), first.angle_increment
        name = first.header.frame_id.lstrip("/")
        if not count or not increment or not math.isfinite(first.angle_min + increment):
            raise RosError(
                f"a scan has {count} rays from {first.angle_min:g} rad on, and an angle of {increment:g} rad"
                " between two rays"
            )
        rotation = mount.rotation
        if abs(rotation[2, 2]) < _LEVEL:
            raise RosError(f"the laser's frame '{name}' is not horizontal: only planar lasers are supported")
        side = math.copysign(1.0, rotation[2, 2])
        turn = math.atan2(rotation[1, 0], rotation[0, 0])
        self.frame: TransformStamped | None = None
        if side < 0.0 or abs(turn) > _ALIGNED:
            level = mount.inverse().quaternion
            self.frame = TransformStamped(f"{name}_forward", name, (0.0, 0.0, 0.0), level, 0)
        else:
            side, turn = 1.0, 0.0
        self._raw = (count, first.angle_min, increment)
        self._raw_angles = first.angle_min + increment * np.arange(count)
        angles = turn + side * self._raw_angles
        order = np.arange(count)
        if side * increment < 0.0:
            order, angles = order[::-1], angles[::-1]
        step = abs(increment)
        around = round(math.tau / step)
        self._around = count >= around - 1
        start = float(angles[0])
        if self._around:
            # A full circle whose last ray repeats the first ray has one ray more than the circle.
            order = order[:around]
            shift = round((-math.pi - start) / step) % len(order)
            order = np.roll(order, -shift)
            start = wrap_angle(start + shift * step)
            start = start if start <= 0.0 else -math.pi
        self._order = order
        self.info = LaserInfo(
            rays=len(order),
            angle_min=start,
            angle_increment=step,
            range_min=first.range_min,
            range_max=first.range_max,
            rate=rate,
            sigma=sigma,
            frame=self.frame.child if self.frame is not None else name,
            range_noise=range_noise,
        )

    def convert(self, message: Any, stamp: int) -> LaserScan:
        """Return a `sensor_msgs/LaserScan` with the *stamp* (ns) as a scan."""
        ranges = ranges_of(message)
        if (len(ranges), message.angle_min, message.angle_increment) != self._raw:
            ranges = self._adapted(message, ranges)
        info = self.info
        return LaserScan(
            ranges[self._order],
            stamp,
            info.angle_min,
            info.angle_increment,
            info.range_min,
            info.range_max,
            info.frame,
        )

    def _adapted(self, message: Any, ranges: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the nearest ray of another scan for each ray of the first scan."""
        increment = message.angle_increment
        if not len(ranges) or not increment or not math.isfinite(message.angle_min + increment):
            return np.full(self._raw[0], np.inf, dtype=np.float32)
        places = np.rint((self._raw_angles - message.angle_min) / increment).astype(int)
        if self._around:
            places %= max(1, round(math.tau / abs(increment)))
        inside = (places >= 0) & (places < len(ranges))
        adapted = np.full(self._raw[0], np.inf, dtype=np.float32)
        adapted[inside] = ranges[places[inside]]
        return adapted


def rgb_of(message: Any) -> NDArray[np.uint8]:
    """Return the pixels of a `sensor_msgs/Image`, shape `(height, width, 3)`.

    Raises:
        RosError: The encoding is not supported, or the image has too few bytes.
    """
    encoding = message.encoding
    if encoding in GREY:
        grey = _pixels(message, np.dtype(np.uint8), 1)[:, :, 0]
        return np.repeat(grey[:, :, None], 3, axis=2)
    if encoding not in CHANNELS:
        known = ", ".join((*CHANNELS, *GREY))
        raise RosError(f"the encoding '{encoding}' is not supported; supported are {known}")
    pixels = _pixels(message, np.dtype(np.uint8), 4 if "a" in encoding else 3)
    return np.ascontiguousarray(pixels[:, :, CHANNELS[encoding]])


def depth_of(message: Any, far: float) -> NDArray[np.float32]:
    """Return the distances (m) of a depth image; +inf where nothing is nearer than *far* (m).

    Raises:
        RosError: The encoding is not supported, or the image has too few bytes.
    """
    order = ">" if message.is_bigendian else "<"
    if message.encoding in ("16UC1", "mono16"):
        depth = _pixels(message, np.dtype(f"{order}u2"), 1)[:, :, 0].astype(np.float32) / np.float32(1000.0)
    elif message.encoding == "32FC1":
        depth = _pixels(message, np.dtype(f"{order}f4"), 1)[:, :, 0].astype(np.float32)
    else:
        raise RosError(f"the encoding '{message.encoding}' is not supported; supported are 16UC1 and 32FC1")
    depth[~((depth > 0.0) & (depth <= far))] = np.inf
    return depth


def _pixels(message: Any, dtype: np.dtype[Any], channels: int) -> NDArray[Any]:
    """Return the pixels, shape `(height, width, channels)`; rows may be padded."""
    row = message.width * channels * dtype.itemsize
    step = message.step or row
    data = np.frombuffer(message.data, dtype=np.uint8)
    if step < row or len(data) < step * message.height:
        raise RosError(
            f"an image of {message.width} x {message.height} pixels ({message.encoding}) has only "
            f"{len(data)} bytes"
        )
    rows = data[: step * message.height].reshape(message.height, step)[:, :row]
    return np.ascontiguousarray(rows).view(dtype).reshape(message.height, message.width, channels)


def camera_info_of(message: Any, source: CameraSource) -> CameraInfo:
    """Return a `sensor_msgs/CameraInfo`, with the facts of *source*."""
    k = message.k
    return CameraInfo(
        width=message.width,
        height=message.height,
        fx=float(k[0]),
        fy=float(k[4]),
        cx=float(k[2]),
        cy=float(k[5]),
        near=source.near,
        far=source.far,
        rate=source.rate,
        frame=message.header.frame_id.lstrip("/"),
    )


def sonar_of(message: Any, stamp: int) -> SonarReading:
    """Return a `sensor_msgs/Range` with the *stamp* (ns) by REP 117."""
    distance = float(message.range)
    low, high = float(message.min_range), float(message.max_range)
    if math.isnan(distance) or distance > high:
        distance = math.inf
    elif distance < low:
        distance = -math.inf
    frame = message.header.frame_id.lstrip("/")
    return SonarReading(distance, stamp, float(message.field_of_view), low, high, frame)


def battery_level(message: Any, full: float) -> float | None:
    """Return the level (percent) in a `sensor_msgs/BatteryState`, or None if the message has none.

    Args:
        message: The message; its percentage may be NaN, then charge and capacity are used.
        full: The percentage that means full: 1 by ROS's definition.
    """
    for fraction in (
        message.percentage / full,
        message.charge / message.capacity if message.capacity else math.nan,
    ):
        if math.isfinite(fraction):
            return min(max(100.0 * fraction, 0.0), 100.0)
    return None
