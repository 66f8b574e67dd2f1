"""`btcore studio` as a process, and its page in Chromium."""

import multiprocessing
import os
import re
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import pytest

from btcore.cli import terminal
from btcore.cli.main import main
from btcore.entry_points import LIMIT_VARIABLE
from btcore_studio.page_server import command, server, session

# Each studio is a copy of a process that has these modules, because their import takes a second.
STARTS = multiprocessing.get_context("forkserver" if os.name == "posix" else "spawn")
STARTS.set_forkserver_preload([__name__, command.__name__, session.__name__])

FIRST_CHECK_MS = 30_000  # the first check of a page starts a process
STRANGE = re.compile(r"Failed to load resource|WebSocket connection")
AXE = Path(__file__).parents[4] / "tools/btcore_studio/page/node_modules/axe-core/axe.min.js"
TREE = """<root BTCPP_format="4" main_tree_to_execute="Round">
  <!-- A robot on its round 🤖 -->
  <BehaviorTree ID="Round">
    <Sequence name="round">
      <Script code="speed := 0.5"/>
      <SubTree ID="Refill"/>
      <Sleep msec="10"/>
    </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="Refill">
    <AlwaysSuccess name="dock"/>
  </BehaviorTree>
</root>
"""
# The name, the label or the text of the element with the focus.
FOCUSED = """(element => element === document.body ? 'body'
  : element.name || element.ariaLabel || element.textContent)(document.activeElement)"""


@dataclass
class Studio:
    """A running `btcore studio`."""

    process: BaseProcess
    url: str
    folder: Path


StartStudio = Callable[..., Studio]
OpenPage = Callable[..., Any]


def run_studio(folder: Path, arguments: tuple[str, ...], libraries: str, address: Connection) -> None:
    """Run the command in this process, and send what it prints."""
    os.environ[LIMIT_VARIABLE] = f"studio robot mock {libraries}"
    os.chdir(folder)
    terminal.print_json = address.send
    main(["studio", "--json", *arguments], prog_name="btcore")


@contextmanager
def running_studio(folder: Path, *arguments: str, libraries: str = "") -> Iterator[Studio]:
    """Start the studio in a folder; skip the test if the page is not built.

    Of the installed libraries of nodes, the studio imports only *libraries*.
    """
    if server.built_page() is None:
        # Continuous integration builds it.
        (pytest.fail if os.environ.get("CI") else pytest.skip)("the page is not built: make page")
    address, child = STARTS.Pipe(duplex=False)
    process = STARTS.Process(target=run_studio, args=(folder, arguments, libraries, child))
    process.start()
    child.close()
    with address:
        try:
            yield Studio(process, address.recv()["url"], folder)
        finally:
            process.kill()
            process.join()
            process.close()


@pytest.fixture
def start_studio() -> Iterator[StartStudio]:
    """Return a function that starts a studio, as `running_studio` does."""
    with ExitStack() as stack:
        yield lambda *arguments, **options: stack.enter_context(running_studio(*arguments, **options))


@pytest.fixture
def open_page(browser: Any) -> Iterator[OpenPage]:
    """Return a function that opens the page of a studio. Errors of a page fail the test."""
    errors: list[str] = []
    contexts: list[Any] = []

    def open(studio: Studio, **options: Any) -> Any:
        context = browser.new_context(**{"viewport": {"width": 1400, "height": 900}, **options})
        contexts.append(context)
        page = context.new_page()
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("console", lambda line: errors.append(line.text) if line.type == "error" else None)
        page.goto(studio.url)
        page.locator("main svg g[data-uid]").first.wait_for()
        return page

    yield open
    for context in contexts:
        context.close()
    # The studio ends before the last page in some tests.
    assert [error for error in errors if not STRANGE.search(error)] == []


def accessibility_violations(page: Any) -> list[tuple[str, list[str]]]:
    """Return what axe finds in the page, by the IDs of its rules. The test is skipped without axe."""
    if not AXE.exists():
        pytest.skip("axe-core is not installed: make page")
    page.evaluate(AXE.read_text(encoding="utf-8"))
    # The label of a node is its name; its attributes are no part of the label.
    options = {"rules": {"label-content-name-mismatch": {"enabled": False}}}
    violations = page.evaluate("(options) => axe.run(options).then((result) => result.violations)", options)
    return [(item["id"], [place["html"] for place in item["nodes"]]) for item in violations]
