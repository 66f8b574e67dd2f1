"""Names, scripts, ports, models, files and the clipboard are shown as text, whatever they contain."""

from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape, quoteattr

import pytest

from tests.tools.btcore_studio.page.conftest import FIRST_CHECK_MS, Studio

ATTACKS = (
    "<img src=x onerror=hacked=1>",
    "</script><script>hacked=1</script>",
    "\"><svg onload='hacked=1'>",
    "javascript:hacked=1",
    "{{constructor.constructor('hacked=1')()}}",
    "]]><b onclick=hacked=1>x</b>",
)
# What the page never makes of a text.
STRANGE = "img, iframe, object, embed, base, a[href^='javascript'], b[onclick], svg[onload], [onerror]"


def document() -> str:
    """Return a document with the attacks wherever it contains text."""
    names = "".join(
        f"<AlwaysSuccess name={quoteattr(text)} _description={quoteattr(text)}/>" for text in ATTACKS
    )
    scripts = "".join(f"<Script code={quoteattr(text)}/>" for text in ATTACKS)
    ports = "".join(f"<Rover speed={quoteattr(text)}/>" for text in ATTACKS)
    calls = "".join(f"<SubTree ID={quoteattr(text)} key={quoteattr(text)}/>" for text in ATTACKS)
    trees = "".join(f"<BehaviorTree ID={quoteattr(text)}><AlwaysSuccess/></BehaviorTree>" for text in ATTACKS)
    models = "".join(
        f"<Action ID={quoteattr(f'Model{number}')}><input_port name={quoteattr(text)} type={quoteattr(text)} "
        f"default={quoteattr(text)}>{escape(text)}</input_port>"
        f"<description>{escape(text)}</description></Action>"
        for number, text in enumerate(ATTACKS)
    )
    return (
        '<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main"><Sequence>\n'
        f"{names}\n{scripts}\n{ports}\n{calls}\n<Model0/>\n</Sequence></BehaviorTree>\n{trees}\n"
        f"<TreeNodesModel>{models}<Action ID={quoteattr(ATTACKS[0])}/></TreeNodesModel></root>\n"
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "<img src=x onerror=hacked=1>"
    folder.mkdir()
    (folder / "<img src=x onerror=hacked=1>.xml").write_text(document(), encoding="utf-8")
    (folder / "'\"><svg onload=hacked=1>.xml").write_text("<root/>", encoding="utf-8")
    return folder


def expect_text_only(page: Any) -> None:
    assert page.evaluate("typeof hacked") == "undefined"
    assert page.locator(STRANGE).count() == 0
    assert page.locator("script").count() == 1


def test_hostile_texts_are_shown_as_text(
    folder: Path, start_studio: Callable[..., Studio], open_page: Callable[..., Any]
) -> None:
    page = open_page(start_studio(folder, "<img src=x onerror=hacked=1>.xml"))
    page.locator(".problems .summary.error").wait_for(timeout=FIRST_CHECK_MS)
    page.locator(".problems .summary").click()
    expect_text_only(page)
    cards = page.locator(".canvas g[data-uid]")
    for index in range(0, cards.count(), 3):
        cards.nth(index).click(force=True)
        page.locator(".form h2").wait_for()
        expect_text_only(page)
    # The palette, and the popup that inserts a node.
    page.get_by_label("Search node types").fill("model")
    page.locator(".palette, aside.left").first.wait_for()
    expect_text_only(page)
    cards.first.click(force=True)
    page.keyboard.press("i")
    page.keyboard.type("img")
    expect_text_only(page)
    page.keyboard.press("Escape")
    page.keyboard.press("Escape")
    page.locator("#search").fill("onerror")
    expect_text_only(page)
    # The text pane has completion and descriptions.
    page.locator(".cm-line").first.click()
    page.keyboard.press("Control+Space")
    expect_text_only(page)


def test_hostile_clipboard_is_pasted_as_text(
    tmp_path: Path, start_studio: Callable[..., Studio], open_page: Callable[..., Any]
) -> None:
    tree = '<root BTCPP_format="4"><BehaviorTree ID="A"><Sequence/></BehaviorTree></root>'
    (tmp_path / "tree.xml").write_text(tree, encoding="utf-8")
    page = open_page(start_studio(tmp_path, "tree.xml"))
    page.locator(".canvas g[data-uid]").first.click()
    for text in (*ATTACKS, f"<AlwaysSuccess name={quoteattr(ATTACKS[0])}/>"):
        page.evaluate(
            """text => {
              const data = new DataTransfer();
              data.setData("text/plain", text);
              data.setData("text/html", text);
              document.querySelector(".canvas").dispatchEvent(
                new ClipboardEvent("paste", {clipboardData: data, bubbles: true, cancelable: true}));
            }""",
            text,
        )
        page.wait_for_timeout(300)
        expect_text_only(page)
    page.locator(".canvas g[data-uid='2']").wait_for()
    expect_text_only(page)
