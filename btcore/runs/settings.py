"""Settings: typed structs whose fields are options of the command line.

A field declares its option once:

    class GripperSettings(Settings):
        port: Annotated[str, option("Serial port of the gripper.", metavar="PORT")]
        force: Annotated[float, option("Greatest force, in N.", gt=0)] = 20.0

The option is named after the field: `--force`. A field without a default is required: its provider is used
only if the option is given. A field of type `tuple[str, ...]` is an option that may be repeated, a `bool` is
a flag, and a `Literal` a choice.
"""

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Final, Literal, NamedTuple, TypeVar, Union, get_args, get_origin

import click
import msgspec
from msgspec.structs import FieldInfo

from btcore.errors import BtcoreError

_DETAILS: Final = "btcore"
"""The key in the `extra` of a field's `msgspec.Meta`."""

S = TypeVar("S", bound="Options")
Function = TypeVar("Function", bound=Callable[..., Any])


class Plural(NamedTuple):
    """An option of `btcore sweep` that varies a setting.

    Attributes:
        name: The name of the option without dashes, such as "worlds".
        parse: Returns the values in the option's text; it may raise click.UsageError.
        metavar: The name of the value in the help.
        help: The help.
    """

    name: str
    parse: Callable[[str], Sequence[str]]
    metavar: str
    help: str


class _OptionDetails(NamedTuple):
    metavar: str | None
    vary: Plural | None
    one_run_only: bool
    bare_value: object
    complete: Any
    option_name: str | None


def option(
    help: str,
    *,
    metavar: str | None = None,
    gt: float | None = None,
    ge: float | None = None,
    le: float | None = None,
    vary: Plural | None = None,
    one_run_only: bool = False,
    bare_value: object = None,
    complete: Any = None,
    name: str | None = None,
) -> msgspec.Meta:
    """Describe a field of `Settings` as an option.

    Args:
        help: The help text, with the unit.
        metavar: The name of the value in the help, such as "FILE.yaml".
        gt: The value is greater than this.
        ge: The value is at least this.
        le: The value is at most this.
        vary: The option of `btcore sweep` that varies the setting; `--param` can vary every setting.
        one_run_only: Whether simultaneous runs cannot share the setting, such as the name of an output.
        bare_value: The value of the option if it is given without one: `--serve-web`.
        complete: A function for shell completion, as the argument `shell_complete` of `click.Option`.
        name: The name of the option without dashes; by default that of the field.
    """
    details = _OptionDetails(metavar, vary, one_run_only, bare_value, complete, name)
    limits: dict[str, Any] = {"gt": gt, "ge": ge, "le": le}
    meta: msgspec.Meta = msgspec.Meta(description=help, extra={_DETAILS: details}, **limits)
    return meta


class Options(msgspec.Struct):
    """Options that a command declares for itself, in the form of `Settings`."""


class Settings(Options):
    """The settings of a provider, whose fields are options of commands.

    A field without a default is required: its provider is used only if the option is given. Required fields
    come first. `__post_init__` may check several settings together and raise click.UsageError.

    Examples:
        >>> from typing import Annotated
        >>> import btcore
        >>> class GripperSettings(btcore.Settings):
        ...     port: Annotated[str, btcore.option("Serial port of the gripper.", metavar="PORT")]
        ...     force: Annotated[float, btcore.option("Greatest force, in N.", gt=0)] = 20.0
        >>> GripperSettings("/dev/ttyUSB0").force
        20.0
    """


class RunSettings(Settings):
    """The settings of every run, which any provider can use as a parameter.

    Attributes:
        rate: Ticks per second of the run's clock (Hz).
        duration: The limit of the run (s of its clock), or None.
        seed: The seed of the random numbers.
        fast: Whether simulated time passes as fast as possible.
    """

    rate: Annotated[float, option("Ticks per second.", metavar="HZ", gt=0, le=10_000)] = 10.0
    duration: (
        Annotated[float, option("End the run after S seconds of the tree's clock.", metavar="S", gt=0)] | None
    ) = None
    seed: Annotated[
        int,
        option("Seed of the random numbers; the same seed reproduces the same run.", metavar="N", ge=0),
    ] = 0
    fast: Annotated[bool, option("Use simulated time and run as fast as possible.")] = False


class FiniteRange(click.FloatRange):
    """A range of finite numbers: infinity and NaN are errors."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Convert *value* to a finite number in the range. Any other value is a usage error.

        Args:
            value: The text of the option.
            param: The option.
            ctx: The context of the command.

        Returns:
            The number.
        """
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


class SettingOption(click.Option):
    """The option of a field of *settings*, and how a sweep treats it."""

    def __init__(self, settings: type[Options], field: FieldInfo) -> None:
        kind, meta = _unwrap(field.type)
        details: _OptionDetails = (meta.extra or {})[_DETAILS]
        self.settings = settings
        self.vary = details.vary
        self.one_run_only = details.one_run_only
        self.is_needed = field.required
        default = None if field.default is msgspec.NODEFAULT else field.default
        arguments: dict[str, Any] = {"help": meta.description, "metavar": details.metavar}
        if details.bare_value is not None:
            arguments |= {"is_flag": False, "flag_value": details.bare_value}
        if kind is bool:
            arguments |= {"is_flag": True, "default": bool(default)}
        else:
            if get_origin(kind) is tuple:
                kind = get_args(kind)[0]
                arguments["multiple"] = True
            elif default is not None:
                arguments |= {"default": default, "show_default": True}
            arguments["type"] = _click_type(kind, meta)
        dashed = (details.option_name or field.name).replace("_", "-")
        super().__init__([f"--{dashed}", field.name], shell_complete=details.complete, **arguments)

    def get_help_extra(self, ctx: click.Context) -> Any:
        """Return what the help shows in brackets, without the range of a number that has no limits."""
        extra = super().get_help_extra(ctx)
        if getattr(self.type, "min", None) is None and getattr(self.type, "max", None) is None:
            extra.pop("range", None)
        return extra


def create_options(settings: type[Options], *names: str) -> list[SettingOption]:
    """Return the options of *settings*, or those of its fields *names*, in the order of the fields.

    Raises:
        BtcoreError: A field is no option.
    """
    options = []
    for field in msgspec.structs.fields(settings):
        if not names or field.name in names:
            try:
                options.append(SettingOption(settings, field))
            except TypeError as error:
                raise BtcoreError(f"the field '{field.name}' of {settings.__name__}: {error}") from error
    return options


def setting_options(settings: type[Options], *names: str) -> Callable[[Function], Function]:
    """Return a decorator that adds the options of *settings* to a command.

    Args:
        settings: The class of the settings.
        names: The fields whose options are added; by default all.
    """

    def decorate(function: Function) -> Function:
        params = function.__dict__.setdefault("__click_params__", [])
        params.extend(reversed(create_options(settings, *names)))
        return function

    return decorate


def pass_settings(settings: type[Options], parameter: str) -> Callable[[Function], Function]:
    """Return a decorator that adds the options of *settings* to a command, which gets them as *parameter*.

    Args:
        settings: The class of the settings.
        parameter: The name of the parameter of the command's function.
    """

    def decorate(function: Function) -> Function:
        @functools.wraps(function)
        def with_settings(*arguments: Any, **values: Any) -> Any:
            own = {field.name: values.pop(field.name) for field in msgspec.structs.fields(settings)}
            return function(*arguments, **{parameter: from_values(settings, own)}, **values)

        return setting_options(settings)(with_settings)  # type: ignore[return-value]

    return decorate


def from_values(settings: type[S], values: Mapping[str, Any]) -> S | None:
    """Return *settings* with the values of a command's parameters; None if a required one is not given.

    Args:
        settings: The class of the settings.
        values: The values of parameters by name; those that are missing have their defaults.

    Raises:
        click.UsageError: The settings contradict each other.
    """
    chosen: dict[str, Any] = {}
    for field in msgspec.structs.fields(settings):
        value = values.get(field.name)
        if field.required and (value is None or value is False or value == ()):
            return None
        if value is not None:
            chosen[field.name] = tuple(value) if isinstance(value, list) else value
    return settings(**chosen)


def check_settings(settings: S) -> S:
    """Check the types and the limits of the values that a program gave to *settings*, and return *settings*.

    Raises:
        TypeError: *settings* are no settings, such as their class.
        ValueError: A value has another type, or is out of range.
    """
    if not isinstance(settings, Options):
        raise TypeError(f"{settings!r} are no settings: write GripperSettings(…)")
    try:
        msgspec.convert(msgspec.structs.asdict(settings), type(settings))
    except msgspec.ValidationError as error:
        raise ValueError(f"{type(settings).__name__}: {error}") from None
    return settings


def given_fields(settings: Options) -> list[str]:
    """Return the names of the fields that are required or differ from their defaults."""
    return [
        field.name
        for field in msgspec.structs.fields(settings)
        if field.required or getattr(settings, field.name) != field.default
    ]


def has_required_fields(settings: type[Options]) -> bool:
    """Return whether *settings* have a field without a default."""
    return any(field.required for field in msgspec.structs.fields(settings))


def option_names(settings: Options) -> list[str]:
    """Return the options for the `given_fields`, with dashes."""
    given = given_fields(settings)
    return [item.opts[0] for item in create_options(type(settings)) if item.name in given]


def arguments(settings: Options) -> list[str]:
    """Return the arguments of a command line that give *settings* to a command with their options.

    Values that are the defaults are omitted.
    """
    given = given_fields(settings)
    words: list[str] = []
    for item in create_options(type(settings)):
        value = getattr(settings, item.name or "")
        if item.name not in given or value is None or value is False:
            continue
        for one in value if isinstance(value, tuple) else (value,):
            words += [item.opts[0]] if one is True else [item.opts[0], str(one)]
    return words


def _unwrap(annotation: Any) -> tuple[Any, msgspec.Meta]:
    """Return the type and the description of a field: `str` for `Annotated[str, option(…)] | None`."""
    if get_origin(annotation) in (Union, UnionType):
        annotation = next(part for part in get_args(annotation) if part is not NoneType)
    if get_origin(annotation) is Annotated:
        kind, *metadata = get_args(annotation)
        for meta in metadata:
            if isinstance(meta, msgspec.Meta) and _DETAILS in (meta.extra or {}):
                return kind, meta
    raise TypeError(f"the type {annotation} is no option: write Annotated[…, option(…)]")


def _click_type(kind: Any, meta: msgspec.Meta) -> "click.ParamType[Any]":
    least: Any = meta.ge if meta.gt is None else meta.gt
    most: Any = meta.le
    if kind is float:
        return FiniteRange(least, most, min_open=meta.gt is not None)
    if kind is int:
        return click.IntRange(least, most, min_open=meta.gt is not None)
    if kind is Path:
        return click.Path(dir_okay=False, path_type=Path)
    if get_origin(kind) is Literal:
        return click.Choice(get_args(kind), case_sensitive=False)
    if kind is str:
        return click.STRING
    raise TypeError(
        f"an option cannot have the type {kind}: use str, bool, int, float, Path, Literal or tuple[str, ...]"
    )
