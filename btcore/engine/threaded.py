"""An action whose work blocks: it runs in a thread of its own, and the tree goes on."""

import threading
from typing import Any, ClassVar

from mypy_extensions import mypyc_attr

from btcore.engine.leaf import StatefulAction
from btcore.errors import NodeError
from btcore.status import RUNNING


@mypyc_attr(allow_interpreted_subclasses=True)
class ThreadedAction(StatefulAction):
    """An action that may block: override :meth:`work`, which runs in a thread of its own.

    The node is RUNNING until it returns; then the tree is woken, and the next tick gives its result
    or raises what it raised. A halt sets :attr:`halt_requested` and waits for it to return: look at
    it often, or sleep by :meth:`pause`.
    """

    state_fields: ClassVar[tuple[str, ...] | None] = None

    _worker: Any = None
    _asked: Any = None
    _done: bool = False
    _result: object = None
    _fault: BaseException | None = None

    def work(self) -> object:
        """Do the work, in a thread; return a Status, True or False."""
        raise NodeError(f"<{self.config.id}> has no work()")

    @property
    def halt_requested(self) -> bool:
        """Whether the node is being halted, so that :meth:`work` is to return soon."""
        return bool(self._asked.is_set())

    def pause(self, seconds: float) -> bool:
        """Sleep for *seconds* (s, real time), less when halted; returns whether it was. For :meth:`work`."""
        return bool(self._asked.wait(seconds))

    def on_start(self) -> object:
        """Start the thread."""
        self._asked = threading.Event()
        self._result = None
        self._fault = None
        self._done = False
        self._worker = threading.Thread(target=self._run, name=self.config.path, daemon=True)
        self._worker.start()
        return RUNNING

    def on_running(self) -> object:
        """Look whether the work is done."""
        if not self._done:
            return RUNNING
        self._worker = None
        fault, self._fault = self._fault, None
        if fault is not None:
            raise fault
        return self._result

    def on_halted(self) -> None:
        """Ask the thread to end, and wait until it has. What it raises then is forgotten."""
        if self._worker is not None:
            self._asked.set()
            self._worker.join()
            self._worker = None

    def _run(self) -> None:
        try:
            self._result = self.work()
        except BaseException as fault:
            self._fault = fault
        finally:
            # The tick that this wakes may come before the thread has ended, and no other wake-up follows.
            self._done = True
            self.wake_up()
