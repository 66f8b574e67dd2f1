"""The studio's server answers its own page only, within limits."""

import asyncio
import json
import socket
from contextlib import ExitStack, suppress
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from btcore_studio.language.server import TreeServer, create_server
from btcore_studio.page_server import server as server_module
from btcore_studio.page_server import session as session_module
from btcore_studio.page_server.session import Shown, Version
from tests.tools.btcore_studio.page_server.conftest import TREE, PageClient, Studio, running_studio

METHOD_NOT_FOUND, INVALID_PARAMS, REFUSED = -32601, -32602, -32803


def get(
    studio: Studio, path: str, headers: dict[str, str] | None = None, method: str = "GET"
) -> tuple[int, bytes, dict[str, str]]:
    connection = HTTPConnection(studio.host, timeout=90)
    connection.request(method, path, headers=headers or {})
    reply = connection.getresponse()
    answer = reply.status, reply.read(), dict(reply.getheaders())
    connection.close()
    return answer


def status_of_socket(studio: Studio, path: str = "{token}/socket", **options: Any) -> int:
    """Return the status of a handshake that is refused, and 101 if it is accepted."""
    url = f"ws://{studio.host}/{path.replace('{token}', studio.server.token)}"
    try:
        with connect(url, **{"origin": f"http://{studio.host}", "compression": None, **options}):
            return 101
    except InvalidStatus as error:
        return error.response.status_code


# --- requests


def test_page_and_its_files_come_with_a_strict_policy(studio: Studio) -> None:
    for name in ("", "studio.js", "studio.css"):
        status, data, headers = get(studio, f"/{studio.server.token}/{name}")
        assert status == 200
        assert data
        policy = headers["Content-Security-Policy"]
        assert "default-src 'none'; script-src 'self'; style-src 'self'; " in policy
        assert "unsafe" not in policy
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert headers["Cache-Control"] == "no-store"


@pytest.mark.parametrize(
    "path",
    [
        "/",
        "//studio.js",
        "/x/studio.js",
        "/{token}",
        "/{token}x/",
        "/{token}/../page/studio.js",
        "/{token}/..%2Fpyproject.toml",
        "/{token}/notes.txt",
        "/{token}/index.html",
        "/{token}/?x",
        "/%00/",
    ],
)
def test_wrong_path_is_not_found(studio: Studio, path: str) -> None:
    assert get(studio, path.replace("{token}", studio.server.token))[0] == 404


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Host": "evil.example"}, 421),
        ({"Host": "127.0.0.1"}, 421),
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Sec-Fetch-Site": "cross-site"}, 403),
        ({"Sec-Fetch-Site": "same-site"}, 403),
        ({"Sec-Fetch-Site": "same-origin"}, 200),
    ],
)
def test_request_of_another_origin_is_refused(studio: Studio, headers: dict[str, str], status: int) -> None:
    assert get(studio, f"/{studio.server.token}/studio.js", headers)[0] == status


@pytest.mark.parametrize(
    ("options", "status"),
    [
        ({}, 101),
        ({"path": "{token}x/socket"}, 404),
        ({"path": "{token}/"}, 200),
        ({"origin": None}, 403),
        ({"origin": "null"}, 403),
        ({"origin": "http://evil.example"}, 403),
        ({"origin": "https://127.0.0.1"}, 403),
        ({"additional_headers": {"Sec-Fetch-Site": "cross-site"}}, 403),
        ({"additional_headers": {"Sec-Fetch-Site": "same-origin"}}, 101),
        ({"additional_headers": {"Host": "evil.example"}}, 421),
    ],
)
def test_socket_of_another_origin_is_refused(studio: Studio, options: dict[str, Any], status: int) -> None:
    assert status_of_socket(studio, **options) == status


def test_methods_and_sizes_are_limited(studio: Studio) -> None:
    path = f"/{studio.server.token}/studio.js"
    for method in ("POST", "PUT", "HEAD", "DELETE"):
        assert get(studio, path, method=method)[0] == 405
    assert get(studio, "/" + 70_000 * "a")[0] == 414
    assert get(studio, path, {"X": 70_000 * "a"})[0] == 431
    assert get(studio, path.replace("studio.js", "socket"), {"Origin": f"http://{studio.host}"})[0] == 426


def test_slow_connections_block_no_page(studio: Studio) -> None:
    address = studio.host.split(":")
    with ExitStack() as opened:
        slow = []
        for _ in range(1_000):
            connection = opened.enter_context(socket.create_connection((address[0], int(address[1])), 90))
            slow.append(connection)
            with suppress(ConnectionError):
                connection.sendall(b"GET / HT")
        assert get(studio, f"/{studio.server.token}/")[0] == 200
        with studio.page() as page:
            assert page.request("btcore/start")["readOnly"] is False
        # All but the last were closed.
        for connection in slow[:900]:
            with suppress(ConnectionResetError):
                assert connection.recv(1) == b""


def test_connection_without_a_request_is_closed(studio: Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    # The limit of the running server is fixed; that of the handshake is what the server was given.
    assert server_module._REQUEST_WITHIN == 10
    host, port = studio.host.split(":")
    with socket.create_connection((host, int(port)), 90) as slow:
        slow.sendall(b"GET / HTTP/1.1\r\n")
        assert slow.recv(1) == b""


def test_number_of_pages_is_limited(studio: Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server_module, "_MAX_PAGES", 2)
    with studio.page() as page, studio.page():
        assert status_of_socket(studio) == 503
        page.request("btcore/start")
    with studio.page() as page:
        page.request("btcore/start")


# --- messages


@pytest.mark.parametrize(
    "message",
    [
        "",
        "{",
        "[]",
        "null",
        "[" * 100_000,
        '{"a":' * 200 + "1" + "}" * 200,
        '{"id": 1}',
        '{"jsonrpc": "1.0", "id": 1, "method": "btcore/start"}',
        '{"jsonrpc": "2.0", "id": {}, "method": "btcore/start"}',
        '{"jsonrpc": "2.0", "id": [1], "method": "btcore/start"}',
        '{"jsonrpc": "2.0", "id": true, "method": "btcore/start"}',
        '[{"jsonrpc": "2.0", "id": 1, "method": "btcore/start"}]',
        b"\xff\x00",
    ],
)
def test_invalid_message_is_refused(studio: Studio, message: str | bytes) -> None:
    with studio.page() as page:
        page.send(message)
        assert page.receive()["error"]["code"] in (-32700, -32600)
        assert page.request("btcore/start")["tree"] is None


@pytest.mark.parametrize(
    "method",
    [
        "exit",
        "shutdown",
        "workspace/executeCommand",
        "workspace/didChangeConfiguration",
        "workspace/didChangeWorkspaceFolders",
        "workspace/didChangeWatchedFiles",
        "notebookDocument/didOpen",
        "btcore/unknown",
        "textDocument/unknown",
        "__class__",
        "",
        "$/setTrace",
    ],
)
def test_unknown_method_is_refused(studio: Studio, method: str) -> None:
    with studio.page() as page:
        assert page.error(method)[0] == METHOD_NOT_FOUND
        page.send({"jsonrpc": "2.0", "method": method, "params": {}})
        page.request("btcore/start")


@pytest.mark.parametrize("method", [None, 1, {}, [], ["exit"]])
def test_method_that_is_no_text_is_refused(studio: Studio, method: object) -> None:
    with studio.page() as page:
        page.send({"jsonrpc": "2.0", "id": 99, "method": method, "params": {}})
        assert page.receive()["error"]["code"] == METHOD_NOT_FOUND
        page.request("btcore/start")


def test_message_inside_a_message_is_not_executed(studio: Studio) -> None:
    with studio.page() as page:
        initialize(page)
        inner = {"jsonrpc": "2.0", "id": 77, "method": "exit", "params": None}
        reply = page.reply_to("textDocument/hover", {"textDocument": inner, "position": inner, "x": [inner]})
        assert reply["error"]["code"] == INVALID_PARAMS
        page.request("btcore/start")
        assert all(message.get("id") != 77 for message in page.notifications)


def test_replies_to_requests_that_were_never_sent(studio: Studio) -> None:
    with studio.page() as page:
        initialize(page)
        for reply in ({"result": {}}, {"error": {"code": 1, "message": "x"}}, {"error": 3}, {}):
            page.send({"jsonrpc": "2.0", "id": "stranger", **reply})
        page.request("btcore/start")


def test_large_message_closes_its_page_only(studio: Studio) -> None:
    with studio.page() as other:
        with studio.page() as page:
            with suppress(ConnectionClosed):
                page.send(" " * (17 << 20))
            with pytest.raises(ConnectionClosed):
                page.receive()
            assert page.socket.close_code == 1009
        other.request("btcore/start")


def test_page_that_reads_nothing_is_closed(studio: Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session_module, "_MAX_WAITING", 1 << 20)
    (studio.folder / "large.xml").write_text("<root>" + " " * (1 << 20) + "</root>")

    def request_much(page: PageClient) -> None:
        for number in range(1_000):
            request = {"jsonrpc": "2.0", "id": number, "method": "btcore/read"}
            page.send({**request, "params": {"uri": studio.uri("large.xml")}})
        while True:
            page.receive()

    with studio.page() as page, pytest.raises(ConnectionClosed):
        request_much(page)


@pytest.mark.parametrize("params", [None, [], {}, {"uri": 1}, {"uri": None}])
def test_invalid_parameters_are_refused(studio: Studio, params: object) -> None:
    with studio.page() as page:
        for method in ("btcore/read", "btcore/push", "btcore/save", "btcore/create", "btcore/resolve"):
            page.send({"jsonrpc": "2.0", "id": 1, "method": method, "params": params})
            assert page.receive()["error"]["code"] == INVALID_PARAMS


# --- the language server of a page


def initialize(page: PageClient, **params: Any) -> None:
    page.request("initialize", {"processId": None, "rootUri": None, "capabilities": {}, **params})
    page.send({"jsonrpc": "2.0", "method": "initialized", "params": {}})


def open_document(page: PageClient, uri: str, text: str) -> None:
    document = {"uri": uri, "languageId": "xml", "version": 1, "text": text}
    params = {"textDocument": document}
    page.send({"jsonrpc": "2.0", "method": "textDocument/didOpen", "params": params})


def test_language_server_checks_the_text_of_its_page(studio: Studio) -> None:
    uri = studio.uri("tree.xml")
    with studio.page() as page, studio.page() as other:
        for each, text in ((page, TREE.replace("AlwaysSuccess", "AlwaysSucess")), (other, TREE)):
            initialize(each)
            open_document(each, uri, text)
        diagnostics = page.notification("textDocument/publishDiagnostics")["diagnostics"]
        assert "AlwaysSucess" in diagnostics[0]["message"]
        assert other.notification("textDocument/publishDiagnostics")["diagnostics"] == []


def test_language_server_ends_with_its_page(studio: Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    servers = []

    def create(live: Any) -> TreeServer:
        servers.append(create_server(live))
        return servers[-1]

    monkeypatch.setattr(session_module, "create_server", create)
    with studio.page() as page:
        initialize(page)
        open_document(page, studio.uri("tree.xml"), TREE)
        page.notification("textDocument/publishDiagnostics")
        process = servers[0].checker._worker._process._process
        assert process.returncode is None
    with studio.page() as page:  # its messages come after the end of the first page
        page.request("btcore/start")
        while process.returncode is None:
            page.request("btcore/start")


def test_page_cannot_choose_what_is_imported(studio: Studio, tmp_path: Path) -> None:
    (tmp_path / "evil.py").write_text(f"open({str(tmp_path / 'imported')!r}, 'w')\n")
    outside = tmp_path.as_uri()
    with studio.page() as page:
        initialize(
            page,
            rootUri=outside,
            workspaceFolders=[{"uri": outside, "name": "x"}],
            initializationOptions={"trusted": True, "plugins": [str(tmp_path / "evil.py")]},
        )
        settings = {"btcore": {"trusted": True, "plugins": [str(tmp_path / "evil.py")]}}
        assert page.error("workspace/didChangeConfiguration", {"settings": settings})[0] == METHOD_NOT_FOUND
        open_document(page, studio.uri("tree.xml"), TREE)
        page.notification("textDocument/publishDiagnostics")
    assert not (tmp_path / "imported").exists()


@pytest.mark.parametrize("where", ["textDocument", "command", "nodes"])
def test_document_outside_of_the_folder_is_refused(studio: Studio, tmp_path: Path, where: str) -> None:
    (tmp_path / "secret.xml").write_text(TREE)
    with studio.page() as page:
        initialize(page)
        for uri in ((tmp_path / "secret.xml").as_uri(), "file:///etc/passwd", "untitled:1", "http://x/y.xml"):
            inner = {"uri": uri, "position": {"line": 0, "character": 0}}
            params = {
                "textDocument": {where: inner, **inner},
                "command": {"command": {"kind": "remove", "nodes": [inner]}},
                "nodes": {"nodes": [inner]},
            }[where]
            code, message = page.error("textDocument/hover", params)
            assert (code, "refused" in message) == (REFUSED, True)


def test_xml_bomb_and_includes_of_system_files(studio: Studio) -> None:
    (studio.folder / "secret.txt").write_text("the secret\n")
    entities = "".join(f'<!ENTITY a{i} "&a{i - 1};&a{i - 1};">' for i in range(1, 60))
    bomb = f'<!DOCTYPE root [<!ENTITY a0 "ha">{entities}]><root BTCPP_format="4">&a59;</root>'
    external = '<!DOCTYPE root [<!ENTITY x SYSTEM "secret.txt">]><root BTCPP_format="4">&x;</root>'
    include = TREE.replace("\n", '\n  <include path="/etc/hostname"/>\n  <include path="/dev/zero"/>\n', 1)
    include = include.replace("\n", '\n  <include path="secret.txt"/>\n', 1)
    with studio.page() as page:
        initialize(page)
        for number, text in enumerate((bomb, external, include)):
            name = f"hostile{number}.xml"
            uri = page.request("btcore/create", {"name": name, "text": text})["uri"]
            open_document(page, uri, text)
            report = json.dumps(page.notification("textDocument/publishDiagnostics"))
            while uri not in report:
                report = json.dumps(page.notification("textDocument/publishDiagnostics"))
            assert '"severity": 1' in report
            assert "the secret" not in report
            page.reply_to("textDocument/documentSymbol", {"textDocument": {"uri": uri}})


def test_change_on_disk_reaches_the_language_server(studio: Studio) -> None:
    text = TREE.replace("<AlwaysSuccess/>", '<SubTree ID="Visit"/>').replace(
        "\n", '\n  <include path="part.xml"/>\n', 1
    )
    with studio.page() as page:
        initialize(page)
        (studio.folder / "part.xml").write_text(TREE.replace("Rounds", "Visit"))
        assert page.notification("btcore/files")
        open_document(page, studio.uri("tree.xml"), text)

        def messages() -> list[str]:
            while True:
                report = page.notification("textDocument/publishDiagnostics")
                if report["uri"] == studio.uri("tree.xml"):
                    return [item["message"] for item in report["diagnostics"]]

        assert messages() == []
        (studio.folder / "part.xml").unlink()
        assert any("part.xml" in message for message in messages())
        assert page.notification("btcore/files")


def test_comparison_shows_two_files_alone_until_its_page_is_closed(
    folder: Path, built: Path, previous: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session_module, "CLOSE_WAIT_S", 0.05)
    empty = tmp_path / "empty"
    empty.mkdir()
    file = folder / "tree.xml"
    versions = Version("", None), Version("tree.xml", file)
    with running_studio(Shown(empty, versions=versions, is_read_only=True), previous, built) as studio:
        with studio.page() as page:
            assert page.request("btcore/start")["versions"] == ["", "tree.xml"]
            initialize(page)
            (difference,) = page.request("btcore/comparison")["differences"]
            assert (difference["changes"], difference["name"]) == (["added"], "Rounds")
            for method in ("btcore/read", "btcore/drawing"):
                params = {"uri": file.as_uri(), "textDocument": {"uri": file.as_uri()}}
                assert "refused" in page.error(method, params)[1]
            file.write_text(TREE.replace("Rounds", "Laps"))
            page.notification("btcore/compared")
            assert page.request("btcore/comparison", {"tree": "Rounds"})["tree"] == "Laps"
            file.unlink()
            assert "can't be read" in page.error("btcore/comparison")[1]
            assert not studio.session.ended.is_set()
        asyncio.run_coroutine_threadsafe(studio.session.ended.wait(), studio.loop).result(10)
