"""The web viewer's page is passed on from this machine, and from nowhere else."""

import http.client
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from btcore_monitor.screen.page import PageServer, free_port

PAGE = b'<html><head><link rel="x" href="https://elsewhere.org/font"></head><canvas></html>'


class Sdk(BaseHTTPRequestHandler):
    """What the SDK would serve."""

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
    """``fetched(path)``: status and body of what the page server answers."""
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


def test_a_proxy_in_the_environment_is_not_asked_for_what_is_on_this_machine(fetched, monkeypatch):
    monkeypatch.setenv("http_proxy", "http://127.0.0.1:1")
    status, page = fetched("/")
    assert status == 200
    assert b"<canvas>" in page
    assert b"elsewhere.org" not in page
    assert fetched("/viewer.wasm?v=1") == (200, b"/viewer.wasm?v=1")


@pytest.mark.parametrize("path", ["@elsewhere.org/", "99/", "http://elsewhere.org/"])
def test_a_path_leads_nowhere_else(fetched, path):
    assert fetched(path)[0] == 404
