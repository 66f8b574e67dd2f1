"""A web server for the viewer's page that works without internet access.

The page of rerun's SDK loads a font, looks for updates and reports usage statistics over the internet. That
fails on a robot without internet, and users have not agreed to it. So this server forwards the page without
these requests.
"""

import contextlib
import http.client
import re
import shutil
import socket
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Final

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
_FORWARDED_HEADERS: Final = ("Content-Type", "rerun-final-length")
_TIMEOUT: Final = 20.0


class PageServer:
    """A server on *port* of this machine that forwards the page that the SDK serves on port *source*.

    Raises:
        OSError: The port is in use.
    """

    def __init__(self, port: int, source: int) -> None:
        self._server = _Server(("127.0.0.1", port), _Handler)
        self._server.source = source
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
    source = 0


class _Handler(BaseHTTPRequestHandler):
    server: _Server

    def do_GET(self) -> None:
        # Not urllib, which would send the request to the environment's proxy, even for this machine.
        source = http.client.HTTPConnection("127.0.0.1", self.server.source, timeout=_TIMEOUT)
        # A browser that closes the connection early is not an error.
        with contextlib.suppress(OSError, http.client.HTTPException), contextlib.closing(source):
            source.request("GET", self.path)
            response = source.getresponse()
            if response.status != http.client.OK:
                self.send_error(response.status)
                return
            self.send_response(response.status)
            for name in _FORWARDED_HEADERS:
                if name in response.headers:
                    self.send_header(name, response.headers[name])
            self.end_headers()
            if response.headers.get_content_type() == "text/html":
                page = _EXTERNAL_LINK.sub(b"", response.read())
                self.wfile.write(page.replace(_HEAD, _HEAD + _BLOCK_EXTERNAL, 1))
            else:
                shutil.copyfileobj(response, self.wfile, 1 << 20)

    def log_message(self, format: str, *arguments: Any) -> None:
        """Log nothing: requests of a browser are not of interest."""


def free_port(wanted: int = 0) -> int:
    """Return the port *wanted* if it is free, otherwise another free port. 0 means any port."""
    with socket.socket() as probe:
        try:
            probe.bind(("0.0.0.0", wanted))
        except OSError:
            probe.bind(("0.0.0.0", 0))
        return int(probe.getsockname()[1])
