"""A transition as a line of text: time, path, old → new."""

from btcore.clock import NS_PER_S
from btcore.status import Status


def format_transition(since: int, path: str, previous: Status, status: Status, width: int = 0) -> str:
    """The transition *since* ns from the start, with *path* in at least *width* characters."""
    return f"{since / NS_PER_S:12.6f}  {path:<{width}}  {previous.name:>7} → {status.name}"
