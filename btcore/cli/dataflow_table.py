"""The table of ``btcore show --data``: who writes and who reads each blackboard entry."""

from collections.abc import Sequence

from rich import box
from rich.table import Table
from rich.text import Text

from btcore.cli import terminal
from btcore.xml.lint.data_flow import DataflowAccess, DataflowRow


def print_data(rows: Sequence[DataflowRow]) -> None:
    """Print *rows*, a section a scope."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), show_edge=False)
    table.add_column("entry", no_wrap=True)
    table.add_column("type", style="dim")
    table.add_column("written by")
    table.add_column("read by")
    for number, row in enumerate(rows):
        name = Text.assemble((f"{row.scope}/" if row.scope else "", "dim"), (row.key, "bold yellow"))
        last = number + 1 == len(rows) or rows[number + 1].scope != row.scope
        table.add_row(name, row.type, _places(row.writers, row), _places(row.readers, row), end_section=last)
    terminal.stdout_console().print(table if rows else Text("no node uses the blackboard", style="dim"))


def _places(found: Sequence[DataflowAccess], row: DataflowRow) -> Text:
    """One line a place; the name that the entry has there, where it is another one."""
    if not found:
        return Text("—", style="dim")
    lines = []
    for one in found:
        line = Text(one.node)
        line.append(f" {one.attribute}", style="dim")
        if one.key.lstrip("@") != row.key:
            line.append(f" as {one.key}", style="yellow")
        lines.append(line)
    return Text("\n").join(lines)
