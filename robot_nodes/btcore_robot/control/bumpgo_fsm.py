"""Bump and go by a state machine (the book's chapter 3): forward, back, turn, and stop without a laser."""

from collections.abc import Callable
from enum import Enum

from btcore_robot.process.process import Process, ProcessContext, ProcessOptions
from btcore_robot.robot import NS_PER_S, LaserScan, Twist2D

PERIOD = 0.05
"""How often (s) it decides: 20 Hz."""
SPEED_LINEAR = 0.3
"""m/s, forward and back."""
SPEED_ANGULAR = 0.3
"""rad/s."""
OBSTACLE_DISTANCE = 1.0
"""How near (m) the middle reading may be before the robot turns away."""
BACKING_TIME = 2 * NS_PER_S
TURNING_TIME = 2 * NS_PER_S
SCAN_TIMEOUT = 1 * NS_PER_S


class State(Enum):
    """What it is doing."""

    FORWARD = "forward"
    BACK = "back"
    TURN = "turn"
    STOP = "stop"


Act = Callable[[LaserScan, int], tuple[Twist2D, State | None]]
"""What is done in a state, given the newest scan and the time (ns) in it: the velocity, and what is next."""


class BumpGo(Process):
    """Drives forward until something is nearer than 1 m ahead; then back for 2 s, left for 2 s, and on.

    With a scan older than 1 s it stops, until there is a newer one. It hears ``input_scan`` and publishes on
    ``output_vel``, nothing before the first scan. In the cycle of a change the velocity is still that of the
    state it leaves. Of two reasons to leave FORWARD an obstacle wins over an old scan.
    """

    def __init__(self, context: ProcessContext, options: ProcessOptions | None = None) -> None:
        super().__init__("bump_go", context, options)
        self.velocities = self.publisher("output_vel", Twist2D)
        self.subscribe("input_scan", LaserScan, self.scanned)
        self.timer(PERIOD, self.cycle)
        self.state = State.FORWARD
        self.since = self.now()
        """When (ns) this state began."""
        self.changes = 0
        """How often the state has changed."""
        self.scan: LaserScan | None = None
        self._acts: dict[State, Act] = {
            State.FORWARD: self.forward,
            State.BACK: self.back,
            State.TURN: self.turn,
            State.STOP: self.stop,
        }

    def scanned(self, scan: LaserScan) -> None:
        """Keep the newest scan."""
        self.scan = scan

    def cycle(self) -> None:
        """Publish what the state asks for, then see whether another one is next."""
        scan = self.scan
        if scan is None:
            return
        twist, following = self._acts[self.state](scan, self.now() - self.since)
        self.velocities.publish(twist)
        if following is not None:
            self.enter(following)

    def enter(self, state: State) -> None:
        """Begin *state*."""
        self.info(f"{self.state.value} -> {state.value}")
        self.state = state
        self.since = self.now()
        self.changes += 1

    def forward(self, scan: LaserScan, elapsed: int) -> tuple[Twist2D, State | None]:
        """Drive forward."""
        following = None
        if self.stale(scan):
            following = State.STOP
        if self.blocked(scan):
            following = State.BACK
        return Twist2D(SPEED_LINEAR, 0.0), following

    def back(self, scan: LaserScan, elapsed: int) -> tuple[Twist2D, State | None]:
        """Drive backwards."""
        return Twist2D(-SPEED_LINEAR, 0.0), State.TURN if elapsed > BACKING_TIME else None

    def turn(self, scan: LaserScan, elapsed: int) -> tuple[Twist2D, State | None]:
        """Turn to the left."""
        return Twist2D(0.0, SPEED_ANGULAR), State.FORWARD if elapsed > TURNING_TIME else None

    def stop(self, scan: LaserScan, elapsed: int) -> tuple[Twist2D, State | None]:
        """Stand until the laser is back."""
        return Twist2D(0.0, 0.0), None if self.stale(scan) else State.FORWARD

    def stale(self, scan: LaserScan) -> bool:
        """Whether the newest scan is too old to drive by."""
        return self.now() - scan.stamp > SCAN_TIMEOUT

    def blocked(self, scan: LaserScan) -> bool:
        """Whether the middle reading is too near."""
        return bool(scan.ranges[len(scan.ranges) // 2] < OBSTACLE_DISTANCE)
