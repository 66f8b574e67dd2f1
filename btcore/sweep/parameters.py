"""``--param KEY=VALUES``: what differs between the settings of a sweep.

KEY is an option of ``btcore run`` without its dashes, or ``bb.NAME`` for an entry of the blackboard (``run
--set``). VALUES stand apart by commas; each may be a range of numbers, ``20..100:20``. One that has a comma
in it stands in double quotes. An empty one leaves the option out.
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
"""What a setting has for each parameter, by KEY, as text."""


@dataclass(frozen=True, slots=True)
class RunOptions:
    """The options of ``btcore run`` by name without dashes, and those that no sweep has, with why."""

    options: Mapping[str, click.Option]
    refused: Mapping[str, str]


def parse_parameters(texts: Sequence[str], choices: RunOptions) -> dict[str, tuple[str, ...]]:
    """The values of each parameter. Raises :class:`click.UsageError` for what is none."""
    found: dict[str, tuple[str, ...]] = {}
    for text in texts:
        key, equals, values = text.partition("=")
        key = key.strip().lstrip("-")
        if not equals or not key:
            raise click.UsageError(
                f"--param '{text}' varies nothing: write KEY=VALUES, say --param battery=20..100:20."
            )
        _check_key(key, choices)
        if key in found:
            raise click.UsageError(f"--param {key} is given twice; put all its values into one.")
        found[key] = _expanded(key, values)
    return found


def settings(parameters: Mapping[str, Sequence[str]]) -> Iterator[dict[str, str]]:
    """Every combination of the parameters' values, the last parameter's changing fastest."""
    for values in product(*parameters.values()):
        yield dict(zip(parameters, values, strict=True))


def setting_arguments(values: Values, choices: RunOptions) -> list[str]:
    """What ``btcore run`` is told for one setting."""
    told: list[str] = []
    for key, value in values.items():
        if key.startswith(BLACKBOARD):
            told += ["--set", f"{key.removeprefix(BLACKBOARD)}={value}"]
            continue
        option = choices.options[key]
        if option.is_flag:
            if value.casefold() in _TRUE:
                told.append(option.opts[0])
            elif value.casefold() not in _FALSE:
                raise click.UsageError(f"--param {key}={value}: it is a switch; give true or false.")
        elif value:
            told += [option.opts[0], value]
    return told


def _check_key(key: str, choices: RunOptions) -> None:
    if key.startswith(BLACKBOARD):
        if key == BLACKBOARD:
            raise click.UsageError("--param bb.=…: write the entry's name after the dot, say bb.laps=1..5.")
        return
    if key in choices.refused:
        raise click.UsageError(f"--param {key}=…: {choices.refused[key]}.")
    if key in choices.options:
        return
    meant = nearest_name(key, choices.options)
    hint = f"Did you mean '{meant}'?" if meant else f"There are {join_names(choices.options, most=12)}."
    raise click.UsageError(
        f"--param {key}=…: 'btcore run' has no option --{key}. {hint} An entry of the blackboard is bb.{key}."
    )


def _expanded(key: str, text: str) -> tuple[str, ...]:
    """The values in *text*, in order, ranges counted out."""
    try:
        parts = next(csv.reader([text], skipinitialspace=True, strict=True), [""])
    except csv.Error as fault:
        raise click.UsageError(f"--param {key}={text}: a double quote isn't closed ({fault}).") from fault
    found: list[str] = []
    for part in parts:
        met = _RANGE.fullmatch(part.strip())
        found += [part] if met is None else _counted(key, part.strip(), *met.groups())
    if len(set(found)) < len(found):
        twice = next(value for number, value in enumerate(found) if value in found[:number])
        raise click.UsageError(f"--param {key}={text}: '{twice}' is there twice; once is enough.")
    return tuple(found)


def _counted(key: str, text: str, first: str, last: str, step: str | None) -> list[str]:
    """The numbers of a range, both ends belong to it; decimal, so that 0.1..0.3:0.1 is what it looks like."""
    start, end, by = Decimal(first), Decimal(last), Decimal(step or 1)
    if by <= 0:
        raise click.UsageError(f"--param {key}={text}: the step has to be greater than 0.")
    if end < start:
        raise click.UsageError(f"--param {key}={text} goes down; {last}..{first} is the same upwards.")
    count = int((end - start) / by) + 1
    if count > MAX_EPISODES:
        raise click.UsageError(f"--param {key}={text}: {count} values are more than a sweep holds.")
    return [f"{start + number * by}" for number in range(count)]
