"""A function becomes a leaf: its ports are read before each start, its resources once."""

import inspect
from collections.abc import Callable
from typing import Any, TypeVar, overload

from mypy_extensions import mypyc_attr

from btcore.blackboard.ports import Input
from btcore.engine.coroutine import CoroutineAction
from btcore.engine.leaf import Condition, LeafNode, SyncAction

F = TypeVar("F", bound=Callable[..., object])


class LeafMark:
    """What a decorator notes on a function: whether it asks or acts, and its ID if one was given."""

    def __init__(self, is_condition: bool, ID: str | None) -> None:
        self.is_condition = is_condition
        self.ID = ID


MARK = "__btcore_leaf__"


@overload
def action(function: F, /) -> F: ...
@overload
def action(*, ID: str | None = None) -> Callable[[F], F]: ...
def action(function: F | None = None, /, *, ID: str | None = None) -> F | Callable[[F], F]:
    """Make a function, a generator function or an ``async def`` an action.

    Its tag is its name in CamelCase, or *ID*; parameters marked In or Put are its ports, the others
    resources. It returns True, False or a Status.
    """
    return _marked(function, LeafMark(False, ID))


@overload
def condition(function: F, /) -> F: ...
@overload
def condition(*, ID: str | None = None) -> Callable[[F], F]: ...
def condition(function: F | None = None, /, *, ID: str | None = None) -> F | Callable[[F], F]:
    """Make a function a condition; see :func:`action`."""
    return _marked(function, LeafMark(True, ID))


def _marked(function: F | None, mark: LeafMark) -> F | Callable[[F], F]:
    def note(marked: F) -> F:
        setattr(marked, MARK, mark)
        return marked

    return note if function is None else note(function)


class BoundFunction:
    """A function with what fills its parameters: ports, read anew for each call, and resources."""

    def __init__(
        self, function: Callable[..., Any], positional: list[object], keywords: dict[str, object]
    ) -> None:
        self.function: Any = function
        self.positional = positional
        self.keywords = keywords
        self.is_bare = not positional and not keywords

    def run(self) -> Any:
        """Call it with what the ports hold now."""
        positional = self.positional
        count = len(positional)
        # Most functions have few parameters, and need no list to be made of them.
        if not self.keywords:
            if count == 1:
                return self.function(_now(positional[0]))
            if count == 2:
                return self.function(_now(positional[0]), _now(positional[1]))
        values = [_now(one) for one in positional]
        if not self.keywords:
            return self.function(*values)
        return self.function(*values, **{key: _now(one) for key, one in self.keywords.items()})


def _now(filling: object) -> object:
    """What fills a parameter now."""
    return filling.read() if isinstance(filling, Input) else filling


@mypyc_attr(allow_interpreted_subclasses=True)
class FunctionAction(SyncAction):
    """A function as a synchronous action."""

    call: BoundFunction

    def tick(self) -> object:
        """Call it."""
        call = self.call
        return call.function() if call.is_bare else call.run()


@mypyc_attr(allow_interpreted_subclasses=True)
class FunctionCondition(Condition):
    """A function as a condition."""

    call: BoundFunction

    def tick(self) -> object:
        """Call it."""
        call = self.call
        return call.function() if call.is_bare else call.run()


@mypyc_attr(allow_interpreted_subclasses=True)
class FunctionCoroutineAction(CoroutineAction):
    """A generator function or an ``async def`` as an action that lasts."""

    call: BoundFunction

    def create_body(self) -> Any:
        """Call it, which starts nothing yet."""
        return self.call.run()


def leaf_class(function: Callable[..., object]) -> type[LeafNode]:
    """The class that runs *function*."""
    if inspect.isgeneratorfunction(function) or inspect.iscoroutinefunction(function):
        return FunctionCoroutineAction
    mark = getattr(function, MARK, None)
    return FunctionCondition if mark is not None and mark.is_condition else FunctionAction


def camel_case(name: str) -> str:
    """``battery_ok`` as ``BatteryOk``."""
    return "".join(part[:1].upper() + part[1:] for part in name.split("_"))
