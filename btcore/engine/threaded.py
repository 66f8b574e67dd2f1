"""The base class of actions that block: their work runs in a separate thread."""

import threading
from typing import Any, ClassVar

from mypy_extensions import mypyc_attr

from btcore.engine.leaf import StatefulAction
from btcore.engine.node_spec import NodeSpec
from btcore.errors import NodeError
from btcore.status import RUNNING


@mypyc_attr(allow_interpreted_subclasses=True)
class ThreadedAction(StatefulAction):
    """An action that may block: override `work`, which runs in a separate thread.

    The node is RUNNING until `work` ends. Then the tree wakes up, and the next tick returns the result
    of `work` or raises its exception. A halt sets `halt_requested` and waits until `work`
    returns. Therefore `work` should check `halt_requested` often, and sleep with `pause`.

    Only the thread that ticks the tree may use ports. Read inputs in `on_start` before the thread starts, and
    write outputs in `on_running` after it has ended.

    Examples:
        >>> import btcore
        >>> class Add(btcore.ThreadedAction):
        ...     limit: btcore.In[int]
        ...     result: btcore.Out[int]
        ...     def on_start(self):
        ...         self.count = self.limit
        ...         return super().on_start()
        ...     def work(self):
        ...         self.total = sum(range(self.count))
        ...         return btcore.SUCCESS
        ...     def on_running(self):
        ...         status = super().on_running()
        ...         if status is btcore.SUCCESS:
        ...             self.result = self.total
        ...         return status
        >>> nodes = btcore.Registry.standard()
        >>> nodes.add(Add)
        >>> b = btcore.Builder(nodes)
        >>> tree = b.build(b.Add(limit=1000, result="{sum}"))
        >>> tree.tick_while_running(), tree.blackboard["sum"]
        (<Status.SUCCESS: 2>, 499500)
    """

    spec: ClassVar[NodeSpec] = NodeSpec(state_fields=None)

    _worker: Any = None
    _halt_event: Any = None
    _done: bool = False
    _result: object = None
    _error: BaseException | None = None

    def work(self) -> object:
        """Do the work, in a separate thread. Override this method.

        Returns:
            The result of the node: a Status other than IDLE, or True (SUCCESS) or False (FAILURE).

        Raises:
            NodeError: The class does not override this method.
        """
        raise NodeError(f"<{self.config.id}> has no work()")

    @property
    def halt_requested(self) -> bool:
        """Whether the node is being halted, so that `work` should return."""
        return bool(self._halt_event.is_set())

    def pause(self, seconds: float) -> bool:
        """Sleep in `work` for *seconds* (s, real time), or until the node is halted.

        Returns:
            Whether the node is being halted.
        """
        return bool(self._halt_event.wait(seconds))

    def on_start(self) -> object:
        """Start the thread."""
        self._halt_event = threading.Event()
        self._result = None
        self._error = None
        self._done = False
        self._worker = threading.Thread(target=self._run, name=self.config.path, daemon=True)
        self._worker.start()
        return RUNNING

    def on_running(self) -> object:
        """Return RUNNING until the work is done, then its result."""
        if not self._done:
            return RUNNING
        self._worker = None
        error, self._error = self._error, None
        if error is not None:
            raise error
        return self._result

    def on_halted(self) -> None:
        """Request a halt, and wait until the thread has ended. Ignore the result or exception of the work."""
        if self._worker is not None:
            self._halt_event.set()
            self._worker.join()
            self._worker = None

    def _run(self) -> None:
        try:
            self._result = self.work()
        except BaseException as error:
            self._error = error
        finally:
            # Not Thread.is_alive(): the tick that this wakes may come before the thread ends, and no other
            # wake-up follows.
            self._done = True
            self.wake_up()
