"""Leaves written as a generator or as `async def`: resumed once per tick, cancelled on halt.

`running` and `sleep` need no event loop. Under `await tree.run()` a leaf may also await
asyncio's functions: it is RUNNING until the awaited future is done, which wakes the tree.
"""

from collections.abc import Generator
from typing import Any, ClassVar

from mypy_extensions import mypyc_attr

from btcore.clock import NS_PER_S
from btcore.engine.leaf import StatefulAction
from btcore.engine.node import read_clock
from btcore.engine.node_spec import NodeSpec
from btcore.errors import NodeError
from btcore.status import RUNNING


class Pause:
    """A wait of *seconds* (s) on the tree's clock; 0 = until the next tick."""

    def __init__(self, seconds: float = 0.0) -> None:
        self.seconds = seconds

    def __await__(self) -> Generator[Any, Any, None]:
        yield self

    def __repr__(self) -> str:
        return f"sleep({self.seconds:g})" if self.seconds else "running()"


def running() -> Pause:
    """`await running()` ends this tick with RUNNING; the leaf continues in the next tick.

    Returns:
        An awaitable, for `await` in a coroutine leaf.

    Examples:
        >>> import btcore
        >>> @btcore.action
        ... async def count():
        ...     for n in range(2):
        ...         await btcore.running()
        ...     return True
        >>> nodes = btcore.Registry.standard()
        >>> nodes.add(count)
        >>> b = btcore.Builder(nodes)
        >>> tree = b.build(b.Count())
        >>> [tree.tick_once().name for _ in range(3)]
        ['RUNNING', 'RUNNING', 'SUCCESS']
    """
    return Pause()


def sleep(seconds: float) -> Pause:
    """`await sleep(s)` keeps the leaf RUNNING for *seconds* (s, tree's clock), then wakes the tree.

    Returns:
        An awaitable, for `await` in a coroutine leaf.

    Examples:
        >>> import btcore
        >>> @btcore.action
        ... async def wait():
        ...     await btcore.sleep(2.0)
        ...     return True
        >>> nodes = btcore.Registry.standard()
        >>> nodes.add(wait)
        >>> b = btcore.Builder(nodes)
        >>> clock = btcore.SimClock()
        >>> b.build(b.Wait(), clock=clock).tick_while_running(), clock.now()
        (<Status.SUCCESS: 2>, 2000000000)
    """
    return Pause(seconds)


@mypyc_attr(allow_interpreted_subclasses=True)
class CoroutineAction(StatefulAction):
    """A leaf whose body is a generator or a coroutine, resumed once per tick."""

    spec: ClassVar[NodeSpec] = NodeSpec(state_fields=None)

    _body: Any = None
    _sleep_end: int = 0  # the time (ns) until which the body sleeps; 0 = it does not
    _future: Any = None  # the future of asyncio that the body awaits

    def create_body(self) -> Any:
        """Return a new generator or coroutine. Called at each start of the node."""
        raise NodeError(f"<{self.config.id}> has no body")

    def on_start(self) -> object:
        """Start the body."""
        self._sleep_end = 0
        self._body = self.create_body()
        return self._resume()

    def on_running(self) -> object:
        """Resume the body, unless it still sleeps or awaits a future that is not done."""
        if self._sleep_end and not self.has_passed(self._sleep_end):
            return RUNNING
        if self._future is not None and not self._future.done():
            return RUNNING
        self._sleep_end = 0
        self._future = None
        return self._resume()

    def _resume(self) -> object:
        try:
            yielded = self._body.send(None)
        except StopIteration as end:
            self._body = None
            return end.value
        except RuntimeError as error:
            self._body = None
            if str(error) == "no running event loop":
                raise self._await_error("asyncio") from error
            raise
        except BaseException:
            self._body = None
            raise
        if isinstance(yielded, Pause):
            if yielded.seconds > 0:
                self._sleep_end = read_clock(self) + round(yielded.seconds * NS_PER_S)
                self.wake_at(self._sleep_end)
        elif yielded is None:
            # A coroutine yields None for asyncio.sleep(0): continue after one cycle of the event loop.
            if self._context.on_wake_up is not None and hasattr(self._body, "cr_await"):
                self._context.on_wake_up()
        elif yielded is not RUNNING:
            if not self._context.is_in_event_loop or not hasattr(yielded, "_asyncio_future_blocking"):
                body, self._body = self._body, None
                body.close()
                raise self._await_error(repr(yielded))
            # The protocol between asyncio.Task and a future that its coroutine yields (asyncio/tasks.py).
            yielded._asyncio_future_blocking = False
            yielded.add_done_callback(self._on_future_done)
            self._future = yielded
        return RUNNING

    def _on_future_done(self, future: object) -> None:
        self.wake_up()

    def _await_error(self, awaited: str) -> NodeError:
        return NodeError(
            f"a leaf can await btcore.running() and btcore.sleep(), or yield without a value; to await "
            f"{awaited}, run the tree with `await tree.run()`"
        )

    def on_halted(self) -> None:
        """Cancel the body: its `finally` blocks run now, and must not await."""
        self.cancel_wake_up()
        body, self._body = self._body, None
        future, self._future = self._future, None
        if future is not None:
            future.cancel()
        if body is None:
            return
        try:
            body.close()
        except RuntimeError as error:
            if "ignored GeneratorExit" in str(error):
                raise NodeError("a leaf cannot await or yield while it is being halted") from None
            raise
