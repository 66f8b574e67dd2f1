"""Waiting between the ticks of a tree in an asyncio event loop."""

import asyncio
import contextlib

from btcore.clock import NS_PER_S, SystemClock, TickSchedule
from btcore.engine.context import TreeContext


class EventLoopWait:
    """A wait that lets the event loop run until the next tick is due, or until a wake-up from any thread."""

    def __init__(self, context: TreeContext, schedule: TickSchedule) -> None:
        self._context = context
        self._loop = asyncio.get_running_loop()
        self._woken = asyncio.Event()
        self._schedule = schedule
        context.on_wake_up = self._wake

    async def until_next_tick(self) -> None:
        """Wait for the next tick of the schedule, a deadline of the tree or a wake-up."""
        context = self._context
        due = context.next_tick_time(self._schedule)
        if isinstance(context.clock, SystemClock):
            duration = max(due - context.clock.now(), 0) / NS_PER_S
            # Not asyncio.wait_for(), which in Python 3.11 drops a cancellation that comes with a wake-up.
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(duration):
                    await self._woken.wait()
            due = 0
        else:
            await asyncio.sleep(0)
        self._woken.clear()
        # Consumes the pending wake-up, and lets a simulated clock advance to the due time.
        context.wait_until(due)

    def close(self) -> None:
        """Stop forwarding wake-ups to the event loop."""
        self._context.on_wake_up = None

    def _wake(self) -> None:
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._woken.set)
