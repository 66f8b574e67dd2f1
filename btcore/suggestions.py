"""Parts of messages: the name nearest to a mistyped name, enumerations of names, and counts."""

from collections.abc import Iterable
from itertools import islice
from pathlib import Path
from typing import Final

MAX_FILES: Final = 500
"""The maximum number of files of a folder whose names are compared."""


def nearest_name(word: str, names: Iterable[str]) -> str | None:
    """Return the known name that is most similar to *word*, or None if no name is similar."""
    known = list(names)
    folded = {name.casefold(): name for name in reversed(known)}
    if word.casefold() in folded:
        return folded[word.casefold()]
    # Imported here, because it is needed for error messages only and would slow down the start.
    from difflib import SequenceMatcher

    # As get_close_matches(word, known, n=1), but a name is compared only if it may be the best.
    matcher = SequenceMatcher(b=word)
    nearest: str | None = None
    highest = 0.6
    for name in known:
        matcher.set_seq1(name)
        if matcher.real_quick_ratio() >= highest and matcher.quick_ratio() >= highest:
            ratio = matcher.ratio()
            if ratio > highest or (ratio == highest and (nearest is None or name > nearest)):
                nearest, highest = name, ratio
    return nearest


def with_article(name: str) -> str:
    """Return "a Robot" or "an Explorer"."""
    return f"{'an' if name[:1] in 'AEIOUaeiou' else 'a'} {name}"


def suggestion(choice: object) -> str:
    """Return the question `did you mean choice?`."""
    return f"did you mean {choice}?"


def did_you_mean(word: str, names: Iterable[str]) -> str:
    """Return the end of an error message, `; did you mean 'name'?`, or "" if no name is near *word*."""
    nearest = nearest_name(word, names)
    return "" if nearest is None else "; " + suggestion(f"'{nearest}'")


def similar_file(path: Path, suffix: str) -> str | None:
    """Return the path of the file whose name is most similar to that of *path*, in the same folder, or None.

    Args:
        path: The path of a file that does not exist.
        suffix: The suffix of the files to compare, such as ".py".
    """
    files = islice(path.parent.glob(f"*{suffix}"), MAX_FILES)
    nearest = nearest_name(path.name, [file.name for file in files])
    return None if nearest is None else str(path.with_name(nearest))


def shortened(text: str, most: int) -> str:
    """Return *text*; if it has more than *most* characters, only the first, with `…` at the end."""
    return text if len(text) <= most else f"{text[: most - 1]}…"


def child_count_text(count: int) -> str:
    """Return a number of children, such as `2 children`."""
    return "no child" if count == 0 else f"{count} children" if count > 1 else "1 child"


def counted(count: int, noun: str, zero: str = "0") -> str:
    """Return a number with a noun, which is given in the singular; *zero* is the word for 0."""
    return f"{f'{count:,}' if count else zero} {noun}{'' if count == 1 else 's'}"


def join_names(names: Iterable[str], conjunction: str = "and", most: int = 8) -> str:
    """Return an enumeration of *names*, such as `a, b and c`.

    Args:
        conjunction: The word before the last name.
        most: The maximum number of names; the others are counted ("3 more").
    """
    words = list(names)
    if len(words) > most:
        words = [*words[:most], f"{len(words) - most} more"]
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} {conjunction} {words[-1]}"
