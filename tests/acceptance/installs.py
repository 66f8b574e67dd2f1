"""Wheels are complete, and run a bundled tree in a fresh environment without a compiler.

`python tests/acceptance/installs.py WHEEL` makes a wheel with a compiler that fails after its first file, and
expects the complete pure build, without compiled files. It installs this wheel and the compiled wheel WHEEL
in new environments, and runs a tree there. It prints what it finds, and exits with 1 if something is wrong.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import venv
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("btcore", "monitor", "robot_nodes", "ros2", "sim", "tools", "docs", "trees")
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


def build_wheel(folder: Path, environment: dict[str, str]) -> Path:
    """Return the wheel that pip builds from a copy of the checkout in *folder*, in *environment*."""
    checkout, dist = folder / "checkout", folder / "dist"
    for package in PACKAGES:
        unwanted = shutil.ignore_patterns("__pycache__", "*.so", "node_modules")
        shutil.copytree(ROOT / package, checkout / package, ignore=unwanted)
    for file in FILES:
        shutil.copy2(ROOT / file, checkout)
    # Our environment contains what the build needs.
    options = ["--quiet", "--no-build-isolation", "--no-deps", "--wheel-dir", dist]
    command = [sys.executable, "-m", "pip", "wheel", *options, checkout]
    subprocess.run(command, env=os.environ | environment, check=True, capture_output=True)
    return next(dist.iterdir())


def wheel_misses(wheel: Path) -> list[str]:
    """Return how *wheel* differs from a complete pure build."""
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    found = [f"{name} is compiled" for name in names if name.endswith((".so", ".pyd"))]
    if not wheel.name.endswith("-py3-none-any.whl"):
        found.append(f"the wheel is called {wheel.name}")
    for folder in ("btcore/engine/", "btcore/docs/reference/"):
        if not any(name.startswith(folder) for name in names):
            found.append(f"{folder} is not in it")
    return found


def installation_misses(wheel: Path, build: str, folder: Path) -> list[str]:
    """Return what is wrong after installing *wheel* in a new environment.

    Args:
        wheel: The wheel.
        build: The build that must be active, "pure" or "compiled".
        folder: The folder for the environment.
    """
    environment, empty = folder / build, folder / "no programs"
    empty.mkdir(exist_ok=True)
    without_programs = {name: text for name, text in os.environ.items() if name not in ("CC", "PYTHONPATH")}
    without_programs["PATH"] = str(empty)
    venv.create(environment, symlinks=os.name != "nt")
    programs = environment / ("Scripts" if os.name == "nt" else "bin")

    def output(*command: str | Path) -> str:
        done = subprocess.run(
            command, env=without_programs, cwd=empty, capture_output=True, encoding="utf-8", check=False
        )
        if done.returncode:
            raise SystemExit(f"{Path(command[0]).name} failed with the {build} wheel:\n{done.stderr}")
        return done.stdout

    install = ["install", "--quiet", "--disable-pip-version-check", "--only-binary=:all:", wheel.resolve()]
    output(sys.executable, "-m", "pip", "--python", environment, *install)
    found = []
    if f"({build} build, " not in (version := output(programs / "btcore", "--version")):
        found.append(f"the version is {version.strip()}")
    # The leaves of the tree need a robot; here they follow a plan.
    tree = next(environment.rglob("btcore/trees/bumpgo.xml"))
    plans = ["--outcomes", "IsObstacle=FSF", "--outcomes", "Forward=RS"]
    report = json.loads(output(programs / "btcore", "run", "bumpgo", "--model", tree, *plans, "--json"))
    if report["status"] != "SUCCESS":
        found.append(f"the tree returned {report['status']}")
    return found


def main() -> int:
    """Build and install the wheels, and return 1 if there is a miss, otherwise 0."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("compiled", metavar="WHEEL", type=Path, help="the compiled wheel, as in dist/")
    compiled = parser.parse_args().compiled
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        compiler = folder / "compiler.py"
        compiler.write_text(HALFWAY, encoding="utf-8")
        # Without any compiler, already the first file would fail.
        pure = build_wheel(folder, {"CC": f"{sys.executable} {compiler}"})
        found = wheel_misses(pure)
        print(f"with a compiler that fails: {'; '.join(found[:3]) or 'the complete pure build'}", flush=True)
        missed = len(found)
        for build, made in {"pure": pure, "compiled": compiled}.items():
            found = installation_misses(made, build, folder)
            print(
                f"without a compiler: {f'the {build} wheel':24} {'; '.join(found) or 'runs a tree'}",
                flush=True,
            )
            missed += len(found)
        if not (folder / "made").exists():
            print("miss: the compiler that fails halfway was never called")
            missed += 1
    return 1 if missed else 0


if __name__ == "__main__":
    raise SystemExit(main())
