"""What the README shows is what happens."""

import re
import subprocess
import sys
from pathlib import Path

README = (Path(__file__).parent.parent / "README.md").read_text(encoding="utf-8")


def test_the_readmes_program_prints_what_its_last_comment_says() -> None:
    (program,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    expected = program.rstrip().rpartition("# ")[2]
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == expected + "\n"


def test_every_file_that_the_readme_points_to_is_there() -> None:
    links = re.findall(r"\]\(([^):]+)\)", README)
    assert "docs/monitor.png" in links
    assert [link for link in links if not (Path(__file__).parent.parent / link).exists()] == []


def test_every_room_that_the_readme_names_is_there() -> None:
    rooms = re.findall(r"^- `(\w+)/`", README, re.MULTILINE)
    assert set(rooms) >= {"btcore", "monitor", "robot_nodes", "sim", "trees"}
    assert [room for room in rooms if not (Path(__file__).parent.parent / room).is_dir()] == []
