"""`btcore lsp`: its end, invalid requests, and the error without its extra."""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator

import pytest
from click.testing import Result


@pytest.mark.parametrize("module", ["pygls", "lsprotocol"])
def test_missing_extra_is_reported_with_the_install_command(
    cli: Callable[..., Result], monkeypatch: pytest.MonkeyPatch, module: str
) -> None:
    """Editors show stderr; stdout belongs to the protocol."""
    monkeypatch.delitem(sys.modules, "btcore_studio.language.server", raising=False)
    monkeypatch.setitem(sys.modules, module, None)  # Python's mark for a module that is missing
    result = cli("lsp")
    assert result.exit_code == 2
    assert result.stdout == ""
    text = " ".join(result.stderr.split())
    assert "'lsp' requires an optional dependency: the module '" in text  # others may be missing, too
    assert "pip install 'btcore[lsp]'" in text


def message(method: str, params: object = None, number: int | None = None) -> bytes:
    """The bytes of a request, or of a notification without *number*."""
    fields = {"jsonrpc": "2.0", "method": method, "params": params, "id": number}
    body = json.dumps({name: value for name, value in fields.items() if value is not None}).encode()
    return b"Content-Length: %d\r\n\r\n" % len(body) + body


def replies(output: bytes) -> Iterator[dict[str, object]]:
    """The messages with an ID in the output of the server."""
    for part in output.split(b"Content-Length: ")[1:]:
        data = json.loads(part.partition(b"\r\n\r\n")[2])
        if "id" in data and "method" not in data:
            yield data


def document() -> dict[str, object]:
    xml = '<root BTCPP_format="4"><BehaviorTree ID="M"><Sequence>{}</Sequence></BehaviorTree></root>'
    text = xml.format("<AlwaysSuccess/>" * 5_000)  # its check takes some time
    return {"uri": "untitled:a.xml", "languageId": "xml", "version": 1, "text": text}


@pytest.mark.parametrize("when", ["at once", "during a check"])
def test_the_server_answers_shutdown_and_invalid_requests_without_a_traceback(when: str) -> None:
    pytest.importorskip("pygls")
    place = {"textDocument": {"uri": "untitled:a.xml"}, "position": {"line": -1, "character": 0}}
    first = [
        message("initialize", {"capabilities": {}, "processId": None, "rootUri": None}, 1),
        message("initialized", {}),
        message("textDocument/didOpen", {"textDocument": document()}),
        message("textDocument/hover", place, 2),
    ]
    last = [message("shutdown", number=3), message("exit")]
    with subprocess.Popen(
        [sys.executable, "-m", "btcore", "lsp"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as server:
        assert server.stdin is not None
        assert server.stdout is not None
        assert server.stderr is not None
        server.stdin.write(b"".join(first))
        server.stdin.flush()
        output = b""
        while when == "during a check" and b'"id": 1' not in output:
            output += server.stdout.read1()
        server.stdin.write(b"".join(last))
        server.stdin.flush()
        output += server.stdout.read()
        errors = server.stderr.read().decode()
    answers = {reply["id"]: reply for reply in replies(output)}
    assert answers[2]["error"] == {
        "code": -32602,
        "message": "the parameters of textDocument/hover are invalid",
    }
    assert answers[3]["result"] is None
    assert "Traceback" not in errors
    assert server.returncode == 0


@pytest.mark.parametrize("last", [message("exit"), b""], ids=["exit", "end of input"])
def test_the_exit_code_is_1_without_a_request_for_the_end(last: bytes) -> None:
    pytest.importorskip("pygls")
    first = message("initialize", {"capabilities": {}, "processId": None, "rootUri": None}, 1)
    done = subprocess.run(
        [sys.executable, "-m", "btcore", "lsp"], input=first + last, capture_output=True, check=False
    )
    assert (done.returncode, done.stderr) == (1, b"")
