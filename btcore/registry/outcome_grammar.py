"""The grammar of outcomes, the texts that plan what mock leaves do: see `parse_outcomes`."""

import re
from functools import lru_cache
from typing import Final, NamedTuple

from btcore.status import FAILURE, RUNNING, SKIPPED, SUCCESS

LETTERS: Final = {"R": RUNNING, "S": SUCCESS, "F": FAILURE, "K": SKIPPED}
"""The statuses of the letters of outcomes, except X, which raises an exception."""

_OUTCOME: Final = re.compile(r"([RSFKX])(?:\(((?:'(?:[^']|'')*'|[^'()])*)\))?(\|?)")
_OUTPUT: Final = re.compile(r"\s*([^=,'\s]+)\s*=\s*(?:'((?:[^']|'')*)'|([^,']*?))\s*(?:,|$)")


class Outcome(NamedTuple):
    """What a mock leaf does in a tick.

    Attributes:
        letter: R (RUNNING), S (SUCCESS), F (FAILURE), K (SKIPPED) or X (raises `MockLeafError`).
        outputs: The names and the values of the output ports that the leaf writes; the values as texts.
    """

    letter: str
    outputs: tuple[tuple[str, str], ...] = ()

    def __str__(self) -> str:
        texts = [f"{port}={_quote(value)}" for port, value in self.outputs]
        return f"{self.letter}({', '.join(texts)})" if texts else self.letter


Start = tuple[Outcome, ...]
"""The outcomes of a leaf from its start until it completes or is halted, one for each tick."""


@lru_cache(maxsize=10_000)
def parse_outcomes(text: str) -> tuple[Start, ...]:
    """Return the outcomes of a text such as `RRS|F`: for each start of a leaf, an outcome for each tick.

    The letters are R (RUNNING), S (SUCCESS), F (FAILURE), K (SKIPPED) and X (raises `MockLeafError`). A start
    ends at the first letter other than R, or at a `|`, which may be omitted after such a letter. Output ports
    that the leaf writes follow in parentheses: `S(cups=3, text='a, b')`. A quote in quotes is doubled.
    """
    starts: list[Start] = []
    start: list[Outcome] = []
    end = 0
    while match := _OUTCOME.match(text, end):
        letter, outputs, bar = match.groups()
        end = match.end()
        start.append(Outcome(letter, _parse_outputs(outputs, text)))
        if letter != "R" or bar or end == len(text):
            starts.append(tuple(start))
            start.clear()
    if not starts or end < len(text) or text.endswith("|"):
        raise ValueError(
            f"invalid outcomes '{text}': write for example RRS|F; the letters are R (RUNNING), S (SUCCESS), "
            "F (FAILURE), K (SKIPPED) and X (an exception); | separates the starts of the leaf; "
            "S(port=value) writes an output port"
        )
    return tuple(starts)


def _parse_outputs(text: str | None, outcomes: str) -> tuple[tuple[str, str], ...]:
    outputs: dict[str, str] = {}
    end = 0
    while match := _OUTPUT.match(text or "", end):
        port, quoted, plain = match.groups()
        outputs[port] = plain if quoted is None else quoted.replace("''", "'")
        end = match.end()
    if text is not None and (end < len(text) or not outputs):
        raise ValueError(f"invalid outcomes '{outcomes}': write outputs as S(port=value, other='a, b')")
    return tuple(outputs.items())


def _quote(value: str) -> str:
    return value if re.fullmatch(r"[^',()\s]+", value) else "'" + value.replace("'", "''") + "'"
