"""This engine does the same as the C++ engines on thousands of recorded random trees, event by event."""

import copy
import gzip
import json
import os
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

import btcore
from tests.conformance.recorded_cases import (
    EXPLICIT_TAGS_RULE,
    HALT_RULE,
    NAME_RULE,
    PORT_ORDER_RULE,
    UNTYPED_TEXT_RULE,
    WIDER_TYPE_RULE,
    ZERO_CHARACTER_RULE,
    compare_case,
    compare_tree_case,
    conformance_registry,
    documented_difference,
    main,
    read_cases,
    run_case,
)

DATA = Path(__file__).parent / "data"
MORE = DATA / "more"
FRESH = DATA / "fresh"
DIFFERENCES = Path(__file__).parents[2] / "docs/reference/differences.md"
NODES = conformance_registry()

Case = dict[str, Any]


@cache
def recorded(name: str) -> list[Case]:
    return list(read_cases(DATA / f"{name}.jsonl.gz"))


@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("v4_control", 800),
        ("v4_full", 1200),
        ("v4_once", 400),
        ("v4_scopes", 583),
        ("v4_mutated", 999),
        ("v3_full", 800),
        ("v3_mutated", 700),
    ],
)
def test_trees_match_the_recordings(name: str, count: int) -> None:
    differences = {
        case["id"]: message for case in recorded(name) if (message := compare_tree_case(case, NODES))
    }
    assert differences == {}
    assert len(recorded(name)) == count


@pytest.mark.parametrize("file", sorted(MORE.glob("*.jsonl.gz")), ids=lambda file: file.name)
def test_further_cases_match_the_recordings(file: Path) -> None:
    cases = list(read_cases(file))
    assert cases
    different = [case for case in cases if compare_case(case, NODES) is not None]
    assert [case["id"] for case in different if documented_difference(case, NODES) is None] == []


@pytest.mark.parametrize(
    ("name", "count", "documented"),
    [
        (
            "real_differences",
            75,
            {
                "R6-name-newline": NAME_RULE,
                "nm8": ZERO_CHARACTER_RULE,
                "R16-set": UNTYPED_TEXT_RULE,
                "g2-ports-5200001-1854": UNTYPED_TEXT_RULE,
                "g2-wide-5200003-2918-once": HALT_RULE,
                "g2-wide-5200001-7193": HALT_RULE,
                "g2-loops-5200002-1485": HALT_RULE,
                "4-control,decorator,blackboard,subtree,scopes,conditions,exceptions-5100005-4841": HALT_RULE,
                "4-control,decorator,blackboard,subtree,scopes,conditions,exceptions-5100005-5599": HALT_RULE,
            },
        ),
        ("value_types", 20, {}),
        (
            "documented",
            6,
            {
                "explicit-set-blackboard": UNTYPED_TEXT_RULE,
                "untyped-text-in-subtree": UNTYPED_TEXT_RULE,
                "wider-type": WIDER_TYPE_RULE,
                "at-k-beside-k": PORT_ORDER_RULE,
                "script-raises-in-halt": HALT_RULE,
                "port-order-rejected": PORT_ORDER_RULE,
            },
        ),
    ],
)
def test_minimal_cases_match_or_differ_by_a_documented_rule(
    name: str, count: int, documented: dict[str, str]
) -> None:
    cases = list(read_cases(FRESH / f"{name}.jsonl.gz"))
    assert len(cases) == count
    different = [case for case in cases if compare_case(case, NODES) is not None]
    assert {case["id"]: documented_difference(case, NODES) for case in different} == documented
    page = DIFFERENCES.read_text("utf-8").replace("`", "")
    for case, rule in documented.items():
        rows = [row for row in page.splitlines() if row.startswith(f"| {rule} |")]
        assert rows, f"{rule} is not in {DIFFERENCES.name}"
        assert name != "real_differences" or any(case in row for row in rows), case


@pytest.mark.parametrize(
    "alter", ["explicit-set-blackboard", "untyped-text-in-subtree", "at-k-beside-k", "script-raises-in-halt"]
)
def test_a_documented_rule_hides_no_other_difference(alter: str) -> None:
    (case,) = (case for case in read_cases(FRESH / "documented.jsonl.gz") if case["id"] == alter)
    for change in (other_event, other_status if "halt" in alter else extra_entry):
        case_with_two_differences = altered(case, change)
        assert documented_difference(case_with_two_differences, NODES) is None


@pytest.mark.parametrize("name", ["wider-type", "port-order-rejected"])
def test_a_rule_for_a_rejected_tree_needs_the_reason(name: str) -> None:
    (case,) = (case for case in read_cases(FRESH / "documented.jsonl.gz") if case["id"] == name)
    xml = case["xml"].replace("LoopDouble", "LoopInt").replace("LoopBool", "LoopInt")
    case = {**case, "xml": xml, "expect": {"load_error": "another reason"}}
    assert compare_case(case, NODES) == "the tree should be rejected, but it loads"
    assert documented_difference(case, NODES) is None


def test_explicit_tag_below_a_reactive_sequence_is_a_documented_difference() -> None:
    (case,) = (
        case for case in read_cases(MORE / "v4b_mutated.jsonl.gz") if case["id"].endswith("770006-3931")
    )
    assert compare_case(case, NODES) == "the tree should be rejected, but it loads"
    assert documented_difference(case, NODES) == EXPLICIT_TAGS_RULE
    other = {**case, "xml": case["xml"].replace("ReactiveSequence", "Sequence")}
    assert documented_difference(other, NODES) is None


def test_text_for_an_untyped_entry_is_a_documented_difference() -> None:
    (case,) = (case for case in read_cases(MORE / "g3_scopes.jsonl.gz") if case["id"].endswith("770200-4998"))
    assert "bb: expected" in str(compare_case(case, NODES))
    assert documented_difference(case, NODES) == UNTYPED_TEXT_RULE
    altered_case = copy.deepcopy(case)
    altered_case["expect"]["ticks"][0]["bb"]["n"] = 3.0
    assert documented_difference(altered_case, NODES) is None


def test_command_counts_documented_differences_separately(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(FRESH / "real_differences.jsonl.gz")]) == 0
    assert capsys.readouterr().out == "66 passed, 0 failed, 9 differ as documented\n"


# --- the runner detects altered cases


def altered(case: Case, alter: Callable[[list[Any]], None]) -> Case:
    other = copy.deepcopy(case)
    alter(other["expect"]["ticks"])
    return other


def case_with_all_data() -> Case:
    """Return a case whose ticks have events, calls and a blackboard, and that raises nothing."""
    for case in recorded("v4_full"):
        ticks = case["expect"].get("ticks", [])
        if len(ticks) > 2 and all(
            "status" in tick and tick["events"] and tick["calls"] and tick["bb"] for tick in ticks
        ):
            return copy.deepcopy(case)
    raise AssertionError("no case is rich enough")


def case_with_exception() -> Case:
    for case in recorded("v4_full"):
        if "exception" in case["expect"].get("ticks", [{}])[-1]:
            return copy.deepcopy(case)
    raise AssertionError("no case raises")


def case_with_load_error() -> Case:
    return next(case for case in recorded("v4_mutated") if "load_error" in case["expect"])


def other_status(ticks: list[Any]) -> None:
    ticks[0]["status"] = "FAILURE" if ticks[0]["status"] != "FAILURE" else "SUCCESS"


def other_event(ticks: list[Any]) -> None:
    ticks[0]["events"][0][2] = "SKIPPED"


def missing_event(ticks: list[Any]) -> None:
    del ticks[-1]["events"][-1]


def swapped_events(ticks: list[Any]) -> None:
    events = next(tick["events"] for tick in ticks if len(tick["events"]) > 1)
    events[0], events[1] = events[1], events[0]


def other_call(ticks: list[Any]) -> None:
    ticks[0]["calls"][0] += "!"


def extra_call(ticks: list[Any]) -> None:
    ticks[-1]["calls"].append("p1:tick")


def other_value(ticks: list[Any]) -> None:
    key = next(iter(ticks[-1]["bb"]))
    ticks[-1]["bb"][key] = "another"


def extra_entry(ticks: list[Any]) -> None:
    ticks[-1]["bb"]["an_entry_of_no_tree"] = None


def other_node_status(ticks: list[Any]) -> None:
    name = next(iter(ticks[0]["nodes"]))
    ticks[0]["nodes"][name] = "SKIPPED"


def missing_tick(ticks: list[Any]) -> None:
    del ticks[-1]


def extra_tick(ticks: list[Any]) -> None:
    ticks.append(copy.deepcopy(ticks[-1]))


def unexpected_exception(ticks: list[Any]) -> None:
    del ticks[-1]["status"]
    ticks[-1]["exception"] = "it never did"


@pytest.mark.parametrize(
    "alter",
    [
        other_status,
        other_event,
        missing_event,
        swapped_events,
        other_call,
        extra_call,
        other_value,
        extra_entry,
        other_node_status,
        extra_tick,
        unexpected_exception,
    ],
)
def test_altered_expectation_is_reported_as_a_difference(alter: Callable[[list[Any]], None]) -> None:
    case = case_with_all_data()
    assert compare_tree_case(case, NODES) is None
    message = compare_tree_case(altered(case, alter), NODES)
    assert message is not None
    assert "expected" in message


def test_unexpected_tick_is_a_difference() -> None:
    case = altered(case_with_all_data(), missing_tick)
    assert "ticks" in str(compare_tree_case(case, NODES))


def test_unexpected_exception_is_a_difference() -> None:
    case = case_with_exception()
    assert compare_tree_case(case, NODES) is None
    last = case["expect"]["ticks"][-1]
    del last["exception"]
    last["status"] = "SUCCESS"
    assert "got an exception" in str(compare_tree_case(case, NODES))


def test_state_at_an_exception_is_compared() -> None:
    case = case_with_exception()
    case["expect"]["ticks"][-1]["calls"].append("nobody:tick")
    assert "calls" in str(compare_tree_case(case, NODES))


def test_a_tree_that_loads_but_should_not_is_a_difference() -> None:
    case = {**case_with_all_data(), "expect": {"load_error": "it is broken"}}
    assert compare_tree_case(case, NODES) == "the tree should be rejected, but it loads"


def test_a_tree_that_is_refused_but_should_load_is_a_difference() -> None:
    refused = case_with_load_error()
    assert compare_tree_case(refused, NODES) is None
    case = {**refused, "expect": {"ticks": []}}
    assert "the tree should load, but it is rejected" in str(compare_tree_case(case, NODES))


def test_case_format_overrides_the_format_in_the_xml() -> None:
    xml = '<root BTCPP_format="4"><BehaviorTree ID="Main"><SequenceStar><PlanSync plan="S"/></SequenceStar>'
    case = {"xml": xml + "</BehaviorTree></root>", "ticks": 1}
    assert [tick["status"] for tick in run_case({**case, "format": 3}, NODES)["ticks"]] == ["SUCCESS"]
    assert "SequenceStar" in run_case({**case, "format": 4}, NODES)["load_error"]


# --- the command


def flip_bytes(packed: bytes) -> bytes:
    return packed[:2000] + bytes(255 - byte for byte in packed[2000:2100]) + packed[2100:]


def write_cases(path: Path, given: list[Case]) -> str:
    with gzip.open(path, "wt", encoding="utf-8") as lines:
        lines.writelines(json.dumps(case) + "\n" for case in given)
    return str(path)


def test_command_counts_and_exits_with_0_when_nothing_differs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trees = write_cases(tmp_path / "trees.jsonl.gz", recorded("v4_control")[:20])
    assert main([trees, str(DATA / "scripts.jsonl.gz"), str(DATA / "convert.jsonl.gz")]) == 0
    assert capsys.readouterr().out == "2420 passed, 0 failed\n"


def test_command_exits_with_1_and_shows_the_difference_of_an_altered_case(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    several = recorded("v4_control")[:5]
    several[2] = altered(several[2], other_status)
    file = write_cases(tmp_path / "altered.jsonl.gz", several)
    assert main([file]) == 1
    first, second = capsys.readouterr().out.splitlines()
    assert first == "4 passed, 1 failed"
    assert second.startswith(f"{file}: {several[2]['id']}: tick 1: status: expected")


def test_command_reads_an_uncompressed_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "plain.jsonl"
    file.write_text(json.dumps(recorded("v4_control")[0]) + "\n\n", encoding="utf-8")
    assert main([str(file)]) == 0
    assert capsys.readouterr().out == "1 passed, 0 failed\n"


def test_command_shows_first_ten_differences(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = write_cases(
        tmp_path / "many.jsonl.gz", [altered(case, other_status) for case in recorded("v4_control")[:12]]
    )
    assert main([file]) == 1
    out = capsys.readouterr().out.splitlines()
    assert out[0] == "0 passed, 12 failed"
    assert len(out) == 11


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("nothing.jsonl.gz", None),
        ("not_packed.jsonl.gz", b'{"id": "x"}\n'),
        ("cut_off.jsonl.gz", (DATA / "v4_control.jsonl.gz").read_bytes()[:5000]),
        ("no_json.jsonl", b"it is not what it says\n"),
        ("no_text.jsonl", b"\xff\xfe\x00"),
        ("flipped_bits.jsonl.gz", flip_bytes((DATA / "v4_control.jsonl.gz").read_bytes())),
        ("no_case.jsonl", b"[1, 2]\n"),
        ("no_tree.jsonl", b'{"id": "x", "ticks": 3}\n'),
    ],
)
def test_unreadable_file_ends_the_command_with_status_2_and_a_message(
    name: str, content: bytes | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / name
    if content is not None:
        file.write_bytes(content)
    assert main([str(file)]) == 2
    message = capsys.readouterr()
    assert message.out == ""
    assert message.err.startswith(f"{file}: cannot read the file as recorded cases: ")
    assert message.err.count("\n") == 1


def test_program_exits_with_1_and_prints_the_difference(tmp_path: Path) -> None:
    good = recorded("v4_control")[:3]
    bad = write_cases(tmp_path / "bad.jsonl.gz", [good[0], altered(good[1], other_event), good[2]])
    home = Path(btcore.__file__).parent.parent
    done = subprocess.run(
        [sys.executable, Path(__file__).with_name("recorded_cases.py"), bad],
        env={**os.environ, "PYTHONPATH": str(home)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert done.stdout.startswith(f"2 passed, 1 failed\n{bad}: {good[1]['id']}: tick 1: events: expected ")
    assert done.stderr == ""
