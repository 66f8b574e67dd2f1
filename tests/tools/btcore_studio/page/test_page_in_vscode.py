"""The page in a web view of VS Code, in Chromium: a replacement for the extension answers its requests."""

from typing import Any

import msgspec
import pytest

from btcore_studio.language.drawing import draw_document
from btcore_studio.language.project import Project
from btcore_studio.language.studio_protocol import DocumentIdentifier, DrawingParams
from btcore_studio.page_server.server import built_page

URI = "file:///tree.xml"
TREE = '<root BTCPP_format="4"><BehaviorTree ID="A"><Inverter><Sleep/></Inverter></BehaviorTree></root>'
EXTENSION = """
window.drawings = 0;
const post = (message) => window.postMessage({ jsonrpc: "2.0", ...message }, "*");
const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));
const answers = {
  "studio/start": () => ({ folder: "/", uri: URI, tree: null, readOnly: false }),
  "btcore/files": () => [{ uri: URI, name: "tree.xml", unsaved: false }],
  "btcore/palette": () => ({ items: [] }),
  "btcore/drawing": () => { window.drawings += 1; return DRAWING; },
  "btcore/edit": () => ({ edit: { changes: {} }, select: [], notes: ["done"] }),
  "studio/apply": async () => {
    post({ method: "studio/changed", params: { uri: URI } });
    await pause(300);  // the changed text is drawn before the reply
    return null;
  },
};
window.acquireVsCodeApi = () => ({
  postMessage: async ({ id, method }) => {
    const result = await answers[method]?.() ?? null;
    if (id !== undefined) post({ id, result });
  },
});
"""


def test_an_edit_is_drawn_once(browser: Any) -> None:
    built = built_page()
    if built is None:
        pytest.skip("the page is not built: make page")
    project = Project()
    params = DrawingParams(DocumentIdentifier(URI), None)
    drawing = msgspec.json.encode(draw_document(project, project.open(URI, TREE, 1), params)).decode()
    page = browser.new_page()
    page.evaluate(f"() => {{ const URI = {URI!r}, DRAWING = {drawing}; {EXTENSION} }}")
    page.add_script_tag(path=built / "studio.js")
    page.locator("main g[data-uid]", has_text="Sleep").first.click()
    before = page.evaluate("drawings")
    page.keyboard.press("Delete")
    page.locator("footer .message", has_text="done").wait_for()
    page.wait_for_timeout(100)
    assert page.evaluate("drawings") == before + 1
    page.close()
