"""Counterexamples as files: a pytest test for each, beside its recording."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

from btcore.testing.source_of_tests import docstring_lines, literal, path_expression
from btcore_proof.counterexample import Counterexample
from btcore_proof.prover import Answer

RECORDING: Final = ".btrec.txt"
"""The extension of recordings."""
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
    """
    words = re.sub(r"[^a-z0-9]+", "-", question.lower())[:_MAX_NAME_CHARS].strip("-")
    return f"{number:02}-{words}" if words else f"{number:02}"


def source_of_test(name: str, answer: Answer, source: TreeReference, folder: Path) -> str:
    """Return the source code of a test that fails until the tree is mended.

    Args:
        name: The name of the files for the question.
        answer: The answer, which has a counterexample.
        folder: The folder of the test. Paths in the test are relative to it.
    """
    run = answer.counterexample
    assert run is not None
    fault = f" ({answer.detail})" if answer.detail else ""
    lines = [
        '"""A counterexample that `btcore prove` has found.',
        "",
        *docstring_lines(f"The question: {answer.question}{fault}"),
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


def _node_lines(source: TreeReference, folder: Path) -> list[str]:
    if not source.plugins and not source.has_libraries:
        return []
    lines = ["    nodes = Registry.standard()"]
    if source.has_libraries:
        lines.append("    nodes.add_installed_libraries()")
    for plugin in source.plugins:
        place = path_expression(Path(plugin), folder) if plugin.endswith(".py") else literal(plugin)
        lines.append(f"    nodes.add_plugin({place})")
    return lines


def _arguments(
    name: str, answer: Answer, run: Counterexample, source: TreeReference, folder: Path
) -> list[str]:
    recording = f"FOLDER / {literal(name + RECORDING)}"
    arguments = [path_expression(source.file, folder), literal(answer.question), recording]
    if run.recorded_cycle is not None:
        arguments.append(f"cycle={run.recorded_cycle}")
    if source.plugins or source.has_libraries:
        arguments.append("nodes=nodes")
    if source.models:
        arguments.append(f"models=[{', '.join(path_expression(model, folder) for model in source.models)}]")
    if source.tree is not None:
        arguments.append(f"tree={literal(source.tree)}")
    if source.format is not None:
        arguments.append(f"format={source.format}")
    if source.declarations is not None:
        arguments.append(f"declarations={path_expression(source.declarations, folder)}")
    return arguments
