"""The options of ``btcore run`` that a sweep has too, and what of them every episode is told."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, cast

import click

from btcore.cli.extension import load_extensions
from btcore.cli.run import explain_missing_options, run
from btcore.sweep.parameters import RunOptions

_GIVEN: Final = "btcore.sweep.options.given"
_REFUSED: Final = {
    "seed": "the seeds of a sweep are its --seeds",
    "fast": "a sweep always has simulated time, as fast as it goes",
    "json": "what an episode tells is in the sweep's table",
    "watch": "an episode doesn't wait for a file to be saved",
    "log": "all episodes would write to one file; replay the one that counts with --log",
    "set": "an entry of the blackboard is bb.KEY, say bb.laps=1..5",
}
_OWN: Final = {"duration", "format"}
"""Options that a sweep has under the same name, for itself or with another default."""


class SweepCommand(click.Command):
    """The command, with those options of ``btcore run``, whoever brings them, that suit many runs."""

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Its own options, then those of the runs, then ``--help``."""
        own = super().get_params(ctx)
        names = {"source", *(option.name for option in own)}
        theirs = [
            option
            for key, option in collect_run_options(ctx).options.items()
            if option.name not in names and key not in _OWN
        ]
        return [*own[:-1], *theirs, own[-1]]

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """As click does; the words that were given are kept as they are."""
        words = list(args)
        with explain_missing_options(ctx):
            rest = super().parse_args(ctx, args)
        ctx.meta[_GIVEN] = self.make_parser(ctx).parse_args(words)[0]
        return rest


def collect_run_options(ctx: click.Context) -> RunOptions:
    """Return the options of ``btcore run``, and those that a sweep refuses."""
    refused = dict(_REFUSED)
    for extension in load_extensions(ctx).extensions:
        for option in extension.options:
            if option.name in extension.single_run_options:
                refused[_key(option)] = (
                    "that is for one run at a time; replay the episode that counts with it"
                )
    options = [one for one in run.get_params(ctx) if isinstance(one, click.Option) and one.name != "help"]
    kept = {_key(one): one for one in options if _key(one) not in {*refused, "help"}}
    return RunOptions(kept, refused)


def given(ctx: click.Context) -> dict[str, Any]:
    """The options of the runs that the command line gives, by key, as the texts that it has."""
    words = ctx.meta[_GIVEN]
    own = {option.name for option in ctx.command.params} - {"duration"}
    runs = collect_run_options(ctx).options
    told = {**runs, "set": next(one for one in run.params if one.name == "entries")}
    return {key: words[one.name] for key, one in told.items() if one.name in words and one.name not in own}


def option_arguments(ctx: click.Context, texts: dict[str, Any]) -> list[str]:
    """What the options *texts*, as :func:`given` has them, are on the command line of a run."""
    runs = {
        **collect_run_options(ctx).options,
        "set": next(one for one in run.params if one.name == "entries"),
    }
    words: list[str] = []
    for key, text in texts.items():
        option = cast(click.Option, runs[key])
        if option.is_flag:
            words.append(option.opts[0])
        else:
            for one in text if isinstance(text, (list, tuple)) else [text]:
                words += [option.opts[0], str(one)]
    return words


def files(texts: dict[str, Any], values: Sequence[tuple[str, str]]) -> list[Path]:
    """The files that options given as *texts*, and parameters with their *values*, name."""
    named = [one for text in texts.values() for one in (text if isinstance(text, (list, tuple)) else [text])]
    named += [value for _, value in values]
    return [Path(one) for one in named if isinstance(one, str) and one and Path(one).is_file()]


def _key(option: click.Option) -> str:
    return option.opts[0].lstrip("-")
