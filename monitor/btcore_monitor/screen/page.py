"""A web server for the viewer's page that works without internet access.

The page of rerun's SDK loads a font, looks for updates and reports usage statistics over the internet. That
fails on a robot without internet, and users have not agreed to it. So this server has the files of the page
without these requests.
"""

import contextlib
import http.client
import re
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Final

from btcore_monitor.screen.rerun_process import LOOPBACK, RerunProcess, ScreenError, hold_port, port_of

_EXTERNAL_LINK: Final = re.compile(rb"<link\b[^>]*\bhref=\"https?://[^>]*>")
_HEAD: Final = b"<head>"
_BLOCK_EXTERNAL: Final = b"""
<script>
  const allowed = new Set([location.hostname]);
  for (const address of new URLSearchParams(location.search).getAll("url")) {
    allowed.add(new URL(address.replace(/^rerun[+]/, ""), location).hostname);
  }
  const originalFetch = window.fetch.bind(window);
  window.fetch = (resource, options) =>
    allowed.has(new URL(resource.url ?? resource, location).hostname)
      ? originalFetch(resource, options)
      : Promise.resolve(new Response(null, { status: 204 }));
</script>
"""
"""A script for the page. It blocks all requests except for the page itself and the recordings in its URL."""
_FILES: Final = ("/", "/re_viewer.js", "/re_viewer_bg.wasm", "/favicon.ico", "/sw.js")
"""The files of the web viewer."""
_LENGTH: Final = "rerun-final-length"
"""A header with the length of a file, from which the page computes the progress of the download."""
_TIMEOUT: Final = 60.0


@dataclass(frozen=True, slots=True)
class PageFile:
    """A file of the page: its content, and its type for the browser."""

    content: bytes
    content_type: str


def page_files() -> Mapping[str, PageFile]:
    """Return the files of rerun's web viewer by path, changed as this module describes.

    Raises:
        ScreenError: The viewer is not installed or does not start.
    """
    with hold_port() as held:
        port = port_of(held)
        # Only rerun's program can serve its page at 127.0.0.1 alone; its SDK serves it at all addresses.
        server = RerunProcess("--serve-web", f"--web-viewer-port={port}")
        try:
            server.wait_until_listening(port)
            return {path: file for path in _FILES if (file := _fetch(port, path)) is not None}
        except (OSError, http.client.HTTPException) as error:
            raise ScreenError(f"rerun does not serve its web viewer: {error}") from error
        finally:
            server.close()


def _fetch(port: int, path: str) -> PageFile | None:
    # Not urllib, which would send the request to the environment's proxy, even for this machine.
    connection = http.client.HTTPConnection(LOOPBACK, port, timeout=_TIMEOUT)
    with contextlib.closing(connection):
        connection.request("GET", path)
        response = connection.getresponse()
        content = response.read()
        if response.status != http.client.OK:
            return None
    if response.headers.get_content_type() == "text/html":
        content = _EXTERNAL_LINK.sub(b"", content).replace(_HEAD, _HEAD + _BLOCK_EXTERNAL, 1)
    return PageFile(content, response.headers.get("Content-Type", "application/octet-stream"))


class PageServer:
    """A server of *files*, by path, on *port* of this machine.

    Raises:
        OSError: The port is in use.
    """

    def __init__(self, port: int, files: Mapping[str, PageFile]) -> None:
        self._server = _Server((LOOPBACK, port), _Handler)
        self._server.files = files
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True, name="btcore-page")
        self._thread.start()

    def close(self) -> None:
        """Stop the server."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


class _Server(ThreadingHTTPServer):
    # A browser may keep its connection open; the process must still be able to exit.
    daemon_threads = True
    files: Mapping[str, PageFile]


class _Handler(BaseHTTPRequestHandler):
    server: _Server

    def do_GET(self) -> None:
        file = self.server.files.get(self.path.partition("?")[0])
        # A browser that closes the connection early is not an error.
        with contextlib.suppress(OSError):
            if file is None:
                self.send_error(http.client.NOT_FOUND)
                return
            self.send_response(http.client.OK)
            self.send_header("Content-Type", file.content_type)
            self.send_header("Content-Length", str(len(file.content)))
            self.send_header(_LENGTH, str(len(file.content)))
            self.end_headers()
            self.wfile.write(file.content)

    def log_message(self, format: str, *arguments: Any) -> None:
        """Log nothing: requests of a browser are not of interest."""
