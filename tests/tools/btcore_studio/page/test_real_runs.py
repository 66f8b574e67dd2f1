"""A run with real leaves in the page: start, watch, end, and its recording on the timeline."""

from pathlib import Path

from tests.tools.btcore_studio.page.conftest import (
    OpenPage,
    StartStudio,
    accessibility_violations,
    running_studio,
)

LIBRARIES = "recorder btrec.txt publisher"
LEAVES = """
import btcore

@btcore.action
def Greet(whom: btcore.In[str]) -> btcore.Status:
    print(f"hello <b>{whom}</b>", flush=True)
    return btcore.Status.SUCCESS
"""
TREE = """<root BTCPP_format="4">
  <BehaviorTree ID="Main">
    <Sequence name="visit"> <Greet whom="{who}"/> <Sleep name="rest" msec="600000"/> </Sequence>
  </BehaviorTree>
</root>
"""


def test_a_run_with_real_leaves(tmp_path: Path, open_page: OpenPage) -> None:
    folder = tmp_path / "project"
    folder.mkdir()
    (folder / "tree.xml").write_text(TREE)
    (folder / "leaves.py").write_text(LEAVES)
    arguments = ("tree.xml", "--plugin", str(folder / "leaves.py"))
    with running_studio(folder, *arguments, libraries=LIBRARIES) as studio:
        page = open_page(studio)
        said = page.locator(".message")
        page.get_by_role("button", name="Run real leaves …").click()
        field = page.get_by_label("Options of btcore run")
        # What a page may not give is refused with the reason.
        field.fill("--log x.btlog")
        field.press("Enter")
        said.get_by_text("a page cannot give the option '--log'").wait_for()
        field.fill("--set who=Ada")
        field.press("Enter")
        bar = page.get_by_role("region", name="Run with real leaves")
        page.locator("main g.node.s1", has_text="rest").wait_for()
        assert page.locator(".blackboard td", has_text="Ada").count() == 1
        bar.get_by_text("Output").click()
        bar.locator("pre", has_text="hello <b>Ada</b>").wait_for()
        assert accessibility_violations(page) == []
        bar.get_by_role("button", name="End the run").click()
        bar.get_by_text("The run was interrupted.").wait_for()
        bar.get_by_role("button", name="Show on the timeline").click()
        page.get_by_role("slider").wait_for()
        shown = page.get_by_role("region", name="Shown run")
        with page.expect_download() as download:
            shown.get_by_role("button", name="Recording").click()
        assert download.value.suggested_filename == "tree.btrec.txt"
        page.locator("g.node", has_text="Greet").click()
        page.locator("aside.right").get_by_text("Ada").first.wait_for()
        bar.get_by_role("button", name="Close").click()
        # The options of the file are kept.
        page.get_by_role("button", name="Run real leaves …").click()
        assert field.input_value() == "--set who=Ada"
        page.set_viewport_size({"width": 390, "height": 800})
        assert page.evaluate("document.documentElement.scrollWidth") <= 390


def test_without_trust_there_are_no_real_leaves(
    tmp_path: Path, start_studio: StartStudio, open_page: OpenPage
) -> None:
    (tmp_path / "tree.xml").write_text(TREE)
    page = open_page(start_studio(tmp_path, "tree.xml"))
    page.get_by_role("button", name="Run", exact=True).wait_for()
    assert page.get_by_role("button", name="Run real leaves …").count() == 0
