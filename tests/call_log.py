"""A log of the calls of leaves in tests."""


class CallLog:
    """A log of the calls of leaves, in order. An entry is `NAME:CALL`, for example `n3:start`.

    Attributes:
        calls: The entries so far.
    """

    def __init__(self) -> None:
        self.calls: list[str] = []

    def record(self, name: str, call: str) -> None:
        """Record a call of the leaf *name*: `start`, `running`, `halted` or `tick`."""
        self.calls.append(f"{name}:{call}")

    def take(self) -> list[str]:
        """Return the calls since the last call of this method."""
        taken, self.calls = self.calls, []
        return taken
