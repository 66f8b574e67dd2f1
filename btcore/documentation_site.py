"""The addresses of pages in the documentation."""

from functools import cache


def documentation_url(page: str) -> str | None:
    """Return the address of a page in the documentation.

    Args:
        page: The page, relative to the first page, such as "reference/errors.html".

    Returns:
        The address. None if btcore is imported without being installed: the metadata of the installed package
        contain the address of the documentation.
    """
    site = _first_page()
    return None if site is None else site + page


def node_url(id: str, library: str) -> str | None:
    """Return the address of a node's page in the documentation.

    Args:
        library: The name of the library that registers the node.

    Returns:
        The address. None if it is unknown, or if the documentation has no pages for the package's nodes.
    """
    from btcore.entry_points import NODES_GROUP, own_packages

    # The nodes of btcore and of its own node libraries have pages.
    if library != "btcore" and library not in own_packages(NODES_GROUP):
        return None
    return documentation_url(f"reference/nodes/{id}.html")


@cache
def _first_page() -> str | None:
    from importlib.metadata import PackageNotFoundError, metadata  # slow to import

    try:
        urls = metadata("btcore").get_all("Project-URL", [])
    except PackageNotFoundError:
        return None
    label = "Documentation, "
    return next((url.removeprefix(label) for url in urls if url.startswith(label)), None)
