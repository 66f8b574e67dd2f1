"""docs/converting.md: every code that a conversion may tell is explained."""

import re
from pathlib import Path

from btcore.xml.convert import changes

PAGE = Path(__file__).parents[2] / "docs" / "converting.md"


def test_every_code_is_explained_and_no_other() -> None:
    codes = {
        value for value in vars(changes).values() if isinstance(value, str) and re.fullmatch(r"C\d{3}", value)
    }
    assert set(re.findall(r"^\| (C\d{3}) \|", PAGE.read_text(encoding="utf-8"), re.MULTILINE)) == codes
