"""The table of ``btcore show --data``: the nodes that write and read each blackboard entry."""

from collections.abc import Sequence

from rich import box
from rich.table import Table
from rich.text import Text

from btcore.cli import terminal
from btcore.xml.lint.data_flow import DataflowAccess, DataflowRow


def print_data(rows: Sequence[DataflowRow]) -> None:
    """Print *rows* as a table with a section for each blackboard scope."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), show_edge=False)
    table.add_column("entry", no_wrap=True)
    table.add_column("type", style="dim")
    table.add_column("written by")
    table.add_column("read by")
    for number, row in enumerate(rows):
        name = Text.assemble((f"{row.scope}/" if row.scope else "", "dim"), (row.key, "bold yellow"))
        last = number + 1 == len(rows) or rows[number + 1].scope != row.scope
        accesses = _accesses(row.writers, row), _accesses(row.readers, row)
        table.add_row(name, row.type, *accesses, end_section=last)
    terminal.stdout_console().print(table if rows else Text("no node uses the blackboard", style="dim"))


def _accesses(accesses: Sequence[DataflowAccess], row: DataflowRow) -> Text:
    """Return a line for each access, with the key that the node uses if it differs from the entry's key."""
    if not accesses:
        return Text("—", style="dim")
    lines = []
    for access in accesses:
        line = Text(access.node)
        line.append(f" {access.attribute}", style="dim")
        if access.key.lstrip("@") != row.key:
            line.append(f" as {access.key}", style="yellow")
        lines.append(line)
    return Text("\n").join(lines)
