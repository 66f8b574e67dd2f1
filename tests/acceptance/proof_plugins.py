"""Decorators of users in the random trees of `proof_trees.py`.

The state of some is declared: the search must give the answers of the enumeration. Others depend on what the
search cannot save and restore: it must not prove what a run refutes.
"""

import random
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from btcore import DecoratorNode, In, NodeSpec, Status
from btcore.clock import NS_PER_MS
from btcore.status import FAILURE, RUNNING, SUCCESS

UNIT_MS = 3
_calls = 0


def begin_run() -> None:
    """Reset what the decorators keep outside of their nodes, so that a run can be repeated."""
    global _calls
    _calls = 0
    random.seed(0)


class _FailsSometimes(DecoratorNode):
    """Returns the result of its child, or FAILURE if `fails` returns True before."""

    spec = NodeSpec(state_fields=())

    def tick(self) -> Status:
        self.set_status(RUNNING)
        if self.child.status is not RUNNING and self.fails():
            return FAILURE
        return self.child.execute_tick()

    def fails(self) -> bool:
        """Return whether to fail."""
        raise NotImplementedError


@dataclass
class Memory:
    """A number that equality ignores."""

    calls: int = field(default=0, compare=False)


class UserMemory(_FailsSometimes):
    """Fails in every third call."""

    spec = NodeSpec(state_fields=("memory",))

    def __init__(self) -> None:
        self.memory = Memory()

    def fails(self) -> bool:
        self.memory.calls = (self.memory.calls + 1) % 3
        return self.memory.calls == 0


class UserTuple(_FailsSometimes):
    """Fails in every second call, and counts in a list within a tuple by the sign of a zero."""

    spec = NodeSpec(state_fields=("last",))

    def __init__(self) -> None:
        self.last = ("", [0.0])

    def fails(self) -> bool:
        self.last[1][0] *= -1
        return str(self.last[1][0]) == "0.0"


class UserTimer(DecoratorNode):
    """Fails when its child lasts too long."""

    msec: In[int]
    spec = NodeSpec(state_fields=("_deadline",), time_fields=("_deadline",))

    def __init__(self) -> None:
        self._deadline = 0

    def tick(self) -> Status:
        """Tick the child, or halt it if its time is over."""
        if self.status is not RUNNING:
            self._deadline = self.now() + self.msec * NS_PER_MS
            self.set_status(RUNNING)
        if self.has_passed(self._deadline):
            self.reset_child()
            return FAILURE
        status = self.child.execute_tick()
        if status is not RUNNING:
            self._deadline = 0
        return status

    def halt(self) -> None:
        """Halt the child."""
        self._deadline = 0
        super().halt()


class UserElapsed(_FailsSometimes):
    """Fails after some time, without a declared deadline."""

    spec = NodeSpec(state_fields=("start",))
    start = 0

    def fails(self) -> bool:
        self.start = self.start or self.now() + 1
        return self.now() + 1 - self.start >= UNIT_MS * NS_PER_MS


class UserCatch(_FailsSometimes):
    """Fails if an entry is 1, and catches what reading it raises."""

    value: In[int]

    def fails(self) -> bool:
        try:
            return self.value == 1
        except Exception:
            return False


class UserKeeps(_FailsSometimes):
    """Fails if an entry has changed."""

    value: In[Any]
    spec = NodeSpec(state_fields=("before",))
    before: tuple[object, ...] = ()

    def fails(self) -> bool:
        before = self.before
        entry = self.blackboard.find("u")
        self.before = () if entry is None else (entry.value,)
        return before != self.before


class UserSwallow(DecoratorNode):
    """Succeeds whatever its child raises."""

    spec = NodeSpec(state_fields=())

    def tick(self) -> Status:
        """Tick the child."""
        try:
            return self.child.execute_tick()
        except:  # noqa: E722
            return SUCCESS


class UserSteps(_FailsSometimes):
    """Fails in every third call, by a generator."""

    spec = NodeSpec(state_fields=("steps",))

    def __init__(self) -> None:
        self.steps = self.results()

    @staticmethod
    def results() -> Iterator[bool]:
        """Return the results of all calls."""
        while True:
            yield from (False, False, True)

    def fails(self) -> bool:
        return next(self.steps)


class UserChance(_FailsSometimes):
    """Fails by chance."""

    def fails(self) -> bool:
        return random.random() < 0.5


class UserWall(_FailsSometimes):
    """Reads the system's clock."""

    def fails(self) -> bool:
        return time.monotonic() < 0


class UserGlobal(_FailsSometimes):
    """Fails in every third call, by a variable of its module."""

    def fails(self) -> bool:
        global _calls
        _calls += 1
        return _calls % 3 == 0


class UserUndeclared(_FailsSometimes):
    """Fails in every third call, by an attribute that is no state field."""

    def __init__(self) -> None:
        self.calls = 0

    def fails(self) -> bool:
        self.calls += 1
        return self.calls % 3 == 0


class UserWrites(_FailsSometimes):
    """Fails if an entry was written, which it counts itself."""

    value: In[Any]
    spec = NodeSpec(state_fields=("seen",))
    seen = 0

    def fails(self) -> bool:
        before, entry = self.seen, self.blackboard.find("u")
        self.seen = 0 if entry is None else entry.sequence_id
        return before != self.seen


DECLARED = (UserMemory, UserTuple, UserTimer)
HIDDEN = (
    UserElapsed,
    UserCatch,
    UserKeeps,
    UserSwallow,
    UserSteps,
    UserChance,
    UserWall,
    UserGlobal,
    UserUndeclared,
    UserWrites,
)
HIDDEN_TAGS = frozenset(cls.__name__ for cls in HIDDEN)
