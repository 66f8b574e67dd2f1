"""Control nodes and decorators with code that the search cannot see into, and what it can check of them.

A search saves and restores the state that nodes declare. Code may depend on more: on the clock, on random
numbers, on variables of its module. Each of these makes the answers unknown, as far as it is noticed.
"""

import random
import sys
import time
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from inspect import get_annotations
from operator import ge, gt, le, lt, sub
from types import CodeType, FunctionType, ModuleType
from typing import Any, Final, NoReturn

from btcore.engine.node import TreeNode, read_clock
from btcore.names import PLUGIN_FILE_PREFIX
from btcore.suggestions import join_names
from btcore.tree.tree import Tree
from btcore_proof.interrupts import HiddenInputError, OpaqueStateError, SearchInterrupt
from btcore_proof.tree_state import Freezer, StateKeeper, TreeState, state_fields_of

_OWN_PACKAGES: Final = (
    "btcore",
    "btcore_monitor",
    "btcore_navigation",
    "btcore_proof",
    "btcore_robot",
    "btcore_ros2",
    "btcore_sim",
)
"""The packages whose nodes declare their state, which their tests check."""
_GUARDED: Final = (time, random)
"""The modules whose functions raise while nodes call them."""
_OPENED: Final = ("builtins", "collections", "itertools", "random")
"""The modules whose objects are compared by their contents outside of the state of a tree."""
_SHOWN: Final = 3
"""The number of nodes that a message names."""
MAX_ITEMS: Final = 1000
"""The length from which on a variable is compared by identity."""


def has_user_code(node: TreeNode) -> bool:
    """Return whether the class of *node*, or a base class, is neither btcore's nor of its packages."""
    classes = [cls for cls in type(node).__mro__ if issubclass(cls, TreeNode)]
    return any(cls.__module__.partition(".")[0] not in _OWN_PACKAGES for cls in classes)


def texts_in_code(tree: Tree) -> str:
    """Return the texts in the code of users' nodes: they may be the keys of entries."""
    texts: dict[str, None] = {}
    classes = {cls: None for node in tree.nodes if has_user_code(node) for cls in _user_classes(node)}
    for cls in classes:
        functions = [member for member in vars(cls).values() if isinstance(member, FunctionType)]
        values = [*vars(cls).values(), *(functions[0].__globals__.values() if functions else ())]
        codes = [function.__code__ for function in functions]
        while codes:
            constants = codes.pop().co_consts
            codes += [each for each in constants if isinstance(each, CodeType)]
            values += constants
        # Without documentation, which names much that the code does not read.
        texts.update((value, None) for value in values if isinstance(value, str) and " " not in value)
    return " ".join(texts)


def _user_classes(node: TreeNode) -> list[type]:
    """Return the classes of *node* that are neither btcore's nor Python's."""
    known_packages = (*_OWN_PACKAGES, "builtins", "typing", "abc")
    return [cls for cls in type(node).__mro__ if cls.__module__.partition(".")[0] not in known_packages]


class _Reading(int):
    """A time that a node has read to set a deadline. Any other use than an addition is noted."""

    note: Callable[[], None]

    @classmethod
    def of(cls, time: int, note: Callable[[], None]) -> "_Reading":
        """Return a reading of *time* (ns)."""
        reading = cls(time)
        reading.note = note
        return reading

    def _note_use(self, operator: Callable[[int, Any], Any], other: object) -> Any:
        self.note()
        return operator(int(self), other)

    def __lt__(self, other: int) -> bool:
        return bool(self._note_use(lt, other))

    def __le__(self, other: int) -> bool:
        return bool(self._note_use(le, other))

    def __gt__(self, other: int) -> bool:
        return bool(self._note_use(gt, other))

    def __ge__(self, other: int) -> bool:
        return bool(self._note_use(ge, other))

    def __sub__(self, other: int) -> int:
        return int(self._note_use(sub, other))

    def __rsub__(self, other: int) -> int:
        self.note()
        return other - int(self)


class UserCode:
    """The nodes of a tree that have code of users.

    Args:
        keeper: Keeps the states of the tree.
        interrupt: Notes an interrupt of the search.

    Attributes:
        nodes: The nodes.
        reasons: Why the answers are unknown, each reason once.
    """

    def __init__(
        self, tree: Tree, keeper: StateKeeper, interrupt: Callable[[SearchInterrupt], SearchInterrupt]
    ) -> None:
        self.nodes = [node for node in tree.nodes if has_user_code(node)]
        self.reasons: dict[str, None] = {}
        self._tree = tree
        self._keeper = keeper
        self._interrupt = interrupt
        self._modules: dict[str, dict[str, Any]] = {}
        self._classes: dict[type, None] = {}
        for node in self.nodes:
            for cls in _user_classes(node):
                self._classes[cls] = None
                for member in vars(cls).values():
                    if isinstance(member, FunctionType):
                        self._modules[member.__module__] = member.__globals__
            self._watch_clock(node)
        variables = [*self._modules.values(), *map(vars, self._classes)]
        keeper.shared = frozenset(id(value) for held in variables for value in held.values())
        self._before = self._outside()

    def _watch_clock(self, node: TreeNode) -> None:
        """Note when a node reads the clock for another purpose than to set a deadline."""
        what = "but its class declares no deadline in time_fields"
        if any(value is self._keeper.clock.replaced for value in vars(node).values()):
            self.reasons[f"{_name_node(node)} keeps the clock, {what}"] = None
        context = self._tree.context

        def note(use: str) -> None:
            self.reasons.setdefault(f"{_name_node(node)} {use}", None)

        def read_without_deadline() -> int:
            note(f"reads the clock, {what}")
            return context.tick_start

        def read() -> int:
            use = "compares the time of now(): use has_passed(), by which a tick has a single time"
            return _Reading.of(read_clock(node), partial(note, use))

        if type(node).now is not TreeNode.now:
            note("has a port called 'now', which hides its readings of the clock")
        vars(node)["now"] = read if node.spec.time_fields else read_without_deadline

    @contextmanager
    def guarded(self) -> Iterator[None]:
        """Let the functions of `time` and `random` raise when the modules of the nodes call them."""
        replaced: list[tuple[dict[str, Any], str, object]] = []
        functions = {id(value): name for module in _GUARDED for name, value in _functions_of(module)}
        for held in self._modules.values():
            for name, value in held.items():
                if any(value is module for module in _GUARDED) or id(value) in functions:
                    replaced.append((held, name, value))
        for held, name, value in replaced:
            if isinstance(value, ModuleType):
                held[name] = _GuardedModule(value, self._refuse)
            else:
                held[name] = _refusing(functions[id(value)], self._refuse)
        self._before = self._outside()
        try:
            yield
        finally:
            for held, name, value in replaced:
                held[name] = value

    def _refuse(self, name: str) -> NoReturn:
        frame, caller = sys._getframe(1), ""
        while not caller and frame.f_back is not None:
            frame = frame.f_back
            held = [*frame.f_locals.values()]
            caller = next((_name_node(node) for node in self.nodes if any(node is each for each in held)), "")
        text = f"{caller or self.names} calls {name}, which the search cannot repeat"
        raise self._interrupt(HiddenInputError(text))

    @property
    def names(self) -> str:
        """The nodes, for a message."""
        shown = [_name_node(node) for node in self.nodes[:_SHOWN]]
        more = len(self.nodes) - len(shown)
        return join_names([*shown, f"one of {more} others"] if more else shown, "or")

    def check_outside(self) -> None:
        """Note what has changed outside of the state that the nodes declare."""
        now = self._outside()
        for place in {**self._before, **now}:
            if self._before.get(place) != now.get(place):
                self.reasons[f"{place} changes, but is not a part of the state of a node"] = None
        self._before = now

    def check_fields(self) -> None:
        """Note unknown values in the present state fields of the nodes: they cannot be compared later."""
        for node in self.nodes:
            for name in state_fields_of(type(node)):
                try:
                    Freezer(self._keeper.shared, unknown=False).freeze(getattr(node, name))
                except OpaqueStateError as error:
                    reason = (
                        f"{_name_node(node)} keeps {error} in '{name}', which cannot be copied and compared"
                    )
                    self.reasons[reason] = None

    def note_difference(self, first: Sequence[Hashable], second: Sequence[Hashable]) -> None:
        """Note that a tick was different when it was repeated.

        Args:
            first: What happened in the tick: states of the tree, and other values.
            second: What happened in the repeated tick.
        """
        value, repeated = next(
            (pair for pair in zip(first, second, strict=False) if pair[0] != pair[1]), (0, 0)
        )
        fields: list[str] = []
        if isinstance(value, TreeState) and isinstance(repeated, TreeState):
            for node, name in self._keeper.differences(value, repeated):
                if node in self.nodes:
                    fields.append(f"{_name_node(node)} has another '{name}'")
        what = fields[0] if fields else f"a tick with {self.names} has another result"
        self.reasons[f"{what} if it is repeated from the same state"] = None

    def _outside(self) -> dict[str, Hashable]:
        """Return the variables of the nodes' modules and classes, and attributes that are no state fields."""
        variables: dict[str, Hashable] = {}
        for module, held in self._modules.items():
            name = module.removeprefix(PLUGIN_FILE_PREFIX)
            variables |= self._contents(held, f"the variable {{}} of {name}")
        for cls in self._classes:
            variables |= self._contents(vars(cls), f"the attribute {{}} of the class {cls.__name__}")
        for node in self.nodes:
            own_classes = [cls for cls in type(node).__mro__ if cls.__module__.startswith("btcore.")]
            known = {name for cls in own_classes for name in get_annotations(cls)}
            known |= {"now", *state_fields_of(type(node))}
            own = {name: value for name, value in vars(node).items() if name not in known}
            variables |= self._contents(own, f"the attribute {{}} of {_name_node(node)}")
            for name, value in own.items():
                if hasattr(type(value), "__next__") and isinstance(self._comparable(value), int):
                    what = f"{_name_node(node)} keeps a {type(value).__name__} in '{name}'"
                    self.reasons[f"{what}, which cannot be copied and compared"] = None
        return variables

    def _contents(self, held: Mapping[str, Any], place: str) -> dict[str, Hashable]:
        """Return what can be compared of variables, by their places."""
        values: dict[str, Hashable] = {}
        for name, value in held.items():
            if not name.startswith("__"):
                values[place.format(f"'{name}'")] = self._comparable(value)
        return values

    def _comparable(self, value: object) -> Hashable:
        cls = type(value)
        is_opened = cls.__module__ in self._modules or cls.__module__ in _OPENED
        if is_opened and not (hasattr(cls, "__len__") and len(value) > MAX_ITEMS):  # type: ignore[arg-type]
            freezer = Freezer()
            try:
                return (freezer.freeze(value), freezer.objects())
            except OpaqueStateError:
                pass
        return id(value)


def _name_node(node: TreeNode) -> str:
    return f"'{node.config.path}' <{node.config.id}>"


def _functions_of(module: ModuleType) -> Iterator[tuple[str, Callable[..., Any]]]:
    """Return the public functions of a module with their full names."""
    for name, value in vars(module).items():
        if not name.startswith("_") and callable(value) and not isinstance(value, type):
            yield f"{module.__name__}.{name}", value


def _refusing(name: str, refuse: Callable[[str], NoReturn]) -> Callable[..., NoReturn]:
    return lambda *_, **__: refuse(name)


class _GuardedModule:
    """Stands for a module: its functions raise."""

    def __init__(self, module: ModuleType, refuse: Callable[[str], NoReturn]) -> None:
        self._module = module
        self._refused = {name for name, _ in _functions_of(module)}
        self._refuse = refuse

    def __getattr__(self, name: str) -> Any:
        full = f"{self._module.__name__}.{name}"
        return _refusing(full, self._refuse) if full in self._refused else getattr(self._module, name)
