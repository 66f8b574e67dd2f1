"""Pyodide, in Node, does the same as this Python: on recorded cases, and in the language server."""

import gzip
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

from btcore.entry_points import LIMIT_VARIABLE
from tests.conformance import recorded_cases
from tests.tools.btcore_studio.site import session_requests

ROOT = Path(__file__).parents[4]
DATA = ROOT / "tests/conformance/data"
RUN = Path(__file__).with_name("run_in_pyodide.mjs")
# The acceptance run takes all cases, some 17,000.
CASES = int(os.environ.get("BTCORE_SITE_CASES", "2000"))
LIMIT_S = 1800
# Nodes of Nav2, unknown nodes, several trees, and format 3.
FILES = (
    "trees/patrolling.xml",
    "trees/tutorials/goal_or_home.xml",
    "trees/navigation/navigate_to_pose_w_replanning_and_recovery.xml",
)
BROKEN = {
    "format3.xml": '<root><BehaviorTree ID="A"><RetryUntilSuccesful num_attempts="3"><Sleep/>'
    "</RetryUntilSuccesful></BehaviorTree></root>",
    "broken.xml": '<root BTCPP_format="4">\r\n<BehaviorTree ID="ü🤖"><Sequence><Slep msec="1"/>'
    '<Script code="a :="/>',
}


def run_in_pyodide(site: Path, folder: Path, *command: str) -> str:
    """Return what the function `main` of a file prints. The file and its arguments are in *folder*."""
    node = shutil.which("node")
    assert node is not None, "there is no Node: use .ci/studio-site"
    line = [node, str(RUN), str(site), str(folder), *command]
    done = subprocess.run(line, capture_output=True, encoding="utf-8", timeout=LIMIT_S, check=False)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return done.stdout


def test_recorded_cases_have_the_results_of_the_cpp_engine(site: Path, tmp_path: Path) -> None:
    lines: list[bytes] = []
    for file in sorted([*DATA.glob("*.jsonl.gz"), *DATA.glob("more/*.jsonl.gz")]):
        with gzip.open(file) as cases:
            lines += [line for line in cases if line.strip()]
    step = max(1, len(lines) // CASES)
    (tmp_path / "cases.jsonl").write_bytes(b"".join(lines[::step]))
    shutil.copy(recorded_cases.__file__, tmp_path)
    printed = run_in_pyodide(site, tmp_path, "recorded_cases.py", "cases.jsonl")
    count = len(lines[::step])
    assert count >= min(CASES, len(lines))
    assert sum(int(part.split()[0]) for part in printed.split(", ")) == count
    assert ", 0 failed" in printed


def test_the_language_server_replies_as_here(site: Path, tmp_path: Path) -> None:
    shutil.copy(session_requests.__file__, tmp_path)
    for name in FILES:
        shutil.copy(ROOT / name, tmp_path)
    for name, text in BROKEN.items():
        (tmp_path / name).write_text(text, encoding="utf-8", newline="")
    command = ["session_requests.py", "models.json", *(Path(name).name for name in FILES), *BROKEN]
    there = run_in_pyodide(site, tmp_path, *command)
    here = subprocess.run(
        [sys.executable, *command],
        cwd=tmp_path,
        env={**os.environ, LIMIT_VARIABLE: "mock"},
        capture_output=True,
        check=True,
        timeout=LIMIT_S,
    )
    expected = here.stdout.decode()
    assert len(expected.splitlines()) == len(FILES) + len(BROKEN)
    # The definitions of built-in nodes are in the source.
    replies = there.replace("/lib/python3.14/site-packages/", f"{ROOT}/")
    for name, *lines in zip((*FILES, *BROKEN), replies.splitlines(), expected.splitlines(), strict=True):
        for reply, wanted in zip(*(json.loads(line)[1] for line in lines), strict=True):
            assert reply == wanted, name
