"""The page of the preview in headless Chromium: tree selector, banner, keyboard and roles."""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

TREES = """<root BTCPP_format="4" main_tree_to_execute="Zulu">
  <BehaviorTree ID="Alpha"><AlwaysSuccess name="first"/></BehaviorTree>
  <BehaviorTree ID="Zulu">
    <Sequence name="round"><Sleep name="rest" msec="5"/><SubTree ID="Alpha"/></Sequence>
  </BehaviorTree>
</root>
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "trees.xml"
    path.write_text(TREES, encoding="utf-8")
    return path


@pytest.fixture
def page(file: Path, browser: Any) -> Iterator[Any]:
    """The page of the file, which shows the main tree."""
    command = [sys.executable, "-m", "btcore", "preview", "--json", str(file)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        page = browser.new_page(viewport={"width": 1280, "height": 760})
        page.goto(json.loads(process.stdout.readline())["url"])
        page.wait_for_selector("#lines .t")
        yield page
        page.close()
        process.terminate()


def test_the_selector_names_the_tree_that_is_drawn(page: Any, file: Path) -> None:
    page.wait_for_selector("#tree option[value='Zulu']", state="attached")
    assert page.input_value("#tree") == "Zulu"
    # A file with errors keeps the picture, and may lack its tree.
    file.write_text(TREES.replace('"Zulu">\n', '"Yankee">\n').replace("</Sequence>", ""), encoding="utf-8")
    page.wait_for_selector("#canvas.stale")
    assert page.text_content("svg > .title") == "Zulu"
    assert page.input_value("#tree") == "Zulu"
    file.write_text(TREES, encoding="utf-8")
    page.wait_for_selector("#canvas:not(.stale)")
    page.select_option("#tree", "Alpha")
    page.wait_for_selector("svg > .title:text('Alpha')")
    file.write_text(TREES.replace("rest", "sleep"), encoding="utf-8")
    page.wait_for_selector("#lines :text('sleep')")
    assert page.text_content("svg > .title") == "Alpha"
    assert page.input_value("#tree") == "Alpha"


def test_each_message_of_the_banner_has_its_own_line(page: Any, file: Path) -> None:
    pytest.importorskip("btcore_monitor.preview_extension")
    file.write_text(TREES.replace("</Sequence>", ""), encoding="utf-8")
    page.wait_for_selector("#canvas.stale")
    page.fill("#address", "no such address")
    page.click("#connect")
    page.wait_for_selector("#notice p + p")
    stale, rejected = page.locator("#notice p").all_text_contents()
    assert stale == "The file has errors. This is the last picture without errors."
    assert "no such address" in rejected


def test_nodes_are_reached_by_tab_and_described_to_screen_readers(page: Any) -> None:
    focus = "document.activeElement.getAttribute('aria-label')"
    for _ in range(20):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.getAttribute('role')") == "treeitem":
            break
    assert page.evaluate(focus) == "round, control Sequence"
    page.keyboard.press("ArrowDown")
    assert page.evaluate(focus) == "rest, action Sleep"
    assert "rest" in page.inner_text("#node .name")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Space")  # hides the nodes below
    page.wait_for_selector("g[aria-expanded='false']")
    assert page.evaluate(focus) == "Alpha, subtree SubTree Alpha"
    tree = page.get_by_role("tree", name="Tree Zulu")
    items = tree.get_by_role("treeitem")
    assert [item.get_attribute("aria-level") for item in items.all()] == ["1", "2", "2"]
    assert items.nth(2).get_attribute("aria-selected") == "true"
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.closest('#canvas')") is None
