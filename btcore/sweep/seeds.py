"""The seeds of a sweep: parsing and formatting ``1000``, ``100..199`` and ``3,17,42``."""

import re
from typing import Final

import click

MAX_EPISODES: Final = 10_000_000
"""The largest number of episodes of a sweep."""

_FORM: Final = re.compile(r"(\d+)(?:\.\.(\d+))?")
_HELP: Final = "write a number (1000 is 0..999), an inclusive range (100..199) or a list (3,17,42)"


def parse_seeds(text: str) -> tuple[int, ...]:
    """Return the seeds in *text*, in its order.

    A single number is the number of seeds, from 0; in a list, whose parts may be ranges, a number is a seed.

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
        match = _FORM.fullmatch(part)
        if match is None:
            raise click.UsageError(f"--seeds {text}: '{part}' is not a seed; {_HELP}.")
        first = int(match[1])
        last = first if match[2] is None else int(match[2])
        if last < first:
            raise click.UsageError(f"--seeds {text}: {part} descends; write {last}..{first}.")
        _check_count(len(seeds) + last - first + 1, text)
        seeds += range(first, last + 1)
    if len(set(seeds)) < len(seeds):
        duplicate = next(seed for number, seed in enumerate(seeds) if seed in seeds[:number])
        raise click.UsageError(
            f"--seeds {text}: {duplicate} is listed more than once; equal seeds give equal episodes."
        )
    return tuple(seeds)


def format_seeds(seeds: tuple[int, ...]) -> str:
    """Return *seeds* in the form that :func:`parse_seeds` reads, with consecutive seeds as ranges."""
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
