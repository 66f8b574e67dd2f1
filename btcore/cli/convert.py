"""`btcore convert`: convert a tree from XML format 3 to format 4."""

from collections.abc import Sequence
from pathlib import Path

import click
from rich.text import Text

from btcore.cli import files, node_libraries, terminal
from btcore.cli.exit_codes import ExitCode
from btcore.cli.tree_source import find_tree
from btcore.diagnostic_codes import Severity
from btcore.errors import Diagnostic
from btcore.input_files import read_file
from btcore.xml.convert.convert import Conversion
from btcore.xml.convert.convert import convert as converted
from btcore.xml.read.document import parse_file

_BYTE_ORDER_MARK = "\ufeff".encode()


@click.command(short_help="Convert a tree from XML format 3 to format 4.")
@click.argument("source", metavar="FILE")
@click.option(
    "-o",
    "--output",
    type=files.OUTPUT_FILE,
    metavar="FILE",
    help="Write the result to this file instead of stdout.",
)
@click.option("--in-place", is_flag=True, help="Overwrite the input file with the result.")
@node_libraries.library_options
def convert(
    source: str, output: Path | None, in_place: bool, plugins: Sequence[str], models: Sequence[Path]
) -> int:
    """Convert FILE from XML format 3 to format 4, and print the result.

    Comments, the order of attributes and the layout are preserved. The changes are listed on stderr,
    including changes of the tree's meaning. Errors that exist in both formats are not reported: use 'btcore
    validate' to find them.

    \b
    Exit codes:
      0  success
      2  the tree uses something that format 4 does not support, or FILE is invalid
    """
    if in_place and output is not None:
        raise click.UsageError("--in-place and --output cannot be used together.")
    path = find_tree(source)
    document = parse_file(path)
    libraries = node_libraries.load_libraries(plugins, models)
    result = converted(document, libraries.nodes_for(document))
    data = result.text.encode()
    # The parser drops a byte order mark, which the conversion must preserve.
    if read_file(path, len(_BYTE_ORDER_MARK)).startswith(_BYTE_ORDER_MARK):
        data = _BYTE_ORDER_MARK + data
    target = path if in_place else output
    if target is None:
        terminal.print_xml(data)
    else:
        files.write(target, data)
    _print_summary(result)
    return ExitCode.USER_ERROR if result.remaining else ExitCode.SUCCESS


def _print_summary(result: Conversion) -> None:
    """Print the changes, the errors in the result, and their numbers on stderr."""
    terminal.print_diagnostics([*result.changes, *result.remaining])
    if not result.changes:
        terminal.print_notes(["the file already has format 4; nothing is changed"])
        return
    mark = Text("✘ ", style="bold red") if result.remaining else Text("✔ ", style="bold green")
    counts = [
        f"{_count(result.changes, 'same meaning')} rewritten with the same meaning",
        f"{_count(result.changes, 'new meaning')} with a new meaning",
    ]
    if manual := _count(result.changes, "manual step"):
        counts.append(f"{manual} to convert manually")
    if result.remaining:
        counts.append(f"{len(result.remaining)} not supported by format 4")
    mark.append(", ".join(counts), style="bold")
    console = terminal.stderr_console()
    console.print()
    console.print(mark)


def _count(diagnostics: Sequence[Diagnostic], severity: Severity) -> int:
    return sum(diagnostic.code.severity == severity for diagnostic in diagnostics)
