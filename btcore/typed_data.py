"""Values from files as the types of the file's format, and messages about values that do not fit.

A format is a `Record`, or a dataclass, whose annotations have the limits:

    class Sonar(Record):
        frame: str
        range_max: Positive
        yaw: float = 0.0

`convert` returns the record of a value. Its error names the key, the value, and what is allowed.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from itertools import islice, repeat
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Final, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import msgspec
from msgspec import Meta

from btcore.suggestions import did_you_mean, join_names, shortened

Value = TypeVar("Value")
Keys = tuple[str | int, ...]
"""The keys, and the indices of lists, that lead to a value."""

Positive = Annotated[float, Meta(gt=0.0)]
NotNegative = Annotated[float, Meta(ge=0.0)]

_WORDS: Final = {
    float: "a number",
    int: "a whole number",
    bool: "true or false",
    str: "a text",
    Path: "a text",
    list: "a list",
}
_MAX_SHOWN: Final = 80
"""Characters of a value that a message shows."""


class Record(msgspec.Struct, forbid_unknown_fields=True):
    """An object of a file. Its `__post_init__` may raise a `FieldError`, or a `ValueError` whose text
    follows the key of the object in the message.

    In a plain `msgspec.Struct`, unknown keys are ignored unless they resemble a missing key.
    """


class FieldError(ValueError):
    """The value of the field *key* contradicts another field; *problem* follows the key in the message."""

    def __init__(self, key: str, problem: str) -> None:
        super().__init__(key, problem)
        self.key = key
        self.problem = problem


class DataError(ValueError):
    """A value does not fit its format; *keys* lead to the value."""

    def __init__(self, keys: Keys, problem: str) -> None:
        super().__init__(keys, problem)
        self.keys = keys
        self.problem = problem

    def __str__(self) -> str:
        """Return the message, such as `'base.radius' is -1, and a number greater than 0 is expected`."""
        path = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in self.keys)
        return f"'{path.removeprefix('.')}' {self.problem}" if path else self.problem


def convert(value: Any, data_type: type[Value]) -> Value:
    """Return *value*, which consists of dictionaries, lists, texts and numbers, as *data_type*.

    Numbers have to be finite, and None is always invalid.
    """
    converted: Value = _check(value, data_type, ())
    return converted


def json_schema(data_type: type) -> dict[str, Any]:
    """Return the JSON schema of a file format, with which editors complete keys and mark mistakes."""
    schema = msgspec.json.schema(data_type, schema_hook=lambda _: {"type": "string"})
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _path(data_type: type, value: Any) -> Any:
    if data_type is Path and isinstance(value, str):
        return Path(value)
    raise TypeError


def _check(value: Any, annotation: Any, keys: Keys) -> Any:
    """Return *value*, to which *keys* lead, as the type *annotation*."""
    data_type, _ = _bare(annotation)
    if get_origin(data_type) in (Union, UnionType) and isinstance(value, dict):
        data_type = _tagged(value, get_args(data_type), keys)
    if (
        isinstance(value, dict)
        and isinstance(data_type, type)
        and (is_dataclass(data_type) or _is_struct(data_type))
    ):
        _check_fields(value, data_type, keys)
    elif isinstance(value, dict) and get_origin(data_type) is dict:
        for key, item in value.items():
            _check(item, get_args(data_type)[1], (*keys, key))
    elif isinstance(value, list):
        for index, (item, item_type) in enumerate(zip(value, _item_types(data_type), strict=False)):
            _check(item, item_type, (*keys, index))
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        raise _misfit(value, annotation, keys)
    try:
        return msgspec.convert(value, annotation, dec_hook=_path)
    except msgspec.ValidationError as error:
        if isinstance(error.__cause__, FieldError):
            raise DataError((*keys, error.__cause__.key), error.__cause__.problem) from None
        if isinstance(error.__cause__, ValueError):
            raise DataError(keys, str(error.__cause__)) from None
        raise _misfit(value, annotation, keys) from None


def _check_fields(value: Mapping[str, Any], data_type: type, keys: Keys) -> None:
    config = data_type.__struct_config__ if _is_struct(data_type) else None  # type: ignore[attr-defined]
    known = {name: annotation for name, annotation, _ in _fields(data_type)}
    if config is not None and config.tag_field is not None:
        known = {config.tag_field: str, **known}
    is_strict = config is None or config.forbid_unknown_fields
    for key in value:
        if key not in known:
            hint = did_you_mean(str(key), known if is_strict else known.keys() - value.keys())
            if is_strict or hint:
                raise DataError((*keys, key), f"is unknown: known are {', '.join(known)}{hint}")
    for name, annotation, is_required in _fields(data_type):
        if name in value:
            _check(value[name], annotation, (*keys, name))
        elif is_required:
            raise DataError((*keys, name), "is missing")


@cache
def _fields(data_type: Any) -> list[tuple[str, Any, bool]]:
    """Return the key, the annotation, and whether it is required, of each field."""
    if _is_struct(data_type):
        return [(info.encode_name, info.type, info.required) for info in msgspec.structs.fields(data_type)]
    hints = get_type_hints(data_type, include_extras=True)
    return [
        (field.name, hints[field.name], field.default is MISSING and field.default_factory is MISSING)
        for field in fields(data_type)
    ]


def _tagged(value: Mapping[str, Any], classes: tuple[Any, ...], keys: Keys) -> Any:
    """Return the struct of a union that the tag in *value* names."""
    configs = {cls.__struct_config__.tag: cls for cls in classes if _is_struct(cls)}
    if not configs:
        return None
    tag_field = next(iter(configs.values())).__struct_config__.tag_field
    if tag_field not in value:
        raise DataError((*keys, tag_field), "is missing")
    tag = value[tag_field]
    if not isinstance(tag, str) or tag not in configs:
        raise _misfit(tag, Literal[tuple(configs)], (*keys, tag_field))
    return configs[tag]


def _is_struct(data_type: Any) -> bool:
    return isinstance(data_type, type) and issubclass(data_type, msgspec.Struct)


def _bare(annotation: Any) -> tuple[Any, dict[str, Any]]:
    """Return the type of *annotation* without `Annotated` and `None`, and its limits by name."""
    limits: dict[str, Any] = {}
    if get_origin(annotation) in (Union, UnionType):
        parts = [part for part in get_args(annotation) if part not in (NoneType, msgspec.UnsetType)]
        if len(parts) > 1:
            return annotation, limits
        annotation = parts[0]
    if get_origin(annotation) is Annotated:
        annotation, *metas = get_args(annotation)
        for meta in metas:
            if isinstance(meta, Meta):
                limits |= {name: limit for name, limit, *_ in meta.__rich_repr__() if limit is not None}
    return annotation, limits


def _item_types(data_type: Any) -> Any:
    if isinstance(data_type, type) and hasattr(data_type, "_fields"):  # a NamedTuple
        return get_type_hints(data_type, include_extras=True).values()
    types = get_args(data_type) if get_origin(data_type) in (tuple, list) else ()
    return repeat(types[0]) if types[1:] in ((...,), ()) and types else types


def _misfit(value: object, annotation: Any, keys: Keys) -> DataError:
    data_type, _ = _bare(annotation)
    is_choice = get_origin(data_type) is Literal and isinstance(value, str)
    hint = did_you_mean(str(value), get_args(data_type)) if is_choice else ""
    # Only the first parts of the text, because a short YAML file with aliases may describe a huge value.
    encoder = json.JSONEncoder(ensure_ascii=False, default=str)
    shown = shortened("".join(islice(encoder.iterencode(value), _MAX_SHOWN)), _MAX_SHOWN)
    return DataError(keys, f"is {shown}, and {expected(annotation)} is expected{hint}")


def expected(annotation: Any) -> str:
    """Return what a value of the type *annotation* is, such as `a number of at least 0`."""
    data_type, limits = _bare(annotation)
    if get_origin(data_type) is Literal:
        return join_names([json.dumps(name) for name in get_args(data_type)], "or", 20)
    if get_origin(data_type) in (Union, UnionType) and not any(map(_is_struct, get_args(data_type))):
        return join_names(map(expected, get_args(data_type)), "or")
    if "examples" in limits:
        return f"a text like {json.dumps(limits['examples'][0])}"
    if data_type in _WORDS:
        words = {"gt": "greater than", "ge": "of at least", "le": "of at most"}
        ranges = [f" {word} {limits[name]:g}" for name, word in words.items() if name in limits]
        return _WORDS[data_type] + " and".join(ranges)
    types = _item_types(data_type)
    if get_origin(data_type) in (tuple, list) or hasattr(data_type, "_fields"):
        count = "" if isinstance(types, repeat) else f"{len(types)} "
        least, most = limits.get("min_length"), limits.get("max_length")
        if least is not None or most is not None:
            pair = f"{least} {'or' if most == (least or 0) + 1 else 'to'} {most} "
            count = pair if least and most else f"at least {least} " if least else f"at most {most} "
        item = _bare(next(iter(types)))[0]
        others = "lists" if get_origin(item) is tuple or hasattr(item, "_fields") else "objects"
        items = {float: "numbers", int: "whole numbers", str: "texts"}.get(item, others)
        return f"a list of {count}{items}"
    return "an object of keys and values" + (", which is not empty," if "min_length" in limits else "")
