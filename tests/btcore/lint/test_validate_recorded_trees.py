"""The validator on thousands of documents whose behaviour was recorded with the C++ engines."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import btcore
from btcore.diagnostics import Diagnostic
from btcore.errors import TreeError
from btcore.lint.validate import validate_document
from btcore.xml.read.read import parse_text
from tests.conformance.recorded_cases import CallLog, conformance_registry, read_cases

DATA = Path(__file__).parents[2] / "conformance" / "data"
NODES = conformance_registry()
MUTATED = ["v4_mutated", "v3_mutated"]

Case = dict[str, Any]


def diagnostics_of(case: Case) -> list[Diagnostic]:
    try:
        document = parse_text(case["xml"])
    except TreeError as tree_error:
        return list(tree_error.diagnostics)
    return validate_document(
        document, nodes=NODES, tree=case.get("tree"), format=case["format"], given=case.get("bb", {}).keys()
    )


def names_of(xml: str, found: list[Diagnostic], code: str) -> Iterator[str]:
    """Yield the names of the nodes that diagnostics of *code* point at; each document is a single line."""
    for one in found:
        named = re.match(r'<\w+ [^>]*?name="(\w+)"', xml[one.column - 1 :])
        if one.code == code and one.line == 1 and named:
            yield named[1]


@pytest.mark.parametrize(
    ("name", "least"),
    [("v4_control", 40), ("v4_full", 50), ("v4_once", 0), ("v4_scopes", 0), ("v3_full", 100)],
)
def test_tree_that_can_be_run_has_no_errors_and_a_node_reported_as_never_ticked_was_never_ticked(
    name: str, least: int
) -> None:
    reported = 0
    for case in read_cases(DATA / f"{name}.jsonl.gz"):
        found = diagnostics_of(case)
        if "load_error" not in case["expect"]:
            assert [one for one in found if one.is_error] == [], case["id"]
        for node in names_of(case["xml"], found, "W105"):
            reported += 1
            for tick in case["expect"].get("ticks", ()):
                assert node not in [event[0] for event in tick.get("events", ())], case["id"]
                assert node not in [call.split(":")[0] for call in tick.get("calls", ())], case["id"]
    assert reported >= least


@pytest.mark.parametrize("name", MUTATED)
def test_errors_include_those_of_the_loader(name: str) -> None:
    tree_error = 0
    for case in read_cases(DATA / f"{name}.jsonl.gz"):
        found = [str(one) for one in diagnostics_of(case) if one.is_error]
        try:
            btcore.loads(
                case["xml"], nodes=NODES, tree=case.get("tree"), format=case["format"], resources=[CallLog()]
            )
        except TreeError as fault:
            tree_error += 1
            # Without a main tree a document is a library; a script may be given on the blackboard.
            loader = {
                str(one)
                for one in fault.diagnostics
                if one.code != "E108" and "which has never been written" not in one.message
            }
            assert loader <= set(found), case["id"]
    assert tree_error > 200
