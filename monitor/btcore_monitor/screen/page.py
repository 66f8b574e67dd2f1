"""A web server for the viewer's page that works without internet access.

The page of rerun's SDK loads a font, looks for updates and reports usage statistics over the internet. That
fails on a robot without internet, and users have not agreed to it. So this server passes the page on without
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

_ELSEWHERE: Final = re.compile(rb"<link\b[^>]*\bhref=\"https?://[^>]*>")
_HEAD: Final = b"<head>"
_STAYS_HERE: Final = b"""
<script>
  const here = new Set([location.hostname]);
  for (const one of new URLSearchParams(location.search).getAll("url")) {
    here.add(new URL(one.replace(/^rerun[+]/, ""), location).hostname);
  }
  const fetched = window.fetch.bind(window);
  window.fetch = (what, how) =>
    here.has(new URL(what.url ?? what, location).hostname)
      ? fetched(what, how)
      : Promise.resolve(new Response(null, { status: 204 }));
</script>
"""
"""The page may load only itself and the recordings that its address names; all other requests are blocked."""
_PASSED_ON: Final = ("Content-Type", "rerun-final-length")
_ANSWER_WITHIN: Final = 20.0


class PageServer:
    """A server on *port* of this machine that passes on the page that the SDK serves on port *source*.

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
        source = http.client.HTTPConnection("127.0.0.1", self.server.source, timeout=_ANSWER_WITHIN)
        # A browser that closes the connection early is not an error.
        with contextlib.suppress(OSError, http.client.HTTPException), contextlib.closing(source):
            source.request("GET", self.path)
            answer = source.getresponse()
            if answer.status != http.client.OK:
                self.send_error(answer.status)
                return
            self.send_response(answer.status)
            for name in _PASSED_ON:
                if name in answer.headers:
                    self.send_header(name, answer.headers[name])
            self.end_headers()
            if answer.headers.get_content_type() == "text/html":
                page = _ELSEWHERE.sub(b"", answer.read())
                self.wfile.write(page.replace(_HEAD, _HEAD + _STAYS_HERE, 1))
            else:
                shutil.copyfileobj(answer, self.wfile, 1 << 20)

    def log_message(self, format: str, *arguments: Any) -> None:
        """Log nothing: requests of a browser are not of interest."""


def free_port(wanted: int = 0) -> int:
    """Return the port *wanted* if it is free, or else another free port."""
    with socket.socket() as probe:
        try:
            probe.bind(("0.0.0.0", wanted))
        except OSError:
            probe.bind(("0.0.0.0", 0))
        return int(probe.getsockname()[1])
