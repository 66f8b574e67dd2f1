"""Random trees are run by BehaviorTree.CPP, recorded by `btcore_recorder.hpp`, and repeated by btcore.

``python tests/acceptance/cpp_recordings.py PREFIX`` needs a C++ compiler. PREFIX has BehaviorTree.CPP 4.10:
its headers in ``include``, its static library and those of tinyxml2 and minitrace in ``lib``. CI has none.
"""

import argparse
import itertools
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from checkout import ROOT
from hypothesis import HealthCheck, Phase, given, seed, settings

from btcore.testing import xml_documents
from tests.tools.btcore_recorder.test_cpp import DATA, check_replay
from tests.tools.btcore_recorder.test_replay import NODES, TAGS

HEADERS = ROOT / "tools/btcore_recorder/cpp"
LIBRARIES = ("behaviortree_cpp", "tinyxml2", "minitrace", "pthread", "dl")
CONDITION_OF_ROOT = re.compile(r'(ID="Main">\s*<[^>]*? _(?:skipIf|while|successIf|failureIf)=)')


def build(prefix: Path, folder: Path) -> Path:
    """Compile the program that runs random trees."""
    program = folder / "random_run"
    command = [os.environ.get("CXX", "c++"), "-std=c++17", "-O1", f"-I{HEADERS}", f"-I{prefix / 'include'}"]
    command += [str(DATA / "random_run.cpp"), f"-L{prefix / 'lib'}", *(f"-l{name}" for name in LIBRARIES)]
    subprocess.run([*command, "-o", str(program)], check=True)
    return program


def draw_trees(count: int, first_seed: int) -> list[str]:
    """Return *count* different documents. The root has no pre-condition, as the recorder requires."""
    found: dict[str, None] = {}
    quiet = settings(
        max_examples=count,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    documents = xml_documents(nodes=NODES, tags=TAGS, subtrees=2, conditions=True, scripts=True, timed=True)

    def collect(xml: str) -> None:
        if not CONDITION_OF_ROOT.search(xml):
            found.setdefault(xml)

    for number in itertools.count(first_seed):
        seed(number)(quiet(given(documents)(collect)))()
        if len(found) >= count:
            break
    return list(found)[:count]


def main() -> int:
    """Run the trees, and return 1 if a replay differs, otherwise 0."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("prefix", type=Path, help="the installation of BehaviorTree.CPP")
    parser.add_argument("--trees", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    equal = unloadable = 0
    with tempfile.TemporaryDirectory(prefix="btcore-") as name:
        folder = Path(name)
        program = build(options.prefix, folder)
        tree, recording = folder / "tree.xml", folder / "run.btrec.txt"
        for number, xml in enumerate(draw_trees(options.trees, options.seed), options.seed):
            tree.write_text(xml, encoding="utf-8")
            done = subprocess.run(
                [program, tree, recording, str(number)], capture_output=True, text=True, check=False
            )
            if done.returncode == 2:
                unloadable += 1
                continue
            assert done.returncode == 0, f"{xml}\n{done.stderr}"
            try:
                check_replay(recording)
            except AssertionError as error:
                print(f"seed {number} differs: {error}\n{xml}\n{recording.read_text(encoding='utf-8')}")
                return 1
            equal += 1
    print(f"{equal} runs in C++ were repeated; {unloadable} trees could not be loaded in C++")
    return 0


if __name__ == "__main__":
    sys.exit(main())
