"""The time limit of all tests, the settings of Hypothesis, and fixtures for the tests of several packages."""

import importlib.util
import os
import shutil
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType, ModuleType
from typing import Any

import pytest

# The files conftest.py in these folders import what is missing. Test files elsewhere use pytest.importorskip.
NEEDS = {
    "sim": "pybullet",
    "tools/btcore_studio/language": "pygls",
    "tools/btcore_studio/page": "websockets",
    "tools/btcore_studio/page_server": "websockets",
}
collect_ignore = [folder for folder, module in NEEDS.items() if importlib.util.find_spec(module) is None]

if importlib.util.find_spec("hypothesis") is not None:
    from hypothesis import HealthCheck, settings

    # A machine may stop for longer than any deadline. Tests that need more examples than others multiply
    # `settings().max_examples`, so that they are short on a developer's machine, too.
    settings.register_profile(
        "local", deadline=None, suppress_health_check=[HealthCheck.too_slow], max_examples=25
    )
    # In CI, the examples are always the same, so that only a change of the code can let a test fail.
    settings.register_profile(
        "ci", settings.get_profile("local"), derandomize=True, database=None, max_examples=100
    )
    settings.load_profile("ci" if os.environ.get("CI") else "local")

TIME_LIMIT = float(os.environ.get("BTCORE_TEST_TIME_LIMIT", "300"))
"""The time limit (s) of each test, and of its fixtures before and after it."""
REPEAT_EVERY = 10.0  # s; the test may have caught the exception
# tests/check.py sets these variables.
START_LIMIT = float(os.environ.get("BTCORE_TEST_START_LIMIT", "inf"))
"""The time (s) after the first test of the process after which no test is started."""
WITHOUT_LIMIT = os.environ.get("BTCORE_TEST_WITHOUT_LIMIT", "")
"""The file or folder of the tests that are started nevertheless."""
BROWSER_OPTIONS = ["--no-sandbox", "--disable-dev-shm-usage"]
NOT_STARTED = "not started: the time limit of `make check` was exceeded"


@contextmanager
def limit_time() -> Iterator[None]:
    """Let the test fail after the time limit. Its fixtures then end the processes that it started.

    The time limit of pytest itself (faulthandler_timeout) ends the worker instead. Then these processes go
    on, and pytest-xdist waits until the last copy of the worker has ended.
    """
    if not hasattr(signal, "SIGALRM"):
        yield
        return

    def interrupt(number: int, frame: FrameType | None) -> None:
        stacks = [
            f"{thread.name}:\n{''.join(traceback.format_stack(sys._current_frames().get(thread.ident or 0)))}"
            for thread in threading.enumerate()
            if thread is not threading.current_thread()  # its stack is pytest's traceback
        ]
        text = "\n".join([f"the test has exceeded the time limit of {TIME_LIMIT:g} s", *stacks])
        pytest.fail(text)

    before = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, TIME_LIMIT, REPEAT_EVERY)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


_first_start: list[float] = []


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Generator[None, object, object]:
    now = time.monotonic()
    if not _first_start:
        _first_start.append(now)
    if now - _first_start[0] > START_LIMIT and not (
        WITHOUT_LIMIT and item.path.is_relative_to(WITHOUT_LIMIT)
    ):
        pytest.skip(NOT_STARTED)
    with limit_time():
        return (yield)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    if file := os.environ.get("BTCORE_TEST_NOT_STARTED"):
        skipped = terminalreporter.stats.get("skipped", [])
        count = sum(NOT_STARTED in str(report.longrepr) for report in skipped)
        Path(file).write_text(str(count), encoding="utf-8")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call() -> Generator[None, object, object]:
    with limit_time():
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown() -> Generator[None, object, object]:
    with limit_time():
        return (yield)


@pytest.fixture
def recorded_tree() -> Callable[[str], str]:
    """Return a function that returns the tree of the recordings; *content* is its subtree's sequence."""

    def write(content: str) -> str:
        return f"""
            <root BTCPP_format="4" main_tree_to_execute="Main">
              <BehaviorTree ID="Main">
                <Sequence name="root_seq">
                  <Script code="x:=42; s:='hello'; f:=2.5"/>
                  <Fallback>
                    <AlwaysFailure/>
                    <Count name="cnt" _onSuccess="done:=true" out="{{val}}" ticks="3"/>
                  </Fallback>
                  <SubTree ID="Sub" lim="7" mode="fast" target="{{val}}"/>
                  <AlwaysSuccess _skipIf="x==42"/>
                </Sequence>
              </BehaviorTree>
              <BehaviorTree ID="Sub">
                <Sequence>{content}</Sequence>
              </BehaviorTree>
            </root>
        """

    return write


@contextmanager
def open_chromium(*options: str) -> Iterator[Any]:
    """Open Chromium without a window; skip the test if it is not installed."""
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        installed = map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))
        paths = [path for path in (*installed, playwright.chromium.executable_path) if path]
        path = next((path for path in paths if Path(path).exists()), None)
        if path is None:
            pytest.skip("there is no Chromium")
        chromium = playwright.chromium.launch(executable_path=path, args=[*BROWSER_OPTIONS, *options])
        yield chromium
        chromium.close()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Chromium without WebGL, which would draw the pages in a process of its own."""
    with open_chromium("--disable-gpu") as chromium:
        yield chromium


@pytest.fixture(scope="session")
def acceptance_script() -> Callable[[str], ModuleType]:
    """Return a function that imports a script of tests/acceptance, for a short run of what it measures."""

    def load(name: str) -> ModuleType:
        path = Path(__file__).parent / "acceptance" / f"{name}.py"
        spec = importlib.util.spec_from_file_location(f"acceptance_{name}", path)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[spec.name] = module
        sys.path.insert(0, str(path.parent))  # a script imports its neighbours
        try:
            spec.loader.exec_module(module)
        finally:
            sys.path.remove(str(path.parent))
        return module

    return load
