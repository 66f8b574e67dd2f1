"""Every recorded script gives the value, the blackboard or the error that the C++ engine gave."""

import gzip
import json
from pathlib import Path

from tests.conformance.recorded_cases import compare_script_case

RECORDED = Path(__file__).parent / "data" / "scripts.jsonl.gz"


def test_scripts_match_the_recordings() -> None:
    with gzip.open(RECORDED, "rt", encoding="utf-8") as lines:
        cases = [json.loads(line) for line in lines]
    differences = {case["id"]: message for case in cases if (message := compare_script_case(case))}
    assert len(cases) == 800
    assert differences == {}


def test_difference_in_value_or_entries_is_detected() -> None:
    case = {"script": "x := 2; x", "bb": {}, "expect": {"value": 2.0, "bb": {"x": 2.0}}}
    assert compare_script_case(case) is None
    assert compare_script_case(case | {"expect": {"value": 3.0, "bb": {"x": 2.0}}}) is not None
    assert compare_script_case(case | {"expect": {"value": 2.0, "bb": {"x": 1.0}}}) is not None
    assert compare_script_case(case | {"expect": {"value": 2.0, "bb": {}}}) is not None
    assert compare_script_case(case | {"expect": {"error": "no", "bb": {"x": 2.0}}}) is not None
    assert compare_script_case(case | {"script": "x := (2"}) is not None
