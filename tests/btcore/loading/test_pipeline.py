"""Loading as a pipeline of values: read, define, plan, instantiate."""

import sys
import traceback
from pathlib import Path
from types import FrameType

import pytest

import btcore
from btcore import Registry, TreeError, builds, loads
from btcore.loading.instantiate import instantiate
from btcore.xml.define import define
from btcore.xml.plan.plan import plan
from btcore.xml.read.read import parse_text, read

CALLING = """<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <Sequence><Script code="a := 1"/><AlwaysSuccess/><SubTree ID="Inner"/></Sequence>
  </BehaviorTree>
  <BehaviorTree ID="Inner"><AlwaysSuccess/></BehaviorTree>
  <BehaviorTree ID="Unused"><Sleep msec="abc"/></BehaviorTree>
</root>"""


def test_each_stage_gets_the_result_of_the_stage_before() -> None:
    sources = read(parse_text(CALLING))
    definitions = define(sources)
    plans = plan(definitions, Registry.standard())
    assert definitions.sources is sources
    assert plans.definitions is definitions
    assert list(definitions.by_id) == ["Main", "Inner", "Unused"]
    assert {id: plans.sizes[id] for id in plans.trees} == {"Main": (5, 3), "Inner": (1, 1)}
    assert instantiate(plans).tick_while_running() is btcore.SUCCESS
    # A result can be used again.
    assert instantiate(plans).nodes[0] is not instantiate(plans).nodes[0]


def test_trees_that_are_not_used_are_planned_on_request_only() -> None:
    definitions = define(read(parse_text(CALLING)))
    assert plan(definitions, Registry.standard()).diagnostics.errors == ()
    (error,) = plan(definitions, Registry.standard(), every_tree=True).diagnostics.errors
    assert (error.code, error.line) == ("E202", 6)


def test_a_stage_keeps_what_the_stages_before_have_found() -> None:
    text = CALLING.replace("</root>", '<include path="absent.xml"/><BehaviorTree ID="Inner"/></root>')
    sources = read(parse_text(text))
    definitions = define(sources, tree_id="Unused")
    plans = plan(definitions, Registry.standard())
    found = [sources.diagnostics, definitions.diagnostics, plans.diagnostics]
    assert [[one.code for one in each.errors] for each in found] == [
        ["E007"],
        ["E007"],
        ["E007", "E104", "E202"],
    ]
    assert [[one.code for one in each.warnings] for each in found] == [[], ["W102"], ["W102"]]
    with pytest.raises(TreeError):
        instantiate(plans)


@pytest.mark.skipif(builds.active_build() == "compiled", reason="compiled functions are not traced")
def test_loading_a_small_tree_stays_a_short_walk() -> None:
    """The second `loads` of a small tree passes few files and calls, so that a reader can follow it."""
    folder = str(Path(btcore.__file__).parent)
    files: list[str] = []

    def count(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and frame.f_code.co_filename.startswith(folder):
            files.append(frame.f_code.co_filename)

    text = CALLING.replace('  <BehaviorTree ID="Unused"><Sleep msec="abc"/></BehaviorTree>\n', "")
    loads(text)
    sys.setprofile(count)
    try:
        loads(text)
    finally:
        sys.setprofile(None)
    assert len(set(files)) <= 26, sorted(set(files))
    assert len(files) <= 550


def test_a_traceback_shows_no_frame_of_contextlib() -> None:
    with pytest.raises(TreeError) as caught:
        loads("<root><BehaviorTree><Absent/></BehaviorTree></root>")
    frames = traceback.extract_tb(caught.value.__traceback__)
    assert not [frame for frame in frames if "contextlib" in frame.filename]
