"""Cases of error messages in text files: a document and the message, as a user reads it."""

import re
from pathlib import Path


def read_cases(file: Path) -> dict[str, tuple[str, str]]:
    """Return the document and the message of each case, by its title.

    A case begins with "### title", and its message with the first line that begins with "t.xml".
    """
    cases = {}
    for case in file.read_text(encoding="utf-8").split("### ")[1:]:
        title, rest = case.split("\n", 1)
        document, message = re.split(r"^(?=t\.xml)", rest, maxsplit=1, flags=re.MULTILINE)
        cases[title] = document, message.rstrip("\n")
    return cases
