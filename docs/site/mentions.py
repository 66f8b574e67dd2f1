"""Find the written pages that mention a name, for the links of the generated pages."""

from pathlib import Path
from typing import Final

DOCS: Final = Path(__file__).parents[1]
MOST_LINKS: Final = 6
PAGES: Final = {
    page.relative_to(DOCS).as_posix(): page.read_text(encoding="utf-8")
    for folder in ("tutorials", "guides", "book", "reference", "explanation")
    for page in sorted((DOCS / folder).rglob("*.md"))
    if page.stem != "errors"
}
"""The texts of the pages by their paths below docs/, without a page whose examples use all nodes."""


def title_of(page: str) -> str:
    """Return the title of a page."""
    return PAGES[page].partition("\n")[0].removeprefix("# ")


def links_to_mentions(mentions: dict[str, int]) -> list[str]:
    """Return links to the pages with the most mentions, for a page in a folder of docs/reference/.

    Args:
        mentions: The number of mentions, by page.
    """
    pages = [page for page, number in mentions.items() if number]
    most = sorted(pages, key=lambda page: -mentions[page])[:MOST_LINKS]
    return [f"- [{title_of(page)}](../../{page})" for page in most]
