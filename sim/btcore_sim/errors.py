"""The error of invalid worlds, robots and scenarios."""


class SimError(Exception):
    """A world, a robot, a fault or an event is invalid; the message gives the reason and what to do."""
