"""A sweep's definition, from its command line; what can be wrong with it is told before any worker starts."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import click

from btcore.cli import paint, trees
from btcore.cli.run import first_reading, run
from btcore.suggest import listing
from btcore.sweep import options, parameters
from btcore.sweep.definition import Definition, digests
from btcore.sweep.seeds import MOST
from btcore.xml.faults import Faults
from btcore.xml.includes import with_includes
from btcore.xml.source import read_file


def definition(
    ctx: click.Context, source: str, params: Sequence[str], seeds: tuple[int, ...], duration: float
) -> Definition:
    """The sweep that the command line of *ctx* asks for.

    Raises click.ClickException for a mistake in it, and TreeError for one in the tree.
    """
    choices = options.choices(ctx)
    varied = parameters.parsed(params, choices)
    texts = options.given(ctx)
    if "duration" not in varied:
        texts = {**texts, "duration": f"{duration:g}"}
    else:
        texts.pop("duration", None)
    twice = [key for key in varied if key in texts and not choices.options[key].multiple]
    if twice:
        raise click.UsageError(f"--{twice[0]} is given beside --param {twice[0]}=…; give one of them.")
    told = tuple(options.arguments(ctx, texts))
    path = trees.find(source)
    named = options.files(texts, [(key, value) for key, values in varied.items() for value in values])
    documents = with_includes(read_file(path), Faults())
    inputs = digests([path, *(Path(one.file) for one in documents if one.file), *named])
    found = Definition(source, told, varied, choices, seeds, inputs, _version())
    count = len(found)
    if count > MOST:
        raise click.UsageError(f"{count} episodes are more than a sweep holds, {MOST}.")
    _rehearse(found)
    return found


def _rehearse(sweep: Definition) -> None:
    """Read the options of every value once, and the tree as the first episode will."""
    first = sweep.settings[0]
    others = [{**first, key: value} for key, values in sweep.varied.items() for value in values[1:]]
    for values in [first, *others]:
        words = [sweep.tree, *sweep.arguments, *parameters.arguments(values, sweep.choices), "--fast"]
        with _naming(values), run.make_context("run", list(words)) as context:
            if values is first:
                _, reading = first_reading(context.params)
                paint.diagnostics(reading.examined.faults.warnings)


@contextmanager
def _naming(values: Mapping[str, str]) -> Iterator[None]:
    """Within it, click's mistakes are told with the parameters that they come from."""
    try:
        yield
    except click.ClickException as fault:
        if not values:
            raise
        raise click.UsageError(f"{fault.format_message()} ({setting(values)})") from fault


def setting(values: Mapping[str, str]) -> str:
    """A setting in a sentence: ``--param battery=20 and fault=laser:5-9``."""
    return "--param " + listing([f"{key}={value}" for key, value in values.items()], most=20)


def _version() -> str:
    try:
        return version("btcore")
    except PackageNotFoundError:
        return "checkout"
