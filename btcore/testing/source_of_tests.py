"""Parts of the source code of tests that btcore writes, such as those of `btcore replay --save-test`."""

import json
import os
import textwrap
from pathlib import Path
from typing import Final

LINE_LENGTH: Final = 88
"""The line length of the tests, which is ruff's default."""


def docstring_lines(text: str) -> list[str]:
    """Return the lines of *text* in a docstring, at most 4."""
    printable = "".join(letter if letter.isprintable() else " " for letter in text)
    plain = printable.replace("\\", "/").replace('"', "'")
    return textwrap.wrap(plain, LINE_LENGTH - 4, max_lines=4)


def literal(text: str) -> str:
    """Return a string literal of Python."""
    return json.dumps(text, ensure_ascii=not text.isprintable())


def path_expression(path: Path, folder: Path) -> str:
    """Return an expression for a path, relative to the folder of the test if that is possible."""
    try:
        relative = Path(os.path.relpath(path.resolve(), folder.resolve()))
    except ValueError:  # on another drive of Windows
        return f"Path({literal(str(path.resolve()))})"
    return f"FOLDER / {literal(relative.as_posix())}"
