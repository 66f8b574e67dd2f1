"""The options `--seeds` and `--param`, which determine how the runs of a sweep differ.

Seeds are given as `1000` (which is 0 to 999), `100..199` or `3,17,42`.

In `--param KEY=VALUES`, KEY is an option of `btcore run` without its dashes, or `bb.NAME` for a
blackboard entry, which `btcore run --set` sets. VALUES are separated by commas. A value may be a range of
numbers: `20..100:20` is 20, 40, 60, 80 and 100. A value that contains a comma is put in double quotes. With
an empty value the option is omitted.
"""

import csv
import re
from collections import Counter
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from itertools import product
from typing import Final

import click

from btcore.suggestions import did_you_mean, join_names

BLACKBOARD: Final = "bb."
MAX_EPISODES: Final = 10_000_000
"""The largest number of episodes of a sweep."""

_SEEDS: Final = re.compile(r"(\d+)(?:\.\.(\d+))?")
_SEEDS_HELP: Final = "write a number (1000 is 0..999), an inclusive range (100..199) or a list (3,17,42)"
_NUMBER: Final = r"[+-]?(?:\d+\.?\d*|\.\d+)"
_RANGE: Final = re.compile(rf"({_NUMBER})\.\.({_NUMBER})(?::({_NUMBER}))?")
_TRUE: Final = {"true", "yes", "on", "1"}
_FALSE: Final = {"false", "no", "off", "0", ""}

Values = Mapping[str, str]
"""A combination: the value of each parameter, as text, by KEY."""


@dataclass(frozen=True, slots=True)
class ParameterOptions:
    """The options of `btcore run` by name without dashes, and the reasons why a sweep rejects others."""

    options: Mapping[str, click.Option]
    refused: Mapping[str, str]


def parse_seeds(text: str) -> tuple[int, ...]:
    """Return the seeds in *text*, in the order of the text.

    A single number N means the N seeds from 0. In a list, each part is a seed or a range of seeds.

    Raises:
        click.UsageError: *text* is invalid, lists a seed twice, or contains more than `MAX_EPISODES` seeds.
    """
    parts = [part.strip() for part in text.split(",")]
    if len(parts) == 1 and re.fullmatch(r"\d+", parts[0]):
        count = int(parts[0])
        if count == 0:
            raise click.UsageError("--seeds 0: a sweep needs at least one seed.")
        return tuple(range(_check_count(count, text)))
    seeds: list[int] = []
    for part in parts:
        match = _SEEDS.fullmatch(part)
        if match is None:
            raise click.UsageError(f"--seeds {text}: '{part}' is not a seed; {_SEEDS_HELP}.")
        first = int(match[1])
        last = first if match[2] is None else int(match[2])
        if last < first:
            raise click.UsageError(f"--seeds {text}: {part} descends; write {last}..{first}.")
        _check_count(len(seeds) + last - first + 1, text)
        seeds += range(first, last + 1)
    if duplicates := find_duplicates(seeds):
        raise click.UsageError(
            f"--seeds {text}: {duplicates[0]} is listed more than once; equal seeds give equal episodes."
        )
    return tuple(seeds)


def find_duplicates(values: Sequence[Hashable]) -> list[Hashable]:
    """Return the values that *values* contains more than once."""
    return [value for value, count in Counter(values).items() if count > 1]


def format_seeds(seeds: tuple[int, ...]) -> str:
    """Return *seeds* in the form that `parse_seeds` reads, with consecutive seeds as ranges."""
    runs: list[list[int]] = []
    for seed in seeds:
        if runs and seed == runs[-1][1] + 1:
            runs[-1][1] = seed
        else:
            runs.append([seed, seed])
    parts = [str(first) if first == last else f"{first}..{last}" for first, last in runs]
    # A single number would be read as the number of seeds.
    return ",".join(parts) if parts != [str(seeds[0])] else f"{seeds[0]}..{seeds[0]}"


def _check_count(count: int, text: str) -> int:
    if count > MAX_EPISODES:
        raise click.UsageError(f"--seeds {text}: {count} seeds exceed the limit of {MAX_EPISODES}.")
    return count


def parse_parameters(texts: Sequence[str], choices: ParameterOptions) -> dict[str, tuple[str, ...]]:
    """Return the values of each parameter, by KEY.

    Args:
        texts: The parameters in the form KEY=VALUES.
        choices: The options that parameters can set.

    Raises:
        click.UsageError: A parameter is unknown, invalid, or given twice.
    """
    parameters: dict[str, tuple[str, ...]] = {}
    for text in texts:
        key, equals, values = text.partition("=")
        key = key.strip().lstrip("-")
        if not equals or not key:
            raise click.UsageError(
                f"--param '{text}' is invalid: write KEY=VALUES, for example --param battery=20..100:20."
            )
        _check_key(key, choices)
        if key in parameters:
            raise click.UsageError(f"--param {key} is given more than once; list all values in one --param.")
        parameters[key] = _expand(key, values)
    return parameters


def combinations(parameters: Mapping[str, Sequence[str]]) -> Iterator[dict[str, str]]:
    """Yield all combinations of parameter values; the last parameter changes fastest."""
    for values in product(*parameters.values()):
        yield dict(zip(parameters, values, strict=True))


def combination_arguments(values: Values, choices: ParameterOptions) -> list[str]:
    """Return the arguments of `btcore run` for a combination.

    Args:
        values: The combination: the value of each parameter, by KEY.
        choices: The options that parameters can set.

    Raises:
        click.UsageError: The value of a flag is neither true nor false.
    """
    arguments: list[str] = []
    for key, value in values.items():
        if key.startswith(BLACKBOARD):
            arguments += ["--set", f"{key.removeprefix(BLACKBOARD)}={value}"]
            continue
        option = choices.options[key]
        if option.is_flag:
            if value.casefold() in _TRUE:
                arguments.append(option.opts[0])
            elif value.casefold() not in _FALSE:
                raise click.UsageError(f"--param {key}={value}: --{key} is a flag; use true or false.")
        elif value:
            arguments += [option.opts[0], value]
    return arguments


def _check_key(key: str, choices: ParameterOptions) -> None:
    if key.startswith(BLACKBOARD):
        if key == BLACKBOARD:
            raise click.UsageError(
                "--param bb.=…: the name of the entry is missing; write for example bb.laps=1..5."
            )
        return
    if key in choices.refused:
        raise click.UsageError(f"--param {key}=…: {choices.refused[key]}.")
    if key in choices.options:
        return
    hint = did_you_mean(key, choices.options) or f"; options: {join_names(choices.options, most=12)}."
    raise click.UsageError(
        f"--param {key}=…: 'btcore run' has no option --{key}{hint} For a blackboard entry write bb.{key}."
    )


def _expand(key: str, text: str) -> tuple[str, ...]:
    """Return the values in *text* in their order, with the numbers of ranges."""
    try:
        parts = next(csv.reader([text], skipinitialspace=True, strict=True), [""])
    except csv.Error as error:
        raise click.UsageError(f"--param {key}={text}: a double quote is not closed ({error}).") from error
    values: list[str] = []
    for part in parts:
        match = _RANGE.fullmatch(part.strip())
        values += [part] if match is None else _expand_range(key, part.strip(), *match.groups())
    if duplicates := find_duplicates(values):
        raise click.UsageError(f"--param {key}={text}: '{duplicates[0]}' is listed more than once.")
    return tuple(values)


def _expand_range(key: str, text: str, first: str, last: str, step: str | None) -> list[str]:
    """Return the numbers of a range, including both ends."""
    # Decimal instead of float: 0.1..0.3:0.1 must give exactly 0.1, 0.2 and 0.3.
    start, end, by = Decimal(first), Decimal(last), Decimal(step or 1)
    if by <= 0:
        raise click.UsageError(f"--param {key}={text}: the step must be greater than 0.")
    if end < start:
        raise click.UsageError(f"--param {key}={text} descends; write {last}..{first}.")
    count = int((end - start) / by) + 1
    if count > MAX_EPISODES:
        raise click.UsageError(f"--param {key}={text}: {count} values exceed the limit of {MAX_EPISODES}.")
    return [f"{start + number * by}" for number in range(count)]
