"""Which seeds a sweep goes through: ``1000``, ``100..199``, ``3,17,42``."""

import re
from typing import Final

import click

MAX_EPISODES: Final = 10_000_000
"""Episodes that one sweep may have."""

_FORM: Final = re.compile(r"(\d+)(?:\.\.(\d+))?")
_HELP: Final = (
    "write a number (1000 is 0..999), a range (100..199, both ends belong to it) or a list (3,17,42)"
)


def parse_seeds(text: str) -> tuple[int, ...]:
    """The seeds that *text* means, in its order. Raises :class:`click.UsageError`.

    A number alone is how many; in a list, whose parts may be ranges, it is a seed.
    """
    parts = [part.strip() for part in text.split(",")]
    if len(parts) == 1 and re.fullmatch(r"\d+", parts[0]):
        count = int(parts[0])
        if count == 0:
            raise click.UsageError("--seeds 0: a sweep without a seed has nothing to do.")
        return tuple(range(_few(count, text)))
    found: list[int] = []
    for part in parts:
        met = _FORM.fullmatch(part)
        if met is None:
            raise click.UsageError(f"--seeds {text}: '{part}' is no seed; {_HELP}.")
        first = int(met[1])
        last = first if met[2] is None else int(met[2])
        if last < first:
            raise click.UsageError(f"--seeds {text}: {part} goes down; {last}..{first} is the same upwards.")
        _few(len(found) + last - first + 1, text)
        found += range(first, last + 1)
    if len(set(found)) < len(found):
        twice = next(seed for number, seed in enumerate(found) if seed in found[:number])
        raise click.UsageError(f"--seeds {text}: {twice} is there twice, and it would go the same way twice.")
    return tuple(found)


def format_seeds(seeds: tuple[int, ...]) -> str:
    """*seeds* as :func:`parse_seeds` reads them, runs of them as ranges."""
    runs: list[list[int]] = []
    for seed in seeds:
        if runs and seed == runs[-1][1] + 1:
            runs[-1][1] = seed
        else:
            runs.append([seed, seed])
    parts = [str(first) if first == last else f"{first}..{last}" for first, last in runs]
    return ",".join(parts) if parts != [str(seeds[0])] else f"{seeds[0]}..{seeds[0]}"


def _few(count: int, text: str) -> int:
    if count > MAX_EPISODES:
        raise click.UsageError(f"--seeds {text}: {count} seeds are more than a sweep holds, {MAX_EPISODES}.")
    return count
