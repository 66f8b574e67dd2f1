"""Words in markdown."""


def plain(text: str) -> str:
    """*text* without what would be markup in a table."""
    return text.replace("|", "¦").replace("`", "'").replace("\n", " ")
