"""Options of commands that are made from the fields of `btcore.options.Options`."""

import functools
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args, get_origin

import click
import msgspec
from msgspec.structs import FieldInfo

from btcore import entry_points
from btcore.errors import BtcoreError
from btcore.options import Options, describe_field, from_values, option_name

# For users; packages of btcore also import `FieldOption` and `create_options`.
__all__ = ["FiniteRange", "add_options", "pass_options"]

Function = TypeVar("Function", bound=Callable[..., Any])


class FiniteRange(click.FloatRange):
    """A range of finite numbers: infinity and NaN are errors."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Convert *value* to a finite number in the range. Any other value is a usage error.

        Args:
            value: The text of the option.
            param: The option.
            ctx: The context of the command, for the error.

        Returns:
            The number.
        """
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


class FieldOption(click.Option):
    """The option of a field of *options_class*, and how a sweep treats it."""

    name: str  # click permits None

    def __init__(self, options_class: type[Options], field: FieldInfo) -> None:
        field_type, meta, details = describe_field(field)
        self.options_class = options_class
        self.sweep_option = details.sweep_option
        self.one_run_only = details.one_run_only
        default = None if field.default is msgspec.NODEFAULT else field.default
        arguments: dict[str, Any] = {"help": meta.description, "metavar": details.metavar}
        if details.bare_value is not None:
            arguments |= {"is_flag": False, "flag_value": details.bare_value}
        if field_type is bool:
            arguments |= {"is_flag": True, "default": bool(default)}
        else:
            if get_origin(field_type) is tuple:
                field_type = get_args(field_type)[0]
                arguments["multiple"] = True
            elif default is not None:
                arguments |= {"default": default, "show_default": True}
            arguments["type"] = _click_type(field_type, meta, details.may_be_folder)
        super().__init__([option_name(field), field.name], shell_complete=details.complete, **arguments)

    def get_help_extra(self, ctx: click.Context) -> Any:
        """Return what the help shows in brackets, without the range of a number that has no limits."""
        extra = super().get_help_extra(ctx)
        if getattr(self.type, "min", None) is None and getattr(self.type, "max", None) is None:
            extra.pop("range", None)
        return extra


def create_options(options_class: type[Options], *names: str) -> list[FieldOption]:
    """Return the options of the fields *names* of a class, or of all fields, in the order of the fields."""
    created = []
    for field in msgspec.structs.fields(options_class):
        if not names or field.name in names:
            try:
                created.append(FieldOption(options_class, field))
            except TypeError as error:
                raise BtcoreError(f"the field '{field.name}' of {options_class.__name__}: {error}") from error
    return created


def add_options(options_class: type[Options], *names: str) -> Callable[[Function], Function]:
    """Return a decorator that adds the options of a class to a command.

    The command's function gets a parameter for each option. Options of `Settings` are an exception: a
    `ProviderCommand` passes them, together with those of its providers, as the parameter *settings*.

    Args:
        options_class: The class of the options.
        names: The fields whose options are added; by default all.
    """

    def decorate(function: Function) -> Function:
        params = function.__dict__.setdefault("__click_params__", [])
        params.extend(reversed(create_options(options_class, *names)))
        return function

    return decorate


def pass_options(options_class: type[Options], parameter: str) -> Callable[[Function], Function]:
    """Return a decorator that adds the options of a class to a command, which gets them as *parameter*.

    Args:
        options_class: The class of the options.
        parameter: The name of the parameter of the command's function.
    """

    def decorate(function: Function) -> Function:
        @functools.wraps(function)
        def with_options(*arguments: Any, **values: Any) -> Any:
            own = {field.name: values.pop(field.name) for field in msgspec.structs.fields(options_class)}
            return function(*arguments, **{parameter: from_values(options_class, own)}, **values)

        return add_options(options_class)(with_options)  # type: ignore[return-value]

    return decorate


class ExtensibleCommand(click.Command):
    """A command that also has the options of an extension, which another package offers.

    Args:
        group: The group of the entry point, which names a class of `Options` with the extension's methods.
    """

    def __init__(self, *arguments: Any, group: str, **attributes: Any) -> None:
        super().__init__(*arguments, **attributes)
        self._group = group

    @functools.cached_property
    def extension_class(self) -> type[Options] | None:
        """The class of the first extension that can be loaded, or None."""
        loaded, _ = entry_points.load(self._group)
        return loaded[0].value if loaded else None

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Return the command's options, those of the extension, and `--help`."""
        own = super().get_params(ctx)  # the last is --help
        extension = self.extension_class
        return own if extension is None else [*own[:-1], *create_options(extension), own[-1]]

    def create_extension(self, values: Mapping[str, Any]) -> Any:
        """Return the extension with *values*, those of its options; None if there is no extension."""
        return None if self.extension_class is None else from_values(self.extension_class, values)


def _click_type(field_type: Any, meta: msgspec.Meta, may_be_folder: bool) -> "click.ParamType[Any]":
    least: Any = meta.ge if meta.gt is None else meta.gt
    most: Any = meta.le
    if field_type is float:
        return FiniteRange(least, most, min_open=meta.gt is not None)
    if field_type is int:
        return click.IntRange(least, most, min_open=meta.gt is not None)
    if field_type is Path:
        return click.Path(dir_okay=may_be_folder, path_type=Path)
    if get_origin(field_type) is Literal:
        return click.Choice(get_args(field_type), case_sensitive=False)
    if field_type is str:
        return click.STRING
    raise TypeError(
        f"an option cannot have the type {field_type}: "
        "use str, bool, int, float, Path, Literal or tuple[str, ...]"
    )
