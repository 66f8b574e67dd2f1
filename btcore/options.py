"""Options: typed structs whose fields are options of the command line.

`Options` are those of a command; those of a provider are `btcore.Settings`. A field declares its option once:

    class GripperSettings(Settings):
        port: Annotated[str, option("Serial port of the gripper.", metavar="PORT")]
        force: Annotated[float, option("Greatest force, in N.", gt=0)] = 20.0

The option is named after the field: `--force`. A field without a default is required: its provider is used
only if the option is given. A field of type `tuple[str, ...]` is an option that may be repeated, a `bool` is
a flag, and a `Literal` a choice.
"""

from collections.abc import Callable, Mapping, Sequence
from types import NoneType, UnionType
from typing import Annotated, Any, Final, NamedTuple, TypeVar, Union, get_args, get_origin

import msgspec
from msgspec.structs import FieldInfo

from btcore.errors import SettingsError

_DETAILS: Final = "btcore"
"""The key in the `extra` of a field's `msgspec.Meta`."""

AnyOptions = TypeVar("AnyOptions", bound="Options")


class SweepOption(NamedTuple):
    """An option of `btcore sweep` that varies a setting.

    Attributes:
        name: The name of the option without dashes, such as "worlds".
        parse: Returns the values in the option's text; it may raise a `SettingsError`.
        metavar: The name of the value in the help.
        help: The help.
    """

    name: str
    parse: Callable[[str], Sequence[str]]
    metavar: str
    help: str


class OptionDetails(NamedTuple):
    """The arguments of `option`, except the help and the limits."""

    metavar: str | None
    sweep_option: SweepOption | None
    one_run_only: bool
    bare_value: object
    complete: Any
    option_name: str | None
    may_be_folder: bool


def option(
    help: str,
    *,
    metavar: str | None = None,
    gt: float | None = None,
    ge: float | None = None,
    le: float | None = None,
    sweep_option: SweepOption | None = None,
    one_run_only: bool = False,
    bare_value: object = None,
    complete: Any = None,
    name: str | None = None,
    may_be_folder: bool = False,
) -> msgspec.Meta:
    """Describe a field of `Options` or `Settings` as an option.

    Args:
        help: The help text, with the unit.
        metavar: The name of the value in the help, such as "FILE.yaml".
        gt: The value is greater than this.
        ge: The value is at least this.
        le: The value is at most this.
        sweep_option: The option of `btcore sweep` that varies the setting; `--param` can vary every setting.
        one_run_only: Whether simultaneous runs cannot share the setting, such as the name of an output.
        bare_value: The value of the option if it is given without one: `--serve-web`.
        complete: A function for shell completion, as the argument `shell_complete` of `click.Option`.
        name: The name of the option without dashes; by default that of the field.
        may_be_folder: Whether a path may be that of a folder.
    """
    details = OptionDetails(metavar, sweep_option, one_run_only, bare_value, complete, name, may_be_folder)
    limits: dict[str, Any] = {"gt": gt, "ge": ge, "le": le}
    meta: msgspec.Meta = msgspec.Meta(description=help, extra={_DETAILS: details}, **limits)
    return meta


class Options(msgspec.Struct):
    """The options of a command, one for each field. `__post_init__` may raise a `SettingsError`."""


def from_values(options_class: type[AnyOptions], values: Mapping[str, Any]) -> AnyOptions | None:
    """Return options with the values of a command's parameters; None if a required option is not given.

    Args:
        values: The values of parameters by name; those that are missing have their defaults.
    """
    chosen: dict[str, Any] = {}
    for field in msgspec.structs.fields(options_class):
        value = values.get(field.name)
        if field.required and (value is None or value is False or value == ()):
            return None
        if value is not None:
            chosen[field.name] = tuple(value) if isinstance(value, list) else value
    return options_class(**chosen)


def check_settings(settings: AnyOptions) -> AnyOptions:
    """Check the types and limits of the values that a program gave to *settings*, and return *settings*."""
    if not isinstance(settings, Options):
        raise TypeError(f"{settings!r} is not a settings object: write GripperSettings(…)")
    try:
        msgspec.convert(msgspec.structs.asdict(settings), type(settings))
    except msgspec.ValidationError as error:
        raise SettingsError(f"{type(settings).__name__}: {error}") from None
    return settings


def required_option_names(options_class: type[Options]) -> list[str]:
    """Return the options of a class that have no default, with dashes."""
    return [option_name(field) for field in msgspec.structs.fields(options_class) if field.required]


def changed_option_names(options: Options) -> list[str]:
    """Return the options that are required or whose values differ from their defaults, with dashes."""
    return [option_name(field) for field in _changed_fields(options)]


def arguments(options: Options) -> list[str]:
    """Return the arguments of a command line that give the values of *options* to a command.

    Values that are the defaults are omitted.
    """
    words: list[str] = []
    for field in _changed_fields(options):
        value = getattr(options, field.name)
        if value is None or value is False:
            continue
        for item in value if isinstance(value, tuple) else (value,):
            words += [option_name(field)] if item is True else [option_name(field), str(item)]
    return words


def _changed_fields(options: Options) -> list[FieldInfo]:
    return [
        field
        for field in msgspec.structs.fields(options)
        if field.required or getattr(options, field.name) != field.default
    ]


def option_name(field: FieldInfo) -> str:
    """Return the option of *field*, with dashes."""
    _, _, details = describe_field(field)
    return "--" + (details.option_name or field.name).replace("_", "-")


def describe_field(field: FieldInfo) -> tuple[Any, msgspec.Meta, OptionDetails]:
    """Return the type of *field*, and its description.

    The type is `str` for `Annotated[str, option(…)] | None`.
    """
    annotation = field.type
    if get_origin(annotation) in (Union, UnionType):
        annotation = next(part for part in get_args(annotation) if part is not NoneType)
    if get_origin(annotation) is Annotated:
        field_type, *metadata = get_args(annotation)
        for meta in metadata:
            if isinstance(meta, msgspec.Meta) and _DETAILS in (meta.extra or {}):
                return field_type, meta, (meta.extra or {})[_DETAILS]
    raise TypeError(f"the type {annotation} is not an option: write Annotated[…, option(…)]")
