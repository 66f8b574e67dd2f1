"""Counterexamples as files: a pytest test for each, beside its recording."""

import json
import os
import re
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

from btcore_proof.counterexample import Counterexample
from btcore_proof.prover import Answer

RECORDING: Final = ".btrec.txt"
"""The extension of recordings."""
_LINE_LENGTH: Final = 88
"""The line length of the tests, which is ruff's default."""
_MAX_NAME_CHARS: Final = 60
"""The greatest number of characters of a question in the name of a file."""


class TreeReference(NamedTuple):
    """How a test names a tree and its nodes.

    Attributes:
        file: The XML file.
        tree: The ID of the tree; None for the main tree.
        format: The XML format; None for the file's own.
        models: The TreeNodesModel files.
        plugins: The modules and Python files with nodes.
        has_libraries: Whether the tree has nodes of installed libraries.
        declarations: The file with declarations, unless it is the file beside the tree.
    """

    file: Path
    tree: str | None = None
    format: int | None = None
    models: Sequence[Path] = ()
    plugins: Sequence[str] = ()
    has_libraries: bool = False
    declarations: Path | None = None


def file_name(number: int, question: str) -> str:
    """Return the name of the files for a question, without suffix.

    Args:
        number: The number of the question, from 1.
        question: The question.
    """
    words = re.sub(r"[^a-z0-9]+", "-", question.lower())[:_MAX_NAME_CHARS].strip("-")
    return f"{number:02}-{words}" if words else f"{number:02}"


def source_of_test(name: str, answer: Answer, source: TreeReference, folder: Path) -> str:
    """Return the source code of a test that fails until the tree is mended.

    Args:
        name: The name of the files for the question.
        answer: The answer, which has a counterexample.
        source: The tree.
        folder: The folder of the test. Paths in the test are relative to it.
    """
    run = answer.counterexample
    assert run is not None
    fault = f" ({answer.detail})" if answer.detail else ""
    lines = [
        '"""A counterexample that `btcore prove` has found.',
        "",
        *_wrap(f"The question: {answer.question}{fault}"),
        "",
        "The test fails until the tree is mended.",
        '"""',
        "",
        "from pathlib import Path",
        "",
    ]
    if source.plugins or source.has_libraries:
        lines.append("from btcore import Registry")
    lines += [
        "from btcore_proof import assert_holds_in_run",
        "",
        "FOLDER = Path(__file__).parent",
        "",
        "",
        f"def test_{name.replace('-', '_')}() -> None:",
        *_node_lines(source, folder),
        "    assert_holds_in_run(",
        *(f"        {argument}," for argument in _arguments(name, answer, run, source, folder)),
        "    )",
    ]
    return "\n".join(lines) + "\n"


def _wrap(text: str) -> list[str]:
    """Return the lines of a text in a docstring."""
    return textwrap.wrap(_plain(text), _LINE_LENGTH - 4, break_long_words=False)


def _plain(text: str) -> str:
    """Return a text that may be part of a docstring."""
    printable = "".join(letter if letter.isprintable() else " " for letter in text)
    return printable.replace("\\", "/").replace('"', "'")


def _node_lines(source: TreeReference, folder: Path) -> list[str]:
    if not source.plugins and not source.has_libraries:
        return []
    lines = ["    nodes = Registry.standard()"]
    if source.has_libraries:
        lines.append("    nodes.add_installed_libraries()")
    for plugin in source.plugins:
        place = _place(Path(plugin), folder) if plugin.endswith(".py") else _text(plugin)
        lines.append(f"    nodes.add_plugin({place})")
    return lines


def _arguments(
    name: str, answer: Answer, run: Counterexample, source: TreeReference, folder: Path
) -> list[str]:
    recording = f"FOLDER / {_text(name + RECORDING)}"
    arguments = [_place(source.file, folder), _text(answer.question), recording]
    if run.recorded_cycle is not None:
        arguments.append(f"cycle={run.recorded_cycle}")
    if source.plugins or source.has_libraries:
        arguments.append("nodes=nodes")
    if source.models:
        arguments.append(f"models=[{', '.join(_place(model, folder) for model in source.models)}]")
    if source.tree is not None:
        arguments.append(f"tree={_text(source.tree)}")
    if source.format is not None:
        arguments.append(f"format={source.format}")
    if source.declarations is not None:
        arguments.append(f"declarations={_place(source.declarations, folder)}")
    return arguments


def _place(path: Path, folder: Path) -> str:
    """Return an expression for a path, relative to the folder of the test if that is possible."""
    try:
        relative = Path(os.path.relpath(path.resolve(), folder.resolve()))
    except ValueError:  # on another drive of Windows
        return f"Path({_text(str(path.resolve()))})"
    return f"FOLDER / {_text(relative.as_posix())}"


def _text(text: str) -> str:
    return json.dumps(text, ensure_ascii=not text.isprintable())
