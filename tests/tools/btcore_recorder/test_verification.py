"""The first difference between a recording and its replay: its place and its probable cause."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest

import btcore
from btcore import Registry, SimClock
from btcore_recorder import record
from btcore_recorder.facts import hash_file
from btcore_recorder.files import read_recording
from btcore_recorder.verification import verify

XML = """<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>
  <Script code="n := 1"/><Sleep msec="300"/><Look map="{m}"/><ScriptCondition name="check" code="n == 1"/>
</Sequence></BehaviorTree></root>
"""


@btcore.action
def look(clock: btcore.Clock, map: btcore.Put[object]) -> bool:
    map(7)
    return True


def run(folder: Path, *, keeps_transitions: bool = False) -> Path:
    document, nodes = folder / "tree.xml", Registry.standard()
    document.write_text(XML)
    nodes.add(look)
    tree = btcore.load(document, nodes=nodes, clock=SimClock())
    with record(tree, folder / "run.btrec.txt", keeps_transitions=keeps_transitions) as recorder:
        tree.tick_while_running(period=0.2)
    assert verify(recorder.path).is_same
    return recorder.path


def edit(file: Path, change: Callable[[str], str]) -> Path:
    """Change a recording, also the checksums of its lines, which are optional."""
    text = change(file.read_text())
    file.write_text(re.sub(r"^((head|end|state_end) .*?)\d+\]$", r"\1null]", text, flags=re.MULTILINE))
    return file


def without_result(text: str) -> str:
    return text.replace('result [4, "SUCCESS"]\n', "")


def test_the_facts_of_a_run_are_recorded(tmp_path: Path) -> None:
    recording = read_recording(run(tmp_path))
    facts = recording.head.facts
    place, code_hash = facts.code["Look"]
    assert place == f"{__file__}:{look.__code__.co_firstlineno}"  # type: ignore[attr-defined]
    assert code_hash == hash_file(__file__)
    assert (list(facts.libraries), facts.resources) == (
        [__name__.partition(".")[0]],
        ("btcore.clock.Clock",),
    )
    # The first tick, the period, and the end of the delay.
    assert [step.woken_by for step in recording.steps if step.tick] == [0, 0, 3]


def test_who_requested_a_tick_is_recorded(tmp_path: Path) -> None:
    b = btcore.Builder()
    tree = b.build(b.Repeat(b.AlwaysSuccess(), num_cycles=2), clock=SimClock())
    with record(tree, tmp_path / "run.btrec.txt") as recorder:
        tree.tick_once()
        tree.wake()
        tree.tick_once()
    assert [step.woken_by for step in read_recording(recorder.path).steps] == [0, 1, -1, 1]


def test_files_of_one_run_have_its_number(tmp_path: Path) -> None:
    tree = btcore.loads(XML.replace('<Look map="{m}"/>', ""), clock=SimClock())
    with record(tree, tmp_path / "run.btrec.txt", max_duration_s=0.1):
        tree.tick_while_running(period=0.1)
    heads = [read_recording(file).head for file in tmp_path.glob("*.btrec.txt")]
    assert len(heads) > 1
    assert len({head.facts.run for head in heads}) == 1


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (lambda text: text.replace('"300"', '"200"'), "the tree changed"),
        (
            lambda text: re.sub(r'("btcore":)"[^"]*"', r'\1"0"', without_result(text)),
            "a rule of the engine changed",
        ),
        (lambda text: text.replace(hash_file(__file__), "0" * 16), "the code of a leaf changed"),
        (lambda text: text.replace('"m", 7', '"m", {"__text": "a map"}'), "a value is not replayable"),
        (without_result, "something was not recorded"),
    ],
)
def test_the_probable_cause(tmp_path: Path, change: Callable[[str], str], cause: str) -> None:
    recording = run(tmp_path)
    assert change(recording.read_text()) != recording.read_text()
    file = edit(recording, lambda text: without_result(change(text)))
    result = verify(file)
    assert result.cause == cause
    assert str(result).endswith(f"probable cause: {cause}")
    if cause != "the tree changed":
        data = result.as_data()
        assert (data["node"], data["recorded"]) == ("Look::4", "the end of the step")
        assert data["place"] == f"{tmp_path / 'tree.xml'}:2"
        assert str(data["code"]).startswith(f"{__file__}:")


def test_a_gap_is_a_probable_cause(tmp_path: Path) -> None:
    file = edit(run(tmp_path), without_result)
    text = file.read_text()
    state = text[text.index("\nentry ") : text.index("\nhead ")]
    file.write_text(
        text.replace("\ntick [3,", f'\nsegment ["the disk is full"]{state}\nstate_end [null]\ntick [3,')
    )
    assert verify(file).cause == "steps are missing"


def test_a_difference_is_located_to_the_transition(tmp_path: Path) -> None:
    file = edit(run(tmp_path, keeps_transitions=True), lambda text: text.replace("n == 1", "n == 2"))
    result = verify(file)
    assert result.difference is not None
    assert (result.difference.recorded, result.difference.now) == (
        "'check' becomes SUCCESS",
        "'check' becomes FAILURE",
    )
    assert result.difference.place == f"{tmp_path / 'tree.xml'}:2"
    assert f"tick 3, transition {result.difference.transition}: recorded: 'check'" in str(result)
