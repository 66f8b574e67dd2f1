"""The page of `btcore studio` in headless Chromium: what it shows and does, and how fast it opens.

``python tests/acceptance/studio.py --trials 9`` prints a line for each check, and exits with 1 if one fails:

- A click on a node marks its line, and a click on a line its node. Folding, search, SVG and PDF work.
  A file that is broken keeps its picture up to the fault. A change on disk is shown, and a change of the page
  is saved. Nothing is requested elsewhere, and the console has no error.
- A running tree is coloured, its entries are listed, and a breakpoint stops it at one node.
- A recording of a run is shown at any tick, with the values of a leaf.
- A run with mock leaves asks for their results.
- Of two versions, what was changed, added, removed and moved is marked.
- A tree of 1,000 nodes is shown in a few times the time in which Chromium opens its static SVG. With less
  than seven trials this is only reported.

``--pictures docs/images`` also writes the pictures of the guide.
"""

import argparse
import json
import re
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen, run
from tempfile import TemporaryDirectory
from typing import Any

from checkout import environment

ROUNDS = """<root BTCPP_format="4" main_tree_to_execute="Rounds">
  <BehaviorTree ID="Rounds">
    <KeepRunningUntilFailure name="forever">
      <Sequence name="round">
        <Script name="choose" code="room := 'Küche'; lap := 3"/>
        <Fallback name="door">
          <ScriptCondition name="is it open?" code="lap == 4"/>
          <Sleep name="open it" msec="400"/>
        </Fallback>
        <SubTree ID="Visit" place="{room}"/>
        <Sleep name="rest" msec="700"/>
      </Sequence>
    </KeepRunningUntilFailure>
  </BehaviorTree>
  <BehaviorTree ID="Visit">
    <Sequence>
      <ScriptCondition name="is known" code="place != ''"/>
      <Parallel success_count="1" failure_count="2">
        <Sleep name="turn" msec="600"/>
        <Sleep name="scan" msec="900"/>
      </Parallel>
      <ForceSuccess>
        <AlwaysFailure name="greet"/>
      </ForceSuccess>
    </Sequence>
  </BehaviorTree>
</root>
"""
DELIVERY = """<root BTCPP_format="4" main_tree_to_execute="Deliver">
  <BehaviorTree ID="Deliver">
    <ReactiveSequence name="deliver">
      <BatteryOk name="battery ok?"/>
      <Sequence name="tour">
        <Fallback name="find door">
          <DoorIsOpen name="door open?"/>
          <OpenDoor name="open the door" angle="{angle}"/>
        </Fallback>
        <Script code="rounds := 1"/>
        <SubTree ID="Carry" _autoremap="true"/>
      </Sequence>
    </ReactiveSequence>
  </BehaviorTree>
  <BehaviorTree ID="Carry">
    <Timeout msec="2000"> <DriveTo name="drive" goal="kitchen"/> </Timeout>
  </BehaviorTree>
  <TreeNodesModel>
    <Condition ID="BatteryOk"/> <Condition ID="DoorIsOpen"/>
    <Action ID="OpenDoor"> <output_port name="angle" type="double"/> </Action>
    <Action ID="DriveTo"> <input_port name="goal"/> </Action>
  </TreeNodesModel>
</root>
"""
_REST = '        <Sleep name="rest" msec="700"/>\n'
_VISIT = '        <SubTree ID="Visit" place="{room}"/>\n'
_OPEN = '<Sleep name="open it" msec="400"/>'
_GREET = '      <ForceSuccess>\n        <AlwaysFailure name="greet"/>\n      </ForceSuccess>\n'
EDITS = (
    (_OPEN, f'<RetryUntilSuccessful num_attempts="3">{_OPEN}</RetryUntilSuccessful>'),
    (_VISIT + _REST, _REST.replace("700", "900") + _VISIT),
    (_GREET, ""),
)
RATIO = 4.0
"""The page of 1,000 nodes may take so many times as long as its SVG alone."""
FEW_TRIALS = 7
CARDS = ".canvas g[data-uid]"
"""The nodes in the picture."""
_SHOWN = """
addEventListener('DOMContentLoaded', () => {
  const mark = () => requestAnimationFrame(() => requestAnimationFrame(() => performance.mark('shown')));
  if (document.documentElement.tagName === 'svg') { mark(); return; }
  new MutationObserver((_, observer) => {
    if (document.querySelector('.canvas g[data-uid]')) { observer.disconnect(); mark(); }
  }).observe(document.body, {childList: true, subtree: true});
});"""
"""Marks the second frame after the drawing is in the document."""


@contextmanager
def start_studio(*arguments: str, folder: Path | None = None) -> Iterator[str]:
    """Start `btcore studio`, by default in the current folder, and yield the address of its page."""
    command = [sys.executable, "-m", "btcore", "studio", "--json", *arguments]
    with Popen(command, stdout=PIPE, text=True, env=environment(), cwd=folder) as process:
        try:
            assert process.stdout is not None
            yield json.loads(process.stdout.readline())["url"]
        finally:
            process.terminate()


def open_page(browser: Any, url: str, wrong: list[str]) -> Any:
    """Return the page at *url* when it shows a tree. The errors of its console are added to *wrong*."""
    page = browser.new_page(viewport={"width": 1440, "height": 860}, accept_downloads=True)
    page.on("console", lambda message: wrong.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.goto(url)
    page.wait_for_selector(CARDS)
    return page


def is_of_page(requested: str, url: str) -> bool:
    """Return whether the page at *url* may request an address: of its own server, or what it contains."""
    return requested.startswith((url, f"blob:{url[: url.index('/', 8)]}", "data:"))


def large_tree(count: int = 1000) -> str:
    """Return a tree with *count* nodes, in sequences and fallbacks of ten."""
    leaves = [f'<Sleep name="wait {number}" msec="{number}"/>' for number in range(count)]
    groups = [
        f'<{"Sequence" if start % 20 else "Fallback"} name="part {start}">\n'
        + "\n".join(leaves[start : start + 9])
        + f"\n</{'Sequence' if start % 20 else 'Fallback'}>"
        for start in range(0, count, 10)
    ]
    body = "\n".join(groups)
    tree = f'<BehaviorTree ID="Large"><Parallel>\n{body}\n</Parallel></BehaviorTree>'
    return f'<root BTCPP_format="4">{tree}</root>'


def printed(page: Any) -> bytes:
    """Return what the browser prints when it is to write a PDF."""
    page.evaluate("window.print = () => {}")  # its dialog would wait for a person
    page.click("text=PDF")
    page.wait_for_selector(".paper", state="attached")
    data: bytes = page.pdf(prefer_css_page_size=True)
    page.wait_for_selector(".paper", state="detached")
    return data


def is_vector_page(pdf: bytes) -> bool:
    """Return whether a PDF has a single page with texts and without images."""
    patterns = rb"/Type /Page\b", rb"/Subtype /Image", rb"/Font "
    pages, images, fonts = (len(re.findall(pattern, pdf)) for pattern in patterns)
    return (pages, images) == (1, 0) and fonts > 0


def check_file(browser: Any, folder: Path, pictures: Path | None) -> list[str]:
    """Return what is wrong with the page of a file."""
    file = folder / "rounds.xml"
    file.write_text(ROUNDS, encoding="utf-8")
    wrong: list[str] = []

    def expect(name: str, condition: object) -> None:
        if not condition:
            wrong.append(name)

    with start_studio(str(file)) as url:
        page = open_page(browser, url, wrong)
        page.on("request", lambda request: expect(f"request to {request.url}", is_of_page(request.url, url)))
        cards = page.locator(CARDS)
        expect("15 cards", cards.count() == 15)
        page.click(f"{CARDS}[data-uid='6']")
        page.wait_for_selector(".cm-activeLine:has-text('open it')")
        page.click(".cm-line:has-text('name=\"scan\"')")
        page.wait_for_selector(f"{CARDS}.selected:has-text('scan')")
        page.fill("#search", "küche")
        page.wait_for_selector(f"{CARDS}.found[data-uid='3']")
        expect("one node found", page.locator(f"{CARDS}.found").count() == 1)
        page.fill("#search", "")
        if pictures is not None:
            page.emulate_media(color_scheme="dark")
            page.click(f"{CARDS}[data-uid='7']")
            page.screenshot(path=pictures / "studio_dark.png")
            page.emulate_media(color_scheme="light")
        page.click("text=Fold")
        page.wait_for_selector(f"{CARDS}[data-uid='9']", state="detached")
        with page.expect_download() as download:
            page.click("text=SVG")
        expect("exported SVG", "Küche" in Path(download.value.path()).read_text(encoding="utf-8"))
        expect("PDF of one page, without images", is_vector_page(printed(page)))
        page.click("text=Unfold")
        page.wait_for_selector(f"{CARDS}[data-uid='15']")
        # The page saves what is changed in the picture, and shows what is changed on disk.
        page.click(f"{CARDS}[data-uid='6']")
        page.keyboard.press("Delete")
        page.wait_for_selector(f"{CARDS}[data-uid='15']", state="detached")
        page.keyboard.press("Control+s")
        page.wait_for_selector("footer :text('Saved rounds.xml')")
        expect("saved change", "open it" not in file.read_text(encoding="utf-8"))
        page.keyboard.press("Control+z")
        page.wait_for_selector(f"{CARDS}[data-uid='15']")
        page.keyboard.press("Control+s")
        page.wait_for_selector("header button:text('Save')[disabled]")
        expect("undone change", file.read_text(encoding="utf-8") == ROUNDS)
        file.write_text(ROUNDS.replace("</Fallback>", ""), encoding="utf-8")
        page.wait_for_selector(".canvas.broken")
        page.wait_for_selector(".problems .summary.error")
        file.write_text(ROUNDS.replace("greet", "&lt;b>Grüße&lt;/b>"), encoding="utf-8")
        page.wait_for_selector(".canvas:not(.broken) text:has-text('<b>Grüße</b>')")
        page.close()
    return wrong


def check_run(browser: Any, folder: Path, pictures: Path | None) -> list[str]:
    """Wait until the page of a running tree shows its results, a breakpoint and an entry."""
    file = folder / "rounds.xml"
    file.write_text(ROUNDS, encoding="utf-8")
    wrong: list[str] = []
    command = [sys.executable, "-m", "btcore", "run", str(file), "--publish", "groot2", "--port", "17667"]
    command += ["--allow-control", "--allow-changes"]
    published = Popen(command, stdout=DEVNULL, stderr=DEVNULL, env=environment())
    try:
        with start_studio(str(file), "--live", "17667") as url:
            page = open_page(browser, url, wrong)
            page.wait_for_selector(".canvas.live g.s1[data-uid='1']")
            page.wait_for_selector(".blackboard td:has-text('Küche')")
            # A whole round, so that every node has a result.
            page.wait_for_selector(f"{CARDS}.r3[data-uid='14']")
            page.click(f"{CARDS}[data-uid='12']")
            page.keyboard.press("b")
            page.wait_for_selector(f"{CARDS}.stopped[data-uid='12']")
            if pictures is not None:
                page.screenshot(path=pictures / "studio.png", animations="disabled")
            page.click(".blackboard button.value:has-text('Küche')")
            page.keyboard.type("Flur")
            if pictures is not None:
                page.emulate_media(color_scheme="dark")
                page.screenshot(path=pictures / "studio_change.png", animations="disabled")
                page.emulate_media(color_scheme="light")
            page.keyboard.press("Enter")
            page.wait_for_selector(".blackboard td:has-text('Flur')")
            page.focus(".canvas")
            page.keyboard.press("b")
            page.wait_for_selector(".continue", state="hidden")
            page.wait_for_selector(f"{CARDS}.s1[data-uid='12']")
            page.close()
    finally:
        published.terminate()
        published.wait(20)
    return wrong


def check_recording(browser: Any, folder: Path, pictures: Path | None) -> list[str]:
    """Wait until the page of a recording shows a tick in which a leaf fails."""
    file, recording = folder / "rounds.xml", folder / "rounds.btrec.txt"
    file.write_text(ROUNDS, encoding="utf-8")
    wrong: list[str] = []
    limit = ["--fast", "--duration", "9", "--record", recording]
    command = [sys.executable, "-m", "btcore", "run", file, *limit]
    run(command, check=True, stdout=DEVNULL, stderr=DEVNULL, env=environment())
    with start_studio(str(recording)) as url:
        page = open_page(browser, url, wrong)
        page.wait_for_selector(".timeline :text('Tick 90')")
        page.focus(".timeline input")
        for _ in range(50):
            page.keyboard.press("ArrowLeft")
        page.wait_for_selector(".timeline :text('Tick 40')")
        page.click(f"{CARDS}[data-uid='9']")
        page.wait_for_selector(".form h2:has-text('is known')")
        page.fill(".timeline input", "5")
        page.wait_for_selector(f"{CARDS}.s1[data-uid='12']")
        page.wait_for_selector(".form .status:text('SUCCESS')")
        if pictures is not None:
            page.screenshot(path=pictures / "studio_recording.png")
        page.close()
    return wrong


def check_mock_run(browser: Any, folder: Path, pictures: Path | None) -> list[str]:
    """Run a tree with mock leaves until the second leaf is asked."""
    file = folder / "deliver.xml"
    file.write_text(DELIVERY, encoding="utf-8")
    wrong: list[str] = []
    with start_studio(str(file)) as url:
        page = open_page(browser, url, wrong)
        page.click(".run-bar .play")
        for name, result in (("battery ok?", "1"), ("door open?", "2")):
            page.wait_for_selector(f".question h2:has-text('{name}')")
            page.focus(".canvas")
            page.keyboard.press(result)
        page.wait_for_selector(".question h2:has-text('open the door')")
        page.wait_for_selector(f"{CARDS}.s3[data-uid='5']")
        page.fill(".question input[name=angle]", "1.5")
        if pictures is not None:
            page.screenshot(path=pictures / "studio_run.png", animations="disabled")
        page.click(".question button[value=S]")
        page.wait_for_selector(".blackboard td:text('1.5')")
        page.close()
    return wrong


def check_versions(browser: Any, folder: Path, pictures: Path | None) -> list[str]:
    """Return what is wrong with the page of two versions of a file."""
    old, new = folder / "old/rounds.xml", folder / "rounds.xml"
    old.parent.mkdir()
    old.write_text(ROUNDS, encoding="utf-8")
    edited = ROUNDS.replace("lap := 3", "lap := 4")
    for before, after in EDITS:
        edited = edited.replace(before, after)
    new.write_text(edited, encoding="utf-8")
    wrong: list[str] = []
    with start_studio("--compare", "old/rounds.xml", "rounds.xml", folder=folder) as url:
        page = open_page(browser, url, wrong)
        page.wait_for_selector(".differences li:nth-child(3)")
        for classes, number in (("changed", 4), ("added", 1), ("removed", 2), ("moved", 2)):
            if page.locator(f"{CARDS}.{classes}").count() != number:
                wrong.append(f"{number} nodes are {classes}")
        page.keyboard.press("n")
        page.wait_for_selector(f"{CARDS}.selected.changed:has-text('choose') >> nth=1")
        if pictures is not None:
            page.set_viewport_size({"width": 1440, "height": 470})
            page.screenshot(path=pictures / "studio_comparison.png")
        page.close()
    return wrong


def measure(browser: Any, url: str) -> float:
    """Return the time in ms from the request of *url* until its drawing is on the screen."""
    context = browser.new_context(viewport={"width": 1440, "height": 900})
    context.add_init_script(_SHOWN)
    page = context.new_page()
    page.goto(url, wait_until="commit")
    shown = 0.0
    while not shown:
        page.wait_for_timeout(20)
        shown = page.evaluate("performance.getEntriesByName('shown').map(entry => entry.startTime)[0] ?? 0")
    context.close()
    return shown


def check_speed(browser: Any, folder: Path, trials: int) -> list[str]:
    """Return a complaint if the page draws 1,000 nodes too slowly; print both times."""
    file, svg = folder / "large.xml", folder / "large.svg"
    file.write_text(large_tree(), encoding="utf-8")
    run([sys.executable, "-m", "btcore", "show", file, "--svg", svg], check=True, env=environment())
    with start_studio(str(file)) as url:
        # In turn, and the least of each, since other programs use the machine as well.
        pairs = [(measure(browser, svg.as_uri()), measure(browser, url)) for _ in range(trials)]
    static, drawn = (min(times) for times in zip(*pairs, strict=True))
    print(f"  1,000 nodes: static SVG {static:.0f} ms, page {drawn:.0f} ms, ratio {drawn / static:.2f}")
    return [] if drawn < RATIO * static else [f"the page takes {drawn / static:.2f} times as long"]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=9)
    parser.add_argument("--pictures", type=Path)
    options = parser.parse_args()
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        print("note: playwright is not installed; the studio is not checked in Chromium")
        return 0
    wrong: list[str] = []
    with sync_playwright() as playwright, TemporaryDirectory() as name:
        places = [
            *map(shutil.which, ("chromium", "chromium-browser", "google-chrome")),
            playwright.chromium.executable_path,
        ]
        place = next((place for place in places if place and Path(place).exists()), None)
        if place is None:
            print("note: there is no Chromium; the studio is not checked in it")
            return 0
        browser = playwright.chromium.launch(executable_path=place, args=["--no-sandbox"])
        for title, found in (
            ("a running tree", check_run(browser, Path(name), options.pictures)),
            ("a recording", check_recording(browser, Path(name), options.pictures)),
            ("a run with mock leaves", check_mock_run(browser, Path(name), options.pictures)),
            ("a file", check_file(browser, Path(name), options.pictures)),
            ("versions", check_versions(browser, Path(name), options.pictures)),
            ("speed", check_speed(browser, Path(name), options.trials)),
        ):
            print(f"studio: {title}: {'; '.join(found) or 'passed'}")
            # A few trials on a busy machine say nothing about the speed.
            if title != "speed" or options.trials >= FEW_TRIALS:
                wrong += found
        browser.close()
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
