"""How long a key takes until the page of `btcore studio` shows the changed tree, in Chromium.

    python benchmarks/studio.py [--pairs 3] [--nodes 100 1000 5000] [--keys 14] [--quick] [--json]

The trees are random. A key in the picture moves or removes a random node, or undoes that; a key in the text
writes or deletes a character of a port's value, which becomes invalid or valid. Each time begins with the
event of the key, and ends after the frame in which the new picture, or the new list of problems, is painted.
Cards move to their new places at once, as with reduced motion. The next key is pressed when the text has been
checked and the page is idle.

The reference is the same drawing alone, as `btcore show --svg` writes it: the time from the text of the SVG
until it is painted in an empty page. A round presses the keys of each kind, and draws the SVG. Targets are
compared with the 95th percentile of all keys, whose spread is that of the rounds. Ratios to the SVG alone are
those of the medians. Trees without a target get one round of 4 keys. Times are wall-clock times, because the
server, the page and the check of the text are three processes: the machine must be idle.
"""

import json
import shutil
import statistics
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from random import Random
from subprocess import DEVNULL, PIPE, Popen, run
from tempfile import TemporaryDirectory
from typing import Any

from btcore.extras import describe_missing
from measure.paired_timing import Spread, percentile
from measure.report import Report, at_most, create_parser

NODES = (100, 1_000, 5_000)
QUICK_NODES = 30
KEYS = 14
"""The keys of each kind in a round: with three rounds, a twentieth of the keys are two."""
BUDGETS_MS = {100: 50, 1_000: 200}
"""The maximum time from a key to the new picture, by the number of nodes."""
PROBLEMS_MS = 500
"""The maximum time from a key in the text to the new list of problems."""
PERCENTILE = 0.95
WITHIN = at_most(pure=1, compiled=1)
PAUSE_MS = 40
"""The time in which the page becomes idle, after the last check of the text."""
TIMEOUT_MS = 60_000
OPTIONS = ("--no-sandbox", "--disable-gpu", "--disable-background-networking")
RECORDER = """
const painted = (then) => requestAnimationFrame(() => {
  const { port1, port2 } = new MessageChannel();
  port1.onmessage = () => then(performance.now());
  port2.postMessage(null);
});
const count = () => performance.getEntriesByName("drawn").length;
const problems = () => document.querySelector(".problems .summary")?.textContent;
let checks = 0;
const Socket = WebSocket;
window.WebSocket = class extends Socket {
  constructor(...parameters) {
    super(...parameters);
    this.addEventListener("message", ({ data }) => { checks += data.includes("publishDiagnostics"); });
  }
};
addEventListener("keydown", (event) => { window.pressed = event.timeStamp; }, true);
function expectAll(names) {
  const [drawings, summary] = [count(), problems()];
  const done = checks;
  window.isChecked = () => checks > done;
  const isChanged = { picture: () => count() > drawings, problems: () => problems() !== summary };
  window.times = Promise.all(names.map((name) => new Promise((resolve, reject) => {
    setTimeout(() => reject(new Error(`the ${name} has not changed`)), 60_000);
    const observer = new MutationObserver(() => {
      if (!isChanged[name]()) return;
      observer.disconnect();
      painted((now) => resolve(now - window.pressed));
    });
    observer.observe(document.body, { childList: true, characterData: true, subtree: true });
  })));
}
function drawAlone(svg) {
  document.body.replaceChildren();
  return new Promise((resolve) => painted(() => {
    const begun = performance.now();
    document.body.innerHTML = svg;
    painted((now) => resolve(now - begun));
  }));
}
Object.assign(window, { problems, expectAll, drawAlone });"""
"""What the page measures. The page marks the end of each drawing as "drawn"."""


@dataclass
class RandomTree:
    """A random tree.

    Attributes:
        text: The document.
        names: The names of the nodes, in the order of the text, each of which no other name contains.
        later: The names of the nodes with a later sibling.
        sleeps: The names of the leaves with a port that is a number.
    """

    text: str
    names: list[str]
    later: list[str]
    sleeps: list[str] = field(default_factory=list)


def random_tree(count: int, random: Random) -> RandomTree:
    """Return a tree of *count* nodes."""
    children: list[list[int]] = [[] for _ in range(count)]
    parents = [0]
    for number in range(1, count):
        parent = random.choice(parents)
        children[parent].append(number)
        if len(children[parent]) == 6:
            parents.remove(parent)
        if len(parents) < 2 or random.random() < 0.3:
            parents.append(number)
    made = RandomTree("", [f"node {number}." for number in range(count)], [])

    def element(number: int, indent: str) -> Iterator[str]:
        name = made.names[number]
        if children[number]:
            tag = random.choice(("Sequence", "Fallback"))
            yield f'{indent}<{tag} name="{name}">'
            for child in children[number]:
                yield from element(child, indent + "  ")
            yield f"{indent}</{tag}>"
        elif random.random() < 0.7:
            made.sleeps.append(name)
            yield f'{indent}<Sleep name="{name}" msec="{number}"/>'
        else:
            yield f'{indent}<Script name="{name}" code=" lap := {number}; speed := lap * 0.5 "/>'

    lines = element(0, "    ")
    head = '<root BTCPP_format="4">\n  <BehaviorTree ID="Random">\n'
    made.text = "\n".join([head.rstrip(), *lines, "  </BehaviorTree>", "</root>", ""])
    made.later = [made.names[number] for row in children for number in row[:-1]]
    return made


@contextmanager
def start_studio(file: Path) -> Iterator[str]:
    """Start `btcore studio`, and yield the address of its page."""
    command = [sys.executable, "-m", "btcore", "studio", "--json", str(file)]
    with Popen(command, stdout=PIPE, text=True, cwd=file.parent) as process:
        try:
            assert process.stdout is not None
            yield json.loads(process.stdout.readline())["url"]
        finally:
            process.terminate()


class Page:
    """The page of a studio, and an empty page for the drawing alone."""

    def __init__(self, context: Any, url: str, svg: str) -> None:
        self._svg = svg
        self._alone = context.new_page()
        self._page = context.new_page()
        self._page.goto(url)
        self._page.wait_for_selector(".canvas g[data-uid]")
        self._page.wait_for_function("() => /✔|\\d/.test(problems())", timeout=TIMEOUT_MS)

    def press(self, key: str, *names: str) -> list[float]:
        """Press a key, and return the time (ms) until each of *names* (picture, problems) has changed."""
        self._page.evaluate("names => expectAll(names)", names)
        self._page.keyboard.press(key)
        times: list[float] = self._page.evaluate("times")
        self._page.wait_for_function("() => isChecked()", timeout=TIMEOUT_MS)
        self._page.wait_for_timeout(PAUSE_MS)
        return times

    def select(self, name: str) -> None:
        """Select a node by its name."""
        self._page.fill("#search", name)
        self._page.press("#search", "Escape")
        self._page.wait_for_selector(f".canvas g.cursor[aria-label^='{name}']")

    def write(self, name: str) -> None:
        """Put the cursor of the text before the number in the last attribute of a node."""
        self.select(name)
        for key in ("Control+Enter", "End", *["ArrowLeft"] * len('"/>'), "Control+ArrowLeft"):
            self._page.keyboard.press(key)

    def draw_alone(self, count: int) -> list[float]:
        """Return the time (ms) in which the drawing alone is painted, *count* times."""
        self._alone.bring_to_front()
        taken = [self._alone.evaluate("svg => drawAlone(svg)", self._svg) for _ in range(count)]
        self._page.bring_to_front()
        return taken


@dataclass
class Round:
    """The times (ms) of a round."""

    picture: list[float] = field(default_factory=list)
    typed: list[float] = field(default_factory=list)
    problems: list[float] = field(default_factory=list)
    alone: list[float] = field(default_factory=list)


def measure_round(page: Page, tree: RandomTree, keys: int, random: Random) -> Round:
    """Press *keys* keys in the picture, and as many in the text."""
    taken = Round()
    for index in range(keys // 2):
        is_move = index % 2 == 0
        page.select(random.choice(tree.later if is_move else tree.names[1:]))
        for key in ("Alt+ArrowRight" if is_move else "Delete", "Control+z"):
            taken.picture += page.press(key, "picture")
    for _ in range(keys // 2):
        page.write(random.choice(tree.sleeps))
        for key in ("x", "Backspace"):
            picture, problems = page.press(key, "picture", "problems")
            taken.typed.append(picture)
            taken.problems.append(problems)
    taken.alone = page.draw_alone(max(1, keys // 4))
    return taken


def add_rows(report: Report, nodes: int, rounds: Sequence[Round]) -> None:
    """Add the rows of a tree of *nodes* nodes."""
    alone = statistics.median(time for taken in rounds for time in taken.alone)
    for label, name, limit in (
        ("key in the picture", "picture", BUDGETS_MS.get(nodes)),
        ("key in the text", "typed", BUDGETS_MS.get(nodes)),
        ("key in the text → problems", "problems", PROBLEMS_MS),
    ):
        times: list[list[float]] = [getattr(taken, name) for taken in rounds]
        every = [time for of_round in times for time in of_round]
        figures = {
            "median": f"{statistics.median(every):.0f} ms",
            "95 %": f"{percentile(every, PERCENTILE):.0f} ms",
            "SVG alone": f"{alone:.0f} ms",
        }
        where = f"{label}, {nodes:,} nodes"
        if limit is not None:
            shares = [percentile(of_round, PERCENTILE) / limit for of_round in times]
            spread = Spread(percentile(every, PERCENTILE) / limit, min(shares), max(shares))
            target = WITHIN if nodes in BUDGETS_MS else None
            report.add(f"{where} / {limit} ms", spread, target, figures)
        if name != "problems":
            ratios = [
                statistics.median(of_round) / statistics.median(taken.alone)
                for of_round, taken in zip(times, rounds, strict=True)
            ]
            report.add(f"{where} / the SVG alone", Spread.of(ratios), None, figures)


def compare(report: Report, browser: Any, sizes: Sequence[int], keys: int) -> None:
    """Add the rows of all sizes."""
    for nodes in sizes:
        random = Random(nodes)
        tree = random_tree(nodes, random)
        with TemporaryDirectory() as folder:
            file, svg = Path(folder) / "random.xml", Path(folder) / "random.svg"
            file.write_text(tree.text, encoding="utf-8")
            run([sys.executable, "-m", "btcore", "show", file, "--svg", svg], check=True, stdout=DEVNULL)
            pairs, count = (report.pairs, keys) if nodes in BUDGETS_MS else (1, min(4, keys))
            with start_studio(file) as url:
                context = browser.new_context(
                    viewport={"width": 1440, "height": 900}, reduced_motion="reduce"
                )
                context.add_init_script(RECORDER)
                page = Page(context, url, svg.read_text(encoding="utf-8"))
                measure_round(page, tree, 4, random)  # the warm-up
                rounds = [measure_round(page, tree, count, random) for _ in range(pairs)]
                context.close()
        add_rows(report, nodes, rounds)


def find_chromium(playwright: Any) -> str | None:
    """Return the path of an installed Chromium."""
    places = [
        *map(shutil.which, ("chromium", "chromium-browser", "google-chrome")),
        playwright.chromium.executable_path,
    ]
    return next((place for place in places if place and Path(place).exists()), None)


def main() -> None:
    """Run the benchmark."""
    parser = create_parser(__doc__ or "", pairs=3)
    parser.add_argument("--nodes", type=int, nargs="+", default=NODES)
    parser.add_argument("--keys", type=int, default=KEYS, help="keys of each kind in a round")
    options = parser.parse_args()
    report = Report("studio", "The keys of the studio, compared with drawing alone", options.pairs)
    missing = next(
        (module for module in ("playwright", "pygls", "websockets") if not find_spec(module)), None
    )
    if missing is not None:
        report.remarks.append(describe_missing(missing))
    else:
        find_and_compare(report, options.quick, options.nodes, options.keys)
    report.output(options.json)


def find_and_compare(report: Report, is_quick: bool, sizes: Sequence[int], keys: int) -> None:
    """Add the rows, or a remark about what is missing."""
    from playwright.sync_api import sync_playwright

    from btcore_studio.page_server.server import built_page

    if built_page() is None:
        report.remarks.append("the page of the studio is not built: make page")
        return
    with sync_playwright() as playwright:
        place = find_chromium(playwright)
        if place is None:
            report.remarks.append("there is no Chromium")
            return
        browser = playwright.chromium.launch(executable_path=place, args=list(OPTIONS))
        compare(report, browser, (QUICK_NODES,) if is_quick else sizes, 4 if is_quick else keys)
        browser.close()


if __name__ == "__main__":
    main()
