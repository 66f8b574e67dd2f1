"""Where frames are in one another, now and a while ago: the transform tree, by tf2's rules."""

import math
from bisect import bisect_left
from collections.abc import Sequence
from difflib import get_close_matches

from btcore_robot.errors import RobotError
from btcore_robot.rigid_transform import Transform
from btcore_robot.robot import NS_PER_S, Robot, TransformStamped

__all__ = [
    "ConnectivityError",
    "ExtrapolationError",
    "FrameBroadcaster",
    "Transform",
    "TransformError",
    "TransformTree",
    "UnknownFrameError",
]

HISTORY = 10 * NS_PER_S
"""How long (ns) a moving frame is remembered: tf2's default. Static frames are remembered for ever."""

_UNIT = 1e-3  # how far from 1 the length of a quaternion may be that stands for a rotation


class TransformError(RobotError):
    """There is no transform to be had, in a sentence."""


class UnknownFrameError(TransformError):
    """A frame that nobody has told of."""


class ConnectivityError(TransformError):
    """Both frames are known, and no chain of frames leads from one to the other."""


class ExtrapolationError(TransformError):
    """The moment lies outside what is remembered; *future* tells on which side."""

    def __init__(self, message: str, future: bool) -> None:
        self.future = future
        super().__init__(message)


class _Link:
    """One frame in its parent: fixed, or with a history in the order of its stamps."""

    __slots__ = ("child", "holds", "parent", "stamps", "static", "transforms")

    def __init__(self, child: str, parent: str, static: bool) -> None:
        self.child = child
        self.parent = parent
        self.static = static
        self.holds = 0
        self.stamps: list[int] = []
        self.transforms: list[Transform] = []

    def put(self, stamp: int, transform: Transform, holds: int) -> None:
        stamps, transforms = self.stamps, self.transforms
        self.holds = holds
        if not stamps or stamp > stamps[-1]:
            stamps.append(stamp)
            transforms.append(transform)
            oldest = stamp - HISTORY
            while stamps[0] < oldest:
                del stamps[0], transforms[0]
        elif stamp >= stamps[-1] - HISTORY:
            place = bisect_left(stamps, stamp)
            if stamps[place] == stamp:
                transforms[place] = transform
            else:
                stamps.insert(place, stamp)
                transforms.insert(place, transform)

    def at(self, stamp: int) -> Transform:
        stamps, transforms = self.stamps, self.transforms
        last = stamps[-1]
        if stamp >= last:
            if stamp - last <= self.holds:
                return transforms[-1]
            raise self._beyond(stamp, stamp - last - self.holds, future=True)
        if stamp < stamps[0]:
            raise self._beyond(stamp, stamps[0] - stamp, future=False)
        place = bisect_left(stamps, stamp)
        later = stamps[place]
        if later == stamp:
            return transforms[place]
        earlier = stamps[place - 1]
        return transforms[place - 1].towards(transforms[place], (stamp - earlier) / (later - earlier))

    def _beyond(self, stamp: int, by: int, *, future: bool) -> ExtrapolationError:
        first, last = self.stamps[0], self.stamps[-1] + self.holds
        side, advice = (
            ("after", "wait for newer data, or ask without a stamp")
            if future
            else ("before", f"{HISTORY // NS_PER_S} s are kept")
        )
        return ExtrapolationError(
            f"where '{self.child}' is in '{self.parent}' is known from {_seconds(first)} to {_seconds(last)}"
            f", and {_seconds(stamp)} lies {_seconds(by)} {side} that; {advice}",
            future,
        )


class TransformTree:
    """The frames of a robot and its world. Every frame has one parent; moving ones are remembered for 10 s.

    Between two stamps positions are interpolated along a line and rotations along the shorter arc. Whoever
    tells of a frame under a new parent moves it there, and what was known of it is forgotten.
    """

    def __init__(self) -> None:
        self._links: dict[str, _Link] = {}
        self._parents: set[str] = set()
        self._chains: dict[tuple[str, str], tuple[tuple[_Link, ...], tuple[_Link, ...]]] = {}

    def set(self, frame: TransformStamped, *, holds: int = 0) -> None:
        """Tell where *frame* was at its stamp. For *holds* ns after the stamp, the newest also counts.

        What is older than the newest by more than 10 s is left out; the same stamp again replaces. Raises
        TransformError for a frame in itself, a ring of frames, and numbers that are no transform.
        """
        link = self._links.get(frame.child)
        if link is None or link.parent != frame.parent or link.static:
            link = self._grow(frame, static=False)
        _check(frame)
        link.put(frame.stamp, Transform(frame.position, frame.quaternion), holds)

    def set_static(self, frame: TransformStamped) -> None:
        """Tell where *frame* is at all times. Raises as `set` does."""
        _check(frame)
        link = self._grow(frame, static=True)
        link.transforms = [Transform(frame.position, frame.quaternion)]

    def lookup(self, target: str, source: str, stamp: int | None = None) -> Transform:
        """What takes points of *source* to *target*, which is the pose of *source* in *target*.

        *stamp* (ns) is the moment; None the newest that is known of all frames on the way. Raises
        UnknownFrameError, ConnectivityError, or ExtrapolationError when the moment is not remembered or
        still to come.
        """
        up, down = self._chain(target, source)
        if stamp is None:
            stamp = _newest(up, down)
        result: Transform | None = None
        for link in up:
            step = link.transforms[0] if link.static else link.at(stamp)
            result = step if result is None else step * result
        if not down:
            return Transform() if result is None else result
        back: Transform | None = None
        for link in down:
            step = link.transforms[0] if link.static else link.at(stamp)
            back = step if back is None else step * back
        assert back is not None
        return back.inverse() if result is None else back.inverse() * result

    def can_transform(self, target: str, source: str, stamp: int | None = None) -> bool:
        """Whether `lookup` finds it."""
        try:
            self.lookup(target, source, stamp)
        except TransformError:
            return False
        return True

    def frames(self) -> Sequence[str]:
        """The names of all frames, sorted."""
        return sorted(self._links.keys() | self._parents)

    def parent(self, frame: str) -> str | None:
        """The parent of *frame*; None for a root and for a frame that nobody has told of."""
        link = self._links.get(frame)
        return None if link is None else link.parent

    def _grow(self, frame: TransformStamped, *, static: bool) -> _Link:
        ancestor: str | None = frame.parent
        while ancestor is not None:
            if ancestor == frame.child:
                what = (
                    "itself"
                    if frame.parent == frame.child
                    else f"'{frame.parent}', which is somewhere below it"
                )
                raise TransformError(f"'{frame.child}' can't be placed in {what}: frames form a tree")
            ancestor = self.parent(ancestor)
        _check(frame)
        link = self._links[frame.child] = _Link(frame.child, frame.parent, static)
        self._parents.add(frame.parent)
        self._chains.clear()
        return link

    def _chain(self, target: str, source: str) -> tuple[tuple[_Link, ...], tuple[_Link, ...]]:
        """The links from *source* up to the frame that both are below, and those from *target* up to it."""
        found = self._chains.get((target, source))
        if found is None:
            for name in (target, source):
                if name not in self._links and name not in self._parents:
                    raise UnknownFrameError(self._unknown(name))
            up, down = self._upwards(source), self._upwards(target)
            while up and down and up[-1] is down[-1]:
                del up[-1], down[-1]
            roots = (up[-1].parent if up else source), (down[-1].parent if down else target)
            if roots[0] != roots[1]:
                raise ConnectivityError(
                    f"'{source}' and '{target}' are not connected: "
                    f"one is below '{roots[0]}', the other below '{roots[1]}'"
                )
            found = self._chains[(target, source)] = (tuple(up), tuple(down))
        return found

    def _upwards(self, name: str) -> list[_Link]:
        links = []
        while (link := self._links.get(name)) is not None:
            links.append(link)
            name = link.parent
        return links

    def _unknown(self, name: str) -> str:
        known = self.frames()
        near = get_close_matches(name, known, n=1)
        if near:
            return f"there is no frame '{name}'; did you mean '{near[0]}'?"
        return f"there is no frame '{name}'; " + (
            f"known are: {', '.join(known)}" if known else "none is known yet"
        )


def _newest(up: tuple[_Link, ...], down: tuple[_Link, ...]) -> int:
    """The latest moment (ns) at which all links are known; 0 when all are fixed."""
    newest: int | None = None
    for links in (up, down):
        for link in links:
            if not link.static:
                last = link.stamps[-1] + link.holds
                if newest is None or last < newest:
                    newest = last
    return 0 if newest is None else newest


def _check(frame: TransformStamped) -> None:
    x, y, z, w = frame.quaternion
    length = math.sqrt(x * x + y * y + z * z + w * w)
    if not abs(length - 1.0) <= _UNIT:
        raise TransformError(
            f"'{frame.child}' in '{frame.parent}': the quaternion {frame.quaternion} has length {length:g}; "
            "one that stands for a rotation has length 1 (x, y, z, w)"
        )
    if not math.isfinite(sum(frame.position)):
        raise TransformError(
            f"'{frame.child}' in '{frame.parent}': the position {frame.position} is not finite"
        )


def _seconds(nanoseconds: int) -> str:
    return f"{nanoseconds / NS_PER_S:.3f} s"


class FrameBroadcaster:
    """Tells a tree what the robot knows of its frames: ``odom`` → ``base_footprint``, and its links.

    `step` belongs on the schedule, at 50 Hz with ``Phase.TRANSFORMS``.
    """

    RATE = 50.0

    def __init__(
        self, robot: Robot, tree: TransformTree, odom: str = "odom", base: str = "base_footprint"
    ) -> None:
        self._robot = robot
        self._tree = tree
        self._odom = odom
        self._base = base

    def step(self, now: int) -> None:
        """Tell where all is now; each frame with the stamp that the robot gives it."""
        odometry = self._robot.odometry()
        pose = odometry.pose
        half = pose.yaw / 2.0
        self._tree.set(
            TransformStamped(
                self._base,
                self._odom,
                (pose.x, pose.y, 0.0),
                (0.0, 0.0, math.sin(half), math.cos(half)),
                odometry.stamp,
            )
        )
        for frame in self._robot.frames():
            self._tree.set(frame)
