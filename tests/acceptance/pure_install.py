"""Installing where compiling fails gives the complete pure build, without compiled files.

``python tests/acceptance/pure_install.py`` makes a wheel for each way to fail, prints what is in it, and
exits with 1 when a wheel is not the complete pure build. Each wheel takes some 15 s of processor time.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("btcore", "monitor", "robot_nodes", "sim", "trees", "benchmarks")
FILES = ("setup.py", "pyproject.toml", "README.md", "LICENSE")

# A compiler that quickly compiles an empty file in place of the first file, and fails after that.
HALFWAY = """
import pathlib, subprocess, sys
folder = pathlib.Path(__file__).parent
made, empty = folder / "made", folder / "empty.c"
arguments = sys.argv[1:]
if "-c" in arguments:
    if made.exists():
        sys.exit("this compiler has had enough")
    made.touch()
    empty.touch()
    arguments = [str(empty) if one.endswith(".c") else one for one in arguments]
sys.exit(subprocess.call(["cc", *arguments]))
"""


def wheel(name: str, folder: Path, environment: dict[str, str]) -> Path:
    """Return the wheel that pip builds from a copy of the checkout, in *environment*."""
    checkout, dist = folder / name, folder / f"{name}-dist"
    for package in PACKAGES:
        unwanted = shutil.ignore_patterns("__pycache__", "*.so")
        shutil.copytree(ROOT / package, checkout / package, ignore=unwanted)
    for file in FILES:
        shutil.copy2(ROOT / file, checkout)
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", dist, checkout]
    subprocess.run(command, env=os.environ | environment, check=True, capture_output=True)
    return next(dist.iterdir())


def misses(made: Path) -> list[str]:
    """Return how the wheel *made* differs from a complete pure build."""
    with zipfile.ZipFile(made) as archive:
        names = archive.namelist()
    found = [f"{name} is compiled" for name in names if name.endswith((".so", ".pyd"))]
    if not made.name.endswith("-py3-none-any.whl"):
        found.append(f"the wheel is called {made.name}")
    if "btcore/engine/node.py" not in names:
        found.append("the source is not in it")
    return found


def main() -> int:
    """Build the wheels, and return 1 if there is a miss, otherwise 0."""
    argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0]).parse_args()
    missed = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        compiler = folder / "compiler.py"
        compiler.write_text(HALFWAY, encoding="utf-8")
        cases = {
            "pure build requested": {"BTCORE_PURE": "1"},
            "no compiler": {"CC": str(folder / "absent")},
            "a compiler that fails halfway": {"CC": f"{sys.executable} {compiler}"},
        }
        for number, (case, environment) in enumerate(cases.items()):
            found = misses(wheel(str(number), folder, environment))
            print(f"installing: {case:32} {'; '.join(found[:3]) or 'the pure build, whole'}", flush=True)
            missed += len(found)
        if not (folder / "made").exists():
            print("miss: the compiler that fails halfway was never called")
            missed += 1
    return 1 if missed else 0


if __name__ == "__main__":
    raise SystemExit(main())
