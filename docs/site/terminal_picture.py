"""Draw the output of a command in a terminal as SVG.

``python docs/site/terminal_picture.py docs/images/show.svg btcore show bumpgo`` runs the command and writes
the picture, with the command above its output.
"""

import io
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

from rich.console import Console
from rich.text import Text

COLUMNS = 110


def draw(command: str, output: str) -> str:
    """Return the SVG of a terminal that shows *command* and its *output*, which may contain colours."""
    lines = [Text.from_ansi(line.rstrip()) for line in output.rstrip().splitlines()]
    width = max(80, len(command) + 2, *(line.cell_len for line in lines))
    console = Console(record=True, width=width, file=io.StringIO())
    console.print(Text.assemble(("$ ", "dim"), (command, "bold")))
    for line in lines:
        console.print(line, soft_wrap=True)
    svg = console.export_svg(title="", unique_id="terminal")
    # A picture must not load fonts from another host.
    return re.sub(r"@font-face \{.*?\}\s*", "", svg, flags=re.DOTALL)


def run(words: list[str], folder: Path) -> str:
    """Run a command in *folder* and return its output, with colours."""
    settings = {**os.environ, "FORCE_COLOR": "1", "COLUMNS": str(COLUMNS), "PYTHONUNBUFFERED": "1"}
    settings.pop("NO_COLOR", None)
    output = subprocess.run(
        words, cwd=folder, env=settings, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False
    ).stdout
    return output.decode()


def main() -> None:
    """Write the picture of the command on the command line."""
    file, *words = sys.argv[1:]
    Path(file).write_text(draw(shlex.join(words), run(words, Path.cwd())), encoding="utf-8")


if __name__ == "__main__":
    main()
