"""Proofs in Chromium: questions, answers, and a counterexample on the tree."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from btcore_recorder import Replay
from tests.tools.btcore_studio.page.conftest import OpenPage, Studio, accessibility_violations, running_studio

TREE = """<root BTCPP_format="4" main_tree_to_execute="Enter">
  <BehaviorTree ID="Enter">
    <ReactiveSequence name="enter">
      <IsClosed/>
      <Fallback name="open"> <Turn name="&lt;i>turn"/> <Push/> </Fallback>
    </ReactiveSequence>
  </BehaviorTree>
  <TreeNodesModel> <Condition ID="IsClosed"/> <Action ID="Push"/> <Action ID="Turn"/> </TreeNodesModel>
</root>
"""
# The search for all states takes longer than any test.
LARGE = " ".join(f'<Sequence> <Act{i}/> <Script code="k{i} := 1"/> <Act{i}/> </Sequence>' for i in range(12))
LARGE = (
    f'<root BTCPP_format="4"><BehaviorTree ID="Large"> <Parallel> {LARGE} </Parallel> </BehaviorTree></root>'
)


@pytest.fixture(scope="module")
def studio(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Studio]:
    folder = tmp_path_factory.mktemp("studio")
    (folder / "door.xml").write_text(TREE)
    (folder / "large.xml").write_text(LARGE)
    with running_studio(folder, "door.xml", libraries="search run btrec.txt changed") as started:
        yield started


@pytest.fixture
def page(studio: Studio, open_page: OpenPage) -> Any:
    return open_page(studio)


def wait_for_message(page: Any, text: str) -> None:
    page.locator(".message", has_text=text).wait_for()


def test_a_proof_and_its_counterexample(page: Any, tmp_path: Path) -> None:
    page.locator(".run-bar button", has_text="Prove").click()
    proof = page.get_by_role("region", name="Proof", exact=True)
    proof.get_by_label("Own questions").fill("never Push\n\nIsClosed is SUCCESS before Push\n")
    proof.locator("button", has_text="Search all runs").click()
    wait_for_message(page, "Enter: 1 refuted, 8 proved.")
    first = proof.locator("li").first
    assert first.locator("b").inner_text() == "never Push"
    assert accessibility_violations(page) == []
    first.locator("button", has_text="Show the run").click()
    page.locator(".shown-run", has_text="Counterexample: never Push").wait_for()
    page.locator("main g.node.s1", has_text="Push").wait_for()
    page.locator("main g.node.s3", has_text="<i>turn").wait_for()
    wait_for_message(page, "The counterexample has one step.")
    # Why, by the key of the picture.
    page.locator("main g.node", has_text="Push").first.click()
    page.keyboard.press("y")
    page.locator(".explanation", has_text="Push").wait_for()
    page.keyboard.press(",")
    page.locator("main .timeline output", has_text="Start").wait_for()
    with page.expect_download() as saved:
        page.get_by_role("region", name="Shown run").locator("button", has_text="Recording").click()
    saved.value.save_as(tmp_path / "run.btrec.txt")
    assert Replay(tmp_path / "run.btrec.txt").verify() is None
    page.get_by_label("Close this run").click()
    page.locator(".run-bar button", has_text="Run").wait_for()
    assert page.locator("main g.node.s1").count() == 0
    # The answers are about the tree before an edit.
    page.locator("main g.node", has_text="Push").first.click()
    page.keyboard.press("Delete")
    proof.locator(".outdated").wait_for()
    proof.locator("button", has_text="Search all runs").press("Enter")
    proof.locator("li.unknown", has_text="the tree has no node 'Push'").first.wait_for()
    page.get_by_role("button", name="Undo").click()  # the pages share the text
    page.locator("main g.node", has_text="Push").first.wait_for()


def test_a_search_shows_its_progress_and_is_stopped(page: Any) -> None:
    page.locator(".files button", has_text="large.xml").click()
    page.locator("main g.node", has_text="Act0").first.wait_for()
    page.locator(".run-bar button", has_text="Prove").press("Enter")
    proof = page.get_by_role("region", name="Proof", exact=True)
    proof.locator("button", has_text="Search all runs").press("Enter")
    proof.locator(".dim", has_text="states searched").wait_for()
    proof.locator("button", has_text="Stop").press("Enter")
    wait_for_message(page, "The search was stopped.")
    proof.locator("button", has_text="Search all runs").wait_for()


def test_what_if_with_the_edited_tree_and_with_another_result(page: Any) -> None:
    page.locator(".run-bar button", has_text="Run").click()
    for name, result in (("IsClosed", "Success"), ("<i>turn", "Failure"), ("Push", "Success")):
        page.locator(".question h2", has_text=f"What does {name} do?").wait_for()
        page.locator(".question button", has_text=result).first.click()
    page.locator(".run-bar output", has_text="SUCCESS").wait_for()
    # Another result of a leaf.
    page.locator("main g.node", has_text="Push").first.click()
    page.locator(".what-if summary").click()
    page.get_by_label("Result of Push").select_option("Failure")
    page.locator(".what-if button", has_text="Run again").first.click()
    shown = page.get_by_role("region", name="Shown run")
    shown.locator("b", has_text="What if Push: Failure in tick 1").wait_for()
    page.locator("main .timeline output", has_text="FAILURE").wait_for()
    assert "it differs from tick 1 on" in shown.inner_text()
    assert accessibility_violations(page) == []
    assert shown.locator("button", has_text="Test").count() == 1
    page.get_by_label("Close this run").click()
    page.locator("main .run-bar output", has_text="SUCCESS").wait_for()
    # The edited tree.
    page.locator("main g.node", has_text="open").first.click()
    page.keyboard.press("Delete")
    page.locator(".run-note button", has_text="What if with the edited tree").click()
    shown.locator("b", has_text="What if with the edited tree").wait_for()
    assert (
        "it differs from tick 1 on: recorded: 'Fallback" in shown.inner_text() or "open" in shown.inner_text()
    )
    page.locator("main .timeline output", has_text="SUCCESS").wait_for()
    page.get_by_role("button", name="Undo").click()
    shown.locator("button", has_text="What if with the edited tree").click()
    shown.locator("span", has_text="the same in all 1 ticks").wait_for()
