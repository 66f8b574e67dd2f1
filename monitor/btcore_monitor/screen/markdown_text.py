"""Short texts in markdown."""

import re


def escape_markdown(text: str) -> str:
    """Replace the characters of *text* that are markup in a markdown table."""
    return text.replace("|", "¦").replace("`", "'").replace("\n", " ")


def brief(message: str) -> str:
    """Return the first line of an error's *message*, without the tree's file and the node's name.

    Both are displayed beside the message already.
    """
    line = message.partition("\n")[0]
    return re.sub(r"^\S+:\d+: (node '.*?' <.*?> raised while \w+: )?", "", line)
