"""What a sweep is: a tree, what is told to every run of it, the settings and the seeds."""

import hashlib
import shlex
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final

import click

from btcore.cli import terminal, trees
from btcore.cli.run import read_tree_source, run
from btcore.suggestions import join_names
from btcore.sweep import options, parameters
from btcore.sweep.seeds import MAX_EPISODES, format_seeds
from btcore.xml.read.diagnostics import DiagnosticCollector
from btcore.xml.read.document import parse_file
from btcore.xml.read.includes import resolve_includes

FORM: Final = 1
"""Of the description that a sweep's folder keeps."""


@dataclass(frozen=True, slots=True)
class Episode:
    """One run of a sweep: its *number* from 0, *seed*, the parameters' *values*, and all of the *command*."""

    number: int
    seed: int
    values: Mapping[str, str]
    command: tuple[str, ...]

    @property
    def replay(self) -> str:
        """The command line that makes the same run again."""
        return shlex.join(("btcore", "run", *self.command))


@dataclass(frozen=True)
class SweepDefinition:
    """A sweep of *tree*, as the user named it.

    *arguments* are told to every run, *varied* are the values of each parameter, *choices* says how they are
    told. *inputs* are digests of the files that a run reads, by name, and *version* is btcore's.
    """

    tree: str
    arguments: tuple[str, ...]
    varied: Mapping[str, tuple[str, ...]]
    choices: parameters.RunOptions
    seeds: tuple[int, ...]
    inputs: Mapping[str, str]
    version: str

    @cached_property
    def settings(self) -> list[dict[str, str]]:
        """Every combination of the parameters' values."""
        return list(parameters.settings(self.varied))

    def __len__(self) -> int:
        return len(self.seeds) * len(self.settings)

    def episode(self, number: int) -> Episode:
        """The episode of that *number*: all settings of the first seed, then all of the next."""
        turn, place = divmod(number, len(self.settings))
        seed, values = self.seeds[turn], self.settings[place]
        told = parameters.setting_arguments(values, self.choices)
        command = (self.tree, *self.arguments, *told, "--fast", "--seed", str(seed))
        return Episode(number, seed, values, command)

    def __iter__(self) -> Iterator[Episode]:
        return (self.episode(number) for number in range(len(self)))

    @cached_property
    def described(self) -> dict[str, Any]:
        """All that its results depend on, for JSON."""
        return {
            "form": FORM,
            "tree": self.tree,
            "arguments": list(self.arguments),
            "params": {key: list(values) for key, values in self.varied.items()},
            "seeds": format_seeds(self.seeds),
            "inputs": dict(self.inputs),
            "version": self.version,
        }


def difference(before: Mapping[str, Any], now: Mapping[str, Any]) -> str | None:
    """In what the sweep described as *before* is another than *now*, as part of a sentence; or None."""
    words = {
        "form": "it was written by another version of btcore",
        "tree": "its tree",
        "arguments": "its options",
        "params": "its parameters",
        "seeds": "its seeds",
        "version": "its version of btcore",
    }
    for key, word in words.items():
        if before.get(key) != now[key]:
            if key == "form":
                return word
            return f"{word}: {_said(before.get(key))} there, {_said(now[key])} now"
    there, here = before.get("inputs", {}), now["inputs"]
    changed = sorted(name for name in {*there, *here} if there.get(name) != here.get(name))
    return f"the file {changed[0]}, which has changed since" if changed else None


def digests(files: Sequence[Path]) -> dict[str, str]:
    """A digest of each of *files* that can be read, by its name."""
    found = {}
    for path in sorted(set(files)):
        if path.is_file():
            found[str(path)] = hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    return found


def _said(value: object) -> str:
    if isinstance(value, list):
        return shlex.join(value) or "none"
    if isinstance(value, dict):
        return " ".join(f"{key}={','.join(values)}" for key, values in value.items()) or "none"
    return str(value)


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
