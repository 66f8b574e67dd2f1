"""Measure the studio's site in Chromium: its start beside that of bare Pyodide, and its memory.

The site is what `make studio-site` builds, which also checks its size. Bare Pyodide has the files that npm
brings. The exit code is 1 if a figure is above its limit.
"""

import argparse
import base64
import json
import shutil
import sys
import zlib
from pathlib import Path

from playwright.sync_api import Browser, sync_playwright

from tests.tools.btcore_studio.site.conftest import serve

ROOT = Path(__file__).parents[2]
SITE = ROOT / "out/studio-site"
PYODIDE = ROOT / "packaging/studio_site/node_modules/pyodide"
MAX_RATIO = 1.5
MAX_MEMORY_MB = 400.0
WAIT_MS = 300_000
NODES = 1_000
# Pyodide alone, in a worker as that of the page.
BARE = """() => new Promise((resolve, reject) => {
  const begun = performance.now();
  const folder = new URL("/", location.origin).href;
  const source = `import { loadPyodide } from "${folder}pyodide.mjs";
    loadPyodide({ indexURL: "${folder}" }).then(() => postMessage(0));`;
  const script = URL.createObjectURL(new Blob([source], { type: "text/javascript" }));
  const worker = new Worker(script, { type: "module" });
  worker.onerror = (event) => reject(new Error(event.message));
  worker.onmessage = () => { worker.terminate(); resolve(performance.now() - begun); };
})"""


def bare_ms(browser: Browser, address: str) -> float:
    """Return how long Pyodide alone takes to start."""
    context = browser.new_context()
    page = context.new_page()
    page.goto(f"{address}pyodide-lock.json")
    took: float = page.evaluate(BARE)
    context.close()
    return took


def tree_ms(browser: Browser, address: str) -> float:
    """Return the time from the start of the page to a tree that can be edited."""
    context = browser.new_context()
    page = context.new_page()
    page.goto(address)
    page.locator(".empty-tree").wait_for(timeout=WAIT_MS)
    took: float = page.evaluate("performance.getEntriesByName('drawn')[0].startTime")
    context.close()
    return took


def memory_mb(browser: Browser, address: str) -> float:
    """Return the peak of the memory of the page's process, which also has the worker, with a large tree."""
    before = {pid for pid, _ in renderers()}
    page = browser.new_page()
    page.goto(address + link_to_large_tree())
    page.locator("g.node", has_text="f0").first.wait_for(timeout=WAIT_MS)
    page.locator("footer", has_text="warning").wait_for(timeout=WAIT_MS)  # the whole text is checked
    return max(peak for pid, peak in renderers() if pid not in before)


def link_to_large_tree() -> str:
    """Return the fragment of a link to a tree. `site/link.ts` describes the format."""
    names = (f"f{number}" for number in range(NODES // 2))
    pairs = "".join(f'<Fallback name="{name}"><AlwaysFailure/></Fallback>\n' for name in names)
    nodes = f'<BehaviorTree ID="Main"><Sequence>\n{pairs}</Sequence></BehaviorTree>'
    tree = f'<root BTCPP_format="4">{nodes}</root>'
    content = json.dumps({"files": [{"name": "tree.xml", "text": tree}]}).encode()
    packed = zlib.compress(content, wbits=-zlib.MAX_WBITS)
    return "#files=" + base64.urlsafe_b64encode(packed).decode().rstrip("=")


def renderers() -> list[tuple[int, float]]:
    """Return the processes of pages with the peak of their resident memory (MB)."""
    found = []
    for status in Path("/proc").glob("[0-9]*/status"):
        try:
            command = (status.parent / "cmdline").read_bytes()
            lines = dict(line.split(":", 1) for line in status.read_text().splitlines() if ":" in line)
        except OSError:  # the process has ended
            continue
        if b"--type=renderer" in command and "VmHWM" in lines:
            found.append((int(status.parent.name), int(lines["VmHWM"].split()[0]) / 1024))
    return found


def main() -> int:
    """Print the figures, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=5, help="number of starts of each kind")
    trials = parser.parse_args().trials
    with serve(SITE) as address, serve(PYODIDE) as bare_address, sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox", "--disable-gpu"]
        )
        starts = [(bare_ms(browser, bare_address), tree_ms(browser, address)) for _ in range(trials)]
        memory = memory_mb(browser, address)
        browser.close()
    # Other programs only make a start slower.
    bare, tree = map(min, zip(*starts, strict=True))
    print(f"start     {tree / bare:5.2f} times that of Pyodide, {bare / 1e3:.2f} s (at most {MAX_RATIO})")
    print(f"memory    {memory:5.0f} MB at the peak, with {NODES:,} nodes (at most {MAX_MEMORY_MB:g})")
    return int(tree / bare > MAX_RATIO or memory > MAX_MEMORY_MB)


if __name__ == "__main__":
    sys.exit(main())
