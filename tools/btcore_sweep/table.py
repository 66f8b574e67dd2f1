"""The table of a sweep, with a row for each episode, as CSV or Parquet, and the condition for a success.

The table is reproducible: it contains nothing that differs between two executions of the same sweep, such as
real times or workers.
"""

import csv
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import click

from btcore.blackboard.blackboard import Blackboard
from btcore.cli import files
from btcore.errors import ScriptError
from btcore.script.program import Program, condition_result
from btcore_sweep.definition import Episode, SweepDefinition
from btcore_sweep.sweep_folder import Record

Row = dict[str, Any]
"""The cells of an episode by column. A cell is a bool, int, float, str or None."""

LEADING_COLUMNS: Final = ("episode", "seed")
RESULT_COLUMNS: Final = ("success", "status", "code", "time_s", "ticks", "failed_at", "error")
TRAILING_COLUMNS: Final = ("failures",)

_TREE_STATUSES: Final = ("SUCCESS", "FAILURE", "SKIPPED", "RUNNING")  # not RAISED, REFUSED, BROKEN, KILLED
_OWN_KEYS: Final = {"status", "ticks", "time_s", "real_time_factor", "nodes", "error", "reloads"}


def create_row(episode: Episode, record: Record, script: Program | None) -> Row:
    """Return the row of an episode.

    Args:
        record: The saved result of the episode.
        script: The condition for a success, or None, see `is_success`.

    Returns:
        The cells by column. `success`: whether the episode is a success; `status`: the last status of the
        tree, or RAISED (a leaf raised an exception), REFUSED (the run could not start), BROKEN (internal
        error) or KILLED (the worker died in each attempt); `failed_at`: the node that made the tree fail or
        raised an exception; `failures`: the number of failures of each node, as JSON; `param.KEY`: the
        values of the parameters; and the reports of the extensions, such as `robot.distance_m`, with lists
        as JSON.

    Raises:
        click.UsageError: The script uses a column that does not exist, or fails for another reason.
    """
    report = record.get("report")
    cells: Row = {"episode": episode.number, "seed": episode.seed}
    cells |= {f"param.{key}": _typed(value) for key, value in episode.values.items()}
    cells |= {"success": None, "status": _status(record), "code": record["code"]}
    cells |= {"time_s": None, "ticks": None, "failed_at": record.get("failed_at"), "error": _error(record)}
    failures = None
    if report is not None:
        cells |= {"time_s": float(report["time_s"]), "ticks": report["ticks"]}
        for key, value in report.items():
            if key not in _OWN_KEYS:
                cells |= _flat(key, value)
        counts = {path: node["failure"] for path, node in report["nodes"].items() if node["failure"]}
        failures = json.dumps(counts, ensure_ascii=False)
    cells["failures"] = failures
    # Last, since the script may use all other columns.
    cells["success"] = is_success(cells, script)
    return cells


def is_success(row: Row, script: Program | None) -> bool:
    """Return whether an episode is a success.

    An episode that raised an exception, could not start or killed its worker is never a success. If the
    script needs a column that is empty in this row, the episode is not a success.

    Args:
        row: The row of the episode.
        script: The condition, whose variables are the columns, with _ instead of a dot. None: the run must
            exit with 0.

    Raises:
        click.UsageError: The script uses a column that does not exist, or fails for another reason.
    """
    if script is None:
        return bool(row["code"] == 0)
    if row["status"] not in _TREE_STATUSES:
        return False
    variables = {
        "".join(letter if letter.isalnum() else "_" for letter in column): value
        for column, value in row.items()
        if column != "success"
    }
    board = Blackboard()
    for name, value in variables.items():
        if value is not None:
            board.set(name, value)
    try:
        return condition_result(script.run(board))
    except ScriptError as error:
        if error.unwritten_key in variables:
            return False
        raise click.UsageError(f"--success-if: {error}\navailable: {', '.join(variables)}") from error


def list_columns(rows: Sequence[Row], definition: SweepDefinition) -> list[str]:
    """Return the columns of a table in order.

    The columns of the extensions' reports come after the other columns, in the order in which they first
    occur. Only `failures` comes after them.

    Args:
        definition: The sweep, for the columns of its parameters.
    """
    varied = [f"param.{key}" for key in definition.varied]
    fixed = [*LEADING_COLUMNS, *varied, *RESULT_COLUMNS]
    figures = dict.fromkeys(key for row in rows for key in row)
    return [*fixed, *(key for key in figures if key not in {*fixed, *TRAILING_COLUMNS}), *TRAILING_COLUMNS]


def _typed(text: str) -> int | float | str:
    """Return the value of a parameter as a number if possible, else as text."""
    for number_type in (int, float):
        try:
            number = number_type(text)
        except ValueError:
            continue
        # int("007") is valid, but such a text counts as a float: integers are kept only in canonical form.
        if f"{number}" == text or number_type is float:
            return number
    return text


def write_table(path: Path, rows: Sequence[Row], names: Sequence[str]) -> None:
    """Write a table to a file.

    Args:
        path: The file; its suffix .csv or .parquet determines the format.
        names: The columns.

    Raises:
        click.ClickException: The file cannot be written.
    """
    data = _parquet(rows, names) if path.suffix == ".parquet" else _csv(rows, names)
    files.write(path, data)


def _csv(rows: Sequence[Row], names: Sequence[str]) -> bytes:
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    for row in rows:
        cells = [row.get(name) for name in names]
        # Booleans as in JSON and in scripts, not as in Python.
        writer.writerow([str(cell).lower() if isinstance(cell, bool) else cell for cell in cells])
    return text.getvalue().encode()


def _parquet(rows: Sequence[Row], names: Sequence[str]) -> bytes:
    import pyarrow
    from pyarrow import parquet

    sink = pyarrow.BufferOutputStream()
    arrays = {name: pyarrow.array(_unify_types([row.get(name) for row in rows])) for name in names}
    parquet.write_table(pyarrow.table(arrays), sink)
    data: bytes = sink.getvalue().to_pybytes()
    return data


def _unify_types(values: list[Any]) -> list[Any]:
    """Return *values* with a common type, which a Parquet column needs: mixed types become float or str."""
    types = {type(value) for value in values if value is not None}
    if len(types) < 2:
        return values
    common = float if types <= {int, float} else str
    return [None if value is None else common(value) for value in values]


def _status(record: Record) -> str:
    if record.get("killed"):
        return "KILLED"
    report = record.get("report")
    if report is None:
        return "REFUSED" if record["code"] == 2 else "BROKEN"
    return "RAISED" if "error" in report else str(report["status"])


def _error(record: Record) -> str | None:
    if record.get("killed"):
        return f"its worker died {record['killed']} times"
    if record.get("fault"):
        return str(record["fault"])
    error = (record.get("report") or {}).get("error")
    return f"{error['exception']}: {error['message']}" if error is not None else None


def _flat(key: str, value: object) -> Row:
    """Return a value of the report as columns: nested keys are joined by dots, lists become JSON."""
    if isinstance(value, Mapping):
        return {
            name: cell for part, item in value.items() for name, cell in _flat(f"{key}.{part}", item).items()
        }
    if isinstance(value, (list, tuple)):
        return {key: json.dumps(value, ensure_ascii=False)}
    return {key: value}
