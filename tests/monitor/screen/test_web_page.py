"""The page server forwards the web viewer's files from this machine only."""

import http.client
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from btcore_monitor.screen.page import PageServer, free_port

PAGE = b'<html><head><link rel="x" href="https://elsewhere.org/font"></head><canvas></html>'


class Sdk(BaseHTTPRequestHandler):
    """A server of the files that the SDK would serve."""

    def do_GET(self) -> None:
        found = self.path.startswith("/")
        self.send_response(200 if found else 404)
        self.send_header("Content-Type", "text/html" if self.path == "/" else "application/wasm")
        self.end_headers()
        self.wfile.write(PAGE if self.path == "/" else self.path.encode())

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def fetched():
    """``fetched(path)``: status and body of the page server's response."""
    port = free_port()
    with HTTPServer(("127.0.0.1", 0), Sdk) as sdk:
        thread = threading.Thread(target=sdk.serve_forever)
        thread.start()
        server = PageServer(port, sdk.server_port)

        def fetched(path: str) -> tuple[int, bytes]:
            asking = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
            asking.request("GET", path)
            answer = asking.getresponse()
            try:
                return answer.status, answer.read()
            finally:
                asking.close()

        yield fetched
        server.close()
        sdk.shutdown()
        thread.join()


def test_local_files_are_served_without_the_proxy_of_the_environment(fetched, monkeypatch):
    monkeypatch.setenv("http_proxy", "http://127.0.0.1:1")
    status, page = fetched("/")
    assert status == 200
    assert b"<canvas>" in page
    assert b"elsewhere.org" not in page
    assert fetched("/viewer.wasm?v=1") == (200, b"/viewer.wasm?v=1")


@pytest.mark.parametrize("path", ["@elsewhere.org/", "99/", "http://elsewhere.org/"])
def test_a_path_that_names_another_host_is_refused(fetched, path):
    assert fetched(path)[0] == 404
