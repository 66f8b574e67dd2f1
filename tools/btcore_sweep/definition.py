"""The definition of a sweep: the tree, the options of its runs, the parameter values and the seeds."""

import hashlib
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import click

import btcore
from btcore import bundled_trees
from btcore.cli import terminal
from btcore.cli.commands.run import parse_run, run
from btcore.input_files import read_file
from btcore.suggestions import join_names
from btcore.xml.read.read import parse_file, read
from btcore_sweep import options, parameters

FORM: Final = 1
"""The version of the format of `sweep.json`, the description that a sweep's folder contains."""


@dataclass(frozen=True, slots=True)
class Episode:
    """One run of the tree in a sweep.

    Attributes:
        number: The number of the episode in the sweep, from 0.
        seed: The seed.
        values: The value of each parameter, as text.
        command: The arguments of `btcore run`.
    """

    number: int
    seed: int
    values: Mapping[str, str]
    command: tuple[str, ...]

    @property
    def replay(self) -> str:
        """The command line that repeats the run."""
        return shlex.join(("btcore", "run", *self.command))


@dataclass(frozen=True)
class SweepDefinition:
    """The definition of a sweep.

    Attributes:
        tree: The tree, as named on the command line.
        arguments: The arguments of `btcore run` that are the same in all runs.
        varied: The values of each parameter, by its KEY.
        choices: The options of `btcore run` that parameters can set.
        seeds: The seeds.
        inputs: The SHA-256 digests (16 hex digits) of the files that the runs read, by file name.
        version: The version of btcore.
    """

    tree: str
    arguments: tuple[str, ...]
    varied: Mapping[str, tuple[str, ...]]
    choices: parameters.ParameterOptions
    seeds: tuple[int, ...]
    inputs: Mapping[str, str]
    version: str

    @cached_property
    def combinations(self) -> list[dict[str, str]]:
        """All combinations of parameter values, by the KEY of the parameter."""
        return list(parameters.combinations(self.varied))

    def __len__(self) -> int:
        return len(self.seeds) * len(self.combinations)

    def episode(self, number: int) -> Episode:
        """Return the episode *number*. Episodes are numbered seed by seed, all combinations for each seed."""
        seed_index, combination_index = divmod(number, len(self.combinations))
        seed, values = self.seeds[seed_index], self.combinations[combination_index]
        varied = parameters.combination_arguments(values, self.choices)
        command = (self.tree, *self.arguments, *varied, "--fast", "--seed", str(seed))
        return Episode(number, seed, values, command)

    def __iter__(self) -> Iterator[Episode]:
        return (self.episode(number) for number in range(len(self)))

    @cached_property
    def described(self) -> dict[str, Any]:
        """Everything on which the results depend, as JSON data."""
        return {
            "form": FORM,
            "tree": self.tree,
            "arguments": list(self.arguments),
            "params": {key: list(values) for key, values in self.varied.items()},
            "seeds": parameters.format_seeds(self.seeds),
            "inputs": dict(self.inputs),
            "version": self.version,
        }


def difference(before: Mapping[str, Any], now: Mapping[str, Any]) -> str | None:
    """Return the first difference between two sweeps as a phrase for a message; None if there is none.

    Args:
        before: The description of the earlier sweep.
        now: The description of the current sweep. Both come from `SweepDefinition.described`.
    """
    if before.get("form") != now["form"]:
        return "it was written by another version of btcore"
    words = {
        "tree": "its tree",
        "arguments": "its options",
        "params": "its parameters",
        "seeds": "its seeds",
        "version": "its version of btcore",
    }
    for key, word in words.items():
        if before.get(key) != now[key]:
            return f"{word}: {_format(before.get(key))} there, {_format(now[key])} now"
    old_inputs, new_inputs = before.get("inputs", {}), now["inputs"]
    changed = sorted(
        name for name in {*old_inputs, *new_inputs} if old_inputs.get(name) != new_inputs.get(name)
    )
    return f"the file {changed[0]}, which has changed since" if changed else None


def _format(value: object) -> str:
    if isinstance(value, list):
        return shlex.join(value) or "none"
    if isinstance(value, dict):
        return " ".join(f"{key}={','.join(values)}" for key, values in value.items()) or "none"
    return str(value)


def create_definition(
    ctx: click.Context, source: str, params: Sequence[str], seeds: tuple[int, ...], duration: float
) -> SweepDefinition:
    """Check the options and the tree on the command line, and return the definition of the sweep.

    Args:
        ctx: The context of `btcore sweep`.
        source: The tree: a file or the name of a bundled tree.
        params: The parameters in the form KEY=VALUES.
        duration: The maximum duration of an episode (s of the tree's clock).

    Raises:
        click.ClickException: The command line has an error.
        TreeError: The tree has an error.
        RegistrationError: A node library cannot be loaded.
    """
    choices = options.collect_run_options(ctx)
    varied = parameters.parse_parameters(params, choices)
    for key, values in options.varied_by_sweep_options(ctx).items():
        if key in varied:
            name = "/".join(options.sweep_options(ctx)[key].opts)
            raise click.UsageError(f"{name} and --param {key}=… cannot be used together.")
        varied[key] = values
    texts = options.given(ctx)
    texts.pop("duration", None)
    if "duration" not in varied:
        texts["duration"] = f"{duration:g}"
    for key in varied:
        if key in texts and not choices.options[key].multiple:
            raise click.UsageError(f"--{key} and --param {key}=… cannot be used together.")
    arguments = tuple(options.option_arguments(ctx, texts))
    path = bundled_trees.find(source)
    documents = read(parse_file(path, confined="confined" in texts)).documents
    files = {path, *(Path(document.file) for document in documents if document.file)}
    files |= options.named_files([*texts.values(), *varied.values()])
    existing = sorted(file for file in files if file.is_file())
    inputs = {str(file): hashlib.sha256(read_file(file)).hexdigest()[:16] for file in existing}
    definition = SweepDefinition(source, arguments, varied, choices, seeds, inputs, btcore.__version__)
    if len(definition) > parameters.MAX_EPISODES:
        raise click.UsageError(f"{len(definition)} episodes exceed the limit of {parameters.MAX_EPISODES}.")
    _check(definition)
    return definition


def _check(sweep: SweepDefinition) -> None:
    """Parse the options with every parameter value once, and check the tree as in the first episode."""
    first = sweep.combinations[0]
    others = [{**first, key: value} for key, values in sweep.varied.items() for value in values[1:]]
    for values in [first, *others]:
        varied = parameters.combination_arguments(values, sweep.choices)
        words = [sweep.tree, *sweep.arguments, *varied, "--fast"]
        try:
            if values is first:
                with parse_run(words) as session:
                    terminal.print_diagnostics(session.plans.diagnostics.warnings)
            else:
                run.make_context("run", words).close()
        except click.ClickException as error:
            if not values:
                raise
            raise click.UsageError(f"{error.format_message()} ({format_combination(values)})") from error


def format_combination(values: Mapping[str, str]) -> str:
    """Return parameter values as a phrase for a message: `--param battery=20 and fault=laser:5-9`."""
    return "--param " + join_names([f"{key}={value}" for key, value in values.items()], most=20)
