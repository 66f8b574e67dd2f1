"""Providers: functions that provide what leaves need, and what else takes part in a run, like fixtures.

    @provider
    def gripper(settings: GripperSettings, clock: Clock) -> Iterator[Gripper]:
        with connect(settings.port) as gripper:
            yield gripper

The return annotation is the type that is provided, and the parameters are the settings and the objects that
the provider needs, by their types. A package offers a provider by an entry point of the group
`btcore.providers`:

    [project.entry-points."btcore.providers"]
    "gripper-grippers.arm.Gripper" = "grippers.providers:gripper"

The name of the entry point is that of the provider, a dash, and the full name of the type. A provider has one
for each type by which leaves or other providers may ask for it. Nothing is imported to find out which
packages provide a type. A side-effect provider, such as a publisher, has no type in its annotation, or needs
the tree; its entry point is named after the provider alone.
"""

import inspect
import re
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from functools import cached_property
from types import NoneType, UnionType
from typing import Any, Final, ForwardRef, NamedTuple, TypeGuard, Union, get_args, get_origin, overload

from btcore.clock import Clock
from btcore.errors import ProviderError
from btcore.options import required_option_names
from btcore.registry.resources import Resources, TypeRef, full_name
from btcore.runs.report import Report
from btcore.runs.settings import Settings
from btcore.tree.tree import Tree

_GENERAL_MODULES: Final = ("builtins", "typing", "abc", "typing_extensions")
"""Modules whose classes are no types of resources, although they are base classes of them."""

_FULL_NAME: Final = re.compile(r"[A-Za-z_]\w*(\.\w+)+")

TYPES_OF_RUN: Final[tuple[TypeRef, ...]] = (Clock, Tree, Report, Resources)
"""The types of parameters whose objects are those of the run itself: attributes of `RunProviders`."""


class Need(NamedTuple):
    """A parameter of a provider.

    Attributes:
        parameter: The name of the parameter.
        type: The type.
        is_optional: Whether the parameter may be None.
    """

    parameter: str
    type: TypeRef
    is_optional: bool

    @property
    def type_name(self) -> str:
        """The full name of the type."""
        return full_name(self.type)


class Provider:
    """A provider: a function, with what its annotations declare.

    Args:
        function: The function or generator function.
        provides: Further types under which the object is provided, such as protocols that it satisfies: the
            classes, or their full names.
        default: Whether the provider is used only if no other provider is equally good.

    Attributes:
        name: The name of the function.
    """

    def __init__(
        self, function: Callable[..., Any], provides: Sequence[type | str] = (), default: bool = False
    ) -> None:
        if inspect.iscoroutinefunction(function) or inspect.isasyncgenfunction(function):
            raise ProviderError(f"the provider {function.__name__} is asynchronous: write def, not async def")
        self.function = function
        self.name = function.__name__
        self.is_default = default
        self._provides = provides
        self.__doc__ = function.__doc__
        self.__module__ = function.__module__

    def __call__(self, *arguments: Any, **keywords: Any) -> Any:
        """Call the function."""
        return self.function(*arguments, **keywords)

    def __repr__(self) -> str:
        return f"{self.name} ({self.place})"

    @property
    def place(self) -> str:
        """The file and the line of the function."""
        code = self.function.__code__
        return f"{code.co_filename}:{code.co_firstlineno}"

    @cached_property
    def _hints(self) -> dict[str, Any]:
        try:
            return _resolve(self.function)
        except (NameError, TypeError) as error:
            raise ProviderError(
                f"the annotations of the provider {self} cannot be read: {error}; write the full name of a "
                "type that is imported under TYPE_CHECKING, as 'grippers.arm.Gripper'"
            ) from error

    @cached_property
    def types(self) -> tuple[TypeRef, ...]:
        """The provided types of each object: those that were passed, then that of the annotation.

        There are none if the provider needs the tree: leaves cannot get what is provided after them.
        """
        if "return" not in self._hints:
            raise ProviderError(f"the provider {self} has no return annotation: write -> Iterator[Gripper]")
        if self.needs_tree:
            return ()
        annotated = (type for type in self._object_types if type not in (NoneType, object))
        return (*self._provides, *annotated)

    @cached_property
    def _object_types(self) -> tuple[Any, ...]:
        """The type of each object that the function yields or returns."""
        annotation = self._hints["return"]
        if get_origin(annotation) in (Iterator, Iterable, Generator):
            annotation = get_args(annotation)[0]
        annotation, _ = _without_none(annotation)
        annotations = get_args(annotation) if get_origin(annotation) is tuple else (annotation or NoneType,)
        return tuple(map(_type_or_full_name, annotations))

    @property
    def provides_several(self) -> bool:
        """Whether the function yields or returns a tuple of objects."""
        return len(self._object_types) > 1

    @cached_property
    def type_names(self) -> frozenset[str]:
        """The full names of the provided types and of their base classes."""
        classes = (base for type in self.types for base in getattr(type, "__mro__", (type,)))
        return frozenset(
            full_name(cls) for cls in classes if getattr(cls, "__module__", None) not in _GENERAL_MODULES
        )

    @cached_property
    def needs(self) -> tuple[Need, ...]:
        """The parameters."""
        needs = []
        for parameter in inspect.signature(self.function).parameters.values():
            if parameter.name not in self._hints:
                raise ProviderError(f"the parameter '{parameter.name}' of the provider {self} has no type")
            annotation, is_optional = _without_none(self._hints[parameter.name])
            needs.append(Need(parameter.name, _type_or_full_name(annotation), is_optional))
        return tuple(needs)

    @cached_property
    def object_needs(self) -> list[Need]:
        """The parameters for objects of other providers or of the program."""
        return [need for need in self.needs if need.type not in TYPES_OF_RUN and not is_settings(need.type)]

    @cached_property
    def settings_classes(self) -> list[type[Settings]]:
        """The classes of its settings."""
        return [need.type for need in self.needs if is_settings(need.type)]

    @cached_property
    def optional_settings(self) -> list[type[Settings]]:
        """The classes of its settings whose parameter may be None."""
        return [need.type for need in self.needs if is_settings(need.type) and need.is_optional]

    @cached_property
    def required_settings(self) -> list[type[Settings]]:
        """The classes of its settings that have to be given: they have a field without a default."""
        needed = [cls for cls in self.settings_classes if cls not in self.optional_settings]
        return [cls for cls in needed if required_option_names(cls)]

    @property
    def needs_tree(self) -> bool:
        """Whether the provider needs the tree, so that it is opened after the tree was created."""
        return any(need.type is Tree for need in self.needs)

    @property
    def provides_clock(self) -> bool:
        """Whether the object, or one of them, is the run's clock."""
        return full_name(Clock) in self.type_names


@overload
def provider(function: Callable[..., Any], /) -> Provider: ...


@overload
def provider(
    *, provides: Sequence[type | str] = (), default: bool = False
) -> Callable[[Callable[..., Any]], Provider]: ...


def provider(
    function: Callable[..., Any] | None = None, *, provides: Sequence[type | str] = (), default: bool = False
) -> Provider | Callable[[Callable[..., Any]], Provider]:
    """Mark a function or generator function as a provider of what leaves need.

    The return annotation is the type that is provided, and the parameters are what the provider needs. A
    generator function yields the object once. What follows the `yield` is executed after the run, also after
    an error, in the reverse order of the providers. The function may yield a tuple of objects, annotated as
    `tuple[Arm, Gripper]`, or None.

    Parameters may have the types of objects that others provide (`X | None`: the object is not necessary),
    classes of `Settings`, and these types: `RunSettings`; `Clock`, the clock of the run; `Report`;
    `Resources`, all provided objects; `Tree`. A provider that has the parameter `Tree` is opened after the
    tree was created, so that its object is for the run alone. When another tree replaces it (`--watch`), the
    method `replace_tree(tree)` of the object is called; an object without such a method is closed, and the
    provider opened again.

    An annotation may be a text with the full names of types whose import would take time, such as
    `"Iterator[grippers.arm.Gripper]"`. For type checkers, the module is imported under TYPE_CHECKING.

    Args:
        function: The function; without it, a decorator is returned.
        provides: Further types under which the object is provided: protocols that it satisfies, and `Clock`,
            if the object, or its attribute `clock`, is the clock of the run. A type whose import would take
            time is given by its full name, as text.
        default: Whether the provider is used only if no other provider is equally good.

    Examples:
        >>> from collections.abc import Iterator
        >>> import btcore
        >>> class Gripper:
        ...     pass
        >>> @btcore.provider
        ... def gripper() -> Iterator[Gripper]:
        ...     yield Gripper()
        >>> gripper.types
        (<class '...Gripper'>,)
    """
    if function is not None:
        return Provider(function, provides, default)
    return lambda function: Provider(function, provides, default)


def _without_none(annotation: Any) -> tuple[Any, bool]:
    """Return `X` and True for `X | None`, and False for any other type."""
    if get_origin(annotation) in (Union, UnionType) and NoneType in get_args(annotation):
        [annotation] = [part for part in get_args(annotation) if part is not NoneType]
        return annotation, True
    return annotation, False


def is_settings(annotation: Any) -> TypeGuard[type[Settings]]:
    """Return whether *annotation* is a class of settings."""
    return isinstance(annotation, type) and issubclass(annotation, Settings)


def _resolve(function: Callable[..., Any]) -> dict[str, Any]:
    """Return the annotations of *function*; what cannot be evaluated must be full names of types."""
    names = {**function.__globals__, "ForwardRef": ForwardRef}
    hints = {}
    for name, annotation in function.__annotations__.items():
        if isinstance(annotation, str):
            try:
                annotation = eval(annotation, names)
            except (NameError, AttributeError):
                annotation = eval(_FULL_NAME.sub(r"ForwardRef('\g<0>')", annotation), names)
        hints[name] = annotation
    return hints


def _type_or_full_name(annotation: Any) -> Any:
    return annotation.__forward_arg__ if isinstance(annotation, ForwardRef) else annotation
