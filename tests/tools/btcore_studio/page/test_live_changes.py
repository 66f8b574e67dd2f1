"""The page attached to a running tree: values, forced results and a reload, by mouse and keyboard."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import btcore
from tests.tools.btcore_studio.page.conftest import OpenPage, StartStudio, accessibility_violations

TREE = """<root BTCPP_format="4">
  <BehaviorTree ID="Main">
    <Fallback name="try">
      <Script name="count" code="laps := laps + 1"/>
      <Sleep name="rest" msec="{rest}"/>
    </Fallback>
  </BehaviorTree>
</root>
"""


class Robot:
    """A tree that a thread ticks and publishes, and that takes the texts of clients as `btcore run` does.

    Attributes:
        texts: The texts, of which those with "bad" are refused.
    """

    def __init__(self, **options: Any) -> None:
        from btcore_monitor.serve import serve

        self.tree = btcore.loads(TREE)
        self.tree.blackboard["rest"] = 1
        self.tree.blackboard["greeting"] = '"<b>hello</b>"'
        self.tree.blackboard.set("laps", 0, btcore.values.ANY)
        self.texts: list[str] = []
        self.publisher = serve(self.tree, groot2_port=0, allow_control=True, **options)
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._tick)

    @property
    def arguments(self) -> tuple[str, ...]:
        return ("--live", self.publisher.address)

    def _tick(self) -> None:
        requests = self.publisher.reload_requests
        while not self._end.wait(0.01):
            self.tree.tick_once()
            if requests is not None and (request := requests.take()) is not None:
                self.texts.append(request.text)
                request.finish("the text has errors" if "bad" in request.text else "")

    @contextmanager
    def running(self) -> Iterator["Robot"]:
        if self.publisher.reload_requests is not None:
            self.publisher.reload_requests.is_used = True
        self._thread.start()
        try:
            yield self
        finally:
            self._end.set()
            self.tree.hooks.ignore_breakpoints()
            self._thread.join(60)
            self.publisher.close()


def entry(page: Any, key: str) -> Any:
    return page.locator(".blackboard tr").filter(has=page.locator("th", has_text=key))


def test_values_results_and_text_are_changed(
    tmp_path: Path, start_studio: StartStudio, open_page: OpenPage
) -> None:
    (tmp_path / "tree.xml").write_text(TREE)
    with Robot(allow_changes=True).running() as robot:
        page = open_page(start_studio(tmp_path, "tree.xml", *robot.arguments))
        said = page.locator(".message")
        page.locator("g.node", has_text="count").click()
        page.keyboard.press("b")
        page.locator("button.continue").wait_for()
        # A value by the keyboard; the text of a string has no quotation marks.
        entry(page, "greeting").locator("button.value").focus()
        page.keyboard.press("Enter")
        field = page.locator(".value-field input")
        assert field.input_value() == '"<b>hello</b>"'
        page.keyboard.type("<img src=x onerror=alert(1)>")
        page.keyboard.press("Enter")
        entry(page, "greeting").locator("td", has_text="<img src=x onerror=alert(1)>").wait_for()
        assert robot.tree.blackboard["greeting"] == "<img src=x onerror=alert(1)>"
        assert page.evaluate("document.activeElement.className") == "value"
        # A value that does not fit keeps the field open, with the reason.
        entry(page, "rest").locator("button.value").click()
        field.fill("long")
        page.keyboard.press("Enter")
        assert "'long' is not an integer" in page.locator(".value-field p").inner_text()
        assert field.get_attribute("aria-invalid") == "true"
        assert accessibility_violations(page) == []
        page.keyboard.press("Escape")
        entry(page, "laps").locator("button.value").click()
        field.fill("500")
        page.keyboard.press("Enter")
        entry(page, "laps").locator("td", has_text="500").wait_for()
        # The node fails without being ticked, so that its sibling is ticked.
        page.locator(".live-controls button", has_text="Fail").click()
        page.locator("g.node.r3", has_text="count").wait_for()
        said.get_by_text("The tree waits at the breakpoint before count.").wait_for()  # in the next tick
        reload = page.locator(".live-controls button", has_text="Reload")
        page.locator("button.continue").wait_for()
        reload.click()
        said.get_by_text("The tree was not reloaded: the tree waits at a breakpoint").wait_for()
        page.locator("g.node", has_text="count").click()
        page.keyboard.press("b")
        page.locator("button.continue").wait_for(state="detached")
        # The text of the page, which is not saved.
        page.locator("#field-name").fill("counted")
        page.keyboard.press("Enter")
        page.locator("g.node", has_text="counted").wait_for()
        reload.click()
        said.get_by_text("The running tree has the text of this page.").wait_for()
        assert robot.texts == [TREE.replace('"count"', '"counted"')]
        assert robot.tree.blackboard["laps"] >= 500
        assert (tmp_path / "tree.xml").read_text() == TREE


def test_what_the_robot_or_the_studio_does_not_allow_is_not_offered(
    tmp_path: Path, start_studio: StartStudio, open_page: OpenPage
) -> None:
    (tmp_path / "tree.xml").write_text(TREE)
    with Robot().running() as robot:
        page = open_page(start_studio(tmp_path, "tree.xml", *robot.arguments))
        cell = entry(page, "rest").locator("td[title*='--allow-changes']")
        cell.wait_for()
        assert page.locator("button.value").count() == 0
        reload = page.locator(".live-controls button[aria-disabled=true]", has_text="Reload")
        assert "--allow-changes" in reload.get_attribute("title")
        reload.dispatch_event("click")
        page.locator(".message", has_text="--allow-changes").wait_for()
    with Robot(allow_changes=True).running() as robot:
        page = open_page(start_studio(tmp_path, "tree.xml", "--read-only", *robot.arguments))
        entry(page, "rest").locator("td[title*='read-only']").wait_for()
        page.locator("g.node", has_text="count").click()
        page.keyboard.press("b")
        page.locator("button.continue").wait_for()
        assert page.locator(".live-controls button[aria-disabled=true]").count() == 3
        page.locator(".live-controls button", has_text="Fail").dispatch_event("click")
        page.locator(".message", has_text="read-only").wait_for()
        assert page.locator("button.continue").is_visible()
