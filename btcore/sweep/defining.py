"""A sweep's definition, from its command line; what can be wrong with it is told before any worker starts."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import click

from btcore.cli import terminal, trees
from btcore.cli.run import read_tree_source, run
from btcore.suggestions import join_names
from btcore.sweep import options, parameters
from btcore.sweep.definition import SweepDefinition, digests
from btcore.sweep.seeds import MAX_EPISODES
from btcore.xml.read.diagnostics import DiagnosticCollector
from btcore.xml.read.document import parse_file
from btcore.xml.read.includes import resolve_includes


def create_definition(
    ctx: click.Context, source: str, params: Sequence[str], seeds: tuple[int, ...], duration: float
) -> SweepDefinition:
    """The sweep that the command line of *ctx* asks for.

    Raises click.ClickException for a mistake in it, and TreeError for one in the tree.
    """
    choices = options.collect_run_options(ctx)
    varied = parameters.parse_parameters(params, choices)
    texts = options.given(ctx)
    if "duration" not in varied:
        texts = {**texts, "duration": f"{duration:g}"}
    else:
        texts.pop("duration", None)
    twice = [key for key in varied if key in texts and not choices.options[key].multiple]
    if twice:
        raise click.UsageError(f"--{twice[0]} is given beside --param {twice[0]}=…; give one of them.")
    told = tuple(options.option_arguments(ctx, texts))
    path = trees.find(source)
    named = options.files(texts, [(key, value) for key, values in varied.items() for value in values])
    documents = resolve_includes(parse_file(path), DiagnosticCollector())
    inputs = digests([path, *(Path(one.file) for one in documents if one.file), *named])
    found = SweepDefinition(source, told, varied, choices, seeds, inputs, _version())
    count = len(found)
    if count > MAX_EPISODES:
        raise click.UsageError(f"{count} episodes are more than a sweep holds, {MAX_EPISODES}.")
    _rehearse(found)
    return found


def _rehearse(sweep: SweepDefinition) -> None:
    """Read the options of every value once, and the tree as the first episode will."""
    first = sweep.settings[0]
    others = [{**first, key: value} for key, values in sweep.varied.items() for value in values[1:]]
    for values in [first, *others]:
        words = [sweep.tree, *sweep.arguments, *parameters.setting_arguments(values, sweep.choices), "--fast"]
        with _naming(values), run.make_context("run", list(words)) as context:
            if values is first:
                _, reading = read_tree_source(context.params)
                terminal.print_diagnostics(reading.examined.diagnostics.warnings)


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
    return "--param " + join_names([f"{key}={value}" for key, value in values.items()], most=20)


def _version() -> str:
    try:
        return version("btcore")
    except PackageNotFoundError:
        return "checkout"
