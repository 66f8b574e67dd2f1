"""Functions as leaves. Input ports are read before each call, and resources are looked up once."""

import inspect
from collections.abc import Callable
from typing import Any, TypeVar, overload

from mypy_extensions import mypyc_attr

from btcore.blackboard.ports import Input
from btcore.engine.coroutine import CoroutineAction
from btcore.engine.leaf import Condition, LeafNode, SyncAction

F = TypeVar("F", bound=Callable[..., object])


class LeafMark:
    """The mark that a decorator sets on a function: whether it is a condition, and the ID if given."""

    def __init__(self, is_condition: bool, id: str | None) -> None:
        self.is_condition = is_condition
        self.id = id


MARK = "__btcore_leaf__"
"""The attribute of a function that holds its `LeafMark`."""


@overload
def action(function: F, /) -> F: ...
@overload
def action(*, ID: str | None = None) -> Callable[[F], F]: ...
def action(function: F | None = None, /, *, ID: str | None = None) -> F | Callable[[F], F]:
    """Mark a function, a generator function or an `async def` as an action.

    Parameters annotated with In or Put are ports. All other parameters are resources: objects that are passed
    to `btcore.load`, and the tree's Clock, Blackboard and `TreeResource` objects. The function
    returns True, False or a Status.

    Args:
        function: The function.
        ID: The tag in the XML; by default the function's name in CamelCase.

    Examples:
        >>> import btcore
        >>> @btcore.action
        ... def add(a: btcore.In[int], b: btcore.In[int], result: btcore.Put[int]):
        ...     result(a + b)
        ...     return True
        >>> nodes = btcore.Registry.standard()
        >>> nodes.add(add)
        >>> b = btcore.Builder(nodes)
        >>> tree = b.build(b.Add(a=2, b=3, result="{sum}"))
        >>> tree.tick_once(), tree.blackboard["sum"]
        (<Status.SUCCESS: 2>, 5)
    """
    return _mark_leaf(function, LeafMark(False, ID))


@overload
def condition(function: F, /) -> F: ...
@overload
def condition(*, ID: str | None = None) -> Callable[[F], F]: ...
def condition(function: F | None = None, /, *, ID: str | None = None) -> F | Callable[[F], F]:
    """Mark a function as a condition.

    Parameters annotated with In or Put are ports. All other parameters are resources: objects that are passed
    to `btcore.load`, and the tree's Clock, Blackboard and `TreeResource` objects. The function
    returns True, False or a Status.

    Args:
        function: The function.
        ID: The tag in the XML; by default the function's name in CamelCase.

    Examples:
        >>> import btcore
        >>> @btcore.condition
        ... def battery_ok(level: btcore.In[float], minimum: btcore.In[float] = 0.2) -> bool:
        ...     return level > minimum
        >>> nodes = btcore.Registry.standard()
        >>> nodes.add(battery_ok)
        >>> b = btcore.Builder(nodes)
        >>> b.build(b.BatteryOk(level=0.1)).tick_once()
        <Status.FAILURE: 3>
    """
    return _mark_leaf(function, LeafMark(True, ID))


def _mark_leaf(function: F | None, mark: LeafMark) -> F | Callable[[F], F]:
    def set_mark(leaf: F) -> F:
        setattr(leaf, MARK, mark)
        return leaf

    return set_mark if function is None else set_mark(function)


class BoundFunction:
    """A function with its arguments: resources, and input ports that are read before each call."""

    def __init__(
        self, function: Callable[..., Any], positional: list[object], keywords: dict[str, object]
    ) -> None:
        self.function: Any = function
        self.positional = positional
        self.keywords = keywords
        self.is_bare = not positional and not keywords

    def run(self) -> Any:
        """Call the function with the current values of the ports."""
        positional = self.positional
        count = len(positional)
        # Without the calls for one and two arguments, a leaf takes 70 ns longer (compiled).
        if not self.keywords:
            if count == 1:
                return self.function(_value(positional[0]))
            if count == 2:
                return self.function(_value(positional[0]), _value(positional[1]))
        values = [_value(argument) for argument in positional]
        if not self.keywords:
            return self.function(*values)
        return self.function(*values, **{name: _value(argument) for name, argument in self.keywords.items()})


def _value(argument: object) -> object:
    return argument.read() if isinstance(argument, Input) else argument


@mypyc_attr(allow_interpreted_subclasses=True)
class FunctionAction(SyncAction):
    """A function as a synchronous action."""

    call: BoundFunction

    def tick(self) -> object:
        """Call the function."""
        call = self.call
        return call.function() if call.is_bare else call.run()


@mypyc_attr(allow_interpreted_subclasses=True)
class FunctionCondition(Condition):
    """A function as a condition."""

    call: BoundFunction

    def tick(self) -> object:
        """Call the function."""
        call = self.call
        return call.function() if call.is_bare else call.run()


@mypyc_attr(allow_interpreted_subclasses=True)
class FunctionCoroutineAction(CoroutineAction):
    """A generator function or an `async def` as an action of several ticks."""

    call: BoundFunction

    def create_body(self) -> Any:
        """Call the function, which returns a generator or coroutine that has not started."""
        return self.call.run()


def leaf_class(function: Callable[..., object]) -> type[LeafNode]:
    """Return the leaf class that runs *function*."""
    if inspect.isgeneratorfunction(function) or inspect.iscoroutinefunction(function):
        return FunctionCoroutineAction
    mark = getattr(function, MARK, None)
    return FunctionCondition if mark is not None and mark.is_condition else FunctionAction


def camel_case(name: str) -> str:
    """Return *name* in CamelCase: `battery_ok` becomes `BatteryOk`."""
    return "".join(part[:1].upper() + part[1:] for part in name.split("_"))
