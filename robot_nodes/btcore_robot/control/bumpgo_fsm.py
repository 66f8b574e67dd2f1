"""Bump and go by a state machine (the book's chapter 3): forward, back, turn, and stop without a scan."""

from collections.abc import Callable
from enum import Enum

from btcore_robot.process.process import Process, ProcessContext, ProcessOptions
from btcore_robot.robot import NS_PER_S, LaserScan, Twist2D

PERIOD = 0.05
"""The period (s) of the control cycle: 20 Hz."""
SPEED_LINEAR = 0.3
"""The speed (m/s) forward and backward."""
SPEED_ANGULAR = 0.3
"""The angular speed (rad/s) of a turn."""
OBSTACLE_DISTANCE = 1.0
"""The distance (m) at the middle beam below which there is an obstacle."""
BACKING_TIME = 2 * NS_PER_S
TURNING_TIME = 2 * NS_PER_S
SCAN_TIMEOUT = 1 * NS_PER_S


class BumpGoState(Enum):
    """The state of the machine."""

    FORWARD = "forward"
    BACK = "back"
    TURN = "turn"
    STOP = "stop"


StateHandler = Callable[[LaserScan, int], tuple[Twist2D, BumpGoState | None]]
"""A state's action: from the newest scan and the time (ns) in the state to the velocity and the next state.

The next state is None while the state does not change.
"""


class BumpGo(Process):
    """Drive forward up to an obstacle 1 m ahead; then back for 2 s, turn left for 2 s, and forward again.

    The robot stops when the newest scan is older than 1 s, until there is a newer scan. The process
    subscribes to ``input_scan`` and publishes on ``output_vel``, starting with the first scan. In the cycle
    of a state change the velocity is still that of the old state. In the state FORWARD an obstacle takes
    precedence over an old scan.
    """

    def __init__(self, context: ProcessContext, options: ProcessOptions | None = None) -> None:
        super().__init__("bump_go", context, options)
        self.velocities = self.create_publisher("output_vel", Twist2D)
        self.create_subscription("input_scan", LaserScan, self.on_scan)
        self.create_timer(PERIOD, self.control_cycle)
        self.state = BumpGoState.FORWARD
        self.since = self.now()
        """The time (ns) at which the current state began."""
        self.changes = 0
        """The number of state changes."""
        self.scan: LaserScan | None = None
        self._handlers: dict[BumpGoState, StateHandler] = {
            BumpGoState.FORWARD: self.forward,
            BumpGoState.BACK: self.back,
            BumpGoState.TURN: self.turn,
            BumpGoState.STOP: self.stop,
        }

    def on_scan(self, scan: LaserScan) -> None:
        """Store the newest scan."""
        self.scan = scan

    def control_cycle(self) -> None:
        """Publish the velocity of the current state, then change the state if necessary."""
        scan = self.scan
        if scan is None:
            return
        twist, next_state = self._handlers[self.state](scan, self.now() - self.since)
        self.velocities.publish(twist)
        if next_state is not None:
            self.enter(next_state)

    def enter(self, state: BumpGoState) -> None:
        """Change to *state*."""
        self.info(f"{self.state.value} -> {state.value}")
        self.state = state
        self.since = self.now()
        self.changes += 1

    def forward(self, scan: LaserScan, elapsed: int) -> tuple[Twist2D, BumpGoState | None]:
        """Drive forward."""
        next_state = None
        if self.is_stale(scan):
            next_state = BumpGoState.STOP
        # Checked last: an obstacle takes precedence over an old scan.
        if self.is_blocked(scan):
            next_state = BumpGoState.BACK
        return Twist2D(SPEED_LINEAR, 0.0), next_state

    def back(self, scan: LaserScan, elapsed: int) -> tuple[Twist2D, BumpGoState | None]:
        """Drive backwards."""
        # Strictly more than the time, as in the book.
        return Twist2D(-SPEED_LINEAR, 0.0), BumpGoState.TURN if elapsed > BACKING_TIME else None

    def turn(self, scan: LaserScan, elapsed: int) -> tuple[Twist2D, BumpGoState | None]:
        """Turn to the left."""
        return Twist2D(0.0, SPEED_ANGULAR), BumpGoState.FORWARD if elapsed > TURNING_TIME else None

    def stop(self, scan: LaserScan, elapsed: int) -> tuple[Twist2D, BumpGoState | None]:
        """Stand until there is a recent scan."""
        return Twist2D(0.0, 0.0), None if self.is_stale(scan) else BumpGoState.FORWARD

    def is_stale(self, scan: LaserScan) -> bool:
        """Return whether the newest scan is too old to drive by."""
        return self.now() - scan.stamp > SCAN_TIMEOUT

    def is_blocked(self, scan: LaserScan) -> bool:
        """Return whether there is an obstacle at the middle beam."""
        return bool(scan.ranges[len(scan.ranges) // 2] < OBSTACLE_DISTANCE)
