"""The table of a sweep: a row an episode, the same for the same sweep, as CSV or Parquet.

There is nothing in it that another run of the same sweep would have otherwise: no wall time, no worker.
"""

import csv
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from btcore.cli import files
from btcore.sweep.definition import Episode, SweepDefinition
from btcore.sweep.journal import Record

Row = dict[str, Any]
"""The cells of an episode by column: bool, int, float, str or None."""

LEADING_COLUMNS: Final = ("episode", "seed")
RESULT_COLUMNS: Final = ("success", "status", "code", "time_s", "ticks", "failed_at", "error")
TRAILING_COLUMNS: Final = ("failures",)

_OWN_KEYS: Final = {"status", "ticks", "time_s", "real_time_factor", "nodes", "error", "reloads"}


def row(episode: Episode, record: Record) -> Row:
    """The row of *episode*, without its ``success``, by what the journal has of it.

    ``status`` is the tree's last one, or RAISED, REFUSED (the run was not to be had), BROKEN (btcore itself
    failed) or KILLED (its worker died, each time it was tried). ``failed_at`` is the node that made the tree
    fail, or raised; ``failures`` how often each node failed, as JSON; ``param.KEY`` what the setting has, and
    the rest what the extensions report, ``robot.distance_m`` for instance, lists as JSON.
    """
    report = record.get("report")
    cells: Row = {"episode": episode.number, "seed": episode.seed}
    cells |= {f"param.{key}": typed(value) for key, value in episode.values.items()}
    cells |= {"success": None, "status": _status(record), "code": record["code"]}
    cells |= {"time_s": None, "ticks": None, "failed_at": record.get("blamed"), "error": _error(record)}
    if report is None:
        return cells | {"failures": None}
    cells |= {"time_s": float(report["time_s"]), "ticks": report["ticks"]}
    for key, value in report.items():
        if key not in _OWN_KEYS:
            cells |= _flat(key, value)
    failures = {path: node["failure"] for path, node in report["nodes"].items() if node["failure"]}
    return cells | {"failures": json.dumps(failures, ensure_ascii=False)}


def columns(rows: Sequence[Row], definition: SweepDefinition) -> list[str]:
    """The columns of *rows*: what every table has, and between that the figures in order of appearance."""
    varied = [f"param.{key}" for key in definition.varied]
    fixed = [*LEADING_COLUMNS, *varied, *RESULT_COLUMNS]
    figures = dict.fromkeys(key for one in rows for key in one)
    return [*fixed, *(key for key in figures if key not in {*fixed, *TRAILING_COLUMNS}), *TRAILING_COLUMNS]


def typed(text: str) -> int | float | str:
    """A parameter's value as a number where it is one."""
    for kind in (int, float):
        try:
            number = kind(text)
        except ValueError:
            continue
        if f"{number}" == text or kind is float:
            return number
    return text


def write(path: Path, rows: Sequence[Row], names: Sequence[str]) -> None:
    """Write *rows* with the columns *names* into *path*, as its suffix says: .csv or .parquet."""
    data = _parquet(rows, names) if path.suffix == ".parquet" else _csv(rows, names)
    unfinished = path.with_name(f".{path.name}.tmp")
    files.write(unfinished, data)
    unfinished.replace(path)


def _csv(rows: Sequence[Row], names: Sequence[str]) -> bytes:
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    for one in rows:
        writer.writerow([_cell(one.get(name)) for name in names])
    return text.getvalue().encode()


def _cell(value: object) -> object:
    return str(value).lower() if isinstance(value, bool) else value


def _parquet(rows: Sequence[Row], names: Sequence[str]) -> bytes:
    import pyarrow
    from pyarrow import parquet

    sink = pyarrow.BufferOutputStream()
    arrays = {name: pyarrow.array(_of_one_kind([one.get(name) for one in rows])) for name in names}
    parquet.write_table(pyarrow.table(arrays), sink)
    data: bytes = sink.getvalue().to_pybytes()
    return data


def _of_one_kind(values: list[Any]) -> list[Any]:
    """*values* as they are if one column can hold them: as floats or, if need be, as texts."""
    kinds = {type(value) for value in values if value is not None}
    if len(kinds) < 2:
        return values
    common = float if kinds <= {int, float} else str
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
        return f"its worker died, {record['killed']} times"
    if record.get("fault"):
        return str(record["fault"])
    error = (record.get("report") or {}).get("error")
    return f"{error['exception']}: {error['message']}" if error is not None else None


def _flat(key: str, value: object) -> Row:
    """A figure as columns: those in an object get the object's name and a dot in front; lists are JSON."""
    if isinstance(value, Mapping):
        return {
            name: cell for one, inner in value.items() for name, cell in _flat(f"{key}.{one}", inner).items()
        }
    if isinstance(value, (list, tuple)):
        return {key: json.dumps(value, ensure_ascii=False)}
    return {key: value}
