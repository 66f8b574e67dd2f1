"""``btcore convert``: a tree of format 3 becomes one of format 4."""

from collections.abc import Sequence
from pathlib import Path

import click
from rich.text import Text

from btcore.cli import (
    files,
    node_libraries,
    node_models,
    terminal,
    trees,
)
from btcore.cli.exit_codes import ExitCode
from btcore.diagnostic_codes import Severity
from btcore.errors import Diagnostic
from btcore.xml.convert.convert import Conversion
from btcore.xml.convert.convert import convert as converted
from btcore.xml.read.document import parse_file

_BYTE_ORDER_MARK = "\ufeff".encode()


@click.command(short_help="Turn a tree of format 3 into one of format 4.")
@click.argument("source", metavar="FILE")
@click.option("-o", "--output", type=click.Path(dir_okay=False, path_type=Path), help="The file to write.")
@click.option("--in-place", is_flag=True, help="Write the result into FILE itself.")
@node_libraries.plugin_option
@node_models.model_option
def convert(
    source: str, output: Path | None, in_place: bool, plugins: Sequence[str], models: Sequence[Path]
) -> int:
    """Print FILE in format 4; comments, the order of attributes and the layout stay as they are.

    What is written differently, and what means something else in format 4, is listed on stderr.
    Exits with 2 when format 4 refuses something that format 3 took, else 0; what is wrong in both
    `btcore validate` tells.
    """
    if in_place and output is not None:
        raise click.UsageError("--in-place and --output are two places: name one of them.")
    path = trees.find(source)
    document = parse_file(path)
    nodes = node_libraries.load_libraries(plugins).nodes
    node_models.add_node_models(nodes, models, [document])
    result = converted(document, nodes)
    data = result.text.encode()
    if path.read_bytes().startswith(_BYTE_ORDER_MARK):
        data = _BYTE_ORDER_MARK + data
    target = path if in_place else output
    if target is None:
        click.echo(data, nl=False)
    else:
        files.write(target, data)
    _tell(result)
    return ExitCode.USER_ERROR if result.remaining else ExitCode.SUCCESS


def _tell(result: Conversion) -> None:
    """The list of changes, errors of the result, and the count of them, on stderr."""
    terminal.print_diagnostics([*result.changes, *result.remaining])
    if not result.changes:
        terminal.print_notes(["it is of format 4 already; nothing is changed"])
        return
    mark = Text("✘ ", style="bold red") if result.remaining else Text("✔ ", style="bold green")
    counts = [
        f"{_count(result.changes, 'same meaning')} rewritten",
        f"{_count(result.changes, 'new meaning')} with another meaning",
    ]
    if left := _count(result.changes, "manual step"):
        counts.append(f"{left} left to you")
    if result.remaining:
        counts.append(f"{len(result.remaining)} that format 4 refuses")
    mark.append(", ".join(counts), style="bold")
    console = terminal.stderr_console()
    console.print()
    console.print(mark)


def _count(found: Sequence[Diagnostic], severity: Severity) -> int:
    return sum(one.code.severity == severity for one in found)
