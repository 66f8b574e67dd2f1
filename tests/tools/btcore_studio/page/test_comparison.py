"""The page of `btcore studio --compare` in Chromium."""

from pathlib import Path
from typing import Any

from tests.tools.btcore_studio.page.conftest import OpenPage, StartStudio, accessibility_violations

HOSTILE = "&lt;img src=x onerror=hacked=1>"
PARTS = "".join(f'<Parallel name="part {number}"><AlwaysSuccess/></Parallel>' for number in range(9))
OLD = f"""<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <Sequence name="round">
      <Sleep name="{HOSTILE}" msec="1"/>
      {PARTS}<Sleep name="rest" msec="5"/>{PARTS.replace("part", "other")}
    </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="Other"><AlwaysSuccess name="ready"/></BehaviorTree>
</root>
"""
NEW = (
    OLD.replace('msec="5"', 'msec="5" _skipIf="&lt;b onclick=hacked=1>"')
    .replace(f'name="{HOSTILE}"', f'name="{HOSTILE}{HOSTILE}"')
    .replace('<Parallel name="part 3">', '<Timeout msec="9"/><Parallel name="part 3">')
    .replace('<AlwaysSuccess name="ready"/>', '<Inverter><AlwaysSuccess name="ready"/></Inverter>')
)


def test_differences_are_marked_and_listed_and_both_pictures_follow(
    tmp_path: Path, start_studio: StartStudio, open_page: OpenPage
) -> None:
    (tmp_path / "old").mkdir()
    (tmp_path / "old/tree.xml").write_text(OLD, encoding="utf-8")
    (tmp_path / "new.xml").write_text(NEW, encoding="utf-8")
    studio = start_studio(tmp_path, "--compare", "old/tree.xml", "new.xml")
    page = open_page(studio, viewport={"width": 1000, "height": 500})
    items = page.locator(".differences li")
    items.nth(3).wait_for()
    assert [text.split("\n")[0] for text in items.all_inner_texts()] == ["≠", "+", "≠", "+"]
    assert "_skipIf\nnot set → <b onclick=hacked=1>" in items.nth(2).inner_text()
    assert page.evaluate("typeof hacked") == "undefined"
    old, new = (page.locator(".version").nth(number) for number in (0, 1))
    assert accessibility_violations(page) == []

    def top(side: Any, name: str) -> float:
        """Return the place of a node below the upper edge of its picture."""
        node, frame = side.locator("g[data-uid]", has_text=name).bounding_box(), side.locator(".canvas")
        return float(node["y"] - frame.bounding_box()["y"])

    # A click in the list shows the node in both pictures, at the same place.
    items.nth(2).locator("button").click()
    for side in (old, new):
        assert side.locator("g.selected.changed .change", has_text="≠").count() == 1
        assert side.locator("g.selected").get_attribute("aria-description").startswith("changed")
    assert abs(top(old, "rest") - top(new, "rest")) < 2
    # The pictures scroll and zoom together, from both sides.
    page.keyboard.press("+")
    for side, other, by in ((old, new, 9_000), (new, old, -9_000)):
        side.locator(".canvas").hover()
        before = other.locator(".canvas").evaluate("frame => frame.scrollTop")
        page.mouse.wheel(0, by)
        page.wait_for_function(
            "([frame, before, by]) => (frame.scrollTop - before) / Math.sign(by) > 20",
            arg=[other.locator(".canvas").element_handle(), before, by],
        )
    # The next difference is in another tree, and one version lacks it.
    page.keyboard.press("n")
    new.locator("g.selected.added", has_text="Inverter").wait_for()
    assert old.locator("g.selected").count() == 0
    assert new.locator(".canvas").get_attribute("aria-label") == "New version of the tree Other"
    (tmp_path / "new.xml").write_text(NEW[: NEW.index("<Inverter")], encoding="utf-8")
    new.locator(".note", has_text="The file has an error").wait_for()
    page.context.close()
    studio.process.join(60)
    assert studio.process.exitcode == 0
