"""The options of `btcore run` that `btcore sweep` also has, and passes to all episodes."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, cast

import click

from btcore.cli.commands.run import run
from btcore.cli.provider_command import ProviderCommand, attach_providers, explain_missing_options
from btcore.errors import SettingsError
from btcore.field_options import FieldOption
from btcore.options import SweepOption
from btcore_sweep.parameters import ParameterOptions

_GIVEN: Final = "btcore_sweep.options.given"
_REFUSED: Final = {
    "seed": "use --seeds to set the seeds of a sweep",
    "fast": "a sweep always uses simulated time",
    "json": "the results of the episodes are in the sweep's table",
    "watch": "episodes cannot wait for a file to be saved",
    "set": "write bb.KEY for a blackboard entry, for example bb.laps=1..5",
}
_OWN: Final = {"duration", "format"}
"""Options of `btcore run` that a sweep defines itself, with another meaning or another default."""


class SweepCommand(click.Command):
    """A command that also has the options of `btcore run`, without those that cannot apply to many runs."""

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Return the command's options, those of `btcore run`, and `--help`."""
        own = super().get_params(ctx)
        names = {"source", *(option.name for option in own)}
        run_options = [
            option
            for key, option in collect_run_options(ctx).options.items()
            if option.name not in names and key not in _OWN
        ]
        return [*own[:-1], *sweep_options(ctx).values(), *run_options, own[-1]]

    format_options = ProviderCommand.format_options  # in sections

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse *args*, and keep the unconverted texts of the options for the command lines of the runs."""
        attach_providers(ctx, run.params, args, has_all_options=True)
        words = list(args)  # click's parser removes the arguments from its list
        with explain_missing_options(ctx):
            try:
                rest = super().parse_args(ctx, args)
            except click.NoSuchOption as error:
                reason = collect_run_options(ctx).refused.get(error.option_name.lstrip("-"))
                if reason is None:
                    raise
                raise click.UsageError(
                    f"a sweep has no option '{error.option_name}': {reason}.", ctx
                ) from error
        ctx.meta[_GIVEN] = self.make_parser(ctx).parse_args(words)[0]
        return rest


def collect_run_options(ctx: click.Context) -> ParameterOptions:
    """Return the options of `btcore run` that a sweep accepts, and the reasons why it rejects others."""
    options = {_key(item): item for item in run.get_params(ctx) if isinstance(item, click.Option)}
    refused = dict(_REFUSED)
    for key, option in options.items():
        if isinstance(option, FieldOption) and option.one_run_only:
            refused[key] = "it applies to a single run; replay a single episode with it"
    accepted = {key: option for key, option in options.items() if key not in {*refused, "help"}}
    return ParameterOptions(accepted, refused)


def given(ctx: click.Context) -> dict[str, Any]:
    """Return the unconverted texts of the run options on a sweep's command line, by name without dashes."""
    own = {option.name for option in ctx.command.params} - {"duration"}
    texts = {name: text for name, text in ctx.meta[_GIVEN].items() if name not in own}
    return {key: texts[item.name] for key, item in _options_with_set(ctx).items() if item.name in texts}


def varied_by_sweep_options(ctx: click.Context) -> dict[str, tuple[str, ...]]:
    """Return the values of the parameters that sweep options such as `--worlds` vary, by KEY."""
    values = {key: ctx.params[str(option.name)] for key, option in sweep_options(ctx).items()}
    return {key: tuple(texts) for key, texts in values.items() if texts is not None}


def sweep_options(ctx: click.Context) -> dict[str, click.Option]:
    """Return the sweep options of settings, by the KEY of the parameter that they vary."""
    settings = (item for item in collect_run_options(ctx).options.values() if isinstance(item, FieldOption))
    return {_key(item): _create_option(item.sweep_option) for item in settings if item.sweep_option}


def _create_option(declared: SweepOption) -> click.Option:
    def parse(ctx: click.Context, option: click.Parameter, text: str | None) -> Sequence[str] | None:
        try:
            return None if text is None else declared.parse(text)
        except SettingsError as error:
            raise click.UsageError(str(error)) from None

    return click.Option([f"--{declared.name}"], metavar=declared.metavar, help=declared.help, callback=parse)


def option_arguments(ctx: click.Context, texts: dict[str, Any]) -> list[str]:
    """Return options as arguments of `btcore run`.

    Args:
        ctx: The context of `btcore sweep`.
        texts: The options, as returned by `given`.
    """
    options = _options_with_set(ctx)
    words: list[str] = []
    for key, text in texts.items():
        option = cast(click.Option, options[key])
        if option.is_flag:
            words.append(option.opts[0])
        else:
            for value in _values(text):
                words += [option.opts[0], str(value)]
    return words


def named_files(values: Sequence[Any]) -> set[Path]:
    """Return those of *values*, of options and parameters, that are names of existing files."""
    names = [name for value in values for name in _values(value) if isinstance(name, str) and name]
    return {Path(name) for name in names if Path(name).is_file()}


def _options_with_set(ctx: click.Context) -> dict[str, click.Parameter]:
    """Return the options of `btcore run` by name without dashes, including `--set`.

    A sweep accepts `--set` for all runs, but rejects it as a parameter.
    """
    set_option = next(option for option in run.params if option.name == "set")
    return {**collect_run_options(ctx).options, "set": set_option}


def _values(text: Any) -> Sequence[Any]:
    """Return the values of an option as a sequence, which has several elements if the option was repeated."""
    return text if isinstance(text, (list, tuple)) else [text]


def _key(option: click.Option) -> str:
    return option.opts[0].lstrip("-")
