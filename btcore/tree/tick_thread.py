"""A tick that may stand still without holding up the event loop that runs the tree.

A tick is a nest of plain calls, which can't be left in the middle and resumed, so it gets a thread
of its own. It and the loop's thread take turns: while one works the other stands still, as if
there were one thread. Leaves use the loop as ever, and nothing of theirs runs beside them but
what the loop does while the tick stands.
"""

import asyncio
import contextvars
import sys
import threading
from collections.abc import Callable
from typing import Any

from btcore.status import IDLE, Status


class TickThread:
    """The thread for one run's ticks. Made, used and closed by the task that runs the tree."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._task: asyncio.Task[Any] | None = asyncio.current_task()
        self._tick: Callable[[], Status] | None = None
        self._status: Status = IDLE
        self._fault: BaseException | None = None
        self._done = False
        self._given = False
        self._freed = asyncio.Event()
        self._go = threading.Semaphore(0)
        self._back = threading.Semaphore(0)
        self._thread = threading.Thread(
            target=contextvars.copy_context().run, args=(self._work,), name="btcore-tick", daemon=True
        )
        self._thread.start()

    # what follows runs on the loop's thread

    async def run(self, tick: Callable[[], Status], ignore_breakpoints: Callable[[bool], None]) -> Status:
        """What *tick* returns or raises.

        Cancelled while it stands, *ignore_breakpoints* frees it, and it goes on to its end before this
        ends too.
        """
        self._tick = tick
        self._done = False
        try:
            self._give_turn()
            while not self._done:
                await self._freed.wait()
                self._freed.clear()
                self._give_turn()
        except BaseException:
            ignore_breakpoints(True)
            while not self._done:
                self._give_turn()
            ignore_breakpoints(False)
            self._fault = None
            raise
        fault, self._fault = self._fault, None
        if fault is not None:
            raise fault
        return self._status

    def close(self) -> None:
        """End the thread."""
        if not self._given:
            self._tick = None
            self._go.release()
            self._thread.join()

    def _give_turn(self) -> None:
        # Debugging, a loop refuses calls from other threads; this one is its own for the moment.
        debugs = self._loop.get_debug()
        if debugs:
            self._loop.set_debug(False)
        try:
            if not self._given:  # by a call that Ctrl-C broke off
                self._given = True
                self._go.release()
            self._back.acquire()
            self._given = False
        finally:
            if debugs:
                self._loop.set_debug(True)

    # what follows runs on the tick's thread

    @property
    def is_current(self) -> bool:
        """Whether this is the tick's thread."""
        return threading.current_thread() is self._thread

    def yield_to_loop(self) -> None:
        """Give the loop its turn: the tick stands."""
        self._back.release()

    def wait_for_turn(self) -> None:
        """Wait for the turn: the tick may go on."""
        self._loop.call_soon_threadsafe(self._freed.set)
        self._go.acquire()

    def _work(self) -> None:
        asyncio._set_running_loop(self._loop)
        if sys.version_info >= (3, 14) and self._task is not None:
            # There, the current task is the thread's, not the loop's.
            asyncio.tasks._enter_task(self._loop, self._task)
        while True:
            self._go.acquire()
            tick = self._tick
            if tick is None:
                return
            try:
                self._status = tick()
            except BaseException as fault:
                self._fault = fault
            self._done = True
            self._back.release()
