"""The addresses of pages in the documentation."""

from typing import Final

FIRST_PAGE: Final = "https://btcore.github.io/btcore/"
"""The address of the documentation, as in pyproject.toml; addresses of other pages begin with it."""


def node_url(id: str, library: str) -> str | None:
    """Return the address of a node's page in the documentation.

    Args:
        library: The name of the library that registers the node.

    Returns:
        The address. None if the documentation has no pages for the library's nodes.
    """
    from btcore.entry_points import NODES_GROUP, own_packages

    # The nodes of btcore and of its own node libraries have pages.
    if library != "btcore" and library not in own_packages(NODES_GROUP):
        return None
    return f"{FIRST_PAGE}reference/nodes/{id}.html"
