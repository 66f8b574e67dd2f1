"""`btcore validate`: report all errors and warnings in tree files."""

from collections.abc import Sequence
from pathlib import Path

import click
from rich.text import Text

from btcore.blackboard.ports import remapped_key
from btcore.cli import terminal
from btcore.cli.node_libraries import load_libraries
from btcore.cli.tree_source import TreeOptions, assumed_keys_option, complete_tree, find_source, parse_source
from btcore.errors import Diagnostic, TreeError, shown_diagnostics
from btcore.exit_codes import ExitCode
from btcore.field_options import pass_options
from btcore.lint.validate import validate_document
from btcore.xml.read.read import read


@click.command(short_help="Check trees, and report all errors and warnings.")
@click.argument("sources", nargs=-1, required=True, metavar="TREE|FOLDER…", shell_complete=complete_tree)
@pass_options(TreeOptions, "options")
@assumed_keys_option
@click.option("--strict", is_flag=True, help="Treat warnings as errors.")
@click.option("--json", "as_json", is_flag=True, help="Print a JSON object.")
def validate(
    sources: Sequence[str],
    options: TreeOptions,
    given: Sequence[str],
    strict: bool,
    as_json: bool,
) -> int:
    """Report all errors and warnings in trees, each with file, line and column.

    Arguments are XML files, - for stdin, names of trees that are bundled with btcore, and folders: all .xml
    files in a folder and its subfolders are checked.

    \b
    Exit codes:
      0  no errors
      2  errors, or with --strict warnings
    """
    files = [file for source in sources for file in _find_files(source)]
    libraries = load_libraries(options.plugins, options.models, options.confined, partial=True)
    keys = [remapped_key(key, key) or key for key in given]
    diagnostics: list[Diagnostic] = []
    for file in files:
        try:
            document = parse_source(file, options.confined)
        except TreeError as error:
            diagnostics += error.diagnostics
        else:
            if libraries.is_partial:
                libraries.load_missing(read(document, libraries.nodes.documents).documents)
            nodes = libraries.nodes_for(document)
            diagnostics += validate_document(
                document, nodes=nodes, tree=options.tree, format=options.format, given=keys
            )
    errors = [item for item in diagnostics if item.is_error]
    warnings = [item for item in diagnostics if not item.is_error]
    valid = not errors and not (strict and warnings)
    if as_json:
        shown, _ = shown_diagnostics([*errors, *warnings])
        data = {
            "ok": valid,
            "files": len(files),
            "diagnostics": list(map(_as_data, shown)),
            "omitted": len(diagnostics) - len(shown),
        }
        terminal.print_json(data)
    else:
        _print(errors, warnings, len(files), valid)
        terminal.print_notes(libraries.missing_library_notes(diagnostics))
    return ExitCode.SUCCESS if valid else ExitCode.USER_ERROR


def _find_files(source: str) -> list[Path]:
    """Return the XML files that the argument *source* selects."""
    if not Path(source).is_dir():
        return [find_source(source)]
    files = sorted(Path(source).rglob("*.xml"))
    if not files:
        raise click.UsageError(f"the folder '{source}' contains no XML file.")
    return files


def _print(errors: Sequence[Diagnostic], warnings: Sequence[Diagnostic], files: int, valid: bool) -> None:
    """Print the errors, the warnings, and their numbers."""
    console = terminal.stdout_console()
    shown, more = shown_diagnostics([*errors, *warnings])
    for diagnostic in shown:
        console.print(terminal.format_diagnostic(diagnostic), soft_wrap=True)
        console.print()
    for sentence in more:
        console.print(Text(f"{sentence}\n", style="bold"), soft_wrap=True)
    mark = Text("✔ ", style="bold green") if valid else Text("✘ ", style="bold red")
    counts = {"file": files, "error": len(errors), "warning": len(warnings)}
    parts = [terminal.counted(count, noun, zero="no") for noun, count in counts.items()]
    console.print(mark.append(", ".join(parts), style="bold"))


def _as_data(diagnostic: Diagnostic) -> dict[str, object]:
    """Return *diagnostic* as JSON data."""
    return {
        "code": diagnostic.code,
        "severity": diagnostic.code.severity,
        "url": diagnostic.code.url,
        "message": diagnostic.message,
        "file": diagnostic.file,
        "line": diagnostic.line,
        "column": diagnostic.column,
        "width": diagnostic.width,
        "hint": diagnostic.hint,
    }
