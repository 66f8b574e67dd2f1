"""Words in markdown, and few of them."""

import re


def escape_markdown(text: str) -> str:
    """*text* without what would be markup in a table."""
    return text.replace("|", "¦").replace("`", "'").replace("\n", " ")


def brief(message: str) -> str:
    """The first line of an error's *message*, without the file that the tree is from and the node's name:
    what is said beside those.
    """
    line = message.partition("\n")[0]
    return re.sub(r"^\S+:\d+: (node '.*?' <.*?> raised while \w+: )?", "", line)
