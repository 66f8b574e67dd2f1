"""Shorter forms of what commands print, for agents: without what is empty, repeated or of no use to them."""

from collections.abc import Mapping
from typing import Any

from btcore.exit_codes import ExitCode


def palette_by_type(nodes: Mapping[str, Any]) -> dict[str, dict[str, str]]:
    """Return a line for each node, by type: its ports, and the first sentence of its description.

    Args:
        nodes: The nodes, as `btcore nodes --json` prints them.
    """
    types: dict[str, dict[str, str]] = {}
    for node, data in nodes.items():
        ports = ", ".join(_port(name, port) for name, port in data["ports"].items())
        first = " ".join(data["description"].split("\n\n")[0].split()).split(". ")[0]
        types.setdefault(data["type"], {})[node] = f"({ports}) {first}" if ports else first
    return types


def _port(name: str, port: Mapping[str, Any]) -> str:
    """Return the name of a port, with the default of an input, or with another direction."""
    if port["direction"] != "input":
        return f"{port['direction']} {name}"
    return name if port["default"] is None else f"{name}={port['default']}"


def ending_of(report: Mapping[str, Any], code: int, log: str) -> dict[str, str]:
    """Return why a run ended, and what can be done next.

    Args:
        report: The report of `btcore run --json`.
        code: The exit code of the command.
        log: The name of the log.
    """
    if code == ExitCode.LEAF_ERROR:
        return {"ended": "a leaf raised an exception, or a tick took too long: see error"}
    if code == ExitCode.INTERRUPTED:
        return {"ended": "the time limit of a call ended the run"}
    if report["status"] == "RUNNING":
        return {
            "ended": "the duration ended the run",
            "next": "unless the tree is meant to run forever, give a longer duration",
        }
    ending = {"ended": f"the tree ended in {report['status']}"}
    failed = report["status"] == "FAILURE"
    return ending | ({"next": f"explain_failure with the log {log} explains why"} if failed else {})


def counts_of(nodes: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return the rows of nodes without zeros and missing values, and the names of nodes that were not ticked.

    Args:
        nodes: The rows by node, as in the reports of `btcore run` and `btcore stats`.
    """
    rows = {
        node: {
            key: round(value, 3) if isinstance(value, float) else value for key, value in row.items() if value
        }
        for node, row in nodes.items()
    }
    return {
        "nodes": {node: row for node, row in rows.items() if row.keys() != {"id"}},
        "not_ticked": [node for node, row in rows.items() if row.keys() == {"id"}],
    }


def answer_of(question: Mapping[str, Any]) -> dict[str, Any]:
    """Return the answer to a question of `btcore prove --json`, without what is empty."""
    answer = {key: value for key, value in question.items() if key != "vacuous"}
    if question["vacuous"]:
        answer["answer"] = "proved, vacuously: its premise never holds"
    filled: dict[str, Any] = _without_empty(answer)
    return filled


def _without_empty(data: Any) -> Any:
    """Return JSON data without null, and without empty texts, lists and objects."""
    if isinstance(data, list):
        return [_without_empty(item) for item in data]
    if isinstance(data, dict):
        return {key: _without_empty(value) for key, value in data.items() if value not in (None, "", [], {})}
    return data
