"""Requests of an editor to the language server, without the protocol between them."""

import gc

from btcore_studio.language.completion import complete
from btcore_studio.language.hover import hover
from btcore_studio.language.project import Project
from btcore_studio.language.server import GC_THRESHOLD
from measure.paired_timing import Work

URI = "untitled:tree.xml"


def requests_at(text: str, offset: int, expected: str) -> dict[str, Work]:
    """Return functions, by name, that replace the open document by *text*, and then request something.

    The garbage collector of this process is set like that of the server.

    Args:
        text: The document.
        offset: The place of the cursor.
        expected: A word that the results contain; it is checked once.
    """
    gc.set_threshold(GC_THRESHOLD)
    project = Project()

    def completion() -> object:
        return complete(project, project.open(URI, text, 1), offset)

    def description() -> object:
        return hover(project, project.open(URI, text, 1), offset)

    works: dict[str, Work] = {"completion": completion, "hover": description}
    for name, work in works.items():
        assert expected in str(work()), f"the result of {name} lacks '{expected}'"
    return works
