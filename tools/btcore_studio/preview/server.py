"""The web server of the preview, for this machine and for those who know its token.

Every request needs the token in its path, and the server's own address as its Host. A page of another origin
can therefore neither read nor change anything, even if it guesses the port. All sizes and times are bounded.
"""

import hmac
import json
import os
import secrets
import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any, Final, cast

from btcore.errors import BtcoreError
from btcore.json_text import load_json
from btcore_drawing.svg import drawing_style
from btcore_studio.preview.session import PreviewSession

_HOST: Final = "127.0.0.1"
_MAX_BODY: Final = 16 << 20
"""Maximum bytes of a request: the unsaved text of an editor."""
_MAX_CONNECTIONS: Final = 48
_MAX_PAGES: Final = 16
"""Maximum number of pages that are open at the same time."""
_READ_WITHIN: Final = 10.0
"""Maximum time (s) for the first request of a connection, and between parts of any request."""
_MAX_FOLDED: Final = 100_000

_PAGE_FILES: Final = {
    "": ("index.html", "text/html"),
    "preview.js": ("preview.js", "text/javascript"),
    "preview.css": ("preview.css", "text/css"),
}
_HEADERS: Final = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}


class RequestError(Exception):
    """A request is answered with *status* and a message."""

    def __init__(self, status: HTTPStatus, message: str) -> None:
        super().__init__(message)
        self.status = status


class PreviewServer(ThreadingHTTPServer):
    """Serves the page of a preview. Use it in a `with` statement, and call `serve_forever` in a thread.

    Args:
        session: The state of the preview.
        port: The TCP port; 0 chooses a free port.

    Raises:
        OSError: The port is in use.
    """

    daemon_threads = True
    # On Windows another process could then listen on the same port.
    allow_reuse_address = os.name == "posix"
    block_on_close = False
    request_queue_size = 32

    def __init__(self, session: PreviewSession, port: int = 0) -> None:
        self.session = session
        self.token = secrets.token_urlsafe(24)
        self.pages = threading.Semaphore(_MAX_PAGES)
        self._connections = threading.Semaphore(_MAX_CONNECTIONS)
        super().__init__((_HOST, port), _Handler)
        number = self.server_address[1]
        self.hosts = (f"{_HOST}:{number}", f"localhost:{number}")
        self.page_files = {
            name: (_page_file(file), f"{content_type}; charset=utf-8")
            for name, (file, content_type) in _PAGE_FILES.items()
        }

    @property
    def url(self) -> str:
        """The address of the page, with its token."""
        return f"http://{self.hosts[0]}/{self.token}/"

    def process_request(self, request: Any, client_address: Any) -> None:
        """Handle a connection in a thread, or close it if there are too many."""
        if not self._connections.acquire(blocking=False):
            self.shutdown_request(request)
            return
        try:
            super().process_request(request, client_address)
        except BaseException:
            self._connections.release()
            raise

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Handle a connection, and free its place."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._connections.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore connections that break; other errors are answered by the handler."""


def _page_file(name: str) -> bytes:
    data = (files("btcore_studio.preview") / "page" / name).read_bytes()
    return drawing_style().encode() + data if name == "preview.css" else data


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server_version = "btcore"
    sys_version = ""
    timeout = _READ_WITHIN
    disable_nagle_algorithm = True

    def setup(self) -> None:
        super().setup()
        # A stranger who sends a request byte by byte would otherwise keep the connection for hours.
        self._limit = threading.Timer(_READ_WITHIN, self._break_off)
        self._limit.daemon = True
        self._limit.start()

    def finish(self) -> None:
        self._limit.cancel()
        with suppress(OSError):
            super().finish()

    def _break_off(self) -> None:
        with suppress(OSError):
            self.connection.shutdown(socket.SHUT_RDWR)

    def log_message(self, format: str, *args: Any) -> None:
        """Write no log: it would contain the token."""

    def do_GET(self) -> None:
        """Answer with a file of the page, or with the events."""
        self._answer(self._get)

    def do_POST(self) -> None:
        """Execute an action of the page."""
        self._answer(self._post)

    def _answer(self, action: Callable[[PreviewServer, str], None]) -> None:
        try:
            try:
                server = cast(PreviewServer, self.server)
                action(server, self._checked_path(server))
            except RequestError as error:
                self.close_connection = True
                self._send_json({"error": str(error)}, error.status)
            except BtcoreError as error:
                self._send_json({"error": str(error)}, HTTPStatus.CONFLICT)
            except (ValueError, RecursionError) as error:
                self.close_connection = True
                self._send_json({"error": f"invalid request: {error}"}, HTTPStatus.BAD_REQUEST)
            except OSError:
                raise
            except Exception as error:
                # Without an answer, the page would report that this process has ended.
                self.close_connection = True
                message = f"internal error (please report it): {error!r}"
                self._send_json({"error": message}, HTTPStatus.INTERNAL_SERVER_ERROR)
        except OSError:
            self.close_connection = True  # the page was closed

    def _checked_path(self, server: PreviewServer) -> str:
        """Return the path after the token. Raise RequestError if the request is not from the page."""
        token, slash, name = self.path.removeprefix("/").partition("/")
        if not hmac.compare_digest(token.encode("latin-1", "replace"), server.token.encode()) or not slash:
            raise RequestError(HTTPStatus.NOT_FOUND, "not found")
        # The name of a foreign site that resolves to this machine would make it the same origin.
        hosts = self.headers.get_all("Host", [])
        if len(hosts) != 1 or hosts[0] not in server.hosts:
            raise RequestError(HTTPStatus.MISDIRECTED_REQUEST, "wrong Host")
        origin = self.headers.get("Origin")
        if origin is not None and origin not in (f"http://{host}" for host in server.hosts):
            raise RequestError(HTTPStatus.FORBIDDEN, "wrong Origin")
        # Only the page itself can be opened by a link.
        if name and self.headers.get("Sec-Fetch-Site", "none") not in ("none", "same-origin"):
            raise RequestError(HTTPStatus.FORBIDDEN, "request of another site")
        self._limit.cancel()
        return name

    def _get(self, server: PreviewServer, name: str) -> None:
        if name == "events":
            self._send_events(server)
        elif name == "drawing":
            self._send(server.session.drawing(None, ()), "application/json")
        elif name in server.page_files:
            self._send(*server.page_files[name])
        else:
            raise RequestError(HTTPStatus.NOT_FOUND, "not found")

    def _post(self, server: PreviewServer, name: str) -> None:
        session, body = server.session, self._body()
        if name == "drawing":
            tree, folded = body.get("tree"), _texts(body.get("folded", []))
            text = tree if isinstance(tree, str) else None
            self._send(session.drawing(text, folded, bool(body.get("styled"))), "application/json")
            return
        if name == "moment":
            position = body.get("position")
            moment = session.moment(position) if isinstance(position, int) else None
            if moment is None:
                raise RequestError(HTTPStatus.BAD_REQUEST, "expected a position in a recording")
            self._send_json(moment)
            return
        if name == "text":
            session.show_text(None if body.get("text") is None else str(body["text"]))
        elif name == "watch":
            session.watch(str(body.get("address", ""))[:300])
        elif name == "breakpoints":
            session.set_breakpoints(_texts(body.get("keys")))
        elif name == "release":
            session.release()
        else:
            raise RequestError(HTTPStatus.NOT_FOUND, "not found")
        self._send_json({})

    def _body(self) -> dict[str, Any]:
        """Return the JSON object in the request."""
        if self.headers.get_content_type() != "application/json":
            raise RequestError(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "expected application/json")
        length = self.headers.get("Content-Length", "")
        if not (length.isascii() and length.isdigit() and len(length) < 12):
            raise RequestError(HTTPStatus.LENGTH_REQUIRED, "expected Content-Length")
        if int(length) > _MAX_BODY:
            raise RequestError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "the request is too large")
        value = load_json(self.rfile.read(int(length)).decode())
        if not isinstance(value, dict):
            raise RequestError(HTTPStatus.BAD_REQUEST, "expected a JSON object")
        return value

    def _send_events(self, server: PreviewServer) -> None:
        """Send events until the page is closed."""
        if not server.pages.acquire(blocking=False):
            raise RequestError(HTTPStatus.SERVICE_UNAVAILABLE, "too many pages are open")
        try:
            self.close_connection = True
            self._send_head("text/event-stream", None)
            for event in server.session.events():
                text = ":\n\n" if event is None else f"event: {event[0]}\ndata: {json.dumps(event[1])}\n\n"
                self.wfile.write(text.encode())
        finally:
            server.pages.release()

    def _send_json(self, value: object, status: HTTPStatus = HTTPStatus.OK) -> None:
        self._send(json.dumps(value).encode(), "application/json", status)

    def _send(self, data: bytes, content_type: str, status: HTTPStatus = HTTPStatus.OK) -> None:
        self._send_head(content_type, len(data), status)
        self.wfile.write(data)

    def _send_head(self, content_type: str, length: int | None, status: HTTPStatus = HTTPStatus.OK) -> None:
        self.send_response(status)
        self.send_header("Content-Type", content_type)
        if length is not None:
            self.send_header("Content-Length", str(length))
        for name, value in _HEADERS.items():
            self.send_header(name, value)
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()


def _texts(value: object) -> list[str]:
    """Return *value*, which must be a list of texts."""
    if isinstance(value, list) and len(value) <= _MAX_FOLDED and all(isinstance(item, str) for item in value):
        return value
    raise RequestError(HTTPStatus.BAD_REQUEST, "expected a list of texts")
