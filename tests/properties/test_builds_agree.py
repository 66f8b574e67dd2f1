"""The compiled engine and its pure Python source do the same with every tree."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import btcore
from btcore import builds
from btcore.testing import Outcomes, outcomes, xml_documents

HOME = Path(btcore.__file__).parent.parent
TREES = settings().max_examples


def drawn_cases() -> list[str]:
    """Return a line of JSON for each random tree and its plans."""
    cases: list[str] = []

    @settings(max_examples=TREES, derandomize=True, database=None)
    @given(
        xml_documents(own_outcomes=False, timed=True, subtrees=2, conditions=True, scripts=True),
        outcomes(skipped=True, raising=True),
        st.integers(1, 8),
    )
    def draw(text: str, plan: Outcomes, ticks: int) -> None:
        cases.append(json.dumps([text, plan.shared, ticks]))

    draw()
    return cases


def run_print_traces(cases: list[str], pure: bool) -> list[str]:
    done = subprocess.run(
        [sys.executable, str(Path(__file__).with_name("print_traces.py"))],
        input="\n".join(cases),
        env={**os.environ, "PYTHONPATH": str(HOME), "BTCORE_PURE": "1" if pure else "0"},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.splitlines()


@pytest.mark.skipif(builds.active_build() == "pure", reason="there is no compiled build here to compare with")
def test_both_builds_produce_the_same_trace_for_every_tree() -> None:
    cases = drawn_cases()
    compiled, pure = run_print_traces(cases, pure=False), run_print_traces(cases, pure=True)
    assert (compiled[0], pure[0]) == ("compiled", "pure")
    assert len(cases) >= TREES
    assert len(compiled) == len(pure) == len(cases) + 1
    differing = [case for case, fast, slow in zip(cases, compiled[1:], pure[1:], strict=True) if fast != slow]
    assert differing == []


def test_trace_contains_every_tick_and_the_halt() -> None:
    text = (
        '<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence name="all">'
        '<Act name="a"/><Script name="b" code="@a := 1"/><Act name="c"/></Sequence></BehaviorTree></root>'
    )
    build, story = run_print_traces([json.dumps([text, "S|RRRS", 2])], pure=True)
    assert build == "pure"
    first, second, end = json.loads(story)
    assert first[0] == "tick 1, at 0 s: RUNNING"
    assert first[1] == ["all: IDLE → RUNNING", "a: IDLE → SUCCESS", "b: IDLE → SUCCESS", "c: IDLE → RUNNING"]
    assert first[4] == {"a": 1}
    assert second[2] == {"all": ["RUNNING"], "c": ["RUNNING"]}
    assert (end[0], end[3], end[5]) == ("after a tick, at 0.02 s", ["all", "c"], [0, 0, 0, 0])
