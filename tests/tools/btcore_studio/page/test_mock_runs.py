"""Runs with mock leaves in Chromium, by mouse and by keyboard."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from btcore_recorder import Replay
from tests.tools.btcore_studio.page.conftest import OpenPage, Studio, accessibility_violations, running_studio

TREE = """<root BTCPP_format="4" main_tree_to_execute="Enter">
  <BehaviorTree ID="Enter">
    <Sequence name="enter">
      <IsClosed/>
      <SubTree ID="Open" angle="{a}"/>
      <Script code="b := a + 1"/>
    </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="Open">
    <Fallback name="open"> <Turn name="&lt;i>turn" angle="{angle}"/> <Push/> </Fallback>
  </BehaviorTree>
  <TreeNodesModel>
    <Condition ID="IsClosed"/> <Action ID="Push"/>
    <Action ID="Turn"> <output_port name="angle" type="int"/> </Action>
  </TreeNodesModel>
</root>
"""
STATUS = {"running": "s1", "success": "s2", "failure": "s3"}


@pytest.fixture(scope="module")
def studio(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Studio]:
    folder = tmp_path_factory.mktemp("studio")
    (folder / "door.xml").write_text(TREE)
    # Each page has a run of its own, and none saves the file.
    with running_studio(folder, "door.xml") as started:
        yield started


@pytest.fixture
def page(studio: Studio, open_page: OpenPage) -> Any:
    return open_page(studio)


def wait_for_question(page: Any, name: str) -> Any:
    page.locator(".question h2", has_text=f"What does {name} do?").wait_for()
    return page.locator(".question")


def wait_for_status(page: Any, name: str, status: str) -> None:
    page.locator(f"main g.node.{STATUS[status]}", has_text=name).first.wait_for()


def wait_for_moment(page: Any, text: str) -> None:
    page.locator(".run-bar output", has_text=text).wait_for()


def wait_for_message(page: Any, text: str) -> None:
    page.locator(".message", has_text=text).wait_for()


def entry(page: Any, key: str) -> str:
    return str(
        page.locator(".blackboard tr:not(.scope)", has=page.locator("th", has_text=key))
        .locator("td")
        .first.inner_text()
    )


def test_a_run_by_mouse(page: Any, tmp_path: Path) -> None:
    page.locator(".run-bar button", has_text="Run").click()
    asked = wait_for_question(page, "IsClosed")
    wait_for_status(page, "enter", "running")
    asked.get_by_label("Answer so from now on").check()
    asked.locator("button", has_text="Success").click()
    asked = wait_for_question(page, "<i>turn")
    asked.locator("input[name=angle]").fill("far")
    asked.locator("button", has_text="Success").click()
    wait_for_message(page, "port [angle] takes int")
    asked.locator("input[name=angle]").fill("4")
    # A node covers no question: the question is beside it, within the picture.
    frame, box = page.locator(".canvas-pane").bounding_box(), asked.bounding_box()
    assert frame["x"] <= box["x"]
    assert box["y"] + box["height"] <= frame["y"] + frame["height"]
    page.get_by_label("Zoom out").click()
    page.wait_for_function(
        "before => document.querySelector('.question').getBoundingClientRect().y !== before.y", arg=box
    )
    asked.locator("button", has_text="Success").click()
    wait_for_message(page, "Tick 1: SUCCESS")
    assert entry(page, "b") == "5"

    # Planned leaves are not asked. The run plays until the tree ends.
    page.locator("main g.node", has_text="<i>turn").first.click()
    page.locator(".leaf-plan select").select_option("outcomes")
    page.locator(".leaf-plan input").fill("RRRRRS(angle=7)")
    page.locator(".leaf-plan input").press("Enter")
    page.locator(".run-bar select").select_option("100")
    page.get_by_label("Play or pause").click()
    wait_for_message(page, "Tick 7: SUCCESS")
    assert entry(page, "b") == "8"
    assert page.locator(".run-bar .track rect").count() == 3  # SUCCESS, RUNNING, SUCCESS

    # Dragged back, the page shows the moment, and the run can continue otherwise.
    page.locator(".run-bar input[type=range]").fill("3")
    wait_for_moment(page, "Tick 3")
    wait_for_status(page, "<i>turn", "running")
    assert entry(page, "b") == "5"
    page.locator(".run-bar button", has_text="Continue from here").click()
    page.locator(".leaf-plan select").select_option("ask")
    page.get_by_label("To the end of the tick").click()
    wait_for_question(page, "<i>turn").locator("button", has_text="Failure").click()
    wait_for_question(page, "Push").locator("button", has_text="Running").click()
    wait_for_message(page, "Tick 4: RUNNING")

    saved: list[Any] = []
    page.on("download", lambda download: saved.append(download))
    with page.expect_download(lambda download: download.suggested_filename == "test_door.py"):
        page.locator(".run-bar button", has_text="Test").click()
    wait_for_message(page, "Saved door.btrec.txt and test_door.py")
    for download in saved:
        download.save_as(tmp_path / download.suggested_filename)
    assert Replay(tmp_path / "door.btrec.txt").verify() is None
    assert 'tree=FOLDER / "door.xml"' in (tmp_path / "test_door.py").read_text()

    # An edit offers to run again: the same answers, and then a question.
    page.locator("main g.node", has_text="Script").first.click()
    page.locator("#field-code").fill("b := a * 100")
    page.locator("#field-code").press("Tab")
    page.locator(".run-note button", has_text="Run again").click()
    wait_for_message(page, "Tick 4: RUNNING")
    assert page.locator(".run-note").count() == 0
    page.locator(".run-bar input[type=range]").fill("1")
    wait_for_moment(page, "Tick 1")
    assert entry(page, "b") == "400"
    page.keyboard.press("Control+z")  # the pages share the text
    page.get_by_label("End the run").click()
    page.locator(".run-bar.start").wait_for()
    assert page.locator("main .live").count() == 0


def test_a_run_by_keyboard(page: Any) -> None:
    page.locator("main .canvas").focus()
    page.keyboard.press("s")
    wait_for_message(page, "At enter, in tick 1.")
    page.keyboard.press("s")
    wait_for_message(page, "At IsClosed, in tick 1.")
    page.keyboard.press("v")
    wait_for_question(page, "IsClosed")
    assert page.locator("[aria-live] p", has_text="IsClosed is ticked").count()
    page.keyboard.press("1")
    wait_for_status(page, "IsClosed", "success")
    page.keyboard.press("s")
    wait_for_message(page, "At Open, in tick 1.")
    page.keyboard.press("v")
    wait_for_question(page, "<i>turn")
    page.keyboard.press("2")
    wait_for_question(page, "Push")
    wait_for_status(page, "<i>turn", "failure")
    # The fields of a question are reached by Tab, and left to the picture by an answer.
    page.locator(".question button[value=R]").focus()
    page.keyboard.press("Enter")
    wait_for_message(page, "At Open, in tick 1.")
    assert page.evaluate("document.activeElement.className") == "canvas live"
    page.keyboard.press("Shift+V")
    wait_for_message(page, "At enter, in tick 1.")
    page.keyboard.press(".")
    wait_for_message(page, "Tick 1: RUNNING")
    page.keyboard.press(",")
    wait_for_message(page, "Before the first tick.")
    page.keyboard.press("r")
    wait_for_question(page, "Push")
    wait_for_moment(page, "In tick 2")
    assert page.get_by_label("Play or pause").get_attribute("aria-pressed") == "true"
    page.keyboard.press("r")
    wait_for_message(page, "Paused.")


def test_why_is_a_chain_on_the_tree(page: Any) -> None:
    page.locator(".run-bar button", has_text="Run").click()
    wait_for_question(page, "IsClosed").locator("button", has_text="Failure").click()
    wait_for_message(page, "Tick 1: FAILURE")
    page.locator("main .canvas").focus()
    page.keyboard.press("Home")
    page.keyboard.press("y")
    page.locator(".explanation", has_text="why did 'enter' return FAILURE").wait_for()
    assert page.locator("main .because").all_text_contents() == ["1", "2"]
    page.locator(".explanation li button", has_text="returned FAILURE").last.click()
    page.locator("main g.selected", has_text="IsClosed").wait_for()
    assert accessibility_violations(page) == []
    page.get_by_label("Close the explanation").click()
    assert page.locator("main .because").count() == 0
    page.locator(".explanation button", has_text="Why?").click()
    page.locator(".explanation", has_text="decides this in its own code").wait_for()


def test_a_run_is_accessible_and_fits_small_windows(page: Any) -> None:
    page.locator(".run-bar button", has_text="Run").click()
    wait_for_question(page, "IsClosed").locator("button", has_text="Success").click()
    wait_for_question(page, "<i>turn")
    page.locator("main g.node", has_text="<i>turn").first.click()
    page.locator(".leaf-plan select").select_option("outcomes")
    for theme in ("light", "dark"):
        page.evaluate("theme => { document.documentElement.dataset.theme = theme; }", theme)
        assert accessibility_violations(page) == []
    page.set_viewport_size({"width": 390, "height": 800})
    page.wait_for_function("() => document.querySelector('.question').getBoundingClientRect().right <= 390")
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    page.locator(".question button", has_text="Failure").click()
    wait_for_question(page, "Push")
