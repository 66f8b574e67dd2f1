"""The contract that every Robot passes: `check_robot`, to be called in a test of your own robot."""

import math
import threading
from collections.abc import Callable

import numpy as np

from robot_nodes.robot import LaserScan, Robot, Twist2D

NS_PER_S = 1_000_000_000


def check_robot(make_robot: Callable[[], Robot], *, drives: bool = True) -> None:
    """Raise AssertionError, with a sentence, for the first thing in which a robot breaks the protocol.

    *make_robot* gives a robot that stands, each time a fresh one, with at least 1 m of room around it. With
    *drives* it is driven about a little: 0.2 m at most.
    """
    check_facts(make_robot())
    check_scan(make_robot())
    check_camera(make_robot())
    check_head(make_robot())
    if drives:
        check_standing(make_robot())
        check_driving(make_robot())
        check_turning(make_robot())
        check_limits(make_robot())
        check_timeout(make_robot())
        check_stop(make_robot())
        check_priority(make_robot())


def check_facts(robot: Robot) -> None:
    """What it says of itself is possible, and its clock goes forward."""
    base, laser = robot.base, robot.laser
    assert isinstance(robot, Robot), "the robot lacks a part of the protocol"
    assert base.v_min <= 0.0 < base.v_max, "a base drives forward, and its v_min is 0 or below"
    assert min(base.w_max, base.v_rate, base.w_rate) > 0.0, "speed and acceleration limits are above 0"
    assert 0.0 < base.command_timeout <= 1.0, "a base stops by itself within 1 s of its last command"
    assert 0.0 < base.radius < 5.0, "the footprint's radius is in metres"
    assert 0.0 <= laser.range_min < laser.range_max, "a laser's range_max is above its range_min"
    assert laser.rays >= 1, "a laser has rays"
    assert abs(laser.angle_min) <= 2 * math.pi, "angles are in radians"
    before = robot.clock.now()
    assert not wait(robot, 0.1), "nobody has set the event, and wait_until says that somebody has"
    passed = robot.clock.now() - before
    assert passed >= NS_PER_S // 10, f"0.1 s were waited, and the clock went {passed} ns: is it in ns?"


def check_scan(robot: Robot) -> None:
    """Scans have the shape and the conventions that are promised, and keep coming."""
    first = scan_within(robot, 2.0)
    facts = robot.laser
    assert first.ranges.dtype == np.float32, "ranges are float32"
    assert first.ranges.shape == (facts.rays,), "a scan has as many ranges as the laser has rays"
    assert first.angle_min == facts.angle_min, "a scan's angle_min is the laser's"
    assert first.angle_increment == facts.angle_increment, "a scan's angle_increment is the laser's"
    assert first.frame == facts.frame, "a scan's frame is the laser's"
    seen = first.ranges[np.isfinite(first.ranges)]
    assert not np.isnan(first.ranges).any(), "no echo is +inf, too near is -inf; a range is never NaN"
    assert (seen >= facts.range_min).all(), "under range_min a range is -inf (REP 117)"
    assert (seen <= facts.range_max).all(), "over range_max a range is +inf (REP 117)"
    assert first.stamp <= robot.clock.now(), "a scan's stamp is not in the future"
    wait(robot, 3.0 / facts.rate)
    later = robot.scan()
    assert later is not None, "a scan is there, and then there is none"
    assert later.stamp > first.stamp, "new scans come, with later stamps, at the laser's rate"


def check_camera(robot: Robot) -> None:
    """A picture, if there is one, has height, width and three colours."""
    wait(robot, 0.3)
    picture = robot.camera()
    if picture is None:
        return
    assert picture.rgb.dtype == np.uint8, "a picture's dtype is uint8"
    assert picture.rgb.ndim == 3, "a picture has height, width and colours"
    assert picture.rgb.shape[2] == 3, "a picture's colours are red, green and blue"
    assert picture.stamp <= robot.clock.now(), "a picture's stamp is not in the future"


def check_head(robot: Robot) -> None:
    """The head, if there is one, goes where it is sent, and no farther than its limits."""
    neck = robot.neck
    if neck is None:
        robot.look(0.1, 0.1)
        assert robot.head() is None, "a robot without a neck has no head position"
        return
    pan, tilt = neck.pan_max / 2, neck.tilt_min / 2
    robot.look(pan, tilt)
    wait(robot, 2.0)
    head = robot.head()
    assert head is not None, "a robot with a neck has a head position"
    assert abs(head.pan - pan) < 0.1, f"the head was sent to pan {pan:.2f} rad, and is at {head.pan:.2f}"
    assert abs(head.tilt - tilt) < 0.1, f"the head was sent to tilt {tilt:.2f} rad, and is at {head.tilt:.2f}"
    robot.look(neck.pan_max + 10.0, neck.tilt_max + 10.0)
    wait(robot, 2.0)
    head = robot.head()
    assert head is not None, "a robot with a neck has a head position"
    assert head.pan <= neck.pan_max + 0.05, "the head stays within pan_max"
    assert head.tilt <= neck.tilt_max + 0.05, "the head stays within tilt_max"


def check_standing(robot: Robot) -> None:
    """Nobody commands it, and it stands."""
    twist = steered(robot, None, 0.5)
    assert still(twist), f"without a command a robot stands, and this one has {twist}"


def check_driving(robot: Robot) -> None:
    """v is m/s, forward is +x of the odometry."""
    start = robot.odometry()
    v = min(0.1, robot.base.v_max)
    twist = steered(robot, (v, 0.0), 1.0)
    end = robot.odometry()
    assert end.stamp > start.stamp, "odometry keeps coming, with later stamps"
    assert math.isclose(twist.v, v, rel_tol=0.2), f"{v:g} m/s were asked for, and odometry says {twist.v:.3f}"
    along = (end.pose.x - start.pose.x) * math.cos(start.pose.yaw)
    along += (end.pose.y - start.pose.y) * math.sin(start.pose.yaw)
    assert 0.5 * v < along < 1.2 * v, f"1 s at {v:g} m/s moved the robot {along:.3f} m ahead"


def check_turning(robot: Robot) -> None:
    """w is rad/s, + is to the left."""
    start = robot.odometry().pose.yaw
    w = min(0.5, robot.base.w_max)
    twist = steered(robot, (0.0, w), 1.0)
    assert math.isclose(twist.w, w, rel_tol=0.2), f"{w:g} rad/s were asked for, odometry says {twist.w:.3f}"
    turned = math.remainder(robot.odometry().pose.yaw - start, 2 * math.pi)
    assert 0.5 * w < turned < 1.2 * w, f"1 s at {w:g} rad/s to the left turned the robot by {turned:.3f} rad"


def check_limits(robot: Robot) -> None:
    """It turns no faster than it says, however much is asked for."""
    twist = steered(robot, (0.0, 10.0 * robot.base.w_max), 2.0)
    assert abs(twist.w) <= 1.1 * robot.base.w_max, (
        f"w_max is {robot.base.w_max:g}, and {twist.w:.2f} was driven"
    )


def check_timeout(robot: Robot) -> None:
    """A command lapses."""
    twist = steered(robot, (0.0, min(0.5, robot.base.w_max)), 0.5)
    assert not still(twist), "the robot was told to turn, and stands"
    twist = steered(robot, None, robot.base.command_timeout + 1.0)
    assert still(twist), f"the last command is older than the time-out, and the robot still has {twist}"


def check_stop(robot: Robot) -> None:
    """Stop stops, and outranks what came before."""
    robot.drive(0.0, min(0.5, robot.base.w_max), priority=100)
    wait(robot, 0.1)
    robot.stop()
    twist = steered(robot, None, 1.0)
    assert still(twist), f"the robot was told to stop, and has {twist}"


def check_priority(robot: Robot) -> None:
    """Of two sources the one with the higher priority wins."""
    w = min(0.5, robot.base.w_max)
    for _ in range(10):
        robot.drive(0.0, w, priority=90)
        robot.drive(0.0, -w, priority=10)
        wait(robot, 0.1)
    assert robot.odometry().twist.w > 0.0, "a command of priority 10 won over one of priority 90"


def steered(robot: Robot, command: tuple[float, float] | None, seconds: float) -> Twist2D:
    """The odometry's twist after *seconds* (s) of a command repeated at 10 Hz, or of silence."""
    for _ in range(round(seconds * 10)):
        if command is not None:
            robot.drive(*command)
        wait(robot, 0.1)
    return robot.odometry().twist


def still(twist: Twist2D) -> bool:
    """Whether that is standing (under 1 cm/s and 0.02 rad/s)."""
    return abs(twist.v) < 0.01 and abs(twist.w) < 0.02


def scan_within(robot: Robot, seconds: float) -> LaserScan:
    """The first scan, which has to come within *seconds* (s)."""
    for _ in range(round(seconds * 10)):
        scan = robot.scan()
        if scan is not None:
            return scan
        wait(robot, 0.1)
    raise AssertionError(f"no scan came within {seconds:g} s")


def wait(robot: Robot, seconds: float) -> bool:
    """Let *seconds* (s) of the robot's time pass; whether something woke the wait."""
    clock = robot.clock
    return clock.wait_until(clock.now() + round(seconds * NS_PER_S), threading.Event())
