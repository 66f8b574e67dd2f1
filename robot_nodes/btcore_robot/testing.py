"""Checks of the `Robot` protocol: call `check_robot` in a test of your own robot.

All `check_…` functions raise AssertionError with a sentence that describes the violation of the protocol.
"""

import math
import threading
from collections.abc import Callable

import numpy as np

from btcore.clock import NS_PER_S
from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import BASE_FRAME, LaserScan, Phase, Robot, TransformStamped, Twist2D

__all__ = ["check_robot"]


def check_robot(make_robot: Callable[[], Robot], *, drives: bool = True) -> None:
    """Check that a robot follows the protocol.

    Args:
        make_robot: A function that returns a new robot at rest, with at least 1 m of free space around it. It
            is called once for each check.
        drives: Whether to include the checks that drive the robot, by 0.2 m at most.

    Raises:
        AssertionError: The first violation of the protocol, described in a sentence.
    """
    checks = [check_info, check_scan, check_schedule, check_frames]
    checks += [check_camera, check_sonars, check_head, check_torso]
    if drives:
        checks += [check_standing, check_driving, check_turning, check_limits, check_timeout]
        checks += [check_stop, check_priority, check_commanded_velocity, check_battery]
    for check in checks:
        check(make_robot())


def check_info(robot: Robot) -> None:
    """Check that the robot's properties are plausible, and that its clock advances."""
    base, laser = robot.base_info, robot.laser_info
    assert isinstance(robot, Robot), "the robot does not have all methods of the protocol"
    assert base.v_min <= 0.0 < base.v_max, "a base drives forward: v_max is above 0, v_min is 0 or below"
    assert min(base.w_max, base.v_rate, base.w_rate) > 0.0, "speed and acceleration limits are above 0"
    assert 0.0 < base.command_timeout <= 1.0, "command_timeout is at most 1 s"
    assert 0.0 < base.radius < 5.0, "the footprint's radius is in metres"
    assert 0.0 <= laser.range_min < laser.range_max, "the laser's range_max is above its range_min"
    assert laser.rays >= 1, "the laser has at least one ray"
    assert abs(laser.angle_min) <= 2 * math.pi, "angles are in radians"
    before = robot.clock.now()
    assert not wait(robot, 0.1), "wait_until reports that the event was set, but it was not set"
    passed = robot.clock.now() - before
    assert passed >= NS_PER_S // 10, (
        f"the clock advanced by {passed} ns while 0.1 s were waited: is it in ns?"
    )


def check_scan(robot: Robot) -> None:
    """Check that scans have the required shape and conventions, and that new scans arrive."""
    first = wait_for_scan(robot, 2.0)
    info = robot.laser_info
    assert first.ranges.dtype == np.float32, "ranges are float32"
    assert first.ranges.shape == (info.rays,), "a scan has as many ranges as the laser has rays"
    assert first.angle_min == info.angle_min, "a scan's angle_min is the laser's"
    assert first.angle_increment == info.angle_increment, "a scan's angle_increment is the laser's"
    assert first.frame == info.frame, "a scan's frame is the laser's"
    finite = first.ranges[np.isfinite(first.ranges)]
    assert not np.isnan(first.ranges).any(), "no echo is +inf, too near is -inf; a range is never NaN"
    assert (finite >= info.range_min).all(), "under range_min a range is -inf (REP 117)"
    assert (finite <= info.range_max).all(), "over range_max a range is +inf (REP 117)"
    assert first.stamp <= robot.clock.now(), "a scan's stamp is not in the future"
    wait(robot, 3.0 / info.rate)
    # A real robot, or a busy machine, may delay a scan.
    end = robot.clock.now() + 2 * NS_PER_S
    while (later := robot.scan()) is not None and later.stamp <= first.stamp and robot.clock.now() < end:
        wait(robot, 1.0 / info.rate)
    assert later is not None, "scan() returned None after a scan had arrived"
    assert later.stamp > first.stamp, "new scans come with later stamps, at the laser's rate"


def check_schedule(robot: Robot) -> None:
    """Check that a scheduled task runs at its rate during a wait, and no longer after it was ended."""
    times: list[int] = []
    start = robot.clock.now()
    end = robot.schedule.add_task(20.0, Phase.COMPONENTS, times.append)
    wait(robot, 0.5)
    assert 9 <= len(times) <= 11, f"a task at 20 Hz ran {len(times)} times in 0.5 s"
    assert times == sorted(times), "the time that a task is called with never decreases"
    assert start < times[0] <= times[-1] <= robot.clock.now(), "a task is called with the time, in ns"
    end()
    before = len(times)
    wait(robot, 0.2)
    assert len(times) == before, "a task was ended, but it runs on"


def check_frames(robot: Robot) -> None:
    """Check that all frames form a tree below `base_footprint`, with the sensors' and the moving frames."""
    wait(robot, 0.1)
    frames = robot.frames()
    parents = {frame.child: frame.parent for frame in frames}
    assert len(parents) == len(frames), "a frame occurs once as a child: it has one parent"
    required = [robot.laser_info.frame, *(sonar.frame for sonar in robot.sonars())]
    if robot.camera_info is not None:
        required.append(robot.camera_info.frame)
    for name in required:
        assert name in parents, f"the sensor's frame '{name}' is not among the frames"
    for frame in robot.moving_frames():
        assert parents.get(frame.child) == frame.parent, (
            f"the moving frame '{frame.child}' in '{frame.parent}' is not among the frames"
        )
    for child in parents:
        chain = [child]
        while chain[-1] in parents and len(chain) <= len(parents):
            chain.append(parents[chain[-1]])
        assert chain[-1] == BASE_FRAME, (
            f"the chain of parents of frame '{child}' ends at '{chain[-1]}', not at {BASE_FRAME}"
        )
    for frame in frames:
        check_frame(frame, robot.clock.now())


def check_frame(frame: TransformStamped, now: int) -> None:
    """Check that a frame's pose and stamp are plausible.

    Args:
        frame: The frame to check.
        now: The robot's time (ns).

    Raises:
        AssertionError: The quaternion does not have length 1, the position is 10 m or more from the parent,
            or the stamp is later than *now*.
    """
    length = math.hypot(*frame.quaternion)
    assert abs(length - 1.0) < 1e-3, f"the quaternion of '{frame.child}' has length {length:.3f}, not 1"
    assert math.hypot(*frame.position) < 10.0, (
        f"'{frame.child}' is more than 10 m from its parent: is its position in metres?"
    )
    assert frame.stamp <= now, f"the stamp of '{frame.child}' is in the future"


def check_camera(robot: Robot) -> None:
    """Check the shape, type, frame and stamp of a camera image and its depth, if the robot has a camera."""
    wait(robot, 0.3)
    image, camera_info = robot.camera(), robot.camera_info
    if image is None:
        return
    assert camera_info is not None, "a robot with camera images has a camera_info"
    assert image.rgb.dtype == np.uint8, "the dtype of a camera image is uint8"
    assert image.rgb.ndim == 3, "a camera image has height, width and colours"
    assert image.rgb.shape[2] == 3, "the colours of a camera image are red, green and blue"
    assert image.stamp <= robot.clock.now(), "the stamp of a camera image is not in the future"
    assert image.rgb.shape[:2] == (camera_info.height, camera_info.width), (
        "a camera image is as high and wide as camera_info says"
    )
    assert image.frame == camera_info.frame, "the frame of a camera image is that of camera_info"
    assert min(camera_info.fx, camera_info.fy) > 0.0, "focal lengths are in pixels, and above 0"
    assert 0.0 < camera_info.near < camera_info.far, "near and far are in metres, and far is above near"
    if image.depth is None:
        return
    assert image.depth.dtype == np.float32, "depth is float32"
    assert image.depth.shape == image.rgb.shape[:2], "depth has a distance for every pixel"
    finite = image.depth[np.isfinite(image.depth)]
    assert not (np.isnan(image.depth) | (image.depth == -np.inf)).any(), (
        "without an echo depth is +inf, never NaN"
    )
    assert ((finite > 0.0) & (finite <= camera_info.far * 1.001)).all(), (
        "depth is in metres, and at most camera_info.far"
    )


def check_sonars(robot: Robot) -> None:
    """Check that sonars, if there are any, follow the conventions of REP 117."""
    wait(robot, 0.5)
    for sonar in robot.sonars():
        assert 0.0 <= sonar.range_min < sonar.range_max, "a sonar's range_max is above its range_min"
        assert 0.0 < sonar.fov < math.pi, "a sonar's fov is an angle in radians"
        assert sonar.stamp <= robot.clock.now(), "a sonar's stamp is not in the future"
        distance = sonar.range
        assert math.isinf(distance) or sonar.range_min <= distance <= sonar.range_max, (
            f"{sonar.frame} reports {distance} m: over its range_max it is +inf, under its range_min -inf"
        )


def check_head(robot: Robot) -> None:
    """Check that the head, if there is one, moves to a commanded position and stays within its limits."""
    head_info = robot.head_info
    if head_info is None:
        robot.move_head(0.1, 0.1)
        assert robot.head() is None, "a robot without head_info has no head position"
        return
    pan, tilt = head_info.pan_max / 2, head_info.tilt_min / 2
    robot.move_head(pan, tilt)
    wait(robot, 2.0)
    head = robot.head()
    assert head is not None, "a robot with head_info has a head position"
    assert abs(head.pan - pan) < 0.1, f"the head was sent to pan {pan:.2f} rad, and is at {head.pan:.2f}"
    assert abs(head.tilt - tilt) < 0.1, f"the head was sent to tilt {tilt:.2f} rad, and is at {head.tilt:.2f}"
    robot.move_head(head_info.pan_max + 10.0, head_info.tilt_max + 10.0)
    wait(robot, 2.0)
    head = robot.head()
    assert head is not None, "a robot with head_info has a head position"
    assert head.pan <= head_info.pan_max + 0.05, "the head stays within pan_max"
    assert head.tilt <= head_info.tilt_max + 0.05, "the head stays within tilt_max"


def check_torso(robot: Robot) -> None:
    """Check that the torso, if there is one, moves to a commanded height and stays within its limits."""
    torso = robot.torso_info
    if torso is None:
        robot.lift(0.1)
        assert robot.torso_height() is None, "a robot without torso limits has no torso height"
        return
    middle = (torso.lift_min + torso.lift_max) / 2
    for commanded, expected in ((middle, middle), (torso.lift_max + 1.0, torso.lift_max)):
        robot.lift(commanded)
        wait(robot, (torso.lift_max - torso.lift_min) / torso.speed + 1.0)
        height = robot.torso_height()
        assert height is not None, "a robot with torso limits has a torso height"
        assert abs(height - expected) < 0.02, (
            f"the torso was sent to {commanded:.2f} m, and is at {height:.2f} m"
        )


def check_standing(robot: Robot) -> None:
    """Check that a robot without a command does not move."""
    twist = drive_for(robot, None, 0.5)
    assert is_standing(twist), f"without a command a robot stands, but its odometry reports {twist}"


def check_driving(robot: Robot) -> None:
    """Check that *v* is in m/s, and that a positive *v* drives the robot forward, along +x of the base."""
    start = robot.odometry()
    v = min(0.1, robot.base_info.v_max)
    twist = drive_for(robot, (v, 0.0), 1.0)
    end = robot.odometry()
    assert end.stamp > start.stamp, "new odometry comes with later stamps"
    assert math.isclose(twist.v, v, rel_tol=0.2), (
        f"{v:g} m/s were commanded, but odometry reports {twist.v:.3f}"
    )
    along = (end.pose.x - start.pose.x) * math.cos(start.pose.yaw)
    along += (end.pose.y - start.pose.y) * math.sin(start.pose.yaw)
    assert 0.5 * v < along < 1.2 * v, f"1 s at {v:g} m/s moved the robot {along:.3f} m ahead"


def check_turning(robot: Robot) -> None:
    """Check that *w* is in rad/s, and that a positive *w* turns the robot to the left."""
    start = robot.odometry().pose.yaw
    w = min(0.5, robot.base_info.w_max)
    twist = drive_for(robot, (0.0, w), 1.0)
    assert math.isclose(twist.w, w, rel_tol=0.2), (
        f"{w:g} rad/s were commanded, but odometry reports {twist.w:.3f}"
    )
    turned = wrap_angle(robot.odometry().pose.yaw - start)
    assert 0.5 * w < turned < 1.2 * w, f"1 s at {w:g} rad/s to the left turned the robot by {turned:.3f} rad"


def check_limits(robot: Robot) -> None:
    """Check that the robot turns no faster than its limit when more is commanded."""
    twist = drive_for(robot, (0.0, 10.0 * robot.base_info.w_max), 2.0)
    assert abs(twist.w) <= 1.1 * robot.base_info.w_max, (
        f"w_max is {robot.base_info.w_max:g} rad/s, but odometry reports {twist.w:.2f}"
    )


def check_timeout(robot: Robot) -> None:
    """Check that a command expires after the base's `command_timeout`."""
    twist = drive_for(robot, (0.0, min(0.5, robot.base_info.w_max)), 0.5)
    assert not is_standing(twist), "the robot was commanded to turn, but it stands"
    twist = drive_for(robot, None, robot.base_info.command_timeout + 1.0)
    assert is_standing(twist), (
        f"the last command is older than command_timeout, but the robot still has {twist}"
    )


def check_stop(robot: Robot) -> None:
    """Check that `stop()` stops the robot, whatever the priority of the last command."""
    robot.drive(0.0, min(0.5, robot.base_info.w_max), priority=100)
    wait(robot, 0.1)
    robot.stop()
    twist = drive_for(robot, None, 1.0)
    assert is_standing(twist), f"stop() was called, but the robot still has {twist}"


def check_priority(robot: Robot) -> None:
    """Check that the robot follows the source of commands with the higher priority."""
    w = min(0.5, robot.base_info.w_max)
    for _ in range(10):
        robot.drive(0.0, w, priority=90)
        robot.drive(0.0, -w, priority=10)
        wait(robot, 0.1)
    assert robot.odometry().twist.w > 0.0, "a command of priority 10 won over one of priority 90"


def check_commanded_velocity(robot: Robot) -> None:
    """Check that the commanded velocity is reported until it expires."""
    w = min(0.3, robot.base_info.w_max)
    assert robot.commanded_velocity() == Twist2D(0.0, 0.0), (
        "commanded_velocity() is zero before the first command"
    )
    robot.drive(0.0, w)
    wait(robot, 0.05)
    assert robot.commanded_velocity() == Twist2D(0.0, w), (
        f"w = {w:g} was commanded, but commanded_velocity() returned {robot.commanded_velocity()}"
    )
    wait(robot, robot.base_info.command_timeout + 0.1)
    assert robot.commanded_velocity() == Twist2D(0.0, 0.0), (
        "commanded_velocity() is zero for an expired command"
    )
    robot.drive(0.0, w)
    robot.stop()
    assert robot.commanded_velocity() == Twist2D(0.0, 0.0), "commanded_velocity() is zero after stop()"


def check_battery(robot: Robot) -> None:
    """Check that the battery, if there is one, discharges while driving and is full after recharging."""
    before = robot.battery()
    if before is None:
        return
    assert 0.0 <= before.level <= 100.0, f"a battery's level is in percent (0 to 100), not {before.level}"
    assert before.stamp <= robot.clock.now(), "a battery's stamp is not in the future"
    drive_for(robot, (0.0, min(0.3, robot.base_info.w_max)), 1.0)
    after = robot.battery()
    assert after is not None, "battery() returned None after it had returned a level"
    assert after.level < before.level, f"1 s of turning did not discharge the battery at {before.level:g} %"
    robot.recharge()
    full = robot.battery()
    assert full is not None, "battery() returned None after it had returned a level"
    assert full.level > 99.0, f"the battery was recharged, and is at {full.level:g} %"


def drive_for(robot: Robot, command: tuple[float, float] | None, seconds: float) -> Twist2D:
    """Repeat a command at 10 Hz for *seconds* (s), and return the odometry's twist at the end.

    Args:
        robot: The robot to drive.
        command: The velocity (m/s, rad/s); with None no command is sent.
        seconds: The duration (s).
    """
    for _ in range(round(seconds * 10)):
        if command is not None:
            robot.drive(*command)
        wait(robot, 0.1)
    return robot.odometry().twist


def is_standing(twist: Twist2D) -> bool:
    """Return whether *twist* means that the robot is at rest (below 1 cm/s and 0.02 rad/s)."""
    return abs(twist.v) < 0.01 and abs(twist.w) < 0.02


def wait_for_scan(robot: Robot, seconds: float) -> LaserScan:
    """Wait for the first scan and return it.

    Args:
        robot: The robot with the laser.
        seconds: The maximum time (s) to wait, on the robot's clock.

    Raises:
        AssertionError: No scan arrived in time.
    """
    for _ in range(round(seconds * 10)):
        scan = robot.scan()
        if scan is not None:
            return scan
        wait(robot, 0.1)
    raise AssertionError(f"no scan came within {seconds:g} s")


def wait(robot: Robot, seconds: float) -> bool:
    """Wait on the robot's clock; the tasks of its schedule run meanwhile.

    Args:
        robot: The robot with the clock.
        seconds: The time (s) to wait.

    Returns:
        Whether the wait ended early, as the clock's `wait_until` returns it.
    """
    clock = robot.clock
    return clock.wait_until(clock.now() + round(seconds * NS_PER_S), threading.Event())
