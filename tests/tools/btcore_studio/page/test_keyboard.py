"""The page with the keyboard alone, and what screen readers announce."""

import json
import time
from pathlib import Path
from typing import Any

from tests.tools.btcore_studio.page.conftest import FIRST_CHECK_MS, FOCUSED, TREE, OpenPage, StartStudio

WAIT_S = 30.0
HEARD = """() => {
  window.heard = [];
  new MutationObserver((records) => {
    for (const { addedNodes } of records) for (const node of addedNodes) heard.push(node.textContent);
  }).observe(document.querySelector("[aria-live]"), { childList: true });
}"""


def open_tree(folder: Path, start_studio: StartStudio, open_page: OpenPage, **options: Any) -> Any:
    """Open a page, whose announcements are collected."""
    (folder / "tree.xml").write_text(TREE, encoding="utf-8")
    page = open_page(start_studio(folder, "tree.xml"), **options)
    page.evaluate(HEARD)
    return page


def hears(page: Any, text: str) -> None:
    """Wait until a text is announced. Forget what has been announced."""
    end = time.monotonic() + WAIT_S
    while not page.evaluate("text => heard.some(item => item.includes(text))", text):
        assert time.monotonic() < end, f"not heard: {text}; but {page.evaluate('heard')}"
        time.sleep(0.05)
    page.evaluate("heard.length = 0")


def press(page: Any, *keys: str) -> str:
    """Press keys. Return the name of the element that has the focus then."""
    for key in keys:
        page.keyboard.press(key)
    return str(page.evaluate(FOCUSED))


def has_focus(page: Any, name: str) -> None:
    """Wait until the element with this name has the focus."""
    page.wait_for_function(f"name => {FOCUSED} === name", arg=name)


def test_nodes_are_items_of_a_tree_for_screen_readers(
    tmp_path: Path, start_studio: StartStudio, open_page: OpenPage
) -> None:
    page = open_tree(tmp_path, start_studio, open_page)
    # The picture has the focus at first.
    assert press(page, "ArrowDown", "ArrowDown") == "Tree Round"
    session = page.context.new_cdp_session(page)
    session.send("Accessibility.enable")
    found = {}
    for item in session.send("Accessibility.getFullAXTree")["nodes"]:
        if item.get("role", {}).get("value") == "treeitem":
            properties = {each["name"]: each["value"].get("value") for each in item["properties"]}
            name = item["name"]["value"].split(",")[0]
            found[name] = [properties.get(each) for each in ("level", "expanded", "selected")]
            if name == "Sleep":
                assert item["description"]["value"] == "msec 10"
    assert found == {
        "round": [1, True, False],
        "Script": [2, None, True],
        "Refill": [2, True, False],
        "dock": [3, None, False],
        "Sleep": [2, None, False],
    }


def test_keys_lead_through_the_panes_and_back(
    tmp_path: Path, start_studio: StartStudio, open_page: OpenPage
) -> None:
    page = open_tree(tmp_path, start_studio, open_page, viewport={"width": 720, "height": 450})
    canvas = page.locator(".canvas")
    canvas.focus()
    # The text follows the selection, but the page stays where it is.
    before = page.evaluate("scrollY")
    press(page, "Home", "ArrowDown", "ArrowRight", "ArrowRight")
    page.locator(".cm-activeLine", has_text="Sleep").wait_for(state="attached")
    page.wait_for_timeout(200)
    assert page.evaluate("scrollY") == before
    page.set_viewport_size({"width": 1400, "height": 900})
    assert press(page, "Shift+F6", "F6") == "Tree Round"
    inner = "document.querySelector('.editor').shadowRoot.activeElement?.ariaLabel"
    press(page, "F6", "F6")
    assert page.evaluate(inner) == "Text of tree.xml"
    press(page, "Shift+F6", "Shift+F6")
    # A called tree, and back to its call.
    press(page, "ArrowLeft", "o")
    hears(page, "Tree Refill, 1 node.")
    press(page, "Escape")
    page.locator(".node.cursor[aria-label^='Refill']").wait_for()
    assert press(page) == "Tree Round"
    # The list of keys returns to where it was opened, also to a splitter.
    page.locator("[aria-label='Width of the left pane']").focus()
    page.keyboard.press("?")
    page.locator("dialog.help").wait_for()
    assert press(page, "Escape") == "Width of the left pane"
    # Tab in the list of node types goes to the place of the new node.
    canvas.focus()
    page.keyboard.press("i")
    page.keyboard.type("alwaysf")
    assert press(page, "Tab").startswith("after")
    press(page, "ArrowRight")
    assert press(page, "Tab") == "Insert a node"
    press(page, "Enter")
    page.locator(".node.cursor[aria-label^='AlwaysFailure'][aria-posinset='2']").wait_for()


def test_changes_are_announced_and_the_focus_stays_on_the_page(
    tmp_path: Path, start_studio: StartStudio, open_page: OpenPage
) -> None:
    page = open_tree(tmp_path, start_studio, open_page)
    page.locator(".problems .summary", has_text="No errors").wait_for(timeout=FIRST_CHECK_MS)
    page.locator(".canvas").focus()
    press(page, "Home", "End", "Alt+ArrowLeft")
    hears(page, "Moved 1 node: 2 of 3 in round.")
    # The line in the text follows the node.
    page.wait_for_function(
        "() => document.querySelector('.editor').shadowRoot.querySelector('.cm-activeLine').textContent"
        ".includes(document.querySelector('.node.cursor').ariaLabel.split(',')[0])"
    )
    # A refused name stays in its field, and an unknown one can become a node type.
    press(page, "x")
    page.keyboard.type("a b")
    press(page, "Enter")
    page.locator(".prompt #refusal", has_text="invalid tree ID 'a b'").wait_for()
    assert page.locator(".prompt input").input_value() == "a b"
    press(page, "Escape", "i")
    page.keyboard.type("TakePhoto")
    page.locator(".quick > button", has_text="New node type TakePhoto").wait_for()
    press(page, "Escape")
    press(page, "Control+z")
    hears(page, "Undone.")
    press(page, "Control+y")
    hears(page, "Repeated.")
    for _ in range(2):
        press(page, "Home", "Alt+ArrowLeft")
        hears(page, "The root stays where it is.")
    press(page, "ArrowDown", "Delete")
    hears(page, "Deleted 1 node.")
    press(page, "w")
    page.keyboard.type("forcesucc")
    press(page, "Enter")
    hears(page, "Wrapped into ForceSuccess.")
    press(page, "ArrowDown", "Delete")
    hears(page, "New error: ")
    press(page, "Control+z")
    hears(page, "No errors or warnings.")
    # An error while typing is announced once.
    page.locator(".cm-line", has_text="<ForceSuccess").first.click()
    page.keyboard.type("<Inverter name='a'", delay=40)
    hears(page, "New error: ")
    page.keyboard.type(" _description='b'")
    page.wait_for_timeout(2000)
    assert page.evaluate("heard.filter(item => item.includes('error'))") == []
    while page.locator(".problems .summary.error").count():
        press(page, "Control+z")
        page.wait_for_timeout(100)
    # Dialogs give the focus back.
    page.locator("button[aria-label='New file']").focus()
    press(page, "Enter")
    page.locator("dialog input").wait_for()
    page.keyboard.type("tree.xml")
    press(page, "Enter")
    page.locator("dialog .error").wait_for()
    page.keyboard.type("new.xml")
    press(page, "Enter")
    hears(page, "Opened new.xml. Tree MainTree, 0 nodes.")
    assert press(page) == "Tree MainTree"
    page.locator("button[aria-label='Change the tree MainTree']").focus()
    for last in ("Escape", "Enter"):
        press(page, "Enter")
        has_focus(page, "Rename")
        press(page, "Enter")
        page.locator("dialog input").wait_for()
        page.keyboard.type("Other")
        press(page, last)
        page.locator("dialog input").wait_for(state="detached")
        assert press(page).startswith("Change the tree ")
    hears(page, "Tree Other")
    assert press(page) == "Change the tree Other"


def test_stop_at_a_breakpoint_is_announced_and_marked(
    tmp_path: Path, start_studio: StartStudio, browser: Any
) -> None:
    (tmp_path / "tree.xml").write_text(TREE, encoding="utf-8")
    studio = start_studio(tmp_path, "tree.xml")
    context = browser.new_context()
    page = context.new_page()
    keys: list[str] = []
    sockets: list[Any] = []

    def connect(socket: Any) -> None:
        def receive(text: str) -> None:
            found = (json.loads(text).get("result") or {}) if '"nodes"' in text else {}
            keys.extend(node["key"] for node in found.get("nodes", ()))
            socket.send(text)

        sockets.append(socket)
        socket.connect_to_server().on_message(receive)

    def show(stopped: str) -> None:
        """Show a running tree, as the studio's process does."""
        state = {
            "address": "tcp://robot:1667",
            "connection": "connected",
            "detail": "",
            "problem": "",
            "statuses": "12001",
            "results": "02030",
            "entries": [],
            "wanted": keys[4:5],
            "breakpoints": keys[4:5],
            "stopped": stopped,
            "keys": keys[:5],
        }
        sockets[0].send(json.dumps({"jsonrpc": "2.0", "method": "btcore/live", "params": state}))

    page.route_web_socket("**/socket", connect)
    page.goto(studio.url)
    page.locator("main svg g[data-uid]").first.wait_for()
    page.evaluate(HEARD)
    show("")
    hears(page, "Connected to tcp://robot:1667.")
    show(keys[4])
    page.locator(".canvas").focus()
    # A running node waits at the breakpoint again in the next tick.
    for _ in range(2):
        hears(page, "The tree waits at the breakpoint before Sleep.")
        press(page, "c")
        hears(page, "The tree continues.")
    show("")
    node = page.locator("g.node[aria-label^='Sleep'][aria-label$='breakpoint']")
    assert node.get_attribute("aria-description") == "RUNNING, msec 10"
    # The statuses differ by more than their colours.
    marks = page.locator("g.mark path").evaluate_all("marks => marks.map(mark => mark.getAttribute('d'))")
    assert len(marks) == 4
    assert len(set(marks)) == 3
    context.close()
