"""The page on static files in Chromium: Python runs in the page, and nothing leaves the page."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.tools.btcore_studio.site.conftest import serve

WAIT_MS = 60_000  # Python starts in 2 s on an idle machine
MODIFIER = "ControlOrMeta"
TREE = (
    '\ufeff<root BTCPP_format="4">\r\n'
    '  <BehaviorTree ID="Main">\r\n'
    "    <!-- ü 🤖 -->\r\n"
    '    <Sequence><Sleep name="&lt;img src=//evil.invalid/ onerror=alert(1)>" msec="10"/></Sequence>\r\n'
    "  </BehaviorTree>\r\n"
    "</root>"
).encode()
# A browser without the dialogs of the File System Access API.
WITHOUT_DIALOGS = "delete window.showOpenFilePicker; delete window.showSaveFilePicker;"
# The dialogs return a real file of the browser's own file system.
OWN_FILE = """window.showOpenFilePicker = async () => {
  const folder = await navigator.storage.getDirectory();
  return [await folder.getFileHandle("own.xml", {create: true})];
};"""


OpenSite = Callable[..., Any]


@pytest.fixture(scope="module")
def address(site: Path) -> Iterator[str]:
    """The address of the site."""
    with serve(site) as address:
        yield address


@pytest.fixture
def open_site(browser: Any, address: str) -> Iterator[OpenSite]:
    """Return a function that opens the page. Errors, and requests to other servers, fail the test."""
    problems: list[str] = []
    contexts: list[Any] = []

    def open(fragment: str = "", script: str = WITHOUT_DIALOGS, **options: Any) -> Any:
        context = browser.new_context(**{"viewport": {"width": 1400, "height": 900}, **options})
        contexts.append(context)
        context.grant_permissions(["clipboard-read", "clipboard-write"])
        context.on(
            "request",
            lambda request: (
                None if request.url.startswith((address, "blob:", "data:")) else problems.append(request.url)
            ),
        )
        page = context.new_page()
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.on("console", lambda line: problems.append(line.text) if line.type == "error" else None)
        page.add_init_script(script)
        page.goto(address + fragment)
        page.locator(".cm-content").wait_for()
        return page

    yield open
    for context in contexts:
        context.close()
    assert problems == []


def wait_for_message(page: Any, text: str) -> None:
    page.locator("footer .message", has_text=text).wait_for(timeout=WAIT_MS)


def saved(page: Any) -> bytes:
    with page.expect_download() as download:
        page.keyboard.press(f"{MODIFIER}+s")
    content = Path(download.value.path()).read_bytes()
    wait_for_message(page, "Saved tree.xml.")
    return content


def test_a_tree_is_written_mended_saved_and_shared(open_site: OpenSite) -> None:
    page = open_site()
    # The text can be edited before Python is ready.
    assert "Python is starting" in page.locator(".notices").inner_text()
    page.locator(".cm-line", has_text="</BehaviorTree>").click()
    page.keyboard.press("Home")
    page.keyboard.insert_text('  <Sequence><Sleep msec="10"/><Slep msec="20"/></Sequence>\n')
    # Python draws the text, finds the error, and mends it.
    page.locator("g.node", has_text="Sequence").first.wait_for(timeout=WAIT_MS)
    page.get_by_role("button", name="Change to <Sleep>").first.click(timeout=WAIT_MS)
    page.locator("footer", has_text="No errors or warnings").wait_for(timeout=WAIT_MS)
    assert page.locator("g.node").count() == 3
    content = saved(page)
    assert b'<Sleep msec="10"/><Sleep msec="20"/>' in content
    assert page.get_by_text("unsaved").count() == 0

    page.get_by_role("button", name="Copy link").click()
    wait_for_message(page, "Copied a link")
    link = page.evaluate("navigator.clipboard.readText()")
    assert link == page.url
    other = open_site(link[link.index("#") :])
    other.locator("g.node").nth(2).wait_for(timeout=WAIT_MS)
    assert saved(other) == content


def test_files_are_kept_byte_for_byte(open_site: OpenSite) -> None:
    page = open_site()
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Open", exact=True).click()
    chooser.value.set_files([{"name": "tree.xml", "mimeType": "text/xml", "buffer": TREE}])
    wait_for_message(page, "Opened tree.xml.")
    page.get_by_role("button", name="Copy link").click()
    wait_for_message(page, "Copied a link")
    other = open_site(page.url[page.url.index("#") :])
    other.locator("g.node", has_text="<img src=").wait_for(timeout=WAIT_MS)
    assert saved(other) == TREE
    # What cannot be opened is refused with a sentence.
    for name, content, reason in (
        ("run.mcap", b"\x89MCAP0", "run.mcap is a recording. This command shows it: btcore studio run.mcap"),
        ("latin.xml", "<ü/>".encode("latin-1"), "latin.xml is not UTF-8"),
        ("tree.txt", b"", "tree.txt is refused"),
        ("large.xml", b" " * ((8 << 20) + 1), "large.xml is too large"),
    ):
        with page.expect_file_chooser() as chooser:
            page.get_by_role("button", name="Open", exact=True).click()
        chooser.value.set_files([{"name": name, "mimeType": "text/xml", "buffer": content}])
        wait_for_message(page, reason)


def test_a_file_of_the_user_is_written_in_place(open_site: OpenSite) -> None:
    page = open_site(script=OWN_FILE)
    page.evaluate(
        """async text => {
        const [handle] = await window.showOpenFilePicker();
        const stream = await handle.createWritable();
        await stream.write(text);
        await stream.close();
    }""",
        TREE.decode(),
    )
    page.get_by_role("button", name="Open", exact=True).click()
    wait_for_message(page, "Opened own.xml.")
    page.locator(".cm-line", has_text="<Sleep").click()
    page.keyboard.press("End")
    page.keyboard.insert_text("<!-- end -->")
    page.keyboard.press(f"{MODIFIER}+s")
    wait_for_message(page, "Saved own.xml")
    read = "async () => (await (await window.showOpenFilePicker())[0].getFile()).text()"
    written = page.evaluate(f"({read})()")
    assert written == TREE.decode().removeprefix("\ufeff").replace("</Sequence>", "</Sequence><!-- end -->")


def test_a_stop_of_python_loses_nothing(open_site: OpenSite) -> None:
    page = open_site()
    page.locator(".empty-tree").wait_for(timeout=WAIT_MS)
    page.locator(".cm-line", has_text="</BehaviorTree>").click()
    page.keyboard.press("Home")
    page.workers[0].evaluate("setTimeout(() => { for (;;); })")
    page.keyboard.insert_text("<Sequence><Sleep/></Sequence>")
    page.get_by_role("button", name="Start Python again").click(timeout=WAIT_MS)
    page.locator(".notices", has_text="Python is starting").wait_for()
    page.locator("g.node", has_text="Sequence").first.wait_for(timeout=WAIT_MS)
    assert b"<Sequence><Sleep/></Sequence>" in saved(page)


@pytest.mark.parametrize(
    ("fragment", "reason"),
    [("#files=AAAA", "The link is damaged"), ("#files=" + "A" * 1_000_001, "are too large")],
)
def test_a_damaged_link_opens_nothing(open_site: OpenSite, fragment: str, reason: str) -> None:
    page = open_site(fragment)
    wait_for_message(page, reason)
    page.locator(".cm-line", has_text='<BehaviorTree ID="MainTree">').wait_for()


def test_proofs_run_in_the_page_and_a_stop_keeps_the_texts(open_site: OpenSite) -> None:
    small = "<Sequence> <IsClosed/> <Open/> </Sequence>"
    large = " ".join(
        f'<Sequence> <Act{i}/> <Script code="k{i} := 1"/> <Act{i}/> </Sequence>' for i in range(12)
    )
    page = open_site()
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Open", exact=True).click()
    files = {"small.xml": small, "large.xml": f"<Parallel> {large} </Parallel>"}
    chooser.value.set_files(
        [
            {
                "name": name,
                "mimeType": "text/xml",
                "buffer": (
                    f'<root BTCPP_format="4"><BehaviorTree ID="Main">{nodes}</BehaviorTree></root>'.encode()
                ),
            }
            for name, nodes in files.items()
        ]
    )
    page.locator(".run-bar button", has_text="Prove").click(timeout=WAIT_MS)
    proof = page.get_by_role("region", name="Proof", exact=True)
    proof.get_by_label("Own questions").fill("never Open")
    proof.locator("button", has_text="Search all runs").click()
    wait_for_message(page, "Main: 1 refuted, 7 proved.")
    proof.locator("button", has_text="Show the run").click()
    page.locator("main g.node.s1", has_text="Open").wait_for()
    page.get_by_label("Close this run").click()
    page.locator(".files button", has_text="large.xml").click()
    page.locator("main g.node", has_text="Act11").first.wait_for()
    proof.locator("button", has_text="Search all runs").click()
    proof.locator(".dim", has_text="states searched").wait_for()
    proof.locator("button", has_text="Stop").click()
    page.locator(".run-bar button", has_text="Prove").wait_for()
    page.locator(".files button", has_text="small.xml").click()
    page.locator("main g.node", has_text="IsClosed").first.wait_for(timeout=WAIT_MS)
