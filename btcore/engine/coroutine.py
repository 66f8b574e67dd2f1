"""Runs a generator or an ``async def`` leaf tick by tick, and cancels it on halt.

No event loop is needed for :func:`running` and :func:`sleep`. Under ``await tree.run()`` a leaf may
await what asyncio offers too: it is RUNNING until that is done, and the tree is woken then.
"""

from collections.abc import Generator
from typing import Any, ClassVar

from mypy_extensions import mypyc_attr

from btcore.clock import NS_PER_S
from btcore.engine.leaf import StatefulAction
from btcore.errors import NodeError
from btcore.status import RUNNING


class Pause:
    """What a leaf waits for: *seconds* (s) of the tree's time; 0 is until the next tick."""

    def __init__(self, seconds: float = 0.0) -> None:
        self.seconds = seconds

    def __await__(self) -> Generator[Any, Any, None]:
        yield self


def running() -> Pause:
    """``await running()`` ends this tick; the leaf is RUNNING and goes on in the next one."""
    return Pause()


def sleep(seconds: float) -> Pause:
    """``await sleep(s)``: RUNNING for *seconds* (s) of the tree's time; the tree is woken then."""
    return Pause(seconds)


@mypyc_attr(allow_interpreted_subclasses=True)
class CoroutineAction(StatefulAction):
    """A leaf whose body is a generator or a coroutine, resumed once a tick."""

    state_fields: ClassVar[tuple[str, ...] | None] = None

    _body: Any = None
    _until: int = 0
    _future: Any = None

    def create_body(self) -> Any:
        """The generator or coroutine of a new start."""
        raise NodeError(f"<{self.id}> has no body")

    def on_start(self) -> object:
        """Start the body."""
        self._until = 0
        self._body = self.create_body()
        return self._resume()

    def on_running(self) -> object:
        """Resume the body, unless it sleeps or awaits something that isn't done."""
        if self._until and self.now() < self._until:
            return RUNNING
        if self._future is not None and not self._future.done():
            return RUNNING
        self._until = 0
        self._future = None
        return self._resume()

    def _resume(self) -> object:
        try:
            waits = self._body.send(None)
        except StopIteration as end:
            self._body = None
            return end.value
        except RuntimeError as fault:
            self._body = None
            if str(fault) == "no running event loop":
                raise self._foreign("asyncio") from fault
            raise
        except BaseException:
            self._body = None
            raise
        if isinstance(waits, Pause):
            if waits.seconds > 0:
                self._until = self.now() + round(waits.seconds * NS_PER_S)
                self.wake_at(self._until)
        elif waits is None:
            # From a coroutine that is asyncio.sleep(0): on as soon as the event loop went round.
            if self._context.on_wake is not None and hasattr(self._body, "cr_await"):
                self._context.on_wake()
        elif waits is not RUNNING:
            if not self._context.in_event_loop or not hasattr(waits, "_asyncio_future_blocking"):
                body, self._body = self._body, None
                body.close()
                raise self._foreign(repr(waits))
            # What a task of asyncio does with a future that its coroutine yields.
            waits._asyncio_future_blocking = False
            waits.add_done_callback(self._future_done)
            self._future = waits
        return RUNNING

    def _future_done(self, future: object) -> None:
        self.wake_up()

    def _foreign(self, what: str) -> NodeError:
        return NodeError(
            f"a leaf awaits btcore.running() and btcore.sleep(), or yields nothing; for {what} "
            "the tree has to be run by `await tree.run()`"
        )

    def on_halted(self) -> None:
        """Cancel the body: its ``finally`` blocks run now. Awaiting there is an error."""
        self.cancel_wake_up()
        body, self._body = self._body, None
        future, self._future = self._future, None
        if future is not None:
            future.cancel()
        if body is None:
            return
        try:
            body.close()
        except RuntimeError as fault:
            if "ignored GeneratorExit" in str(fault):
                raise NodeError("a leaf that is being halted can't await or yield any more") from None
            raise
