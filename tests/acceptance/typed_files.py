"""Typing: files are typed character by character into the language server, which never fails.

``python tests/acceptance/typed_files.py --files 200`` types files of at most 4 kB: trees of this project and
of others, recorded trees, with non-ASCII names and comments, half of them with mistakes. Each character is an
incremental change of unsaved text, so that the server sees broken XML most of the time. Requests for every
feature are sent in between. In the end the diagnostics are those of `btcore validate`. Every file follows
from its number and the seed: ``--only 17`` types one file again. The script exits with 1 if anything else
happens.
"""

import argparse
import asyncio
import json
import os
import random
import sys
import tempfile
import time
import traceback
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from pathlib import Path

from click.testing import CliRunner
from editor import Editor, position, start_session
from fuzz import corpus, mutate
from lsprotocol import types
from pygls.exceptions import JsonRpcException

from btcore.cli.commands.validate import validate

ROOT = Path(__file__).parents[2]
LIMIT = 4_000
"""The maximum size of a file (bytes)."""
REQUEST_EVERY = 60
"""The number of characters between two requests."""
GREETINGS = ("<!-- Grüße 🤖 -->", "<!-- 你好\n𝄞 -->", "<!-- \u2028 é -->")
# The leaves of the recorded trees, as a node library of the user.
LIBRARY = f"""
import sys

sys.path.append({str(ROOT)!r})
from tests.conformance.recorded_cases import conformance_registry

def register(nodes):
    for manifest in conformance_registry():
        if manifest.id not in nodes:
            nodes.add(manifest.cls, ID=manifest.id)
"""

Mistake = tuple[str, str, str, int, int, int]


@cache
def real_files() -> list[str]:
    """Return the texts of the trees in this repository that are small enough."""
    folders = (ROOT / "trees", ROOT / "tests" / "robot_nodes" / "third_party_trees")
    texts = [path.read_text(encoding="utf-8") for folder in folders for path in sorted(folder.rglob("*.xml"))]
    return [text for text in texts if len(text.encode()) <= LIMIT]


def file_text(seed: int, number: int) -> str:
    """Return the text of a file."""
    rng = random.Random(f"{seed}:{number}")
    if rng.random() < 0.4:
        text = rng.choice(real_files())
    else:
        text = str(rng.choice(corpus("v4_full", "v4_scopes", "v3_full"))["xml"]).replace("><", ">\n<")
    at = text.find(">", rng.randrange(len(text))) + 1
    text = text[:at] + rng.choice(GREETINGS) + text[at:]
    text = text.replace('name="', 'name="Größe 🤖 ', 2)
    if rng.random() < 0.5:
        text = mutate(text, rng)
    return text.encode()[:LIMIT].decode(errors="ignore")


def validate_file(path: Path, library: Path) -> list[Mistake]:
    """Return what `btcore validate` reports about a file."""
    result = CliRunner().invoke(
        validate, [str(path), "--json", "--plugin", str(library)], standalone_mode=False
    )
    if result.exception is not None:
        raise result.exception
    lines = path.read_bytes().decode().replace("\r\n", "\n").replace("\r", "\n").split("\n")
    found = []
    for item in json.loads(result.stdout)["diagnostics"]:
        assert item["file"] == str(path)
        line, column, width = max(0, item["line"] - 1), item["column"], item["width"]
        text = lines[line]
        before, marked = (text[: column - 1], text[column - 1 : column - 1 + width]) if column else ("", text)
        start = len(before.encode("utf-16-le")) // 2
        end = start + max(1, len(marked.encode("utf-16-le")) // 2) if item["line"] else start
        message = item["message"] + (f"\n{item['hint']}" if item["hint"] else "")
        found.append((item["code"], item["severity"], message, line, start, end))
    return sorted(found)


def shown_mistakes(diagnostics: Sequence[types.Diagnostic]) -> list[Mistake]:
    """Return what the editor shows, in the form of `expected`."""
    names = {types.DiagnosticSeverity.Error: "error", types.DiagnosticSeverity.Warning: "warning"}
    return sorted(
        (
            str(item.code),
            names[item.severity or types.DiagnosticSeverity.Hint],
            str(item.message),
            item.range.start.line,
            item.range.start.character,
            item.range.end.character,
        )
        for item in diagnostics
    )


async def request_everything(editor: Editor, uri: str, offset: int, rng: random.Random) -> None:
    """Send a request for each feature at the cursor; a failure of the server raises an exception."""
    text = editor.texts[uri]
    identifier = types.TextDocumentIdentifier(uri)
    at = position(text, offset)
    whole = types.Range(types.Position(0, 0), position(text, len(text)))
    options = types.FormattingOptions(rng.choice((2, 4)), rng.random() < 0.5)
    capabilities = editor.server_capabilities
    wanted = {
        "code_action_provider": lambda: editor.text_document_code_action_async(
            types.CodeActionParams(identifier, whole, types.CodeActionContext([]))
        ),
        "document_formatting_provider": lambda: editor.text_document_formatting_async(
            types.DocumentFormattingParams(identifier, options)
        ),
        "document_range_formatting_provider": lambda: editor.text_document_range_formatting_async(
            types.DocumentRangeFormattingParams(identifier, types.Range(at, at), options)
        ),
        "code_lens_provider": lambda: editor.text_document_code_lens_async(types.CodeLensParams(identifier)),
        "completion_provider": lambda: editor.text_document_completion_async(
            types.CompletionParams(identifier, at)
        ),
        "hover_provider": lambda: editor.text_document_hover_async(types.HoverParams(identifier, at)),
        "inlay_hint_provider": lambda: editor.text_document_inlay_hint_async(
            types.InlayHintParams(identifier, whole)
        ),
        "semantic_tokens_provider": lambda: editor.text_document_semantic_tokens_full_async(
            types.SemanticTokensParams(identifier)
        ),
        "definition_provider": lambda: editor.text_document_definition_async(
            types.DefinitionParams(identifier, at)
        ),
        "references_provider": lambda: editor.text_document_references_async(
            types.ReferenceParams(types.ReferenceContext(True), identifier, at)
        ),
        "rename_provider": lambda: editor.text_document_prepare_rename_async(
            types.PrepareRenameParams(identifier, at)
        ),
        "document_symbol_provider": lambda: editor.text_document_document_symbol_async(
            types.DocumentSymbolParams(identifier)
        ),
        "workspace_symbol_provider": lambda: editor.workspace_symbol_async(types.WorkspaceSymbolParams("a")),
        "folding_range_provider": lambda: editor.text_document_folding_range_async(
            types.FoldingRangeParams(identifier)
        ),
    }
    for name, send in wanted.items():
        if getattr(capabilities, name, None):
            async with asyncio.timeout(60):
                try:
                    await send()
                except JsonRpcException as error:
                    # Not everything can be renamed.
                    if name != "rename_provider" or error.code != types.LSPErrorCodes.RequestFailed.value:
                        raise


async def type_file(editor: Editor, folder: Path, library: Path, seed: int, number: int) -> str:
    """Type a file. Return the difference to `btcore validate`, or ""."""
    rng = random.Random(f"typing:{seed}:{number}")
    text = file_text(seed, number)
    path = folder / f"größe_{number}.xml"
    path.write_text("<root/>", encoding="utf-8")  # what is on disk is not what the editor shows
    uri = editor.open(path, "")
    due = rng.randrange(REQUEST_EVERY)
    for offset, character in enumerate(text):
        editor.replace(uri, offset, offset, character)
        if rng.random() < 0.01:  # a slip of the finger
            editor.replace(uri, offset + 1, offset + 1, rng.choice('<>"{🤖'))
            editor.replace(uri, offset + 1, len(editor.texts[uri]), "")
        if offset == due:
            await request_everything(editor, uri, offset + 1, rng)
            due += rng.randrange(1, 2 * REQUEST_EVERY)
    assert editor.texts[uri] == text
    shown = shown_mistakes(await editor.find_mistakes(uri))
    await request_everything(editor, uri, rng.randint(0, len(text)), rng)
    editor.close(uri)
    path.write_bytes(text.encode())
    wanted = validate_file(path, library)
    return "" if shown == wanted else f"the editor shows {shown}, btcore validate reports {wanted}"


def run(seed: int, numbers: Sequence[int]) -> tuple[list[str], int]:
    """Type the files *numbers* in one session. Return the failures, and the number of mistakes found."""
    wrong: list[str] = []
    count = 0  # mistakes that were shown in the end

    async def type_all(folder: Path) -> None:
        nonlocal count
        library = folder / "leaves.py"
        library.write_text(LIBRARY, encoding="utf-8")
        settings = {"trusted": True, "plugins": [str(library)]}
        async with start_session([folder], settings) as editor:
            for number in numbers:
                try:
                    problem = await type_file(editor, folder, library, seed, number)
                except Exception as error:
                    traceback.print_exc()
                    problem = f"{type(error).__name__}: {error}"
                if problem:
                    wrong.append(f"{number}: {problem}")
            count = sum(len(item.diagnostics) for item in editor.published.values())
            wrong.extend(editor.shown)

    with tempfile.TemporaryDirectory() as folder:
        asyncio.run(type_all(Path(folder).resolve()))
    return wrong, count


def main(arguments: list[str]) -> int:
    """Run the command line *arguments*, and return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--files", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--only", type=int, metavar="NUMBER", help="type one file again")
    chosen = parser.parse_args(arguments)
    numbers = range(chosen.files) if chosen.only is None else [chosen.only]
    began = time.monotonic()
    jobs = min(chosen.jobs, len(numbers))
    slices = [numbers[start::jobs] for start in range(jobs)]
    with ProcessPoolExecutor(jobs) as pool:
        done = list(pool.map(run, [chosen.seed] * jobs, slices))
    wrong = [line for failures, _ in done for line in failures]
    mistakes = sum(count for _, count in done)
    took = time.monotonic() - began
    print(
        f"{len(numbers)} files typed in {took:.0f} s, with {mistakes} mistakes in the end; {len(wrong)} wrong"
    )
    for line in wrong[:10]:
        print("   ", line[:1000])
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
