"""Links to the studio in the browser; `test_site.py` opens them in the page."""

import random

import pytest

from btcore.errors import BtcoreError
from btcore_studio.site.links import MAX_CONTENT, MAX_FILES, MAX_FRAGMENT, link_to

RANDOM = random.Random(1)


@pytest.mark.parametrize(
    "name",
    [
        "",
        ".xml",
        "tree.py",
        "../a.xml",
        "a\\b.xml",
        "a\n.xml",
        "\u202ea.xml",
        "\ud800.xml",
        "a" * 97 + ".xml",
    ],
)
def test_names_that_the_page_refuses_are_refused(name: str) -> None:
    with pytest.raises(BtcoreError, match="is not the name of a file"):
        link_to({name: ""})


@pytest.mark.parametrize(
    "text", ["a" * MAX_CONTENT, "".join(chr(33 + RANDOM.randrange(90)) for _ in range(MAX_FRAGMENT))]
)
def test_what_is_too_large_is_refused(text: str) -> None:
    with pytest.raises(BtcoreError, match="too large"):
        link_to({"tree.xml": text})
    with pytest.raises(BtcoreError, match="too large"):
        link_to({"tree.xml": ""}, recording=text)


def test_files_that_are_no_content_of_a_link_are_refused() -> None:
    for files in ({}, {f"{number}.xml": "" for number in range(MAX_FILES + 1)}):
        with pytest.raises(BtcoreError, match="from 1 to 32 files"):
            link_to(files)
    with pytest.raises(BtcoreError, match="Unicode"):
        link_to({"tree.xml": "\ud800"})
