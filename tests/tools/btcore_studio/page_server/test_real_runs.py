"""Runs with real leaves by the requests of a page: each is a `btcore run` in a process of its own."""

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

import btcore
from btcore.entry_points import LIMIT_VARIABLE
from btcore.errors import BtcoreError
from btcore_monitor.live_extension import RobotExtension
from btcore_studio.language.real_runs import UNTRUSTED, RealRuns
from btcore_studio.language.run_options import parse_options
from btcore_studio.page_server.session import Shown
from tests.tools.btcore_studio.page_server.conftest import PageClient, Studio, running_studio
from tests.tools.btcore_studio.page_server.test_server import initialize, open_document

REQUEST_FAILED = -32803
LEAVES = """
import os
import time
import btcore

@btcore.action
def Pace(rounds: btcore.In[int]) -> btcore.Status:
    print("pid", os.getpid(), flush=True)
    return btcore.Status.SUCCESS

@btcore.action
def Hang() -> btcore.Status:
    print("hangs", flush=True)
    while True:
        time.sleep(0.01)

@btcore.action
def Crash() -> btcore.Status:
    os._exit(99)
"""
TREE = """<root BTCPP_format="4">
  <BehaviorTree ID="Main"> <Sequence> <Pace rounds="3"/> {} </Sequence> </BehaviorTree>
</root>
"""


@pytest.fixture
def studio(
    folder: Path, built: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[..., Studio]]:
    """Return a function that returns a studio with leaves in Python."""
    (folder / "leaves.py").write_text(LEAVES)
    # The process of the run has these, too.
    monkeypatch.setenv(LIMIT_VARIABLE, "studio robot recorder btrec.txt publisher changed")

    with ExitStack() as stack:

        def start(plugins: tuple[str, ...] = ("leaves.py",), **options: Any) -> Studio:
            shown = Shown(folder, folder / "tree.xml", plugins=plugins, live=RobotExtension(), **options)
            return stack.enter_context(running_studio(shown, tmp_path / "previous", built))

        yield start


def start(page: PageClient, studio: Studio, leaf: str, options: str = "") -> None:
    """Start a run of a text that is not saved."""
    uri = studio.uri("tree.xml")
    initialize(page)
    open_document(page, uri, TREE.format(leaf))
    page.request("btcore/startRealRun", {"textDocument": {"uri": uri}, "options": options})


def ended(page: PageClient) -> dict[str, Any]:
    """Return the state of the run at its end."""
    while (state := page.notification("btcore/realRun"))["running"]:
        pass
    result: dict[str, Any] = state
    return result


def test_a_run_is_watched_and_its_recording_shown(studio: Callable[..., Studio]) -> None:
    opened = studio()
    with opened.page() as page:
        uri = opened.uri("tree.xml")
        start(page, opened, '<Sleep msec="600000"/>')
        live = page.notification("btcore/live")
        while live["statuses"][-1:] != "1" or live["refusals"].get("reload") != "":
            live = page.notification("btcore/live")
        assert page.error("btcore/startRealRun", {"textDocument": {"uri": uri}}) == (
            REQUEST_FAILED,
            "a run with real leaves has not ended: end it first",
        )
        # The edited text replaces the running tree.
        change = {
            "textDocument": {"uri": uri, "version": 2},
            "contentChanges": [{"text": TREE.format("<AlwaysFailure/>")}],
        }
        page.send({"jsonrpc": "2.0", "method": "textDocument/didChange", "params": change})
        page.request("btcore/reload", {"textDocument": {"uri": uri}})
        state = ended(page)
        assert (state["code"], state["recorded"]) == (1, True)
        assert "FAILURE" in state["output"]
        assert f"pid {os.getpid()}" not in state["output"]


def test_a_recording_is_opened(studio: Callable[..., Studio]) -> None:
    opened = studio()
    with opened.page() as page:
        start(page, opened, '<Sleep msec="100"/>', "--rate 50 --seed=4")
        assert ended(page)["code"] == 0
        recording = page.request("btcore/openRecording")
        assert len(recording["keys"]) == 3
        end = recording["start"]
        run = recording["run"]
        assert page.request("btcore/moment", {"run": run, "position": end})["root"] == btcore.Status.SUCCESS
        pace, sleep = recording["keys"][1:]
        first = page.request("btcore/moment", {"run": run, "position": 1})
        assert first["leaves"][pace]["inputs"] == {"rounds": "3"}
        why = page.request("btcore/why", {"run": run, "key": sleep, "position": end})
        assert why["answer"]
        results = [{"tick": 1, "key": pace, "result": "F"}]
        changed = page.request("btcore/whatIf", {"run": run, "results": results})
        assert "it differs from tick 1 on" in changed["report"][0]
        [file] = page.request("btcore/runFiles", {"run": run, "tree": "tree.xml"})["files"]
        assert file["name"] == "tree.btrec.txt"
        assert "Pace" in file["text"]


def test_a_leaf_that_hangs_is_ended(studio: Callable[..., Studio]) -> None:
    opened = studio()
    with opened.page() as page:
        start(page, opened, "<Hang/>")
        while "hangs" not in page.notification("btcore/realRun")["output"]:
            pass
        page.request("btcore/endRealRun")
        assert ended(page)["code"] == 130


def test_a_leaf_that_ends_its_process(studio: Callable[..., Studio]) -> None:
    opened = studio()
    with opened.page() as page:
        start(page, opened, "<Crash/>")
        state = ended(page)
        assert (state["code"], state["output"].count("pid")) == (99, 1)
        reason = "this run is no longer shown: open it again"
        assert page.error("btcore/moment", {"position": 1}) == (REQUEST_FAILED, reason)


def test_a_run_ends_with_its_page(studio: Callable[..., Studio], monkeypatch: pytest.MonkeyPatch) -> None:
    closed = threading.Event()
    close = RealRuns.close

    async def close_and_note(runs: RealRuns) -> None:
        await close(runs)
        closed.set()

    monkeypatch.setattr(RealRuns, "close", close_and_note)
    opened = studio()
    with opened.page() as page:
        start(page, opened, '<Sleep msec="600000"/>')
        while "pid" not in (output := page.notification("btcore/realRun")["output"]):
            pass
    assert closed.wait(60)
    with pytest.raises(ProcessLookupError):
        os.kill(int(output.partition("pid ")[2].split()[0]), 0)


REFUSED = [
    ("--plugin other.py", "a page cannot give the option '--plugin'"),
    ("--record-on=never", "a page cannot give the option '--record-on'"),
    ("--log=x.btlog", "a page cannot give the option '--log'"),
    ("--save-map m.yaml", "a page cannot give the option '--save-map'"),
    ("--fast=1", "a page cannot give the option '--fast'"),
    ("--wrold arena", "did you mean '--world'?"),
    ("tree.xml", "a page cannot give the option 'tree.xml'"),
    ("-- -x", "a page cannot give the option '--'"),
    ("--seed", "the option --seed needs a value"),
    ("--set 'a=1", "the options of the run are not valid: no closing quotation"),
    ("--set a=\0", "the value of --set contains a null character"),
    ("x" * 3_000, "at most 2,000 characters"),
]


@pytest.mark.parametrize(("options", "reason"), REFUSED)
def test_options_that_a_page_may_not_give(options: str, reason: str) -> None:
    with pytest.raises(BtcoreError) as raised:
        parse_options(options)
    assert reason in str(raised.value)


def test_an_option_cannot_be_hidden_in_a_value() -> None:
    arguments = parse_options("--world --log=x --set 'a=1 2' --fast --seed=3")
    assert arguments == ["--world=--log=x", "--set=a=1 2", "--fast", "--seed=3"]


def test_a_folder_that_is_not_trusted(studio: Callable[..., Studio]) -> None:
    opened = studio(plugins=())
    with opened.page() as page:
        initialize(page)
        uri = opened.uri("tree.xml")
        open_document(page, uri, TREE)
        assert page.request("btcore/start")["trusted"] is False
        assert page.error("btcore/startRealRun", {"textDocument": {"uri": uri}}) == (
            REQUEST_FAILED,
            UNTRUSTED,
        )
        code, message = page.error("btcore/startRealRun", {"textDocument": {"uri": uri}, "options": 3})
        assert (code, "options" in message) == (-32602, True)
        assert page.error("btcore/openRecording")[0] == REQUEST_FAILED
        assert page.request("btcore/endRealRun") is None
