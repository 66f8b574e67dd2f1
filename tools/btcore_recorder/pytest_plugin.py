"""A pytest plugin that keeps the end of the runs of failed tests as recordings, beside pytest's other files.

It records the trees of the fixtures `btcore_harness` and `btcore_trace`. pytest loads it automatically;
`-p no:btcore_recorder` turns it off.
"""

import re
from collections.abc import Generator
from typing import TYPE_CHECKING

import pytest

from btcore.errors import BtcoreError
from btcore.tree.tree import Tree

if TYPE_CHECKING:
    from btcore_recorder.file_recorder import RingRecorder

_RINGS = pytest.StashKey[list["RingRecorder"]]()


@pytest.hookimpl(optionalhook=True)
def pytest_btcore_tree(request: pytest.FixtureRequest, tree: Tree) -> None:
    """Record *tree* in memory, unless it cannot be recorded."""
    from btcore_recorder.file_recorder import RingRecorder
    from btcore_recorder.recorder import RecorderOptions

    rings = request.node.stash.setdefault(_RINGS, [])
    folder = request.getfixturevalue("tmp_path_factory").getbasetemp() / "recordings"
    folder.mkdir(exist_ok=True)
    test = re.sub(r"[^\w-]+", "_", request.node.nodeid)[-100:]
    number = f".{len(rings) + 1}" if rings else ""
    try:
        file = folder / f"{test}{number}.btrec.txt"
        ring = RingRecorder(tree, file, RecorderOptions(gives_way=True))
    except BtcoreError:  # the test records the tree itself
        return
    rings.append(ring)

    def close() -> None:
        ring.close()
        rings.clear()  # pytest keeps all tests until its end

    request.addfinalizer(close)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: "pytest.CallInfo[None]"
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Write the recordings of a failed test, and name their files in its report."""
    report = yield
    if report.when == "call" and report.failed:
        for ring in item.stash.get(_RINGS, []):
            if not ring.has_steps:
                continue
            try:
                ring.save()
            except BtcoreError as error:
                text = str(error)
            else:
                text = f"btcore replay {ring.path}"
            report.sections.append(("btcore: the recording of the run", text))
    return report
