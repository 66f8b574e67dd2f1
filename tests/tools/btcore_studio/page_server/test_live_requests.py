"""Requests of a page that change a running tree: refused with a sentence, and never by a read-only studio."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from btcore_studio.page_server.session import Shown
from tests.tools.btcore_studio.language.test_live import Connection, Extension
from tests.tools.btcore_studio.page_server.conftest import TREE, PageClient, Studio, running_studio
from tests.tools.btcore_studio.page_server.test_server import initialize, open_document

INVALID_PARAMS, REQUEST_FAILED = -32602, -32803


@pytest.fixture
def attached(folder: Path, built: Path, tmp_path: Path) -> Iterator[Callable[..., Any]]:
    """Return a function that returns a studio whose pages can watch the running tree of a connection."""

    with ExitStack() as stack:

        def start(connection: Connection, **options: Any) -> Studio:
            shown = Shown(folder, folder / "tree.xml", live=Extension(connection), **options)  # type: ignore[arg-type]
            return stack.enter_context(running_studio(shown, tmp_path / "previous", built))

        yield start


def watch(page: PageClient, condition: Callable[[dict[str, Any]], object]) -> None:
    initialize(page)
    page.request("btcore/watch", {"address": "somewhere"})
    while not condition(page.notification("btcore/live")):
        pass


def test_entry_and_tree_of_a_running_tree_are_changed(attached: Callable[..., Studio]) -> None:
    connection = Connection()
    studio = attached(connection)
    with studio.page() as page:
        uri = studio.uri("tree.xml")
        watch(page, lambda state: state["connection"] == "connected")
        open_document(page, uri, TREE.replace("tempo", "speed"))
        page.request("btcore/setEntry", {"path": "", "key": "key", "value": "2"})
        page.request("btcore/reload", {"textDocument": {"uri": uri}})
        page.request("btcore/release", {"status": "SUCCESS"})
        error = page.error("btcore/setEntry", {"path": "", "key": "key", "value": "invalid"})
        assert error == (REQUEST_FAILED, "'key' is not set")
        assert page.error("btcore/reload", {"textDocument": {"uri": "file:///etc/passwd"}})[0] < 0
    assert connection.calls[:2] == [("", "key", "2"), TREE.replace("tempo", "speed")]


WRONG: Sequence[tuple[str, Any, str]] = [
    ("btcore/release", {"status": "RUNNING"}, "status"),
    ("btcore/release", {"status": 2}, "status"),
    ("btcore/setEntry", {"path": "", "key": "key"}, "value"),
    ("btcore/setEntry", {"path": "", "key": "key", "value": 2}, "value"),
    ("btcore/setEntry", {"path": "", "key": "k" * 1_001, "value": "2"}, "key"),
    ("btcore/setEntry", {"path": "", "key": "key", "value": "2" * 10_001}, "value"),
    ("btcore/reload", {"textDocument": 5}, "textDocument"),
]


def test_wrong_parameters_are_refused(attached: Callable[..., Studio]) -> None:
    connection = Connection()
    with attached(connection).page() as page:
        watch(page, lambda state: state["connection"] == "connected")
        for method, params, name in WRONG:
            code, message = page.error(method, params)
            assert code == INVALID_PARAMS
            assert name in message
    assert connection.calls in ([], ["close"])


def test_read_only_studio_changes_no_running_tree(attached: Callable[..., Studio]) -> None:
    connection = Connection()
    studio = attached(connection, is_read_only=True)
    with studio.page() as page:
        watch(page, lambda state: state["refusals"].get("breakpoints") == "")
        for method, params in [
            ("btcore/setEntry", {"path": "", "key": "key", "value": "2"}),
            ("btcore/reload", {"textDocument": {"uri": studio.uri("tree.xml")}}),
            ("btcore/release", {"status": "FAILURE"}),
        ]:
            code, message = page.error(method, params)
            assert (code, message.split(":")[0]) == (REQUEST_FAILED, "this studio is read-only")
    assert connection.calls in ([], ["close"])


def test_change_without_a_running_tree_is_refused(attached: Callable[..., Studio]) -> None:
    with attached(Connection()).page() as page:
        initialize(page)
        error = page.error("btcore/setEntry", {"path": "", "key": "key", "value": "2"})
        assert error == (REQUEST_FAILED, "no running tree is connected")
