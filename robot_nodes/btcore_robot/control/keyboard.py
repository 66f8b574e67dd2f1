"""Driving by keys: what each of them means, where they come from, and how long one counts."""

import os
import select
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self

from btcore_robot.errors import RobotError
from btcore_robot.robot import NS_PER_S, Robot, Twist2D

KEY_VEL = 90
"""The priority of a keyboard's commands (twist_mux of Tiago's start-up files)."""
HELD = round(0.75 * NS_PER_S)
"""How long (ns) a key counts. A terminal repeats one that is held, the first time after half a second."""
FORWARD, BACKWARD, TURN = 0.3, -0.2, 0.5
"""How fast keys drive: m/s, m/s, rad/s."""

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
END = ("x", "\x03", "\x04")
"""Keys that end the drive: x, Ctrl-C, Ctrl-D."""
HELP = "w/↑ forward, s/↓ back, a/← left, d/→ right, q and e both at once, space stop, x end"


class KeyInputError(RobotError):
    """Keys that can't be driven by: a sentence that says which, and what would be right."""


class Keys(Protocol):
    """Where keys come from."""

    def pressed(self, now: int) -> str | None:
        """The key that was pressed last, or is held, at *now* (ns); None if none; "x" for the end."""
        ...


@dataclass(frozen=True, slots=True)
class Script(Keys):
    """Keys that are held one after the other: pairs of a key and until when (ns) from the start on."""

    holds: tuple[tuple[str, int], ...]

    def pressed(self, now: int) -> str | None:
        """The key that is held; after the last one the drive ends."""
        return next((key for key, until in self.holds if now < until), "x")


def script(text: str) -> Script:
    """The keys written ``w:5,a:2,…``: each with how long (s) it is held. Raises `KeyInputError`."""
    holds, until = [], 0
    for part in text.split(","):
        name, colon, seconds = part.strip().partition(":")
        key = " " if name == "space" else name
        if key not in _KEYS:
            raise KeyInputError(
                f"'{part.strip()}' has no key to drive by: there are w, a, s, d, q, e and space"
            )
        try:
            lasts = float(seconds) if colon else 1.0
        except ValueError:
            lasts = -1.0
        if not 0.0 < lasts < 1e6:
            raise KeyInputError(f"'{part.strip()}' says no time: w:5 holds the key w for 5 s")
        until += round(lasts * NS_PER_S)
        holds.append((key, until))
    return Script(tuple(holds))


class Terminal(Keys):
    """The keys of the terminal that the program runs in, which doesn't show them meanwhile.

    Raises `KeyInputError` where standard input is no terminal.
    """

    def __init__(self) -> None:
        if not sys.stdin.isatty():
            raise KeyInputError("standard input is no terminal that has keys: --keys w:5,a:2 drives without")
        self._pressed: tuple[str, int] | None = None

    def __enter__(self) -> Self:
        import termios
        import tty

        self._before = termios.tcgetattr(sys.stdin)
        tty.setcbreak(sys.stdin)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        import termios

        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)

    def pressed(self, now: int) -> str | None:
        """The last key, while it counts."""
        for key in keys_in(self._read()):
            self._pressed = (key, now)
            if key in END:
                return "x"
        if self._pressed is None or now - self._pressed[1] > HELD:
            return None
        return self._pressed[0]

    def _read(self) -> str:
        read = b""
        while select.select([sys.stdin], [], [], 0.0)[0]:
            more = os.read(sys.stdin.fileno(), 64)
            if not more:
                return read.decode(errors="ignore") + "\x04"
            read += more
        return read.decode(errors="ignore")


def keys_in(text: str) -> Sequence[str]:
    """The keys in what a terminal sends: arrows come as three characters, capitals mean the same."""
    for arrow, key in _ARROWS.items():
        text = text.replace(arrow, key)
    return [one for one in text.lower() if one in _KEYS or one in END]


class KeyDrive:
    """Drives *robot* by *keys*, from now on. `step` is called ten times a second or so."""

    def __init__(self, robot: Robot, keys: Keys) -> None:
        self._robot = robot
        self._keys = keys
        self._began = robot.clock.now()

    def step(self) -> bool:
        """Drive as the key says that is held; whether the drive goes on."""
        key = self._keys.pressed(self._robot.clock.now() - self._began)
        if key == "x":
            self._robot.drive(0.0, 0.0, priority=KEY_VEL)
            return False
        asked = _KEYS.get(key or " ", _KEYS[" "])
        self._robot.drive(asked.v, asked.w, priority=KEY_VEL)
        return True
