"""The web server of the studio, for this machine and for those who know its token.

Every request needs the token in its path, and the server's own address as its Host. A page of another origin
can therefore neither read nor change anything, even if it guesses the port. All sizes and times are bounded.
"""

import asyncio
import hmac
import json
import logging
import os
import secrets
from collections.abc import Callable, Mapping
from http import HTTPStatus
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import PurePath
from typing import Final, Self

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from btcore_drawing.svg import drawing_style
from btcore_studio.page_server.session import StudioSession

_HOST: Final = "127.0.0.1"
_SOCKET: Final = "socket"
"""The name of the WebSocket below the token."""
_MAX_MESSAGE: Final = 16 << 20
"""Maximum bytes of a message: the text of a document."""
_MAX_CONNECTIONS: Final = 48
"""Maximum number of connections that are no open page; the oldest is closed for a new one."""
_MAX_PAGES: Final = 16
"""Maximum number of pages that are open at the same time."""
_REQUEST_WITHIN: Final = 10.0
"""Maximum time (s) for the first request of a connection and its reply."""
_CLOSE_WITHIN: Final = 2.0
"""Maximum time (s) for the end of a connection."""

_TYPES: Final = {
    ".css": "text/css",
    ".html": "text/html",
    ".js": "text/javascript",
    ".map": "application/json",
    ".svg": "image/svg+xml",
    ".woff2": "font/woff2",
}
# CodeMirror has images in data: URLs, and the export of a picture has one in a blob: URL.
_POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self' ws://{host}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS: Final = {
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


class StudioServer:
    """Serves the page of a studio. Use it in an `async with` statement.

    Args:
        session: What the pages share.
        port: The TCP port; 0 chooses a free port.
        page: The folder of the built page.

    Raises:
        OSError: The port is in use.
    """

    def __init__(self, session: StudioSession, port: int, page: Traversable) -> None:
        self.session = session
        self.token = secrets.token_urlsafe(24)
        self._port = port
        self._page_files = {
            "" if file.name == "index.html" else file.name: file
            for file in page.iterdir()
            if PurePath(file.name).suffix in _TYPES
        }
        self._waiting: dict[ServerConnection, None] = {}
        self._pages: set[ServerConnection] = set()
        self._server: Server
        self._hosts: tuple[str, ...] = ()

    @property
    def url(self) -> str:
        """The address of the page, with its token."""
        return f"http://{self._hosts[0]}/{self.token}/"

    async def __aenter__(self) -> Self:
        # Its messages would contain the token.
        silent = logging.Logger("btcore.studio", logging.CRITICAL + 1)
        self._server = await serve(
            self._serve_page,
            _HOST,
            self._port,
            process_request=self._process,
            create_connection=_counted_connection(self._admit, self._forget),
            compression=None,
            server_header=None,
            open_timeout=_REQUEST_WITHIN,
            close_timeout=_CLOSE_WITHIN,
            max_size=_MAX_MESSAGE,
            logger=silent,
            # On Windows another process could otherwise listen on the same port.
            reuse_address=os.name == "posix",
        )
        number = self._server.sockets[0].getsockname()[1]
        self._hosts = (f"{_HOST}:{number}", f"localhost:{number}")
        return self

    async def __aexit__(self, *error: object) -> None:
        for connection in self._waiting:
            connection.transport.abort()
        self._server.close()
        await self._server.wait_closed()

    # --- connections

    def _admit(self, connection: ServerConnection) -> None:
        """Count a new connection. A stranger with many slow connections keeps none, and blocks no page."""
        self._waiting[connection] = None
        if len(self._waiting) > _MAX_CONNECTIONS:
            oldest = next(iter(self._waiting))
            del self._waiting[oldest]
            oldest.transport.abort()

    def _forget(self, connection: ServerConnection) -> None:
        self._waiting.pop(connection, None)
        self._pages.discard(connection)

    # --- requests

    def _process(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return the reply to a request; None accepts the WebSocket of a page."""
        try:
            name, host = self._checked_name(request)
            if name != _SOCKET:
                return self._file(name, host)
            if request.headers.get("Origin") is None:
                raise RequestError(HTTPStatus.FORBIDDEN, "the Origin is missing")
            if request.headers.get("Upgrade", "").lower() != "websocket":
                raise RequestError(HTTPStatus.UPGRADE_REQUIRED, "this is a WebSocket")
            if len(self._pages) >= _MAX_PAGES:
                raise RequestError(HTTPStatus.SERVICE_UNAVAILABLE, "too many pages are open")
        except RequestError as error:
            text = json.dumps({"error": str(error)}).encode()
            return _response(error.status, "application/json", text, {})
        # It is closed as a connection that waits if the rest of the request is not that of a WebSocket.
        self._pages.add(connection)
        return None

    def _checked_name(self, request: Request) -> tuple[str, str]:
        """Return the path after the token, and the Host. Raise RequestError if it is not from the page."""
        token, slash, name = request.path.removeprefix("/").partition("/")
        if not hmac.compare_digest(token.encode(), self.token.encode()) or not slash:
            raise RequestError(HTTPStatus.NOT_FOUND, "not found")
        if request.method != "GET":
            raise RequestError(HTTPStatus.METHOD_NOT_ALLOWED, "expected GET")
        # The name of a foreign site that resolves to this machine would make it the same origin.
        hosts = request.headers.get_all("Host")
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            raise RequestError(HTTPStatus.MISDIRECTED_REQUEST, "wrong Host")
        origins = request.headers.get_all("Origin")
        if any(origin != f"http://{hosts[0]}" for origin in origins):
            raise RequestError(HTTPStatus.FORBIDDEN, "wrong Origin")
        # Only the page itself can be opened by a link.
        sites = request.headers.get_all("Sec-Fetch-Site")
        if name and any(site not in ("none", "same-origin") for site in sites):
            raise RequestError(HTTPStatus.FORBIDDEN, "request of another site")
        return name, hosts[0]

    def _file(self, name: str, host: str) -> Response:
        file = self._page_files.get(name)
        if file is None:
            raise RequestError(HTTPStatus.NOT_FOUND, "not found")
        data = file.read_bytes()
        if name == "studio.css":
            data = drawing_style().encode() + data
        policy = {"Content-Security-Policy": _POLICY.format(host=host)}
        content_type = f"{_TYPES[PurePath(file.name).suffix]}; charset=utf-8"
        return _response(HTTPStatus.OK, content_type, data, policy)

    async def _serve_page(self, connection: ServerConnection) -> None:
        """Serve the WebSocket of a page until it is closed."""
        self._waiting.pop(connection, None)
        await self.session.serve_page(connection)


def built_page() -> Traversable | None:
    """Return the folder of the built page, or None if it is not built."""
    folder = files("btcore_studio") / "page" / "built"
    return folder if (folder / "index.html").is_file() else None


def _response(status: HTTPStatus, content_type: str, body: bytes, more: Mapping[str, str]) -> Response:
    headers = {
        "Content-Type": content_type,
        "Content-Length": str(len(body)),
        "Connection": "close",
        **_HEADERS,
        **more,
    }
    return Response(status.value, status.phrase, Headers(headers), body)


def _counted_connection(
    made: Callable[[ServerConnection], None], lost: Callable[[ServerConnection], None]
) -> type[ServerConnection]:
    """Return the class of connections that call *made* at their start and *lost* at their end."""

    class CountedConnection(ServerConnection):
        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            super().connection_made(transport)
            made(self)

        def connection_lost(self, exc: Exception | None) -> None:
            super().connection_lost(exc)
            lost(self)

    return CountedConnection
