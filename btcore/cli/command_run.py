"""The runs of commands with the options of providers, and the settings in these options."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Unpack

import click
from click.core import ParameterSource

from btcore.cli import terminal
from btcore.cli.provider_command import command_providers
from btcore.errors import SettingsError
from btcore.field_options import FieldOption, create_options
from btcore.loading.load import LoadArguments
from btcore.options import from_values, required_option_names
from btcore.runs.run import Run, TreelessProgram
from btcore.runs.settings import GivenSettings, Settings
from btcore.suggestions import join_names
from btcore.xml.plan.plan import Plans


def given_settings(ctx: click.Context, defaults: Mapping[str, Any] | None = None) -> GivenSettings:
    """Return the settings of which an option was given, or has a value in *defaults*.

    Settings that lack a required option are left out, with a warning.

    Args:
        ctx: The context of a command of class `ProviderCommand`.
        defaults: Values of options that were not given, by the names of their parameters.

    Raises:
        click.UsageError: The settings of a class cannot be used together.
    """
    defaults = defaults or {}
    options = _given_options(ctx)
    values = {**defaults, **{option.name: ctx.params[option.name] for option in options}}
    if defaults:
        providers = command_providers(ctx).available.all()
        structs = [struct for provider in providers for struct in provider.settings]
        options += [item for struct in structs for item in create_options(struct) if item.name in defaults]
    given = GivenSettings()
    for struct in dict.fromkeys(option.struct for option in options):
        try:
            settings = from_values(struct, values)
        except SettingsError as error:
            raise click.UsageError(str(error)) from error
        if isinstance(settings, Settings):
            given[type(settings)] = settings
        else:
            needed = join_names(required_option_names(struct))
            names = join_names([option.opts[0] for option in options if option.struct is struct])
            terminal.print_warning(f"{names}: no effect without {needed}")
    return given


def _given_options(ctx: click.Context) -> list[FieldOption]:
    """Return the options of settings that were given."""
    not_given = (None, ParameterSource.DEFAULT)
    return [
        option
        for option in ctx.command.get_params(ctx)
        if isinstance(option, FieldOption)
        and issubclass(option.struct, Settings)
        and ctx.get_parameter_source(option.name) not in not_given
    ]


class CommandRun(Run):
    """A run of a command of class `ProviderCommand`.

    Options that no provider uses are printed, and what the providers raise when they are closed.

    Args:
        ctx: The context of the command.
        source: The tree or the program.
        prepare: As in `Run`.
        settings: The settings of the command line; by default `given_settings` of the context.
        provided: As in `Run`.
        used: Classes of settings that the command uses itself.
        arguments: As in `Run`.
    """

    def __init__(
        self,
        ctx: click.Context,
        source: Plans | TreelessProgram,
        prepare: Callable[[Any], None] | None = None,
        *,
        settings: GivenSettings | None = None,
        provided: Sequence[object] = (),
        used: Iterable[type[Settings]] = (),
        **arguments: Unpack[LoadArguments],
    ) -> None:
        super().__init__(
            source,
            settings=given_settings(ctx) if settings is None else settings,
            provided=provided,
            providers=command_providers(ctx).available,
            prepare=prepare,
            **arguments,
        )
        self.report.print_warning = terminal.print_warning
        self._ctx = ctx
        self._used = frozenset(used)

    def warn_unused(self, unused: type[Settings], reason: str) -> None:
        """Print a warning for the given options of *unused*, unless the command uses them itself."""
        if unused in self._used:
            return
        names = [option.opts[0] for option in _given_options(self._ctx) if option.struct is unused]
        have = "has" if len(names) == 1 else "have"
        terminal.print_warning(f"{join_names(names)} {have} no effect: {reason}")

    def handle_closing_errors(self, error: BaseException | None) -> None:
        """Print the errors, which also determine the exit code."""
        for closing_error in self.closing_errors:
            terminal.print_error(str(closing_error))
