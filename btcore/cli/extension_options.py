"""The options of extensions: when `btcore run` and programs load, parse and report them."""

import random
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Final

import click
from click.core import ParameterSource

from btcore import entry_points
from btcore.cli import terminal
from btcore.cli.extension import LoadedExtensions, load_extensions
from btcore.run_extension import RunExtension
from btcore.suggestions import join_names
from btcore.xml.models.stubs import StubResults

_DEFERRED: Final = "btcore.cli.extension_options.deferred"
"""The key in the context's `meta`: whether the command has no options of extensions so far."""


class RunCommand(click.Command):
    """A command that also has the options of all extensions of `btcore run`."""

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Return the command's options, those of the extensions unless they are deferred, and `--help`."""
        own = super().get_params(ctx)  # the last is --help
        if ctx.meta.get(_DEFERRED):
            return own
        extensions = load_extensions(ctx).extensions
        added = [option for extension in extensions for option in extension.options]
        return [*own[:-1], *added, own[-1]]

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse *args*; for an unknown option explain which packages may add it.

        Args:
            ctx: The context of the command.
            args: The arguments.

        Returns:
            The arguments that remain.
        """
        words = list(args)  # click's parser removes the arguments from its list
        if ctx.meta.get(_DEFERRED):
            try:
                return super().parse_args(ctx, args)
            except click.NoSuchOption:
                ctx.meta[_DEFERRED] = False
        with explain_missing_options(ctx):
            return super().parse_args(ctx, words)


class DeferringRunCommand(RunCommand):
    """`btcore run`, which defers the extensions until they are needed, because importing them takes time.

    For `btcore run tree.xml --monitor`, click calls `parse_args`, which sets the key `_DEFERRED`. The first
    parse in `RunCommand.parse_args` fails at `--monitor`, because `get_params` omits options of extensions.
    The second parse has them: `get_params` calls `load_extensions`. Without `--monitor` the first parse
    succeeds, and `create_session` calls `load_needed_extensions` for the resources of the leaves.

    Nothing is deferred if extensions of other distributions are installed, which may take part in each run,
    nor for `--help` and shell completion, which show the options of all extensions.
    """

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse *args*, first without the options of extensions if possible: see the class."""
        others = entry_points.find(entry_points.RUN_EXTENSIONS_GROUP, own=False)
        ctx.meta[_DEFERRED] = not ctx.resilient_parsing and not others
        return super().parse_args(ctx, args)

    def format_help(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the help with the options of all extensions."""
        ctx.meta[_DEFERRED] = False
        super().format_help(ctx, formatter)


def load_needed_extensions(
    ctx: click.Context, settings: Mapping[str, Any], wanted: Sequence[type]
) -> tuple[LoadedExtensions, Mapping[str, Any]]:
    """Return the extensions of a run, and *settings* with the values of their options.

    There are no extensions if they are deferred and no leaf needs a resource of an extension.
    """
    if not ctx.meta.get(_DEFERRED):
        return load_extensions(ctx), settings
    if all(kind in (random.Random, StubResults) for kind in wanted):  # `create_session` adds these itself
        return LoadedExtensions([], []), settings
    loaded = load_extensions(ctx)
    added: list[click.Parameter] = [option for item in loaded.extensions for option in item.options]
    # No option of an extension was given: the options have the values of an empty command line.
    defaults = click.Command("run", params=added).make_context("run", [], parent=ctx).params
    return loaded, {**defaults, **settings}


@contextmanager
def explain_missing_options(ctx: click.Context) -> Iterator[None]:
    """Return a context that explains that an unknown option may come from a package that is not installed."""
    try:
        yield
    except click.NoSuchOption as error:
        unavailable = load_extensions(ctx).unavailable
        if not unavailable:
            raise
        text = error.format_message().rstrip(".")
        packages = "; ".join(
            f"{names}: {remedy}" for remedy, names in entry_points.names_by_remedy(unavailable).items()
        )
        raise click.UsageError(
            f"{text}. The option may belong to an extension that cannot be loaded: {packages}", ctx
        ) from error


def warn_unused_options(
    ctx: click.Context,
    without_resources: Sequence[RunExtension],
    subject: str = "the tree",
    used: Sequence[str] = (),
) -> None:
    """Print a warning for options on the command line that no leaf of the tree uses.

    Args:
        without_resources: The extensions that provided no resource.
        subject: The subject of the sentence: what has no such leaf.
        used: Options that the command itself uses.
    """
    for extension in without_resources:
        given = [
            option.opts[0]
            for option in extension.options
            if ctx.get_parameter_source(option.name or "") is ParameterSource.COMMANDLINE
            and option.opts[0] not in used
        ]
        if extension.used_by is not None and given:
            have = "has" if len(given) == 1 else "have"
            terminal.print_warning(
                f"{join_names(given)} {have} no effect: {subject} has no {extension.used_by}"
            )
