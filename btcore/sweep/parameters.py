"""``--param KEY=VALUES``: the parameters that vary between the runs of a sweep.

KEY is an option of ``btcore run`` without its dashes, or ``bb.NAME`` for a blackboard entry (``run --set``).
VALUES are separated by commas. A value may be a range of numbers, ``20..100:20``. A value that contains a
comma is put in double quotes. With an empty value the option is omitted.
"""

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from itertools import product
from typing import Final

import click

from btcore.suggestions import join_names, nearest_name
from btcore.sweep.seeds import MAX_EPISODES

BLACKBOARD: Final = "bb."

_NUMBER: Final = r"[+-]?(?:\d+\.?\d*|\.\d+)"
_RANGE: Final = re.compile(rf"({_NUMBER})\.\.({_NUMBER})(?::({_NUMBER}))?")
_TRUE: Final = {"true", "yes", "on", "1"}
_FALSE: Final = {"false", "no", "off", "0", ""}

Values = Mapping[str, str]
"""The value of each parameter in a setting, as text, by KEY."""


@dataclass(frozen=True, slots=True)
class RunOptions:
    """The options of ``btcore run`` by name without dashes, and the reasons why a sweep rejects others."""

    options: Mapping[str, click.Option]
    refused: Mapping[str, str]


def parse_parameters(texts: Sequence[str], choices: RunOptions) -> dict[str, tuple[str, ...]]:
    """Return the values of each parameter.

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


def settings(parameters: Mapping[str, Sequence[str]]) -> Iterator[dict[str, str]]:
    """Yield all combinations of the parameters' values; the last parameter changes fastest."""
    for values in product(*parameters.values()):
        yield dict(zip(parameters, values, strict=True))


def setting_arguments(values: Values, choices: RunOptions) -> list[str]:
    """Return the arguments of ``btcore run`` for a setting.

    Args:
        values: The value of each parameter.
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


def _check_key(key: str, choices: RunOptions) -> None:
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
    nearest = nearest_name(key, choices.options)
    hint = f"Did you mean '{nearest}'?" if nearest else f"Options: {join_names(choices.options, most=12)}."
    raise click.UsageError(
        f"--param {key}=…: 'btcore run' has no option --{key}. {hint} For a blackboard entry write bb.{key}."
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
    if len(set(values)) < len(values):
        duplicate = next(value for number, value in enumerate(values) if value in values[:number])
        raise click.UsageError(f"--param {key}={text}: '{duplicate}' is listed more than once.")
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
