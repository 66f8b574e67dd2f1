"""The options of providers: which commands have them, and how they become settings."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Final

import click
from click.core import ParameterSource

from btcore import entry_points
from btcore.cli import terminal
from btcore.field_options import FieldOption, create_options
from btcore.registry.registry import Plugin, import_plugin
from btcore.runs.available_providers import AvailableProviders, providers_in
from btcore.runs.providers import Provider, ProviderError
from btcore.runs.settings import (
    Options,
    RunSettings,
    Settings,
    SettingsError,
    from_values,
    required_option_names,
)
from btcore.suggestions import join_names

_META_KEY: Final = "btcore.cli.provider_options"


class CommandProviders:
    """The providers that a command can use.

    Args:
        plugins: The values of the option `--plugin`.
        has_all_options: Whether the command has the options of all providers, or of those in plugins and in
            the core alone.

    Attributes:
        available: The providers.
        plugins: The imported plugins, by the values of the option.
    """

    def __init__(self, plugins: Sequence[str] = (), has_all_options: bool = True) -> None:
        self.plugins: dict[str, Plugin] = {name: import_plugin(name) for name in plugins}
        self.available = AvailableProviders(
            provider for plugin in self.plugins.values() for provider in providers_in(plugin.module)
        )
        self.has_all_options = has_all_options
        self._options: dict[bool, list[FieldOption]] = {}

    def options(self, own: Sequence[click.Parameter]) -> list[FieldOption]:
        """Return the options of the providers' settings, without settings that *own* options belong to.

        Raises:
            ProviderError: Two providers have an option of the same name.
        """
        if self.has_all_options not in self._options:  # click asks several times
            self._options[self.has_all_options] = self._make_options(own)
        return self._options[self.has_all_options]

    def _make_options(self, own: Sequence[click.Parameter]) -> list[FieldOption]:
        kinds = {option.options for option in own if isinstance(option, FieldOption)} | {RunSettings}
        taken = {name: "the command" for option in own for name in (*option.opts, option.name or "")}
        options: list[FieldOption] = []
        some = [*self.available.of_user, *self.available.core]
        for provider in self.available.all() if self.has_all_options else some:
            for kind in [kind for kind in provider.settings if kind not in kinds]:
                kinds.add(kind)
                options += _without_clash(provider, kind, taken)
        return options


def _without_clash(provider: Provider, kind: type[Settings], taken: dict[str, str]) -> list[FieldOption]:
    options = create_options(kind)
    for option in options:
        for name in (option.opts[0], option.name or ""):
            if name in taken:
                raise ProviderError(
                    f"{option.opts[0]} is an option of {provider} and of {taken[name]}: rename one"
                )
            taken[name] = repr(provider)
    return options


def find_providers(ctx: click.Context, args: Sequence[str], has_all_options: bool) -> CommandProviders:
    """Find the providers for the command with the context *ctx*, also in its plugins.

    Args:
        ctx: The context.
        args: The arguments of the command, which may contain the option `--plugin`.
        has_all_options: As in `CommandProviders`.
    """
    found = ctx.meta[_META_KEY] = CommandProviders(list(_plugins_in(args)), has_all_options)
    return found


def command_providers(ctx: click.Context) -> CommandProviders:
    """Return the providers for the command with the context *ctx*."""
    if _META_KEY not in ctx.meta:
        ctx.meta[_META_KEY] = CommandProviders()
    found: CommandProviders = ctx.meta[_META_KEY]
    return found


class ProviderCommand(click.Command):
    """A command that also has the options of all providers.

    Importing the providers takes time. Therefore the command has the options of installed providers only if
    its arguments contain a word like an option that is not its own, such as `--monitor` or `--help`, or if a
    plugin has options.
    """

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Return the command's options, those of providers, and `--help`."""
        own = super().get_params(ctx)  # the last is --help
        return [*own[:-1], *command_providers(ctx).options(own), own[-1]]

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse *args*; for an unknown option explain which packages may add it.

        Args:
            ctx: The context of the command.
            args: The arguments.

        Returns:
            The arguments that remain.
        """
        has_plugins = any(parameter.name == "plugins" for parameter in self.params)
        providers = find_providers(ctx, args if has_plugins else (), has_all_options=False)
        options = [*self.params, *providers.options(self.params)]
        known = {name for option in options for name in (*option.opts, *option.secondary_opts)}
        # Without `-`, which is standard input or output.
        words = {word.partition("=")[0] for word in args if word.startswith("-") and word != "-"}
        # An option of a plugin could have the name of any other option, which is an error in every run.
        has_own = any(provider.settings for provider in providers.available.of_user)
        providers.has_all_options = ctx.resilient_parsing or has_own or not words <= known
        with explain_missing_options(ctx):
            return super().parse_args(ctx, args)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options; those of providers in plugins in a section for each file.

        Args:
            ctx: The context of the command.
            formatter: The formatter, to which the help is written.
        """
        sections: dict[str, list[tuple[str, str]]] = {}
        users: dict[type[Options], Provider] = {
            kind: provider
            for provider in command_providers(ctx).available.of_user
            for kind in provider.settings
        }
        for option in self.get_params(ctx):
            record = option.get_help_record(ctx)
            if record is not None and not isinstance(option, click.Argument):
                provider = users.get(option.options) if isinstance(option, FieldOption) else None
                file = "" if provider is None else provider.place.rpartition(":")[0].rpartition("/")[2]
                sections.setdefault(f"Options of {file}" if file else "Options", []).append(record)
        for title, records in sections.items():
            with formatter.section(title):
                formatter.write_dl(records)


def _plugins_in(args: Sequence[str]) -> Iterator[str]:
    """Yield the values of the option `--plugin` in *args*, once each."""
    seen: set[str] = set()
    for word, following in zip(args, [*args, ""][1:], strict=True):
        if word == "--":
            return
        value = following if word == "--plugin" else word.removeprefix("--plugin=")
        if value and (word == "--plugin" or value != word) and value not in seen:
            seen.add(value)
            yield value


def given_options(ctx: click.Context) -> list[FieldOption]:
    """Return the options of settings that were given to the command with the context *ctx*."""
    not_given = (None, ParameterSource.DEFAULT)
    return [
        option
        for option in ctx.command.get_params(ctx)
        if isinstance(option, FieldOption)
        and issubclass(option.options, Settings)
        and ctx.get_parameter_source(option.name or "") not in not_given
    ]


def settings_of(ctx: click.Context, defaults: Mapping[str, Any] | None = None) -> list[Settings]:
    """Return the settings whose options were given to the command with the context *ctx*.

    Settings that lack a required option are left out, with a warning.

    Args:
        ctx: The context.
        defaults: Values of options that were not given, by the names of their parameters, as in click's
            `default_map`.

    Raises:
        click.UsageError: Settings contradict each other.
    """
    given = given_options(ctx)
    values = {option.name or "": ctx.params[option.name or ""] for option in given}
    if defaults:
        every = (kind for provider in command_providers(ctx).available.all() for kind in provider.settings)
        given += [item for kind in every for item in create_options(kind) if item.name in defaults]
        values = {**defaults, **values}
    found: list[Settings] = []
    for kind in dict.fromkeys(option.options for option in given):
        try:
            settings = from_values(kind, values)
        except SettingsError as error:
            raise click.UsageError(str(error)) from error
        if isinstance(settings, Settings):
            found.append(settings)
        else:
            needed = join_names(required_option_names(kind))
            names = join_names([option.opts[0] for option in given if option.options is kind])
            terminal.print_warning(f"{names}: no effect without {needed}")
    return found


@contextmanager
def explain_missing_options(ctx: click.Context) -> Iterator[None]:
    """Return a context that explains that an unknown option may come from a package that is not installed."""
    try:
        yield
    except click.NoSuchOption as error:
        unavailable = command_providers(ctx).available.unavailable
        if not unavailable:
            raise
        text = error.format_message().rstrip(".")
        packages = "; ".join(
            f"{names}: {remedy}" for remedy, names in entry_points.names_by_remedy(unavailable).items()
        )
        raise click.UsageError(
            f"{text}. The option may belong to a provider that cannot be loaded: {packages}", ctx
        ) from error
