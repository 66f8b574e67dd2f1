"""The preview's server answers its own page only, within limits."""

import json
import socket
from contextlib import suppress
from http.client import HTTPConnection
from typing import Any

import pytest

from btcore_studio.preview import server as server_module
from btcore_studio.preview.server import PreviewServer

JSON = {"Content-Type": "application/json"}


def request(
    server: PreviewServer, method: str, path: str, body: Any = None, headers: dict[str, str] | None = None
) -> tuple[int, bytes, dict[str, str]]:
    connection = HTTPConnection("127.0.0.1", server.server_address[1], timeout=90)
    data = body if isinstance(body, bytes | None) else json.dumps(body).encode()
    connection.request(method, path, data, headers or {})
    reply = connection.getresponse()
    answer = reply.status, reply.read(), dict(reply.getheaders())
    connection.close()
    return answer


def test_page_and_its_files_come_with_a_strict_policy(server: PreviewServer) -> None:
    for name in ("", "preview.js", "preview.css"):
        status, data, headers = request(server, "GET", f"/{server.token}/{name}")
        assert status == 200
        assert data
        policy = headers["Content-Security-Policy"]
        assert "default-src 'none'; script-src 'self'" in policy
        assert "unsafe" not in policy
        assert headers["X-Content-Type-Options"] == "nosniff"
        # Nothing comes from the internet; the namespaces are not fetched.
        assert b"https://" not in data
    assert b"onclick=" not in request(server, "GET", f"/{server.token}/")[1]


def test_drawing_of_the_tree(server: PreviewServer) -> None:
    status, data, _ = request(server, "POST", f"/{server.token}/drawing", {"folded": []}, JSON)
    assert status == 200
    assert len(json.loads(data)["nodes"]) == 9


def test_internal_error_is_answered(server: PreviewServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server.session, "drawing", lambda *arguments: [][0])
    status, data, _ = request(server, "POST", f"/{server.token}/drawing", {"folded": []}, JSON)
    assert (status, "internal error" in json.loads(data)["error"]) == (500, True)


@pytest.mark.parametrize(
    "path", ["/", "//drawing", "/x/drawing", "/{token}", "/{token}/../session.py", "/{token}x/"]
)
def test_wrong_path_is_not_found(server: PreviewServer, path: str) -> None:
    path = path.replace("{token}", server.token)
    assert request(server, "GET", path)[0] == 404
    assert request(server, "POST", path, {}, JSON)[0] == 404


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Host": "evil.example"}, 421),
        ({"Host": "127.0.0.1"}, 421),
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Sec-Fetch-Site": "cross-site"}, 403),
        ({"Sec-Fetch-Site": "same-site"}, 403),
        ({"Content-Type": "text/plain"}, 415),
    ],
)
def test_request_of_another_origin_changes_nothing(
    server: PreviewServer, headers: dict[str, str], status: int
) -> None:
    path = f"/{server.token}/text"
    assert request(server, "POST", path, {"text": "gone"}, JSON | headers)[0] == status
    assert json.loads(request(server, "POST", f"/{server.token}/drawing", {}, JSON)[1])["nodes"]


@pytest.mark.parametrize(
    ("body", "status"),
    [
        (b"{", 400),
        (b"\xff", 400),
        (b"[]", 400),
        (b'{"folded": [1]}', 400),
        (b'{"folded": {"a": 1}}', 400),
        (b'{"tree": {"a": 1}, "folded": ["x"]}', 200),
    ],
)
def test_invalid_bodies_are_rejected(server: PreviewServer, body: bytes, status: int) -> None:
    assert request(server, "POST", f"/{server.token}/drawing", body, JSON)[0] == status


def test_sizes_and_methods_are_limited(server: PreviewServer) -> None:
    path = f"/{server.token}/text"
    assert request(server, "POST", path, b"", JSON | {"Content-Length": "99999999999"})[0] == 413
    assert request(server, "POST", path, b"", JSON | {"Content-Length": "-1"})[0] == 411
    assert request(server, "GET", "/" + 70_000 * "a")[0] == 414
    assert request(server, "PUT", path, {})[0] == 501


def test_slow_and_superfluous_connections_are_closed(
    server: PreviewServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server_module, "_READ_WITHIN", 0.3)
    place = ("127.0.0.1", server.server_address[1])
    sockets = [socket.create_connection(place, timeout=90) for _ in range(49)]
    for slow in sockets[:-1]:
        with suppress(ConnectionError):  # it was closed before
            slow.sendall(b"GET / HT")
    for closed in sockets:
        with suppress(ConnectionResetError):
            assert closed.recv(1) == b""
        closed.close()


def test_events_begin_with_the_document(server: PreviewServer) -> None:
    connection = HTTPConnection("127.0.0.1", server.server_address[1], timeout=90)
    connection.request("GET", f"/{server.token}/events")
    reply = connection.getresponse()
    assert reply.readline() == b"event: document\n"
    assert json.loads(reply.readline().removeprefix(b"data: "))["drawable"]
    connection.close()


def test_watching_needs_the_monitor(server: PreviewServer) -> None:
    status, data, _ = request(server, "POST", f"/{server.token}/watch", {"address": "1667"}, JSON)
    assert status == 409
    assert "btcore[monitor]" in json.loads(data)["error"]
