"""The studio's page in Chromium: the text, undo over all edits, problems, files, and two pages at once."""

from pathlib import Path
from typing import Any

import pytest

from tests.tools.btcore_studio.page.conftest import (
    FIRST_CHECK_MS,
    TREE,
    OpenPage,
    StartStudio,
    accessibility_violations,
)

MISSPELLED = TREE.replace("AlwaysSuccess ", "AlwaysSucces ")
CRLF = TREE.replace("\n", "\r\n")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "tree.xml").write_bytes(MISSPELLED.encode())
    (tmp_path / "other.xml").write_bytes(CRLF.encode())
    return tmp_path


def content(folder: Path, name: str = "tree.xml") -> str:
    return (folder / name).read_bytes().decode()


def line(page: Any, text: str) -> Any:
    return page.locator(".cm-line", has_text=text).first


def node(page: Any, name: str) -> Any:
    return page.locator("main g[data-uid]", has_text=name).first


def save(page: Any) -> None:
    """Save the unsaved changes."""
    page.locator("header .tag", has_text="unsaved").wait_for()
    page.keyboard.press("Control+s")
    page.locator("header .tag").wait_for(state="detached")


def undo_all(page: Any) -> None:
    while page.locator(".group button:enabled", has_text="Undo").count():
        page.keyboard.press("Control+z")


def test_fix_is_a_button_and_one_step_of_undo(
    folder: Path, start_studio: StartStudio, open_page: OpenPage
) -> None:
    page = open_page(start_studio(folder, "tree.xml"))
    fix = page.locator(".problems button", has_text="Change to <AlwaysSuccess>")
    fix.wait_for(timeout=FIRST_CHECK_MS)
    page.locator("main g.error", has_text="dock").wait_for()
    fix.click()
    line(page, "<AlwaysSuccess ").wait_for()
    page.locator(".problems", has_text="No errors or warnings").wait_for()
    save(page)
    assert content(folder) == TREE
    page.keyboard.press("Control+z")
    page.locator(".problems .error", has_text="E101").wait_for()
    save(page)
    assert content(folder) == MISSPELLED
    page.keyboard.press("Control+y")
    line(page, "<AlwaysSuccess ").wait_for()
    assert page.locator("header .tag").inner_text() == "unsaved"


def test_pages_share_their_edits_but_not_undo(
    folder: Path, start_studio: StartStudio, open_page: OpenPage
) -> None:
    studio = start_studio(folder, "tree.xml")
    page, other = open_page(studio), open_page(studio)
    line(page, "Sleep").click()
    page.keyboard.press("End")
    page.keyboard.type("<!-- 🤖 -->")
    line(other, "🤖 -->").nth(0).wait_for()
    line(other, "<Script").click()
    other.keyboard.press("Home")
    other.keyboard.type("<!-- other -->")
    line(page, "other").wait_for()
    node(page, "dock").click()
    page.keyboard.press("Delete")
    node(other, "dock").wait_for(state="detached")
    undo_all(page)
    save(page)
    assert content(folder) == MISSPELLED.replace("<Script", "<!-- other --><Script")
    other.bring_to_front()
    undo_all(other)
    save(other)
    assert content(folder) == MISSPELLED


def test_picture_stays_while_the_text_is_broken(
    folder: Path, start_studio: StartStudio, open_page: OpenPage
) -> None:
    page = open_page(start_studio(folder, "tree.xml"))
    line(page, "<Sleep").click()
    page.keyboard.press("Home")
    page.keyboard.type("<")
    page.locator(".notices", has_text="The file has an error").wait_for()
    assert node(page, "round").is_visible()
    assert node(page, "Script").is_visible()
    page.keyboard.press("Backspace")
    page.locator(".notices p").wait_for(state="detached")
    assert node(page, "Sleep").is_visible()


def test_cursor_and_selection_follow_each_other(
    folder: Path, start_studio: StartStudio, open_page: OpenPage
) -> None:
    page = open_page(start_studio(folder, "tree.xml"))
    line(page, "<Sleep").click()
    page.locator("main g.selected", has_text="Sleep").wait_for()
    node(page, "dock").click()
    page.locator(".cm-activeLine", has_text="dock").wait_for()
    assert page.locator("main g.selected").count() == 1
    # Tab leaves the text; Ctrl+] indents.
    line(page, "<Sleep").click()
    page.keyboard.press("Control+]")
    line(page, "  " * 4 + "<Sleep").wait_for()
    page.keyboard.press("Tab")
    assert page.locator(".text .editor:focus").count() == 0


def test_undo_in_a_field_is_first_that_of_its_text(
    folder: Path, start_studio: StartStudio, open_page: OpenPage
) -> None:
    page = open_page(start_studio(folder, "tree.xml"))
    node(page, "Sleep").click()
    field = page.locator("#field-msec")
    field.fill("20")
    field.press("Enter")
    line(page, 'msec="20"').wait_for()
    field.press("End")
    field.type("0")
    assert field.input_value() == "200"
    field.press("Control+z")
    assert field.input_value() == "20"
    assert line(page, 'msec="20"').is_visible()
    field.press("Control+z")
    line(page, 'msec="10"').wait_for()
    field.press("Control+Shift+z")
    line(page, 'msec="20"').wait_for()


def test_rename_in_several_places_is_one_step(
    folder: Path, start_studio: StartStudio, open_page: OpenPage
) -> None:
    page = open_page(start_studio(folder, "tree.xml"))
    page.locator(".files button", has_text="Refill").first.click()
    page.locator("button[aria-label='Change the tree Refill']").click()
    page.locator("dialog button", has_text="Rename").click()
    page.locator("dialog input").fill("Load")
    page.keyboard.press("Enter")
    line(page, 'SubTree ID="Load"').wait_for()
    line(page, 'BehaviorTree ID="Load"').wait_for()
    page.keyboard.press("Control+z")
    line(page, 'BehaviorTree ID="Refill"').wait_for()
    save_is_needed = page.locator("header .tag")
    save_is_needed.wait_for(state="detached")


def test_line_breaks_of_windows_are_kept(
    folder: Path, start_studio: StartStudio, open_page: OpenPage
) -> None:
    page = open_page(start_studio(folder, "tree.xml"))
    page.locator(".files button", has_text="other.xml").click()
    line(page, "<AlwaysSuccess ").click()
    page.keyboard.press("End")
    page.keyboard.press("Enter")
    page.keyboard.type("<!-- new -->")
    save(page)
    new = '<AlwaysSuccess name="dock"/>\r\n    <!-- new -->\r\n'
    assert content(folder, "other.xml") == CRLF.replace('<AlwaysSuccess name="dock"/>\r\n', new)
    # Delete joins lines, Backspace too.
    page.keyboard.press("Home")
    page.keyboard.press("Home")
    page.keyboard.press("Backspace")
    page.keyboard.press("End")
    page.keyboard.press("Delete")
    save(page)
    assert "\r" not in content(folder, "other.xml").replace("\r\n", "")
    assert content(folder, "other.xml").count("\r\n") == CRLF.count("\r\n") - 1
    undo_all(page)
    save(page)
    assert content(folder, "other.xml") == CRLF


def test_completion_hover_and_definition(
    folder: Path, start_studio: StartStudio, open_page: OpenPage
) -> None:
    page = open_page(start_studio(folder, "tree.xml"))
    line(page, "<Sleep").click()
    page.keyboard.press("End")
    page.keyboard.press("Enter")
    page.keyboard.type("<Inver", delay=30)
    page.locator(".cm-tooltip-autocomplete li", has_text="Inverter").wait_for()
    page.wait_for_timeout(100)  # CodeMirror ignores keys right after the list appeared
    page.keyboard.press("Enter")
    line(page, "<Inverter").wait_for()
    # A change of the editor, for example of its colours, ends a hover.
    about = page.locator(".cm-tooltip .about b", has_text="Sequence")
    for _ in range(60):
        line(page, "<Sequence").get_by_text("Sequence").hover()
        page.wait_for_timeout(500)
        if about.is_visible():
            break
        page.mouse.move(0, 0)
    assert about.is_visible()
    page.mouse.move(500, 600)
    page.locator(".cm-tooltip .about").wait_for(state="detached")
    line(page, "<SubTree").get_by_text("Refill").click()
    page.keyboard.press("F12")
    page.locator(".cm-activeLine", has_text='<BehaviorTree ID="Refill">').wait_for()


def test_breakpoints_are_beside_the_text(
    folder: Path, start_studio: StartStudio, open_page: OpenPage
) -> None:
    pytest.importorskip("zmq")
    page = open_page(start_studio(folder, "tree.xml"))
    node(page, "Sleep").click()
    page.keyboard.press("b")
    stops = page.locator(".cm-stops .stop")
    stops.wait_for()
    stops.click()
    stops.wait_for(state="detached")
    page.locator("main circle.stop").wait_for(state="detached")


def test_new_files_and_trees(folder: Path, start_studio: StartStudio, open_page: OpenPage) -> None:
    for number in range(80):
        (folder / f"library_{number}.xml").write_text('<root BTCPP_format="4"/>')
    page = open_page(start_studio(folder, "tree.xml"))
    # The long list of files leaves the list of trees its place.
    assert page.locator(".files ul").last.evaluate("list => list.scrollHeight <= list.clientHeight")
    page.locator("button[aria-label='New file']").click()
    page.locator("dialog input").fill("new.xml")
    page.keyboard.press("Enter")
    page.locator(".files [aria-current]", has_text="new.xml").wait_for()
    assert "MainTree" in content(folder, "new.xml")
    page.locator("button[aria-label='New tree']").click()
    page.locator("dialog input").fill("Second")
    page.keyboard.press("Enter")
    page.locator(".files [aria-current=true]", has_text="Second").wait_for()
    line(page, 'BehaviorTree ID="Second"').wait_for()


def test_read_only_studio_changes_nothing(
    folder: Path, start_studio: StartStudio, open_page: OpenPage
) -> None:
    page = open_page(start_studio(folder, "tree.xml", "--read-only"))
    line(page, "<Sleep").click()
    page.keyboard.type("x")
    node(page, "Sleep").click()
    page.keyboard.press("Delete")
    assert line(page, '<Sleep msec="10"/>').is_visible()
    assert page.locator(".group button", has_text="Save").is_disabled()
    assert content(folder) == MISSPELLED


def test_end_of_the_process_is_explained(
    folder: Path, start_studio: StartStudio, open_page: OpenPage
) -> None:
    studio = start_studio(folder, "tree.xml")
    page = open_page(studio)
    studio.process.kill()
    page.locator(".notices", has_text="process does not answer").wait_for()
    line(page, "<Sleep").click()
    page.keyboard.type("x")
    assert page.locator(".cm-content", has_text="x").is_visible()


def test_edits_without_a_connection_arrive_later(
    folder: Path, start_studio: StartStudio, browser: Any
) -> None:
    studio = start_studio(folder, "tree.xml")
    context = browser.new_context()
    page = context.new_page()
    sockets: list[Any] = []

    def connect(socket: Any) -> None:
        sockets.append(socket)
        if len(sockets) != 2:  # the second connection fails
            socket.connect_to_server()
        else:
            socket.close()

    page.route_web_socket("**/socket", connect)
    page.goto(studio.url)
    line(page, "<Sleep").click()
    page.keyboard.press("End")
    page.keyboard.type("<!-- 1 -->")
    page.locator("header .tag", has_text="unsaved").wait_for()
    sockets[0].close()
    page.locator(".notices", has_text="process does not answer").wait_for()
    page.keyboard.type("<!-- 2 -->")
    page.locator(".notices", has_text="process does not answer").wait_for(state="detached")
    page.keyboard.type("<!-- 3 -->")
    save(page)
    context.close()
    assert len(sockets) == 3
    assert content(folder) == MISSPELLED.replace('msec="10"/>', 'msec="10"/><!-- 1 --><!-- 2 --><!-- 3 -->')


def test_page_is_accessible(folder: Path, start_studio: StartStudio, open_page: OpenPage) -> None:
    page = open_page(start_studio(folder, "tree.xml"), reduced_motion="reduce")
    page.locator(".problems li button").first.wait_for(timeout=FIRST_CHECK_MS)
    page.locator("main g.error").wait_for()
    for scheme, width, height in (("light", 1400, 900), ("dark", 1400, 900), ("light", 390, 844)):
        page.emulate_media(color_scheme=scheme)
        page.set_viewport_size({"width": width, "height": height})
        assert accessibility_violations(page) == [], (scheme, width)
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), (scheme, width)
