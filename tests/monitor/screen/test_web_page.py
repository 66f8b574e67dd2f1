"""The page of the web viewer is served with rerun's files, and without requests to other hosts."""

import http.client
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from btcore_monitor.screen.page import PageServer, page_files


@pytest.fixture(scope="module")
def fetched(free_port: Callable[[], int]) -> Iterator[Callable[..., Any]]:
    """``fetched(path)``: status, body and headers of the page server's response."""
    port = free_port()
    server = PageServer(port, page_files())

    def fetched(path: str) -> tuple[int, bytes, http.client.HTTPMessage]:
        asking = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
        asking.request("GET", path)
        answer = asking.getresponse()
        try:
            return answer.status, answer.read(), answer.headers
        finally:
            asking.close()

    yield fetched
    server.close()


def test_the_page_has_no_links_to_other_hosts(fetched: Callable[..., Any]) -> None:
    status, page, headers = fetched("/")
    assert status == 200
    assert headers.get_content_type() == "text/html"
    assert b"<canvas" in page
    assert b"fonts.googleapis.com" not in page


def test_the_viewer_is_served_with_its_length_for_the_progress_bar(fetched: Callable[..., Any]) -> None:
    status, program, headers = fetched("/re_viewer_bg.wasm?v=1")
    assert status == 200
    assert program.startswith(b"\0asm")
    assert headers["Content-Type"] == "application/wasm"
    assert int(headers["rerun-final-length"]) == len(program)


@pytest.mark.parametrize("path", ["@elsewhere.org/", "99/", "http://elsewhere.org/", "/../sinks.py"])
def test_a_path_that_is_not_a_file_of_the_page_is_refused(fetched: Callable[..., Any], path: str) -> None:
    assert fetched(path)[0] == 404
