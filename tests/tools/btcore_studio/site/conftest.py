"""The site of static files, which `.ci/studio-site` builds and tests."""

import functools
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest


class _QuietHandler(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None: ...


@contextmanager
def serve(site: Path) -> Iterator[str]:
    """Serve the files of the site without special headers, and return its address."""
    handler = functools.partial(_QuietHandler, directory=str(site))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield f"http://127.0.0.1:{server.server_address[1]}/"
        finally:
            server.shutdown()


@pytest.fixture(scope="session")
def site() -> Path:
    """The folder of the built site; the test is skipped without the environment variable BTCORE_SITE."""
    folder = os.environ.get("BTCORE_SITE")
    if not folder:
        pytest.skip("BTCORE_SITE is not set: .ci/studio-site")
    return Path(folder).resolve()
