"""The README matches the behaviour of the project."""

import re
import subprocess
import sys
from pathlib import Path

README = (Path(__file__).parent.parent / "README.md").read_text(encoding="utf-8")


def test_readme_program_prints_the_output_in_its_last_comment() -> None:
    (program,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    expected = program.rstrip().rpartition("# ")[2]
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == expected + "\n"


def test_every_file_linked_in_the_readme_exists() -> None:
    links = re.findall(r"\]\(([^):]+)\)", README)
    assert "docs/images/monitor.png" in links
    assert [link for link in links if not (Path(__file__).parent.parent / link).exists()] == []


def test_every_folder_named_in_the_readme_exists() -> None:
    packages = re.findall(r"^- `(\w+)/`", README, re.MULTILINE)
    assert set(packages) >= {"btcore", "monitor", "robot_nodes", "sim", "trees"}
    assert [package for package in packages if not (Path(__file__).parent.parent / package).is_dir()] == []
