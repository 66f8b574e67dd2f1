"""Changes of a running tree that wait for the thread that ticks it."""

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Final

from btcore_monitor.serve.hook_controller import RequestRejectedError

MAX_WAIT_S: Final = 5.0
"""Maximum time (s, wall clock) until a change is executed; afterwards it is refused."""

_MAX_WAITING: Final = 16
_MAX_ERROR_CHARS: Final = 2_000


class Change:
    """A change that a client has requested.

    Args:
        text: The XML of the new tree, or "".
        execute: Executes the change on the thread that ticks.
    """

    def __init__(self, text: str = "", execute: Callable[[], None] = lambda: None) -> None:
        self.text = text
        self.execute = execute
        self.deadline = time.monotonic() + MAX_WAIT_S
        self.result: str | None = None
        """None before the end of the change, then "", or why nothing was changed."""

    def finish(self, error: str = "") -> None:
        """End the change. *error* is why nothing was changed, or ""."""
        self.result = error[:_MAX_ERROR_CHARS]


class ChangeQueue:
    """Changes that wait for the thread that ticks. All methods are thread-safe.

    Attributes:
        is_used: Whether a program takes the changes.
    """

    def __init__(self) -> None:
        self.is_used = False
        self._waiting: deque[Change] = deque()
        self._lock = threading.Lock()

    @property
    def has_waiting(self) -> bool:
        """Whether a change waits."""
        return bool(self._waiting)

    def add(self, change: Change) -> None:
        """Append a change.

        Raises:
            RequestRejectedError: Too many changes wait.
        """
        with self._lock:
            if len(self._waiting) >= _MAX_WAITING:
                raise RequestRejectedError("too many changes wait for the tree")
            self._waiting.append(change)

    def take(self) -> Change | None:
        """Remove and return the next change, which the caller executes and finishes; None without one."""
        if not self.has_waiting:  # the usual case, before each tick
            return None
        with self._lock:
            return self._waiting.popleft() if self._waiting else None

    def execute_all(self) -> None:
        """Execute and finish all changes."""
        while (change := self.take()) is not None:
            try:
                change.execute()
                change.finish()
            # The thread that ticks must continue, also if the class of a value raises another exception.
            except Exception as error:
                change.finish(f"the entry is not set: {error}")

    def refuse(self, reason: str, before: float = float("inf")) -> None:
        """Refuse the changes whose deadline (s, monotonic) is earlier than *before*."""
        with self._lock:
            while self._waiting and self._waiting[0].deadline < before:
                self._waiting.popleft().finish(reason)
