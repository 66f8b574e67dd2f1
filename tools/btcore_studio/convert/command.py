"""`btcore convert`: convert a tree from XML format 3 to format 4."""

from collections.abc import Sequence
from pathlib import Path

import click
from rich.text import Text

from btcore import bundled_trees
from btcore.cli import files, terminal
from btcore.cli.node_libraries import LibraryOptions, NodeLibraries
from btcore.diagnostic_codes import DiagnosticKind
from btcore.diagnostics import Diagnostic
from btcore.exit_codes import ExitCode
from btcore.field_options import pass_options
from btcore.input_files import read_file
from btcore.suggestions import counted
from btcore.xml.read.read import parse_file
from btcore_studio.convert.convert import Conversion
from btcore_studio.convert.convert import convert as converted

_BYTE_ORDER_MARK = "\ufeff".encode()


@click.command()
@click.argument("source", metavar="FILE")
@click.option(
    "-o",
    "--output",
    type=files.OUTPUT_FILE,
    metavar="FILE",
    help="Write the result to this file instead of stdout.",
)
@click.option("--in-place", is_flag=True, help="Overwrite FILE with the result, if the result is valid.")
@click.option("--force", is_flag=True, help="Overwrite FILE also with an invalid result.")
@pass_options(LibraryOptions, "options")
def convert(
    source: str,
    output: Path | None,
    in_place: bool,
    force: bool,
    options: LibraryOptions,
) -> int:
    """Convert FILE from XML format 3 to format 4, and print the result.

    Comments, the order of attributes and the layout are preserved. The changes are listed on stderr,
    including changes of the tree's meaning, and the errors of the result, as 'btcore validate' reports them.

    \b
    Exit codes:
      0  success: the result is valid
      2  the result has errors, such as unknown nodes, or FILE cannot be read
    """
    if in_place and output is not None:
        raise click.UsageError("--in-place and --output cannot be used together.")
    path = bundled_trees.find(source)
    document = parse_file(path)
    libraries = NodeLibraries(options.plugins, options.models)
    result = converted(document, libraries.nodes_for(document))
    data = result.text.encode()
    # The parser drops a byte order mark, which the conversion must preserve.
    if read_file(path, len(_BYTE_ORDER_MARK)).startswith(_BYTE_ORDER_MARK):
        data = _BYTE_ORDER_MARK + data
    target = path if in_place else output
    if target is None:
        terminal.print_xml(data)
    elif force or not (target.exists() and target.samefile(path)):
        files.write(target, data)
    elif not in_place:
        raise click.ClickException(
            f"'{target}' is the file to convert: --in-place overwrites it if the result is valid"
        )
    elif not result.remaining:
        files.write(target, data)
    _print_summary(result)
    if not result.remaining:
        return ExitCode.SUCCESS
    terminal.print_notes(libraries.missing_library_notes(result.remaining))
    if in_place and not force:
        terminal.print_notes([f"{target} is not changed; --force overwrites it nevertheless"])
    return ExitCode.USER_ERROR


def _print_summary(result: Conversion) -> None:
    """Print the changes, the errors in the result, and their numbers on stderr."""
    terminal.print_diagnostics([*result.changes, *result.remaining])
    if not result.changes:
        terminal.print_notes(["the file already has format 4; nothing is converted"])
        return
    mark = Text("✘ ", style="bold red") if result.remaining else Text("✔ ", style="bold green")
    counts = [
        f"{_count(result.changes, 'same meaning')} rewritten with the same meaning",
        f"{_count(result.changes, 'new meaning')} with a new meaning",
    ]
    if manual := _count(result.changes, "manual step"):
        counts.append(f"{manual} to convert manually")
    if result.remaining:
        counts.append(f"the result has {counted(len(result.remaining), 'error')}")
    mark.append(", ".join(counts), style="bold")
    console = terminal.stderr_console()
    console.print()
    console.print(mark)


def _count(diagnostics: Sequence[Diagnostic], kind: DiagnosticKind) -> int:
    return sum(diagnostic.code.kind == kind for diagnostic in diagnostics)
