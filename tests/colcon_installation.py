"""Installation of packaging/ros in a folder, by the commands of colcon."""

import subprocess
import sys
from pathlib import Path

PACKAGE = Path(__file__).parent.parent / "packaging" / "ros"


def install_as_by_colcon(folder: Path, python: str = sys.executable) -> Path:
    """Install the package as `colcon build` does, and return the prefix, a folder in *folder*."""
    base, prefix = folder / "build", folder / "install"
    base.mkdir()
    command = [python, "setup.py", "-q", "egg_info", "--egg-base", base, "build", "--build-base", base]
    command += ["install", "--single-version-externally-managed", "--no-compile", "--record", base / "files"]
    subprocess.run([*command, "--prefix", prefix], cwd=PACKAGE, check=True, capture_output=True)
    return prefix
