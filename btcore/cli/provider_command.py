"""Commands with the options of providers, also of those in plugins, and their runs with these settings."""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Final, NamedTuple, TypeGuard

import click
from click.core import ParameterSource

from btcore import entry_points
from btcore.cli import terminal
from btcore.clock import Clock
from btcore.errors import BtcoreError, ProviderError, SettingsError
from btcore.field_options import FieldOption, create_options
from btcore.options import Options, from_values, required_option_names
from btcore.registry.registry import Plugin, import_plugin
from btcore.runs.available_providers import AvailableProviders, providers_in
from btcore.runs.providers import Provider
from btcore.runs.report import RunPrinter
from btcore.runs.run import Run, TreelessProgram
from btcore.runs.settings import GivenSettings, RunSettings, Settings
from btcore.suggestions import join_names
from btcore.xml.plan.plan import Plans

_META_KEY: Final = "btcore.cli.provider_command"
_PLUGINS: Final = "plugins"  # the name of the parameter of --plugin


class CommandProviders(NamedTuple):
    """The providers that a command can use.

    Attributes:
        available: The providers.
        options: The options of their settings.
        plugins: The imported plugins, by the values of the option `--plugin`.
    """

    available: AvailableProviders
    options: Sequence[FieldOption]
    plugins: Mapping[str, Plugin]


def attach_providers(
    ctx: click.Context,
    command_options: Sequence[click.Parameter],
    args: Sequence[str],
    has_all_options: bool = False,
) -> CommandProviders:
    """Find the providers for a command, also in its plugins, and attach them to the context *ctx*.

    Args:
        ctx: The context of the command, for `command_providers`.
        command_options: The options that the command has without providers.
        args: The arguments of the command, which may contain the option `--plugin`.
        has_all_options: Whether to add the options of all providers in any case.
    """
    texts, _ = _parse_known_options(command_options, args)
    plugins = {name: import_plugin(name) for name in dict.fromkeys(texts.get(_PLUGINS, ()))}
    available = AvailableProviders(
        provider for plugin in plugins.values() for provider in providers_in(plugin.module)
    )
    options = _create_options(command_options, available.known)
    if has_all_options or _may_need_all_options(ctx, args, available, [*command_options, *options]):
        options = _create_options(command_options, available.all())
    providers = ctx.meta[_META_KEY] = CommandProviders(available, options, plugins)
    return providers


def _may_need_all_options(
    ctx: click.Context,
    args: Sequence[str],
    available: AvailableProviders,
    known_options: Sequence[click.Parameter],
) -> bool:
    """Return whether to import all installed providers, which takes time, for their options.

    They may be needed if:

    - *args* contain an option that is none of *known_options*: it may be an option of a provider, such as
      `--monitor`, or `--help`, which lists all options;
    - a provider of a plugin has options: two providers may define options of the same name, which is an
      error even if neither of them is used;
    - the program has set defaults for options, also for those of providers;
    - a shell completes the command line.
    """
    has_settings = any(provider.settings_classes for provider in available.of_user)
    if ctx.resilient_parsing or ctx.default_map or has_settings:
        return True
    _, other_words = _parse_known_options(known_options, args)
    return any(word.startswith("-") and word != "-" for word in other_words)  # `-` is standard input


def _parse_known_options(
    options: Sequence[click.Parameter], args: Sequence[str]
) -> tuple[Mapping[str, Any], Sequence[str]]:
    """Return the values of the *options* in *args* by parameter, and the remaining words.

    Unknown options are no error, because the options of providers do not exist yet.
    """
    known: list[click.Parameter] = [option for option in options if isinstance(option, click.Option)]
    command = click.Command(name=None, params=known, add_help_option=False)
    ctx = click.Context(command, ignore_unknown_options=True, resilient_parsing=True)
    return command.make_parser(ctx).parse_args(list(args))[:2]


def command_providers(ctx: click.Context) -> CommandProviders:
    """Return the providers that are attached to the context of a command."""
    if _META_KEY not in ctx.meta:  # nothing was parsed
        return attach_providers(ctx, ctx.command.params, (), has_all_options=True)
    providers: CommandProviders = ctx.meta[_META_KEY]
    return providers


def _create_options(
    command_options: Sequence[click.Parameter], providers: Sequence[Provider]
) -> list[FieldOption]:
    """Return the options of the providers' settings, except for settings of which the command has options."""
    names = (name for option in command_options for name in (*option.opts, option.name or ""))
    owner_by_name = dict.fromkeys(["--help", *names], "the command")
    known = {option.options_class for option in command_options if isinstance(option, FieldOption)}
    known.add(RunSettings)
    created = []
    for provider in providers:
        new = [cls for cls in provider.settings_classes if cls not in known]
        known.update(new)
        for option in itertools.chain(*map(create_options, new)):
            for name in (option.opts[0], option.name):
                if owner := owner_by_name.get(name):
                    raise ProviderError(
                        f"{option.opts[0]} is an option of {provider} and of {owner}: rename one"
                    )
                owner_by_name[name] = repr(provider)
            created.append(option)
    return created


def given_setting_options(ctx: click.Context) -> list[FieldOption]:
    """Return the options of settings that were given to a command of class `ProviderCommand`."""
    not_given = (None, ParameterSource.DEFAULT)
    return [
        option
        for option in ctx.command.get_params(ctx)
        if _is_of_settings(option) and ctx.get_parameter_source(option.name) not in not_given
    ]


def given_settings(ctx: click.Context) -> GivenSettings:
    """Return the settings of which an option was given to a command of class `ProviderCommand`.

    Settings that lack a required option are left out, with a warning.

    Raises:
        click.UsageError: The settings of a class cannot be used together.
    """
    options = given_setting_options(ctx)
    given: list[Settings] = []
    for settings_class in dict.fromkeys(option.options_class for option in options):
        try:
            settings = from_values(settings_class, ctx.params)
        except SettingsError as error:
            raise click.UsageError(str(error)) from error
        if isinstance(settings, Settings):
            given.append(settings)
        else:
            needed = join_names(required_option_names(settings_class))
            names = [option.opts[0] for option in options if option.options_class is settings_class]
            terminal.print_warning(f"{join_names(names)}: no effect without {needed}")
    return GivenSettings(given)


def _is_of_settings(option: click.Parameter) -> TypeGuard[FieldOption]:
    return isinstance(option, FieldOption) and issubclass(option.options_class, Settings)


class ProviderCommand(click.Command):
    """A command that also has the options of providers.

    Its function gets the parameter *settings*, the `GivenSettings`, in place of the options of `Settings`.
    """

    def invoke(self, ctx: click.Context) -> Any:
        """Call the function of the command, and return its result."""
        assert self.callback is not None, "a command has a function"
        values = {
            option.name: ctx.params[option.name]
            for option in self.params
            if option.name in ctx.params and not _is_of_settings(option)
        }
        return ctx.invoke(self.callback, settings=given_settings(ctx), **values)

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Return the command's options, those of providers, and `--help`."""
        own = super().get_params(ctx)  # the last is --help
        return [*own[:-1], *command_providers(ctx).options, own[-1]]

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse *args*; for an unknown option explain which packages may add it.

        Args:
            ctx: The context of the command.
            args: The arguments.

        Returns:
            The arguments that remain.
        """
        attach_providers(ctx, self.params, args)
        with explain_missing_options(ctx):
            return super().parse_args(ctx, args)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options; those of providers in plugins in a section for each file.

        Args:
            ctx: The context of the command.
            formatter: The formatter, to which the help is written.
        """
        sections: dict[str, list[tuple[str, str]]] = {}
        file_by_settings: dict[type[Options], str] = {
            settings_class: provider.place.rpartition(":")[0].rpartition("/")[2]
            for provider in command_providers(ctx).available.of_user
            for settings_class in provider.settings_classes
        }
        for option in self.get_params(ctx):
            record = option.get_help_record(ctx)
            if record is not None and not isinstance(option, click.Argument):
                file = file_by_settings.get(option.options_class) if isinstance(option, FieldOption) else ""
                sections.setdefault(f"Options of {file}" if file else "Options", []).append(record)
        for title, records in sections.items():
            with formatter.section(title):
                formatter.write_dl(records)


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


def create_run(
    ctx: click.Context,
    source: Plans | TreelessProgram,
    settings: GivenSettings,
    prepare: Callable[[Run], None] | None = None,
    *,
    resources: Sequence[object] = (),
    clock: Clock | None = None,
    tick_limit: float | None = None,
) -> Run:
    """Return the run of a command of class `ProviderCommand`, which prints its warnings and closing errors.

    Args:
        ctx: The context of the command.
        source: The tree or the program.
        settings: The settings, which the function of the command got.
        prepare: As in `Run`.
        resources: As in `Run`.
        clock: As in `Run`.
        tick_limit: As in `Run`.
    """
    return Run(
        source,
        settings=settings,
        providers=command_providers(ctx).available,
        prepare=prepare,
        resources=resources,
        clock=clock,
        tick_limit=tick_limit,
        printer=_CommandPrinter(ctx),
    )


class _CommandPrinter(RunPrinter):
    """Prints the messages of a command's run, with the names of its options."""

    def __init__(self, ctx: click.Context) -> None:
        self._ctx = ctx

    def print_warning(self, message: str) -> None:
        terminal.print_warning(message)

    def print_errors(self, errors: Sequence[BtcoreError]) -> bool:
        for error in errors:
            terminal.print_error(str(error))
        return True

    def print_unused(self, settings_class: type[Settings], reason: str) -> None:
        own = [option.options_class for option in self._ctx.command.params if isinstance(option, FieldOption)]
        if settings_class in own:
            return  # the command may use its own options
        given = [item for item in given_setting_options(self._ctx) if item.options_class is settings_class]
        names = join_names([option.opts[0] for option in given])
        terminal.print_warning(f"{names} {'has' if len(given) == 1 else 'have'} no effect: {reason}")
