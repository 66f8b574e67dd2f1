"""Fast access to the members of an enum, on Python 3.11.

There, the look-up of `Status.SUCCESS` takes as long as the engine needs for a node: `EnumType` has a method
`__getattr__`, so that the interpreter does not cache the attributes of its classes. Later versions have none.
"""

import sys
from enum import Enum, EnumMeta
from typing import Any, NoReturn

# Never compiled: mypyc does not support classes that derive from `type`.


class _CachedEnumType(type):
    """`EnumType` without `__getattr__`, so that the interpreter can cache the members."""

    __bool__ = EnumMeta.__bool__
    __call__ = EnumMeta.__call__
    __contains__ = EnumMeta.__contains__
    __dir__ = EnumMeta.__dir__
    __getitem__ = EnumMeta.__getitem__
    __iter__ = EnumMeta.__iter__
    __len__ = EnumMeta.__len__
    __members__ = EnumMeta.__members__
    __repr__ = EnumMeta.__repr__
    __reversed__ = EnumMeta.__reversed__

    # For isinstance(enum, EnumType), which libraries use to recognise enums.
    __class__ = property(lambda cls: EnumMeta)

    def __new__(metacls, name: str, bases: tuple[type, ...], namespace: dict[str, object]) -> NoReturn:
        raise TypeError(f"{name} cannot extend the enum {bases[-1].__name__}")

    def __setattr__(cls, name: str, value: object) -> None:
        if name in vars(cls)["_member_map_"]:
            raise AttributeError(f"cannot reassign member {name!r}")
        type.__setattr__(cls, name, value)

    def __delattr__(cls, name: str) -> None:
        if name in vars(cls)["_member_map_"]:
            raise AttributeError(f"{cls.__name__!r} cannot delete member {name!r}.")
        type.__delattr__(cls, name)


def cache_members(enum: type[Enum]) -> None:
    """Let the interpreter cache the members of *enum*.

    Afterwards, on Python 3.11, `type(enum)` is not `EnumType`. Everything else is as before, also
    `isinstance(enum, EnumType)`.
    """
    if sys.version_info < (3, 12):
        changed: Any = enum
        changed.__class__ = _CachedEnumType
