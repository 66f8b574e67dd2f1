"""Runs a generator or an ``async def`` leaf tick by tick, and cancels it on halt.

No event loop is needed: :func:`running` and :func:`sleep` are all that such a leaf waits for here.
"""

from collections.abc import Generator
from typing import Any

from mypy_extensions import mypyc_attr

from btcore.clock import NS_PER_S
from btcore.errors import NodeFault
from btcore.leaf import StatefulAction
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
class SteppedAction(StatefulAction):
    """A leaf whose body is a generator or a coroutine, resumed once a tick."""

    _body: Any = None
    _until: int = 0

    def begin(self) -> Any:
        """The generator or coroutine of a new start."""
        raise NodeFault(f"<{self.id}> has no body")

    def on_start(self) -> object:
        """Start the body."""
        self._until = 0
        self._body = self.begin()
        return self._resume()

    def on_running(self) -> object:
        """Resume the body, unless it sleeps."""
        if self._until and self.now() < self._until:
            return RUNNING
        self._until = 0
        return self._resume()

    def _resume(self) -> object:
        try:
            waits = self._body.send(None)
        except StopIteration as end:
            self._body = None
            return end.value
        except BaseException:
            self._body = None
            raise
        if isinstance(waits, Pause):
            if waits.seconds > 0:
                self._until = self.now() + round(waits.seconds * NS_PER_S)
                self.wake_at(self._until)
        elif waits is not None and waits is not RUNNING:
            self._body.close()
            self._body = None
            raise NodeFault(
                f"a leaf may await btcore.running() and btcore.sleep(), or yield nothing, not {waits!r}; "
                "anything of asyncio needs an event loop"
            )
        return RUNNING

    def on_halted(self) -> None:
        """Cancel the body: its ``finally`` blocks run now. Awaiting there is an error."""
        self.forget_wake_up()
        body, self._body = self._body, None
        if body is None:
            return
        try:
            body.close()
        except RuntimeError as fault:
            if "ignored GeneratorExit" in str(fault):
                raise NodeFault("a leaf that is being halted can't await or yield any more") from None
            raise
