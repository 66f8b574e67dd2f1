"""The contract that every Robot passes: `check_robot`, to be called in a test of your own robot."""

import math
import threading
from collections.abc import Callable

import numpy as np

from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import NS_PER_S, LaserScan, Phase, Robot, TransformStamped, Twist2D

FOOTPRINT = "base_footprint"


def check_robot(make_robot: Callable[[], Robot], *, drives: bool = True) -> None:
    """Raise AssertionError, with a sentence, for the first thing in which a robot breaks the protocol.

    *make_robot* gives a robot that stands, each time a fresh one, with at least 1 m of room around it. With
    *drives* it is driven about a little: 0.2 m at most.
    """
    check_facts(make_robot())
    check_scan(make_robot())
    check_schedule(make_robot())
    check_frames(make_robot())
    check_camera(make_robot())
    check_sonars(make_robot())
    check_head(make_robot())
    check_torso(make_robot())
    if drives:
        check_standing(make_robot())
        check_driving(make_robot())
        check_turning(make_robot())
        check_limits(make_robot())
        check_timeout(make_robot())
        check_stop(make_robot())
        check_priority(make_robot())
        check_asked(make_robot())
        check_battery(make_robot())


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


def check_schedule(robot: Robot) -> None:
    """What is scheduled runs at its rate while somebody waits, and no longer when it has been ended."""
    times: list[int] = []
    begun = robot.clock.now()
    end = robot.schedule.every(20.0, Phase.PROCESSES, times.append)
    wait(robot, 0.5)
    assert 9 <= len(times) <= 11, f"a task at 20 Hz ran {len(times)} times in 0.5 s"
    assert times == sorted(times), "a task is called with the time, and that doesn't go back"
    assert begun < times[0] <= times[-1] <= robot.clock.now(), "a task is called with the time, in ns"
    end()
    before = len(times)
    wait(robot, 0.2)
    assert len(times) == before, "a task was ended, and runs on"


def check_frames(robot: Robot) -> None:
    """All frames hang together below ``base_footprint``, and sensors have theirs."""
    wait(robot, 0.1)
    frames = robot.frames()
    parents = {frame.child: frame.parent for frame in frames}
    assert len(parents) == len(frames), "a frame is told of once: it has one parent"
    wanted = [robot.laser.frame, *(sonar.frame for sonar in robot.sonars())]
    if robot.camera_info is not None:
        wanted.append(robot.camera_info.frame)
    for name in wanted:
        assert name in parents, f"the sensor's frame '{name}' is not among the frames"
    for child in parents:
        way = [child]
        while way[-1] in parents and len(way) <= len(parents):
            way.append(parents[way[-1]])
        assert way[-1] == FOOTPRINT, (
            f"from frame '{child}' the way up ends at '{way[-1]}', not at {FOOTPRINT}"
        )
    for frame in frames:
        check_frame(frame, robot.clock.now())


def check_frame(frame: TransformStamped, now: int) -> None:
    """A frame's quaternion is one, and its stamp is of the time up to *now* (ns)."""
    length = math.hypot(*frame.quaternion)
    assert abs(length - 1.0) < 1e-3, f"the quaternion of '{frame.child}' has length {length:.3f}, and not 1"
    assert math.hypot(*frame.position) < 10.0, (
        f"'{frame.child}' is over 10 m from its parent: is it in metres?"
    )
    assert frame.stamp <= now, f"the stamp of '{frame.child}' is in the future"


def check_camera(robot: Robot) -> None:
    """A picture, if there is one, has height, width and three colours, as the lens says; perhaps depth."""
    wait(robot, 0.3)
    picture, lens = robot.camera(), robot.camera_info
    if picture is None:
        return
    assert lens is not None, "a robot that has pictures has a lens"
    assert picture.rgb.dtype == np.uint8, "a picture's dtype is uint8"
    assert picture.rgb.ndim == 3, "a picture has height, width and colours"
    assert picture.rgb.shape[2] == 3, "a picture's colours are red, green and blue"
    assert picture.stamp <= robot.clock.now(), "a picture's stamp is not in the future"
    assert picture.rgb.shape[:2] == (lens.height, lens.width), (
        "a picture is as high and wide as the lens says"
    )
    assert picture.frame == lens.frame, "a picture's frame is the lens's"
    assert min(lens.fx, lens.fy) > 0.0, "focal lengths are in pixels, and above 0"
    assert 0.0 < lens.near < lens.far, "what is drawn lies between near and far, in metres"
    if picture.depth is None:
        return
    assert picture.depth.dtype == np.float32, "depth is float32"
    assert picture.depth.shape == picture.rgb.shape[:2], "depth has a distance for every pixel"
    seen = picture.depth[np.isfinite(picture.depth)]
    assert not (np.isnan(picture.depth) | (picture.depth == -np.inf)).any(), "where nothing is depth is +inf"
    assert ((seen > 0.0) & (seen <= lens.far * 1.001)).all(), (
        "depth is in metres, and no farther than the lens"
    )


def check_sonars(robot: Robot) -> None:
    """Sonars, if there are some, have REP 117's conventions too."""
    wait(robot, 0.5)
    for sonar in robot.sonars():
        assert 0.0 <= sonar.range_min < sonar.range_max, "a sonar's range_max is above its range_min"
        assert 0.0 < sonar.fov < math.pi, "a sonar's cone is an angle in radians"
        assert sonar.stamp <= robot.clock.now(), "a sonar's stamp is not in the future"
        heard = sonar.range
        assert math.isinf(heard) or sonar.range_min <= heard <= sonar.range_max, (
            f"{sonar.frame} tells of {heard} m: over its range_max it is +inf, under its range_min -inf"
        )


def check_head(robot: Robot) -> None:
    """The head, if there is one, goes where it is sent, and no farther than its limits."""
    neck = robot.head_info
    if neck is None:
        robot.move_head(0.1, 0.1)
        assert robot.head() is None, "a robot without a neck has no head position"
        return
    pan, tilt = neck.pan_max / 2, neck.tilt_min / 2
    robot.move_head(pan, tilt)
    wait(robot, 2.0)
    head = robot.head()
    assert head is not None, "a robot with a neck has a head position"
    assert abs(head.pan - pan) < 0.1, f"the head was sent to pan {pan:.2f} rad, and is at {head.pan:.2f}"
    assert abs(head.tilt - tilt) < 0.1, f"the head was sent to tilt {tilt:.2f} rad, and is at {head.tilt:.2f}"
    robot.move_head(neck.pan_max + 10.0, neck.tilt_max + 10.0)
    wait(robot, 2.0)
    head = robot.head()
    assert head is not None, "a robot with a neck has a head position"
    assert head.pan <= neck.pan_max + 0.05, "the head stays within pan_max"
    assert head.tilt <= neck.tilt_max + 0.05, "the head stays within tilt_max"


def check_torso(robot: Robot) -> None:
    """The torso, if there is one, lifts as high as it is sent, and no farther than its limits."""
    torso = robot.torso
    if torso is None:
        robot.lift(0.1)
        assert robot.torso_height() is None, "a robot without a torso that lifts has no height of it"
        return
    middle = (torso.lift_min + torso.lift_max) / 2
    for sent, ends in ((middle, middle), (torso.lift_max + 1.0, torso.lift_max)):
        robot.lift(sent)
        wait(robot, (torso.lift_max - torso.lift_min) / torso.speed + 1.0)
        height = robot.torso_height()
        assert height is not None, "a robot with a torso has a height of it"
        assert abs(height - ends) < 0.02, f"the torso was sent to {sent:.2f} m, and is at {height:.2f} m"


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
    turned = wrap_angle(robot.odometry().pose.yaw - start)
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


def check_asked(robot: Robot) -> None:
    """What was asked for is told, until it lapses."""
    w = min(0.3, robot.base.w_max)
    assert robot.commanded_velocity() == Twist2D(0.0, 0.0), "nobody has asked for a velocity yet"
    robot.drive(0.0, w)
    wait(robot, 0.05)
    assert robot.commanded_velocity() == Twist2D(0.0, w), (
        f"w = {w:g} was asked for, and asked() says {robot.commanded_velocity()}"
    )
    wait(robot, robot.base.command_timeout + 0.1)
    assert robot.commanded_velocity() == Twist2D(0.0, 0.0), "a command that has lapsed is no longer asked for"
    robot.drive(0.0, w)
    robot.stop()
    assert robot.commanded_velocity() == Twist2D(0.0, 0.0), "after a stop nothing is asked for"


def check_battery(robot: Robot) -> None:
    """The battery, if there is one, falls with driving, and is full when recharged."""
    before = robot.battery()
    if before is None:
        return
    assert 0.0 <= before.level <= 100.0, f"a battery's level is in percent, and {before.level} is not"
    assert before.stamp <= robot.clock.now(), "a battery's stamp is not in the future"
    steered(robot, (0.0, min(0.3, robot.base.w_max)), 1.0)
    after = robot.battery()
    assert after is not None, "a battery is there, and then there is none"
    assert after.level < before.level, f"1 s of turning took nothing from the battery at {before.level:g} %"
    robot.recharge()
    full = robot.battery()
    assert full is not None, "a battery is there, and then there is none"
    assert full.level > 99.0, f"the battery was recharged, and is at {full.level:g} %"


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
