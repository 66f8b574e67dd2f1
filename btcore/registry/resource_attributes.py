"""Resources that a node class declares as annotated attributes, such as `lamp: Lamp`."""

import dis
import inspect
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from types import CodeType
from typing import Any, Final

from btcore.blackboard.ports import UNSET
from btcore.engine.signature import Parameter, class_annotations, hides_attribute
from btcore.errors import NodeError
from btcore.suggestions import with_article

_ENGINE: Final = "btcore"


class MissingResourceError(NodeError, AttributeError):
    """An attribute was read for which the tree has no resource."""


class ResourceAttribute:
    """A class attribute whose value nodes get when they are created. Reading it before raises an error."""

    def __init__(self, parameter: Parameter) -> None:
        self.parameter = parameter

    def __get__(self, node: Any, cls: type) -> object:
        """Raise MissingResourceError. A value of the node itself takes precedence."""
        if node is None:
            return self
        name, type_name = self.parameter.name, self.parameter.type_name
        raise MissingResourceError(
            f"<{node.config.id}> needs {with_article(type_name)} for its attribute '{name}': pass it in "
            f"resources=[…], or assign it; if it is a port, mark it: {name}: In[{type_name}]"
        )


def class_resources(cls: type, names: Mapping[str, Any]) -> list[Parameter]:
    """Return the attributes of a node class that are filled with resources, by their types.

    These are the public attributes that are annotated with a class, except for built-in classes such as
    float, and that have no value: neither in the class nor by an assignment in one of its methods.

    Args:
        names: Local names, for resolving annotations that are strings.
    """
    parents = [parent for parent in cls.__mro__ if parent.__module__.partition(".")[0] != _ENGINE]
    declared = {name for parent in parents for name in inspect.get_annotations(parent)}
    candidates = {
        name: resource_type
        for name, resource_type in class_annotations(cls, names).items()
        if name in declared and isinstance(resource_type, type) and resource_type.__module__ != "builtins"
        if not name.startswith("_") and not _has_value(cls, name)
    }
    if candidates:
        for code in _method_codes(parents):
            for name in _assigned_names(code):
                candidates.pop(name, None)
    return [Parameter(name, True, None, resource_type, UNSET) for name, resource_type in candidates.items()]


def _has_value(cls: type, name: str) -> bool:
    value = getattr(cls, name, UNSET)
    if value is UNSET or hides_attribute(name, value):
        return False
    return not isinstance(value, ResourceAttribute)


def bind_resources(cls: type, attributes: Iterable[Parameter]) -> None:
    """Make *attributes*, the result of `class_resources`, attributes of *cls* that report a missing value."""
    for parameter in attributes:
        setattr(cls, parameter.name, ResourceAttribute(parameter))


def _method_codes(classes: list[type]) -> Iterator[CodeType]:
    for cls in classes:
        for member in vars(cls).values():
            for function in (member, *(getattr(member, part, None) for part in ("fget", "fset", "__func__"))):
                code = getattr(inspect.unwrap(function) if callable(function) else None, "__code__", None)
                if isinstance(code, CodeType):
                    yield code


@lru_cache(maxsize=2048)  # a process with several registries adds the same classes to each
def _assigned_names(code: CodeType) -> frozenset[str]:
    """Return the names of attributes that *code* assigns, also in functions that it defines."""
    names = {
        str(instruction.argval)
        for instruction in dis.get_instructions(code)
        if instruction.opname == "STORE_ATTR"
    }
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            names |= _assigned_names(constant)
        elif isinstance(constant, str) and "setattr" in code.co_names:
            names.add(constant)
    return frozenset(names)
