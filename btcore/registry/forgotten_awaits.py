"""Find calls of `sleep()` and `running()` in a leaf whose result is never awaited.

Such a call has no effect, and Python does not warn about it. The check reads the bytecode when the leaf is
registered, so that a tick needs no check, and leaves without source code are checked, too.
"""

import contextlib
import dis
import inspect
from collections.abc import Iterator, Mapping
from itertools import pairwise
from types import CodeType, FunctionType
from typing import Any, Final

from btcore.engine.coroutine import running, sleep
from btcore.engine.node import TreeNode
from btcore.errors import RegistrationError

_PAUSES: Final = (running, sleep)
_NAMES: Final = frozenset(function.__name__ for function in _PAUSES)


def check_awaits(id: str, leaf: Any) -> None:
    """Check that a leaf awaits each `sleep()` and `running()`.

    The check includes the coroutines and generators that the code of the leaf names. It does not find calls
    whose result is stored in a container or passed to another function.
    """
    pending = _methods(leaf) if isinstance(leaf, type) else [leaf]
    seen = set()
    while pending:
        function = inspect.unwrap(pending.pop())
        code = getattr(function, "__code__", None)
        if not isinstance(code, CodeType) or code in seen:
            continue
        seen.add(code)
        names = {**function.__globals__, **_closure(function)}
        for part in _code_within(code):
            used = (*part.co_names, *part.co_freevars)
            if not _NAMES.isdisjoint(part.co_names) or any(names.get(name) in _PAUSES for name in used):
                _check_code(id, function.__qualname__, part, names)
            pending += [names[name] for name in part.co_names if _is_coroutine(names.get(name))]
        pending += [value for value in _closure(function).values() if _is_coroutine(value)]


def _methods(cls: type) -> list[Any]:
    """Return the functions of a node class, without those of the base classes of the engine."""
    return [
        getattr(value, "__func__", value)
        for parent in cls.__mro__
        if parent not in TreeNode.__mro__ and not parent.__module__.startswith("btcore.")
        for value in vars(parent).values()
        if callable(value) and not isinstance(value, type)
    ]


def _closure(function: Any) -> dict[str, object]:
    cells = {}
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=False):
        with contextlib.suppress(ValueError):  # not assigned yet
            cells[name] = cell.cell_contents
    return cells


def _code_within(code: CodeType) -> Iterator[CodeType]:
    """Yield *code* and the code of the functions and comprehensions that it contains."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _code_within(constant)


def _is_coroutine(value: object) -> bool:
    return isinstance(value, FunctionType) and (
        inspect.iscoroutinefunction(value) or inspect.isgeneratorfunction(value)
    )


def _check_code(id: str, function_name: str, code: CodeType, names: Mapping[str, object]) -> None:
    instructions = [
        instruction for instruction in dis.get_instructions(code) if instruction.opname != "EXTENDED_ARG"
    ]
    used = {
        name
        for instruction in instructions
        if "LOAD_FAST" in instruction.opname
        for name in (instruction.argval if isinstance(instruction.argval, tuple) else (instruction.argval,))
    }
    # The pauses whose name begins at a place; the place of a call is the same.
    pauses: dict[tuple[int, int], str] = {}
    for instruction, following in pairwise(instructions):
        place = _place(instruction)
        if place is None:
            continue
        pause = names.get(instruction.argval) if instruction.opname in ("LOAD_GLOBAL", "LOAD_DEREF") else None
        if following.argval in _NAMES and following.opname in ("LOAD_ATTR", "LOAD_METHOD"):
            pause = getattr(pause, following.argval, None)
        if pause in _PAUSES:
            pauses[place] = pause.__name__
        if not instruction.opname.startswith("CALL") or place not in pauses:
            continue
        target = following.argval[0] if isinstance(following.argval, tuple) else following.argval
        is_stored = following.opname.startswith("STORE_FAST")
        if following.opname == "POP_TOP" or (is_stored and target not in used):
            raise RegistrationError(
                f"<{id}>: {function_name} calls {pauses[place]}() in {code.co_filename}:{place[0]} without "
                f"await, which has no effect: {_remedy(code, pauses[place])}"
            )


def _place(instruction: dis.Instruction) -> tuple[int, int] | None:
    """Return line and column of the expression; None if Python runs with `-X no_debug_ranges`."""
    positions = instruction.positions
    if positions is None or positions.lineno is None or positions.col_offset is None:
        return None
    return positions.lineno, positions.col_offset


def _remedy(code: CodeType, pause: str) -> str:
    call = f"{pause}(…)" if pause == sleep.__name__ else f"{pause}()"
    if code.co_flags & inspect.CO_COROUTINE:
        return f"write `await {call}`"
    if code.co_flags & inspect.CO_GENERATOR:
        return f"write `yield {call}`"
    return f"make the function an `async def`, and write `await {call}`"
