"""The oldest permitted versions of the dependencies work, and have no known vulnerabilities.

`python tests/acceptance/lower_bounds.py WHEEL` installs WHEEL with its extras in a new environment, each
direct dependency in exactly the version of its lower bound in pyproject.toml, and runs some tests of every
package there. It exits with 1 if a test fails, or if an advisory is known for a lower bound.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
import tomllib
import venv
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
EXTRAS = ("bags", "batch", "lsp", "mcp", "monitor", "robot", "sim", "sweep", "testing")

FIXED = {
    "click": ("8.3.3", "CVE-2026-7246"),
    "dask": ("2026.1.0", "CVE-2026-23528"),
    "lxml": ("6.1.0", "CVE-2026-41066"),
    "mcp": ("1.28.1", "CVE-2026-59950"),
    "msgpack": ("1.2.1", "CVE-2026-57585"),
    "opencv-python-headless": ("5.0.0.93", "CVE-2026-40962, in its FFmpeg"),
    "pillow": ("12.3.0", "CVE-2026-54059 and others"),
    "pyarrow": ("23.0.1", "CVE-2026-25087"),
    "pytest": ("9.0.3", "CVE-2025-71176"),
    "pyyaml": ("5.4", "CVE-2020-14343"),
    "scipy": ("1.11.1", "CVE-2023-29824"),
    "setuptools": ("78.1.1", "CVE-2025-47273"),
}
"""The first versions without the known vulnerabilities, and an advisory; as of November 2026."""

TESTS = (
    "tests/btcore/nodes/test_timing.py",
    "tests/btcore/cli/commands/test_validate.py",
    "tests/tools/btcore_studio/language/test_command.py",
    "tests/tools/btcore_studio/agents/test_summaries.py",
    "tests/tools/btcore_bags/test_bags.py",
    "tests/tools/btcore_batch",
    "tests/monitor/serve/test_groot1.py",
    "tests/monitor/serve/test_groot2.py",
    "tests/monitor/serve/test_keys.py",
    "tests/monitor/screen/test_scene_recording.py",
    "tests/monitor/watch/test_feed.py",
    "tests/robot_nodes/leaves/test_obstacle.py",
    "tests/robot_nodes/test_occupancy_map.py",
    "tests/robot_nodes/navigation/test_planner.py",
    "tests/sim/test_run_command.py",
)


def lower_bounds() -> dict[str, str]:
    """Return the lower bound of each direct dependency by name.

    Raises:
        ValueError: A dependency has no lower bound, or two different ones.
    """
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    groups = [project["dependencies"], *(project["optional-dependencies"][extra] for extra in EXTRAS)]
    bounds: dict[str, str] = {}
    for requirement in (requirement for group in groups for requirement in group):
        name, bound = re.fullmatch(r"([\w-]+)(?:\[[^]]*\])?(?:>=([\d.]+))?.*", requirement).groups()
        if name == "btcore":
            continue
        if bound is None or bounds.setdefault(name, bound) != bound:
            raise ValueError(f"{requirement}: no lower bound, or another than {bounds.get(name)}")
    return bounds


def vulnerable(bounds: dict[str, str]) -> Iterator[str]:
    """Yield the lower bounds with known vulnerabilities."""
    for name, bound in bounds.items():
        first, advisory = FIXED.get(name, ("0", ""))
        if _numbers(bound) < _numbers(first):
            yield f"{name} {bound}: {advisory}, fixed in {first}"


def _numbers(version: str) -> tuple[int, ...]:
    numbers = [int(number) for number in version.split(".")]
    return tuple(numbers + [0] * (4 - len(numbers)))


def main() -> int:
    """Install, run the tests, and return 1 if something is wrong, otherwise 0."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("wheel", metavar="WHEEL", type=Path)
    wheel = parser.parse_args().wheel.resolve()
    bounds = lower_bounds()
    found = list(vulnerable(bounds))
    with tempfile.TemporaryDirectory() as name:
        environment = Path(name)
        venv.create(environment, symlinks=os.name != "nt")
        exact = [f"{dependency}=={bound}" for dependency, bound in bounds.items()]
        install = [
            "install",
            "--quiet",
            "--disable-pip-version-check",
            "--only-binary=:all:",
            f"{wheel}[{','.join(EXTRAS)}]",
            *exact,
        ]
        subprocess.run([sys.executable, "-m", "pip", "--python", environment, *install], check=True)
        print(f"lower bounds: {len(bounds)} dependencies in their oldest versions", flush=True)
        programs = environment / ("Scripts" if os.name == "nt" else "bin")
        tests = [programs / "pytest", "-q", "-p", "no:cacheprovider", *TESTS]
        found += ["a test failed"] if subprocess.run(tests, cwd=ROOT, check=False).returncode else []
    for violation in found:
        print(f"✗ {violation}")
    return 1 if found else 0


if __name__ == "__main__":
    raise SystemExit(main())
