"""What a user can get wrong about worlds and robots, said as sentences."""

from collections.abc import Iterable
from difflib import get_close_matches


class SimError(Exception):
    """A world, a robot or a fault can't be had as asked for; the text says why and what to do."""


def did_you_mean(word: str, names: Iterable[str]) -> str:
    """``did you mean 'house'? `` when one of *names* is near to *word*, else nothing."""
    found = get_close_matches(word, list(names), n=1, cutoff=0.6)
    return f"did you mean '{found[0]}'? " if found else ""
