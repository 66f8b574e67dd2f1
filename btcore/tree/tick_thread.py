"""A thread for ticks that may stop at a breakpoint without blocking the event loop that runs the tree.

A tick consists of nested function calls, which cannot be suspended and resumed, so it runs on a separate
thread. This thread and the event loop's thread alternate: only one of them works at any time, as if there
were one thread. So leaves may use the event loop as usual; it runs only while the tick is stopped.
"""

import asyncio
import contextvars
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from btcore.status import Status


class TickThread:
    """The thread for the ticks of one `tree.run()`. The task that runs the tree creates and closes it."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._task: asyncio.Task[Any] | None = asyncio.current_task()
        self._tick: Callable[[], Status] | None = None
        self._result: Future[Status] = Future()
        self._has_turn = False
        self._released = asyncio.Event()
        # Released to give the turn to the tick thread, and to give it back to the event loop's thread.
        self._tick_turn = threading.Semaphore(0)
        self._loop_turn = threading.Semaphore(0)
        self._thread = threading.Thread(
            target=contextvars.copy_context().run, args=(self._run_ticks,), name="btcore-tick", daemon=True
        )
        self._thread.start()

    # --- the methods below run on the event loop's thread

    async def run(self, tick: Callable[[], Status], ignore_breakpoints: Callable[[bool], None]) -> Status:
        """Run *tick* on the tick thread. Return its result or raise its exception.

        Args:
            tick: The function that ticks the tree.
            ignore_breakpoints: Called with True when the task is cancelled while the tick is stopped, so that
                the tick completes before the cancellation continues; then called with False.
        """
        self._tick = tick
        self._result = Future()
        try:
            self._give_turn()
            while not self._result.done():
                await self._released.wait()
                self._released.clear()
                self._give_turn()
        except BaseException:
            ignore_breakpoints(True)
            while not self._result.done():
                self._give_turn()
            ignore_breakpoints(False)
            raise
        return self._result.result()

    def close(self) -> None:
        """End the thread."""
        if not self._has_turn:
            self._tick = None
            self._tick_turn.release()
            self._thread.join()

    def _give_turn(self) -> None:
        # In debug mode an event loop rejects calls from other threads. The tick thread acts as the event
        # loop's thread while it has its turn.
        is_debugging = self._loop.get_debug()
        if is_debugging:
            self._loop.set_debug(False)
        try:
            if not self._has_turn:  # True if Ctrl-C interrupted the last call in acquire()
                self._has_turn = True
                self._tick_turn.release()
            self._loop_turn.acquire()
            self._has_turn = False
        finally:
            if is_debugging:
                self._loop.set_debug(True)

    # --- the methods below run on the tick thread

    @property
    def is_current(self) -> bool:
        """Whether the calling thread is the tick thread."""
        return threading.current_thread() is self._thread

    def yield_to_loop(self) -> None:
        """Let the event loop run, because the tick is stopped."""
        self._loop_turn.release()

    def wait_for_turn(self) -> None:
        """Request a turn, and wait until the event loop's thread gives it: then the tick may continue."""
        self._loop.call_soon_threadsafe(self._released.set)
        self._tick_turn.acquire()

    def _run_ticks(self) -> None:
        asyncio._set_running_loop(self._loop)
        if sys.version_info >= (3, 14) and self._task is not None:
            # From Python 3.14 on, the current task is stored per thread, and not per event loop.
            asyncio.tasks._enter_task(self._loop, self._task)
        while True:
            self._tick_turn.acquire()
            tick = self._tick
            if tick is None:
                return
            try:
                self._result.set_result(tick())
            except BaseException as error:
                self._result.set_exception(error)
            self._loop_turn.release()
