"""Request what a page requests of files, and print the replies: `session_requests.py MODELS FILE …`.

The script runs in Pyodide, where it writes the models of the site into the file MODELS, and then here with
these models. The results are compared.
"""

import asyncio
import json
import shutil
import sys
from pathlib import Path
from typing import Any

from btcore_studio.site.session import MODELS, SiteSession

FOLDER = "file:///studio"
CAPABILITIES = {
    "textDocument": {
        "codeAction": {"codeActionLiteralSupport": {"codeActionKind": {"valueSet": ["quickfix"]}}},
        "completion": {"completionItem": {"snippetSupport": True, "documentationFormat": ["markdown"]}},
        "hover": {"contentFormat": ["markdown"]},
    }
}
PLACES = 6
"""The number of nodes of each file whose forms, descriptions and completions are requested."""


class Page:
    """The page's side of a session."""

    def __init__(self, models: Path | None) -> None:
        self.session = SiteSession(self.receive, models)
        self.replies: dict[int, Any] = {}
        self.problems: dict[str, Any] = {}
        self.changed = asyncio.Event()
        self.last = 0

    def receive(self, text: str) -> None:
        message = json.loads(text)
        if message.get("method") == "textDocument/publishDiagnostics":
            self.problems[message["params"]["uri"]] = message["params"]["diagnostics"]
        elif "method" not in message:
            self.replies[message["id"]] = message.get("result", message.get("error"))
        self.changed.set()

    def notify(self, method: str, params: object) -> None:
        self.session.receive(json.dumps({"jsonrpc": "2.0", "method": method, "params": params}))

    async def request(self, method: str, params: object) -> Any:
        self.last += 1
        self.session.receive(
            json.dumps({"jsonrpc": "2.0", "id": self.last, "method": method, "params": params})
        )
        await self.until(self.replies, self.last)
        return self.replies.pop(self.last)

    async def until(self, found: dict[Any, Any], key: object) -> None:
        while key not in found:
            self.changed.clear()
            await asyncio.wait_for(self.changed.wait(), 60)


async def requested(page: Page, uri: str) -> list[Any]:
    """Return the replies about an open document."""
    document = {"textDocument": {"uri": uri}}
    await page.until(page.problems, uri)
    drawing = await page.request("btcore/drawing", {**document, "tree": None, "folded": [], "call": ""})
    replies = [page.problems[uri], drawing]
    for method in ("btcore/palette", "textDocument/documentSymbol", "textDocument/foldingRange"):
        replies.append(await page.request(method, document))
    replies.append(await page.request("textDocument/semanticTokens/full", document))
    options = {"tabSize": 2, "insertSpaces": True}
    replies.append(await page.request("textDocument/formatting", {**document, "options": options}))
    for problem in page.problems[uri][:PLACES]:
        params = {**document, "range": problem["range"], "context": {"diagnostics": [problem]}}
        replies.append(await page.request("textDocument/codeAction", params))
    for node in drawing["nodes"][:PLACES]:
        place = node["place"]
        at = {**document, "position": {**place["position"], "character": place["position"]["character"] + 2}}
        replies.append(await page.request("btcore/node", place))
        for method in ("textDocument/hover", "textDocument/completion", "textDocument/definition"):
            replies.append(await page.request(method, at))
        for command in (
            {"kind": "remove", "nodes": [place]},
            {"kind": "wrap", "nodes": [place], "id": "Inverter"},
            {"kind": "disable", "nodes": [place]},
        ):
            replies.append(await page.request("btcore/edit", {"command": command}))
            replies.append(await page.request("btcore/preview", {"command": command}))
        replies.append(await page.request("btcore/copy", {"nodes": [place]}))
    return replies


async def main(arguments: list[str]) -> int:
    """Print the replies about each file as a line of JSON, and return the exit code."""
    models = Path(arguments[0])
    if not models.exists():
        shutil.copy(MODELS, models)
    page = Page(models)
    folders = [{"uri": FOLDER, "name": "studio"}]
    await page.request("initialize", {"capabilities": CAPABILITIES, "workspaceFolders": folders})
    page.notify("initialized", {})
    for name in arguments[1:]:
        uri = f"{FOLDER}/{name}"
        text = Path(name).read_bytes().decode()
        document = {"uri": uri, "languageId": "behaviortree", "version": 1, "text": text}
        page.notify("textDocument/didOpen", {"textDocument": document})
        print(json.dumps([name, await requested(page, uri)], sort_keys=True))
        page.notify("textDocument/didClose", {"textDocument": {"uri": uri}})
    return 0


if __name__ == "__main__":
    sys.exit(asyncio.run(main(sys.argv[1:])))
