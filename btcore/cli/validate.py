"""``btcore validate``: every fault of some trees, each with its place."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import click
from rich.text import Text

from btcore.blackboard.ports import remapped_key
from btcore.cli import (
    node_libraries,
    node_models,
    terminal,
    trees,
)
from btcore.cli.exit_codes import ExitCode
from btcore.errors import Diagnostic, TreeError
from btcore.registry.registry import Registry
from btcore.xml.lint.validate import validate_document
from btcore.xml.read.document import parse_file


class ValidationOptions(NamedTuple):
    """What is asked of each file: which *tree*, in which *format*, on a blackboard that holds *given*.

    Nodes that explicit tags name are good *without_code* too, if that is set.
    """

    tree: str | None
    format: int | None
    given: Sequence[str]
    without_code: bool


@click.command(short_help="Find every fault in trees, with file, line and column.")
@click.argument("sources", nargs=-1, required=True, metavar="TREE|FOLDER…")
@node_libraries.plugin_option
@node_models.model_option
@trees.tree_option
@trees.format_option
@click.option(
    "--given",
    "given",
    multiple=True,
    metavar="KEY",
    help="A key that the program writes before the first tick; may be given several times.",
)
@click.option("--strict", is_flag=True, help="Warnings count as errors.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def validate(
    sources: Sequence[str],
    plugins: Sequence[str],
    models: Sequence[Path],
    tree: str | None,
    format: int | None,
    given: Sequence[str],
    strict: bool,
    as_json: bool,
) -> int:
    """Check trees: files, names of trees that come with btcore, or folders of XML files.

    Exits with 0 when they can be run, 2 when one can't.
    """
    nodes = node_libraries.load_libraries(plugins)
    files = [file for source in sources for file in _files(source)]
    node_models.add_node_models(nodes.nodes, models)
    asked = ValidationOptions(tree, format, given, without_code=bool(models))
    found = [one for file in files for one in _check(file, nodes.nodes, asked)]
    errors = [one for one in found if one.is_error]
    warnings = [one for one in found if not one.is_error]
    good = not errors and not (strict and warnings)
    if as_json:
        click.echo(
            json.dumps({"ok": good, "files": len(files), "diagnostics": [_as_data(one) for one in found]})
        )
    else:
        _print(errors, warnings, len(files), good)
        terminal.print_notes(nodes.missing_library_notes(found))
    return ExitCode.SUCCESS if good else ExitCode.USER_ERROR


def _files(source: str) -> list[Path]:
    """The files that *source* means."""
    if not Path(source).is_dir():
        return [trees.find(source)]
    files = sorted(Path(source).rglob("*.xml"))
    if not files:
        raise click.UsageError(f"the folder '{source}' holds no XML file.")
    return files


def _check(file: Path, nodes: Registry, asked: ValidationOptions) -> list[Diagnostic]:
    """What is wrong with *file*."""
    try:
        document = parse_file(file)
    except TreeError as fault:
        return list(fault.diagnostics)
    if asked.without_code:
        # Of this file alone: in another one the same tag may have other ports.
        nodes = nodes.copy()
        node_models.add_document_nodes(nodes, [document])
    return validate_document(
        document,
        nodes=nodes,
        tree=asked.tree,
        format=asked.format,
        given=[remapped_key(one, one) or one for one in asked.given],
    )


def _print(errors: Sequence[Diagnostic], warnings: Sequence[Diagnostic], files: int, good: bool) -> None:
    """Errors, then warnings, then the count of both."""
    console = terminal.stdout_console()
    for one in (*errors, *warnings):
        console.print(terminal.format_diagnostic(one), soft_wrap=True)
        console.print()
    mark = Text("✔ ", style="bold green") if good else Text("✘ ", style="bold red")
    mark.append(
        ", ".join(
            [_counted(files, "file"), _counted(len(errors), "error"), _counted(len(warnings), "warning")]
        ),
        style="bold",
    )
    console.print(mark)


def _counted(number: int, noun: str) -> str:
    return f"{number or 'no'} {noun}{'' if number == 1 else 's'}"


def _as_data(one: Diagnostic) -> dict[str, object]:
    """A diagnostic as plain data."""
    return {
        "code": one.code,
        "severity": one.code.severity,
        "documentation": one.code.documentation,
        "message": one.message,
        "file": one.file,
        "line": one.line,
        "column": one.column,
        "width": one.width,
        "hint": one.hint,
    }
