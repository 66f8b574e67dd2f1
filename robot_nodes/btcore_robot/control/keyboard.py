"""Driving with keys: the velocity of each key, and keys from the terminal or from a script."""

import os
import select
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self

from btcore.clock import NS_PER_S
from btcore_robot.errors import RobotError
from btcore_robot.robot import Robot, Twist2D

__all__ = [
    "KeyInputError",
    "KeySource",
    "KeyboardTeleop",
    "ScriptedKeys",
    "Terminal",
    "parse_key_script",
    "parse_keys",
]

KEY_VEL_PRIORITY = 90
"""The priority of a keyboard's commands (twist_mux configuration of Tiago)."""
KEY_TIMEOUT = round(0.75 * NS_PER_S)
"""The time (ns) for which a key counts as held after it was received.

A terminal repeats a held key; the first repetition comes after about 0.5 s.
"""
FORWARD, BACKWARD, TURN = 0.3, -0.2, 0.5
"""The speeds of the keys: forward (m/s), backward (m/s) and turning (rad/s)."""

_KEYS = {
    "w": Twist2D(FORWARD, 0.0),
    "q": Twist2D(FORWARD, TURN),
    "e": Twist2D(FORWARD, -TURN),
    "a": Twist2D(0.0, TURN),
    "d": Twist2D(0.0, -TURN),
    "s": Twist2D(BACKWARD, 0.0),
    " ": Twist2D(0.0, 0.0),
}
_ARROWS = {"\x1b[A": "w", "\x1b[B": "s", "\x1b[C": "d", "\x1b[D": "a"}
_WINDOWS_ARROWS = {"H": "w", "P": "s", "M": "d", "K": "a"}
"""The second character of an arrow key on Windows, after one of `_WINDOWS_PREFIXES`."""
_WINDOWS_PREFIXES = ("\x00", "\xe0")
END_KEYS = ("x", "\x03", "\x04")
"""The keys that end the drive: x, Ctrl-C, Ctrl-D."""
HELP = "w/↑ forward, s/↓ back, a/← left, d/→ right, q/e forward and left/right, space stop, x end"


class KeyInputError(RobotError):
    """The keys cannot be used; the message names the problem and gives an example."""


class KeySource(Protocol):
    """A source of the keys that drive the robot."""

    def pressed(self, now: int) -> str | None:
        """Return the key that is held, None if no key is held, or "x" to end the drive.

        *now* is the time (ns) since the start of the drive.
        """


@dataclass(frozen=True, slots=True)
class ScriptedKeys(KeySource):
    """Keys that are held in sequence. *holds* has pairs of a key and its end (ns from the start)."""

    holds: tuple[tuple[str, int], ...]

    def pressed(self, now: int) -> str | None:
        """Return the key that is held; after the last key, "x"."""
        return next((key for key, until in self.holds if now < until), "x")


def parse_key_script(text: str) -> ScriptedKeys:
    """Return the keys in *text*, such as `w:5,a:2`: each key with the time (s) for which it is held.

    Without a time, a key is held for 1 s.

    Raises:
        KeyInputError: A key or a time is invalid.
    """
    holds, until = [], 0
    for part in text.split(","):
        name, colon, seconds = part.strip().partition(":")
        key = " " if name == "space" else name
        if key not in _KEYS:
            raise KeyInputError(f"'{part.strip()}' has no key to drive by: use w, a, s, d, q, e or space")
        try:
            duration = float(seconds) if colon else 1.0
        except ValueError:
            duration = -1.0
        if not 0.0 < duration < 1e6:
            raise KeyInputError(f"'{part.strip()}' has no valid time: w:5 holds the key w for 5 s")
        until += round(duration * NS_PER_S)
        holds.append((key, until))
    return ScriptedKeys(tuple(holds))


class Terminal(KeySource):
    """The keys of the program's terminal, which does not echo them during the drive.

    Raises:
        KeyInputError: Standard input is not a terminal.
    """

    def __init__(self) -> None:
        if not sys.stdin.isatty():
            raise KeyInputError("standard input is not a terminal: use --keys w:5,a:2 to drive without one")
        self._pressed: tuple[str, int] | None = None

    def __enter__(self) -> Self:
        # On Windows, the functions that read single keys do not echo them.
        if sys.platform != "win32":
            import termios
            import tty

            self._terminal_attributes = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
        return self

    def __exit__(
        self, error_type: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if sys.platform != "win32":
            import termios

            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._terminal_attributes)

    def pressed(self, now: int) -> str | None:
        """Return the last key until `KEY_TIMEOUT` after it was received; "x" if a key ends the drive."""
        for key in parse_keys(self._read()):
            self._pressed = (key, now)
            if key in END_KEYS:
                return "x"
        if self._pressed is None or now - self._pressed[1] > KEY_TIMEOUT:
            return None
        return self._pressed[0]

    def _read(self) -> str:
        """Return the keys typed since the last call, without waiting for more."""
        if sys.platform == "win32":
            import msvcrt

            text = ""
            while msvcrt.kbhit():
                key = msvcrt.getwch()
                text += _WINDOWS_ARROWS.get(msvcrt.getwch(), "") if key in _WINDOWS_PREFIXES else key
            return text
        read = b""
        while select.select([sys.stdin], [], [], 0.0)[0]:
            more = os.read(sys.stdin.fileno(), 64)
            if not more:
                # End of input, for example when a pipe is closed: end the drive.
                return read.decode(errors="ignore") + "\x04"
            read += more
        return read.decode(errors="ignore")


def parse_keys(text: str) -> Sequence[str]:
    """Return the keys in the input of a terminal.

    An arrow key arrives as three characters; case is ignored.
    """
    for arrow, key in _ARROWS.items():
        text = text.replace(arrow, key)
    return [key for key in text.lower() if key in _KEYS or key in END_KEYS]


class KeyboardTeleop:
    """Drives *robot* with *keys*. Call `step` about ten times a second."""

    def __init__(self, robot: Robot, keys: KeySource) -> None:
        self._robot = robot
        self._keys = keys
        self._start = robot.clock.now()

    def step(self) -> bool:
        """Send the command of the held key; return False when the drive ends."""
        key = self._keys.pressed(self._robot.clock.now() - self._start)
        if key == "x":
            self._robot.drive(0.0, 0.0, priority=KEY_VEL_PRIORITY)
            return False
        # Without a held key the robot stops.
        twist = _KEYS.get(key or " ", _KEYS[" "])
        self._robot.drive(twist.v, twist.w, priority=KEY_VEL_PRIORITY)
        return True
