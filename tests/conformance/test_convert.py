"""Every recorded text converts to the value or the error that the C++ engine gave."""

import gzip
import json
from pathlib import Path
from typing import Any

import pytest

from tests.conformance.recorded_cases import compare_conversion_case

RECORDED = Path(__file__).parent / "data" / "convert.jsonl.gz"


def test_conversions_match_the_recordings() -> None:
    with gzip.open(RECORDED, "rt", encoding="utf-8") as lines:
        cases = [json.loads(line) for line in lines]
    differences = {case["id"]: message for case in cases if (message := compare_conversion_case(case))}
    assert len(cases) == 1600
    assert differences == {}


@pytest.mark.parametrize(
    ("kind", "text", "expected"),
    [
        ("int", "3.7", {"value": 4}),
        ("int", "3", {"value": 3.0}),
        ("int", "3", {"error": "no"}),
        ("int", "x", {"value": 3}),
        ("bool", "1", {"value": 1}),
        ("vector<int>", "1;2", {"value": [1]}),
        ("float", "0.1", {"value": 0.1}),
        ("no such type", "1", {"value": 1}),
    ],
)
def test_difference_is_detected(kind: str, text: str, expected: Any) -> None:
    assert compare_conversion_case({"convert": kind, "text": text, "expect": expected}) is not None


@pytest.mark.parametrize("value", ["SUCCESS", 2])
def test_a_recorded_status_may_be_a_name_or_a_number(value: int | str) -> None:
    case = {"convert": "NodeStatus", "text": "SUCCESS", "expect": {"value": value}}
    assert compare_conversion_case(case) is None
