"""docs/guides/converting.md describes the codes of conversion messages."""

import re
from pathlib import Path

from btcore.diagnostic_codes import ALL_CODES

PAGE = Path(__file__).parents[2] / "docs/guides/converting.md"


def test_the_page_lists_exactly_the_conversion_codes_and_their_summaries() -> None:
    rows = re.findall(r"^\| (C\d{3}) \| ([^|]+) \|", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    codes = [code for code in ALL_CODES if code.startswith("C")]
    assert rows == [(code, code.summary) for code in codes]
    assert {code.documentation for code in codes} == {"guides/converting.md"}
