"""Breakpoints and fault injection: at most one hook before and one after the tick of each node.

Hooks do what BehaviorTree.CPP's ``Groot2Publisher`` lets a client do (groot2.md §7). As there, a
status that is injected takes the place of the tick or of its result, and nothing more: a node that
was RUNNING is not halted by it.
"""

import threading
from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import Final

from btcore.engine.context import TreeContext
from btcore.engine.node import TreeNode
from btcore.status import SKIPPED, Status
from btcore.tree.tick_thread import TickThread

LOOK_EVERY: Final = 0.1
"""The longest time (s, wall clock) for which a tick at a breakpoint is deaf to signals."""


class HookPosition(IntEnum):
    """Where a hook sits. The numbers are those of Groot 2's protocol."""

    PRE = 0
    POST = 1


class HookMode(IntEnum):
    """What a hook does. The numbers are those of Groot 2's protocol.

    BREAKPOINT: the tick stands until it is let go, and then takes *desired_status*. REPLACE: it takes
    *desired_status* at once.
    """

    BREAKPOINT = 0
    REPLACE = 1


class Hook:
    """What happens before or after the ticks of node *uid*.

    *desired_status* counts if it is SUCCESS or FAILURE; any other, SKIPPED for instance, leaves the node
    to itself. *once*: the hook goes after it has fired. One that isn't *enabled* does nothing.
    """

    def __init__(
        self,
        uid: int,
        position: HookPosition = HookPosition.PRE,
        mode: HookMode = HookMode.BREAKPOINT,
        desired_status: Status = SKIPPED,
        once: bool = False,
        enabled: bool = True,
    ) -> None:
        self.uid = uid
        self.position = position
        self.mode = mode
        self.desired_status = desired_status
        self.once = once
        self.enabled = enabled
        self.waiting = False
        """Whether a tick stands here now."""
        self.ready = False
        """Whether the next tick that comes here, or stands here, may go on."""

    def __repr__(self) -> str:
        words = [self.mode.name, self.position.name, f"node {self.uid}", self.desired_status.name]
        return f"<Hook {' '.join(words)}{' once' if self.once else ''}{'' if self.enabled else ' disabled'}>"


class Hooks:
    """The hooks of one tree (``tree.hooks``). Every method may be called from any thread.

    A breakpoint stops the thread that ticks. Under ``await tree.run()`` it is awaited instead, and the
    event loop goes on; there, one that is set while a tick is under way counts from the next tick on.
    """

    def __init__(self, nodes: Sequence[TreeNode], context: TreeContext) -> None:
        self._nodes = {node.uid: node for node in nodes}
        self._context = context
        self._change = threading.Condition()
        self._tables: dict[HookPosition, dict[int, Hook]] = {HookPosition.PRE: {}, HookPosition.POST: {}}
        self._listeners: list[Callable[[Hook], object]] = []
        self._letting_go = False
        self._aside: TickThread | None = None

    # --- setting

    def insert(self, hook: Hook) -> bool:
        """Set *hook*; one at the same place takes over what it says. False: there is no such node."""
        node = self._nodes.get(hook.uid)
        if node is None:
            return False
        with self._change:
            table = self._tables[hook.position]
            known = table.get(hook.uid)
            if known is not None:
                if known.waiting and hook.mode is HookMode.REPLACE:
                    known.ready = True
                known.mode, known.once, known.enabled = hook.mode, hook.once, hook.enabled
                known.desired_status = hook.desired_status
                self._change.notify_all()
                return True
            own = _copy(hook)
            table[hook.uid] = own
            if own.position is HookPosition.PRE:
                node.set_pre_tick_function(self._before)
            else:
                node.set_post_tick_function(self._after)
        return True

    def unlock(
        self,
        uid: int,
        position: HookPosition = HookPosition.PRE,
        desired_status: Status = SKIPPED,
        remove_when_done: bool = False,
    ) -> bool:
        """Let go the tick that stands at a breakpoint, or comes there next. False: there is no such hook.

        *desired_status* is the hook's from now on; with *remove_when_done* it goes when it has fired.
        """
        with self._change:
            hook = self._tables[position].get(uid)
            if hook is None:
                return False
            hook.desired_status = desired_status
            hook.once = hook.once or remove_when_done
            if hook.mode is HookMode.BREAKPOINT:
                hook.ready = True
                self._change.notify_all()
        return True

    def remove(self, uid: int, position: HookPosition = HookPosition.PRE) -> bool:
        """Take a hook away; a tick that stands there goes on. False: there is none."""
        with self._change:
            hook = self._tables[position].get(uid)
            if hook is None:
                return False
            self._forget(hook)
            self._change.notify_all()
        return True

    def remove_all(self) -> None:
        """Take all hooks away; a tick that stands at one goes on."""
        with self._change:
            for table in self._tables.values():
                for hook in list(table.values()):
                    self._forget(hook)
            self._change.notify_all()

    def enable_all(self, enabled: bool) -> None:
        """Enable or disable all hooks; a tick that stands at a disabled one goes on."""
        with self._change:
            for table in self._tables.values():
                for hook in table.values():
                    hook.enabled = enabled
            self._change.notify_all()

    def ignore_breakpoints(self, free: bool = True) -> None:
        """No breakpoint holds the tree any more, as long as *free* is not taken back."""
        with self._change:
            self._letting_go = free
            self._change.notify_all()

    # --- looking

    def all(self) -> list[Hook]:
        """The hooks as they are now, as copies: those before a tick, then those after one."""
        with self._change:
            return [_copy(hook) for table in self._tables.values() for hook in table.values()]

    def subscribe(self, listener: Callable[[Hook], object]) -> Callable[[], None]:
        """Let *listener* be called when a hook fires; the callable returned ends that.

        It runs on the thread that ticks, before a breakpoint stops it; it is brief, and does not raise.
        """
        with self._change:
            self._listeners = [*self._listeners, listener]

        def leave() -> None:
            with self._change:
                self._listeners = [one for one in self._listeners if one is not listener]

        return leave

    # --- ticking

    @property
    def may_pause(self) -> bool:
        """Whether a breakpoint is set that could stop the next tick."""
        with self._change:
            return not self._letting_go and any(
                hook.enabled and hook.mode is HookMode.BREAKPOINT
                for table in self._tables.values()
                for hook in table.values()
            )

    async def tick_in_thread(self, tick: Callable[[], Status]) -> Status:
        """What *tick* returns or raises; the event loop goes on while it stands at a breakpoint."""
        if self._aside is None:
            self._aside = TickThread()
        return await self._aside.run(tick, self.ignore_breakpoints)

    def close_tick_thread(self) -> None:
        """No event loop runs the tree any more."""
        aside, self._aside = self._aside, None
        if aside is not None:
            aside.close()

    def _before(self, node: TreeNode) -> Status:
        return self._fire(self._tables[HookPosition.PRE].get(node.uid))

    def _after(self, node: TreeNode, status: Status) -> Status:
        return self._fire(self._tables[HookPosition.POST].get(node.uid))

    def _fire(self, hook: Hook | None) -> Status:
        """What the hook wants the status to be."""
        if hook is None:
            return SKIPPED
        aside = self._aside if self._context.in_event_loop else None
        stood = False
        with self._change:
            if not hook.enabled:
                return SKIPPED
            if hook.mode is HookMode.BREAKPOINT:
                if self._letting_go or (
                    self._context.in_event_loop and (aside is None or not aside.is_current)
                ):
                    return SKIPPED
                stood = True
            for listener in self._listeners:
                listener(hook)
            if stood:
                self._stand(hook, aside)
        if stood and aside is not None:
            aside.wait_for_turn()  # without the lock, which the event loop may want before it gives way
        with self._change:
            if not hook.enabled or (stood and self._letting_go):
                return SKIPPED
            if hook.once:
                self._forget(hook)
            return hook.desired_status

    def _stand(self, hook: Hook, aside: TickThread | None) -> None:
        """Return when the tick may go on."""
        hook.waiting = True
        if aside is not None:
            aside.yield_to_loop()
        try:
            while hook.enabled and not hook.ready and not self._letting_go:
                self._change.wait(LOOK_EVERY)
        finally:
            hook.waiting = hook.ready = False

    def _forget(self, hook: Hook) -> None:
        hook.enabled = False
        del self._tables[hook.position][hook.uid]
        node = self._nodes[hook.uid]
        if hook.position is HookPosition.PRE:
            node.set_pre_tick_function(None)
        else:
            node.set_post_tick_function(None)


def _copy(hook: Hook) -> Hook:
    copy = Hook(hook.uid, hook.position, hook.mode, hook.desired_status, hook.once, hook.enabled)
    copy.waiting = hook.waiting
    return copy
