"""Breakpoints and fault injection: at most one hook before and one after the tick of each node.

Hooks have the same effects as the hooks that clients of BehaviorTree.CPP's `Groot2Publisher` insert
(src/loggers/groot2_publisher.cpp, docs/reference/protocols.md). An injected status replaces the tick or its
result and has no other effect: a node that was RUNNING is not halted.
"""

import threading
import time
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Final

from btcore.engine.context import TreeContext
from btcore.engine.node import TreeNode
from btcore.status import SKIPPED, Status
from btcore.tree.tick_thread import TickThread

__all__ = ["Hook", "HookMode", "HookPosition", "Hooks"]

SIGNAL_CHECK_S: Final = 0.1
"""The longest time (s, wall clock) for which a thread at a breakpoint ignores signals (Ctrl-C)."""


class HookPosition(IntEnum):
    """When a hook fires: before or after the tick. The numbers are those of Groot 2's protocol."""

    PRE = 0
    POST = 1


class HookMode(IntEnum):
    """The effect of a hook. The numbers are those of Groot 2's protocol.

    BREAKPOINT: the tick stops at the hook until it is unlocked; then *desired_status* takes effect.
    REPLACE: *desired_status* takes effect at once.
    """

    BREAKPOINT = 0
    REPLACE = 1


@dataclass(eq=False, repr=False)
class Hook:
    """A breakpoint or an injected status, before or after the ticks of one node.

    Attributes:
        uid: The uid of the node.
        position: Whether the hook fires before or after the tick.
        mode: Whether it is a breakpoint, or replaces the status at once.
        desired_status: SUCCESS or FAILURE replaces the status of the node; any other value has no effect.
        once: Whether the hook is removed after it has fired.
        enabled: False = the hook has no effect.
        waiting: Whether a tick is stopped at this hook now.
        ready: Whether the tick that is stopped here, or the next tick that arrives here, may continue.
    """

    uid: int
    position: HookPosition = HookPosition.PRE
    mode: HookMode = HookMode.BREAKPOINT
    desired_status: Status = SKIPPED
    once: bool = False
    enabled: bool = True
    waiting: bool = field(default=False, init=False)
    ready: bool = field(default=False, init=False)

    def __repr__(self) -> str:
        words = [self.mode.name, self.position.name, f"node {self.uid}", self.desired_status.name]
        return f"<Hook {' '.join(words)}{' once' if self.once else ''}{'' if self.enabled else ' disabled'}>"


class Hooks:
    """The hooks of one tree (`tree.hooks`). All methods are thread-safe.

    A breakpoint stops the thread that ticks. Under `await tree.run()` the event loop continues to run while
    a tick is stopped; there, a breakpoint that is set during a tick takes effect from the next tick on.

    Args:
        nodes: The nodes of the tree.
        context: The objects that the tree's nodes share.

    Examples:
        >>> import btcore
        >>> from btcore.tree.hooks import Hook, HookMode, HookPosition
        >>> b = btcore.Builder()
        >>> tree = b.build(b.AlwaysSuccess(name="door"))
        >>> hook = Hook(tree.root.uid, HookPosition.PRE, HookMode.REPLACE, btcore.FAILURE)
        >>> tree.hooks.insert(hook)
        True
        >>> tree.tick_once()
        <Status.FAILURE: 3>
    """

    def __init__(self, nodes: Sequence[TreeNode], context: TreeContext) -> None:
        self._nodes = {node.config.uid: node for node in nodes}
        self._context = context
        self._condition = threading.Condition()
        self._hooks: dict[tuple[HookPosition, int], Hook] = {}
        self._listeners: list[Callable[[Hook], object]] = []
        self._ignores_breakpoints = False
        self._tick_thread: TickThread | None = None

    # --- setting

    def insert(self, hook: Hook) -> bool:
        """Insert a copy of *hook*, or update the existing hook of the same node and position.

        Returns:
            Whether the tree has a node with this uid.
        """
        if hook.uid not in self._nodes:
            return False
        with self._condition:
            known = self._hooks.get((hook.position, hook.uid))
            if known is not None:
                if known.waiting and hook.mode is HookMode.REPLACE:
                    known.ready = True
                known.mode, known.once, known.enabled = hook.mode, hook.once, hook.enabled
                known.desired_status = hook.desired_status
                self._condition.notify_all()
                return True
            own = self._hooks[hook.position, hook.uid] = replace(hook)
            self._set_callback(own, lambda *_: self._fire(own))
        return True

    def unlock(
        self,
        uid: int,
        position: HookPosition = HookPosition.PRE,
        desired_status: Status = SKIPPED,
        remove_when_done: bool = False,
    ) -> bool:
        """Release the tick that is stopped at a breakpoint, or the next tick that arrives there.

        Args:
            uid: The uid of the node.
            position: The position of the hook.
            desired_status: The new *desired_status* of the hook, which takes effect when the tick continues.
            remove_when_done: Whether to remove the hook after it has fired.

        Returns:
            Whether there is such a hook.
        """
        with self._condition:
            hook = self._hooks.get((position, uid))
            if hook is None:
                return False
            hook.desired_status = desired_status
            hook.once = hook.once or remove_when_done
            if hook.mode is HookMode.BREAKPOINT:
                hook.ready = True
                self._condition.notify_all()
        return True

    def remove(self, uid: int, position: HookPosition = HookPosition.PRE) -> bool:
        """Remove a hook. A tick that is stopped there continues.

        Args:
            uid: The uid of the node.
            position: The position of the hook.

        Returns:
            Whether there was such a hook.
        """
        with self._condition:
            hook = self._hooks.get((position, uid))
            if hook is None:
                return False
            self._remove(hook)
            self._condition.notify_all()
        return True

    def remove_all(self) -> None:
        """Remove all hooks. A tick that is stopped at a hook continues."""
        with self._condition:
            for hook in list(self._hooks.values()):
                self._remove(hook)
            self._condition.notify_all()

    def enable_all(self, enabled: bool) -> None:
        """Enable or disable all hooks. A tick that is stopped at a disabled hook continues."""
        with self._condition:
            for hook in self._hooks.values():
                hook.enabled = enabled
            self._condition.notify_all()

    def call_while_stopped(self, action: Callable[[], object]) -> bool:
        """Call *action* if a tick is stopped at a breakpoint, which it does not leave meanwhile.

        Returns:
            Whether *action* was called.
        """
        with self._condition:
            is_stopped = any(hook.waiting for hook in self._hooks.values())
            if is_stopped:
                action()
            return is_stopped

    def ignore_breakpoints(self, ignore: bool = True) -> None:
        """Ignore all breakpoints, and release a stopped tick. If *ignore* is False, respect them again."""
        with self._condition:
            self._ignores_breakpoints = ignore
            self._condition.notify_all()

    # --- listing and subscribing

    def all(self) -> list[Hook]:
        """Return copies of all hooks: first those with position PRE, then those with position POST."""
        with self._condition:
            return [copy(hook) for hook in sorted(self._hooks.values(), key=lambda hook: hook.position)]

    def subscribe(self, listener: Callable[[Hook], object]) -> Callable[[], None]:
        """Subscribe *listener*, which is called when a hook fires. Return a function that unsubscribes it.

        The listener runs on the thread that ticks, before a breakpoint stops it. It must return quickly and
        must not raise.
        """
        with self._condition:
            self._listeners = [*self._listeners, listener]

        def unsubscribe() -> None:
            with self._condition:
                self._listeners = [other for other in self._listeners if other is not listener]

        return unsubscribe

    # --- ticking

    @property
    def has_active_breakpoint(self) -> bool:
        """Whether a breakpoint is set that could stop the next tick."""
        with self._condition:
            return not self._ignores_breakpoints and any(
                hook.enabled and hook.mode is HookMode.BREAKPOINT for hook in self._hooks.values()
            )

    async def tick_in_thread(self, tick: Callable[[], Status]) -> Status:
        """Run *tick* on the tick thread, and return its result. While *tick* stops, the event loop runs."""
        if self._tick_thread is None:
            self._tick_thread = TickThread()
        return await self._tick_thread.run(tick, self.ignore_breakpoints)

    def close_tick_thread(self) -> None:
        """End the tick thread, when the event loop no longer runs the tree."""
        tick_thread, self._tick_thread = self._tick_thread, None
        if tick_thread is not None:
            tick_thread.close()

    def _set_callback(self, hook: Hook, callback: Callable[..., Status] | None) -> None:
        node = self._nodes[hook.uid]
        if hook.position is HookPosition.PRE:
            node.set_pre_tick_function(callback)
        else:
            node.set_post_tick_function(callback)

    def _fire(self, hook: Hook) -> Status:
        """Stop at a breakpoint until it is unlocked. Return the status that *hook* injects, or SKIPPED."""
        tick_thread = self._tick_thread  # None unless an event loop runs the tree
        with self._condition:
            stops = hook.mode is HookMode.BREAKPOINT
            # A tick on the event loop's own thread must not stop: the loop could never unlock it.
            is_on_loop = self._context.is_in_event_loop and not (tick_thread and tick_thread.is_current)
            if not hook.enabled or (stops and (self._ignores_breakpoints or is_on_loop)):
                return SKIPPED
            for listener in self._listeners:
                listener(hook)
            if stops:
                self._stop_at(hook, tick_thread)
        if stops and tick_thread is not None:
            # Without the lock: the event loop may need it before it yields to this thread.
            tick_thread.wait_for_turn()
        with self._condition:
            if not hook.enabled or (stops and self._ignores_breakpoints):
                return SKIPPED
            if hook.once:
                self._remove(hook)
            return hook.desired_status

    def _stop_at(self, hook: Hook, tick_thread: TickThread | None) -> None:
        """Wait until the tick may continue. The caller holds the lock, which is released during the wait."""
        hook.waiting = True
        if tick_thread is not None:
            tick_thread.yield_to_loop()
        start = time.monotonic_ns()
        try:
            while hook.enabled and not hook.ready and not self._ignores_breakpoints:
                self._condition.wait(SIGNAL_CHECK_S)
        finally:
            hook.waiting = hook.ready = False
            self._context.exclude_time(time.monotonic_ns() - start)

    def _remove(self, hook: Hook) -> None:
        hook.enabled = False
        del self._hooks[hook.position, hook.uid]
        self._set_callback(hook, None)
