"""The nearest name to a mistyped one, and lists that read as sentences."""

from collections.abc import Iterable


def nearest_name(word: str, names: Iterable[str]) -> str | None:
    """The one of *names* that *word* most probably meant, or None."""
    known = list(names)
    folded = {name.casefold(): name for name in reversed(known)}
    if word.casefold() in folded:
        return folded[word.casefold()]
    # Imported for a mistake only: start-up does without it.
    from difflib import get_close_matches

    found = get_close_matches(word, known, n=1, cutoff=0.6)
    return found[0] if found else None


def join_names(names: Iterable[str], conjunction: str = "and", most: int = 8) -> str:
    """*names* as people write a list: ``a, b and c``; what is over *most* is counted."""
    words = list(names)
    if len(words) > most:
        words = [*words[:most], f"{len(words) - most} more"]
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} {conjunction} {words[-1]}"
