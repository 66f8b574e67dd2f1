"""The transform tree, as in ROS's tf2: present and recent poses of frames relative to each other."""

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Sequence

from btcore.clock import NS_PER_S
from btcore.suggestions import did_you_mean
from btcore_robot.errors import RobotError
from btcore_robot.rigid_transform import Transform as Transform  # also public here
from btcore_robot.robot import BASE_FRAME as BASE_FRAME  # these are also public here
from btcore_robot.robot import MAP_FRAME as MAP_FRAME
from btcore_robot.robot import ODOM_FRAME as ODOM_FRAME
from btcore_robot.robot import Robot, TransformStamped

CACHE_TIME = 10 * NS_PER_S
"""The time (ns) for which poses of a moving frame are kept: tf2's default. Static frames are kept forever."""

_LENGTH_TOLERANCE = 1e-3  # of a unit quaternion


class TransformError(RobotError):
    """A transform is not available; the message gives the reason."""


class UnknownFrameError(TransformError):
    """A frame is not in the tree."""


class ConnectivityError(TransformError):
    """Both frames are in the tree, but no chain of frames connects them."""


class ExtrapolationError(TransformError):
    """The requested time is outside the stored period; *future* is True if it is after the period.

    Args:
        message: The error message.
    """

    def __init__(self, message: str, future: bool) -> None:
        self.future = future
        super().__init__(message)


class _Link:
    """The poses of a frame in its parent: one static pose, or poses in the order of their stamps."""

    __slots__ = ("child", "holds", "parent", "stamps", "static", "transforms")

    def __init__(self, child: str, parent: str, static: bool) -> None:
        self.child = child
        self.parent = parent
        self.static = static
        self.holds = 0
        # Deques, because one pose is added and one removed 50 times a second.
        self.stamps: deque[int] = deque()
        self.transforms: deque[Transform] = deque()

    def put(self, stamp: int, transform: Transform, holds: int) -> None:
        stamps, transforms = self.stamps, self.transforms
        self.holds = holds
        if not stamps or stamp > stamps[-1]:
            stamps.append(stamp)
            transforms.append(transform)
            oldest = stamp - CACHE_TIME
            while stamps[0] < oldest:
                stamps.popleft()
                transforms.popleft()
        elif stamp >= stamps[-1] - CACHE_TIME:
            # A late transform: insert it in the order of stamps.
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
        return transforms[place - 1].interpolate(transforms[place], (stamp - earlier) / (later - earlier))

    def _beyond(self, stamp: int, by: int, *, future: bool) -> ExtrapolationError:
        first, last = self.stamps[0], self.stamps[-1] + self.holds
        side, advice = (
            ("after", "wait for newer data, or look it up without a stamp")
            if future
            else ("before", f"{CACHE_TIME // NS_PER_S} s are kept")
        )
        return ExtrapolationError(
            f"the pose of '{self.child}' in '{self.parent}' is known from {_seconds(first)} to "
            f"{_seconds(last)}, but {_seconds(stamp)} is {_seconds(by)} {side} that; {advice}",
            future,
        )


class TransformTree:
    """The frames of a robot and its world: every frame has one parent, and poses are kept for 10 s.

    Between two stamps, positions are interpolated linearly and rotations along the shorter arc. Setting a
    frame with another parent moves it to that parent and discards its previous poses.

    Examples:
        >>> from btcore_robot.robot import TransformStamped
        >>> from btcore_robot.transforms import TransformTree
        >>> tree = TransformTree()
        >>> tree.set_static(TransformStamped("laser", "base", (0.2, 0.0, 0.1), (0.0, 0.0, 0.0, 1.0), 0))
        >>> tree.lookup("base", "laser").position
        (0.2, 0.0, 0.1)
    """

    def __init__(self) -> None:
        self._links: dict[str, _Link] = {}
        self._parents: set[str] = set()
        self._chains: dict[tuple[str, str], tuple[tuple[_Link, ...], tuple[_Link, ...]]] = {}

    def set(self, frame: TransformStamped, *, holds: int = 0) -> None:
        """Store the pose of *frame* at its stamp.

        A pose that is more than 10 s older than the newest is ignored. A pose with the same stamp replaces
        the old pose.

        Args:
            frame: The pose of the child frame in its parent.
            holds: The time (ns) after the stamp for which the newest pose remains valid.

        Raises:
            TransformError: The frame would be its own ancestor, its quaternion does not have length 1, or its
                position is not finite.
        """
        link = self._links.get(frame.child)
        if link is None or link.parent != frame.parent or link.static:
            link = self._add_link(frame, static=False)
        newest = link.transforms[-1] if link.transforms else None
        # Most frames of a robot are fixed: their pose consists of the same objects as the previous pose.
        if (
            newest is None
            or newest.position is not frame.position
            or newest.quaternion is not frame.quaternion
        ):
            _check(frame)
            newest = Transform(frame.position, frame.quaternion)
        link.put(frame.stamp, newest, holds)

    def set_static(self, frame: TransformStamped) -> None:
        """Store the pose of *frame* as a static pose, which is valid at all times.

        Raises:
            TransformError: The frame would be its own ancestor, its quaternion does not have length 1, or its
                position is not finite.
        """
        _check(frame)
        link = self._add_link(frame, static=True)
        link.transforms.append(Transform(frame.position, frame.quaternion))

    def lookup(self, target: str, source: str, stamp: int | None = None) -> Transform:
        """Return the pose of *source* in *target*, which transforms points of *source* to *target*.

        Args:
            target: The frame of the result.
            source: The frame whose pose is requested.
            stamp: The time (ns) of the pose; by default the newest time at which all frames in between are
                known.

        Raises:
            UnknownFrameError: A frame is not in the tree.
            ConnectivityError: No chain of frames connects *source* and *target*.
            ExtrapolationError: The time is outside the stored period.
        """
        up, down = self._chain(target, source)
        if stamp is None:
            stamp = _newest(up, down)
        to_ancestor, from_ancestor = _product(up, stamp), _product(down, stamp)
        if from_ancestor is None:
            return Transform() if to_ancestor is None else to_ancestor
        back = from_ancestor.inverse()
        return back if to_ancestor is None else back * to_ancestor

    def can_transform(self, target: str, source: str, stamp: int | None = None) -> bool:
        """Return whether `lookup` would succeed with the same arguments.

        Args:
            target: The frame of the result of `lookup`.
            source: The frame whose pose is requested.
            stamp: The time (ns) of the pose; by default the newest time at which all frames in between are
                known.
        """
        try:
            self.lookup(target, source, stamp)
        except TransformError:
            return False
        return True

    def frames(self) -> Sequence[str]:
        """Return the names of all frames, sorted."""
        return sorted(self._links.keys() | self._parents)

    def parent(self, frame: str) -> str | None:
        """Return the parent of *frame*, or None for a root and for an unknown frame."""
        link = self._links.get(frame)
        return None if link is None else link.parent

    def newest(self, frame: str) -> int | None:
        """Return the newest stamp (ns) of *frame*, or None for a static or unknown frame."""
        link = self._links.get(frame)
        return None if link is None or link.static else link.stamps[-1]

    def forget_moving(self) -> None:
        """Remove all poses that are not static, after a jump of the clock."""
        self._links = {child: link for child, link in self._links.items() if link.static}
        self._parents = {link.parent for link in self._links.values()}
        self._chains.clear()

    def _add_link(self, frame: TransformStamped, *, static: bool) -> _Link:
        ancestor: str | None = frame.parent
        while ancestor is not None:
            if ancestor == frame.child:
                below = f"'{frame.parent}', which is somewhere below it"
                position = "itself" if frame.parent == frame.child else below
                raise TransformError(f"'{frame.child}' can't be placed in {position}: frames form a tree")
            ancestor = self.parent(ancestor)
        _check(frame)
        link = self._links[frame.child] = _Link(frame.child, frame.parent, static)
        self._parents.add(frame.parent)
        self._chains.clear()
        return link

    def _chain(self, target: str, source: str) -> tuple[tuple[_Link, ...], tuple[_Link, ...]]:
        """Return the links from *source* up to the common ancestor, and those from *target* up to it.

        The result is cached until a link is added or replaced, because `lookup` is called for every scan and
        every tick.
        """
        chain = self._chains.get((target, source))
        if chain is None:
            for name in (target, source):
                if name not in self._links and name not in self._parents:
                    raise UnknownFrameError(self._unknown(name))
            up, down = self._links_to_root(source), self._links_to_root(target)
            while up and down and up[-1] is down[-1]:
                del up[-1], down[-1]
            roots = (up[-1].parent if up else source), (down[-1].parent if down else target)
            if roots[0] != roots[1]:
                raise ConnectivityError(
                    f"'{source}' and '{target}' are not connected: "
                    f"their roots are '{roots[0]}' and '{roots[1]}'"
                )
            chain = self._chains[(target, source)] = (tuple(up), tuple(down))
        return chain

    def _links_to_root(self, name: str) -> list[_Link]:
        links = []
        while (link := self._links.get(name)) is not None:
            links.append(link)
            name = link.parent
        return links

    def _unknown(self, name: str) -> str:
        known = self.frames()
        names = f"known frames: {', '.join(known)}" if known else "no frame is known yet"
        return f"there is no frame '{name}'{did_you_mean(name, known) or f'; {names}'}"


def _product(links: tuple[_Link, ...], stamp: int) -> Transform | None:
    """Return the pose of the first link's child in the last link's parent at *stamp* (ns).

    Return None without links.
    """
    result: Transform | None = None
    for link in links:
        step = link.transforms[0] if link.static else link.at(stamp)
        result = step if result is None else step * result
    return result


def _newest(up: tuple[_Link, ...], down: tuple[_Link, ...]) -> int:
    """Return the latest time (ns) at which all links are known; 0 when all are static."""
    return min((link.stamps[-1] + link.holds for link in (*up, *down) if not link.static), default=0)


def _check(frame: TransformStamped) -> None:
    x, y, z, w = frame.quaternion
    length = math.sqrt(x * x + y * y + z * z + w * w)
    if not abs(length - 1.0) <= _LENGTH_TOLERANCE:
        raise TransformError(
            f"'{frame.child}' in '{frame.parent}': the quaternion {frame.quaternion} has length {length:g}; "
            "a rotation has length 1 (x, y, z, w)"
        )
    if not math.isfinite(sum(frame.position)):
        place = f"'{frame.child}' in '{frame.parent}'"
        raise TransformError(f"{place}: the position {frame.position} is not finite")


def _seconds(nanoseconds: int) -> str:
    return f"{nanoseconds / NS_PER_S:.3f} s"


class FrameBroadcaster:
    """Writes the robot's frames to a transform tree: `odom` → `base_footprint`, links and sensors.

    Schedule `step` at `RATE` with `Phase.TRANSFORMS`.

    Args:
        robot: The robot.
        tree: The transform tree.
    """

    RATE = 50.0
    """The rate (Hz) at which `step` should run."""

    def __init__(self, robot: Robot, tree: TransformTree) -> None:
        self._robot = robot
        self._tree = tree
        self._wrote_fixed = False

    def step(self, now: int) -> None:
        """Write the current frames to the tree, each with the robot's stamp. *now* (ns) is not used.

        The first step writes the frames that never move; they are valid at all times.
        """
        odometry = self._robot.odometry()
        base = Transform.from_pose(odometry.pose)
        frame = TransformStamped(BASE_FRAME, ODOM_FRAME, base.position, base.quaternion, odometry.stamp)
        self._tree.set(frame)
        moving = self._robot.moving_frames()
        for frame in moving:
            self._tree.set(frame)
        if not self._wrote_fixed:
            self._wrote_fixed = True
            names = {frame.child for frame in moving}
            for frame in self._robot.frames():
                if frame.child not in names:
                    self._tree.set_static(frame)
