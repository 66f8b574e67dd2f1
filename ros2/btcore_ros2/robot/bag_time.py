"""The time of a bag, which jumps from stamp to stamp."""

import threading
from collections.abc import Callable, Iterator

from btcore.errors import EndOfTimeError
from btcore_robot.schedule import SimulatedSchedule

BagMessage = tuple[str, int, bytes]
"""A message of a bag: its topic, its stamp (ns), and its content."""


class BagTime(SimulatedSchedule):
    """The time of the messages of a bag, and the periodic tasks on it.

    Waiting passes on the messages up to the end of the wait, at the times of their stamps. After the last
    message, waiting raises an EndOfTimeError.

    Args:
        messages: The messages in the order of their stamps.
        receive: Called with the topic and the content of each message.
    """

    def __init__(self, messages: Iterator[BagMessage], receive: Callable[[str, bytes], None]) -> None:
        self._messages = messages
        self._receive = receive
        self._next = next(messages, None)
        super().__init__(start=0 if self._next is None else self._next[1], pace=self._play)

    def advance(self) -> bool:
        """Pass on the next message; return whether there was one."""
        if self._next is None:
            return False
        topic, stamp, data = self._next
        self._now = max(self._now, stamp)
        self._receive(topic, data)
        self._next = next(self._messages, None)
        return True

    def finish_moment(self) -> None:
        """Pass on the messages with the present time."""
        while self._next is not None and self._next[1] <= self._now:
            self.advance()

    def _play(self, now: int, until: int, wake: threading.Event) -> bool:
        """Pass on the messages up to *until* (ns); see `SimulatedSchedule`."""
        while self._next is not None and self._next[1] <= until and not wake.is_set():
            self.advance()
        if self._next is None:
            raise EndOfTimeError("the bag has ended")
        return wake.is_set()
