"""When the next tick of a periodic loop is due."""

from btcore.clock import NS_PER_S


class Metronome:
    """Ticks are due at multiples of *period* seconds after *now* (ns).

    One that comes late moves the next ones, and none is made up for.
    """

    def __init__(self, period: float, now: int) -> None:
        self.step = round(period * NS_PER_S)
        self.due = now

    def next(self, now: int) -> int:
        """The time (ns) of the next tick, it being *now*; an early tick doesn't move it."""
        if now >= self.due:
            self.due = max(self.due + self.step, now)
        return self.due
