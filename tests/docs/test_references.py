"""Every page and every test file that the code or the documentation names exists in the repository.

So does every name in the code that a package's README mentions.
"""

import os
import re
from collections.abc import Iterator, Set
from pathlib import Path

ROOT = Path(__file__).parents[2]
URL = re.compile(r"https?://\S+")
GENERATED = re.compile(r"\.\./(api|commands|nodes)/")
REFERENCE = re.compile(r"(?<!\})(?:[\w./-]*[\w-]\.md|(?<=`)tests/[\w./-]*\w\.py)\b")
NAME = re.compile(r"`(?!X[A-Z])([A-Za-z_][\w.]*)(?<!\.py)(?:\([^`]*\))?`")
"""A name in the code, as READMEs write it. In `XItem`, X is any datum."""
FILE_TYPES = {".cfg", ".in", ".json", ".md", ".py", ".toml", ".ts", ".xml", ".yaml", ".yml", ""}
# Folders of generated or installed files. Hidden folders are excluded, too, except those of the CI.
EXCLUDED = {"__pycache__", "build", "dist", "node_modules", "out"}
HIDDEN = {".ci", ".github"}


def text_files() -> Iterator[Path]:
    """Return the repository's text files."""
    for folder, subfolders, names in os.walk(ROOT):
        subfolders[:] = [
            name
            for name in subfolders
            if name in HIDDEN or not (name in EXCLUDED or name.startswith(".") or name.endswith(".egg-info"))
        ]
        yield from (Path(folder, name) for name in names if Path(name).suffix in FILE_TYPES)


def missing_references(text: str, folder: Path) -> list[str]:
    """Return line and name of each reference in *text* to a page or a test file that does not exist.

    A reference is relative to *folder*, to the repository or to docs/. Web addresses, the pages that
    docs/site/build_site.py writes, and files that a recipe adds are ignored.
    """
    return [
        f"{number}: {name}"
        for number, line in enumerate(text.splitlines(), 1)
        for name in REFERENCE.findall(URL.sub("", line))
        if not GENERATED.match(name)
        and f"+++ {name}" not in text
        and not any((start / name).is_file() for start in (folder, ROOT, ROOT / "docs"))
    ]


def test_markdown_references_resolve() -> None:
    missing = [
        f"{path.relative_to(ROOT)}:{reference}"
        for path in sorted(text_files())
        for reference in missing_references(path.read_text(encoding="utf-8", errors="replace"), path.parent)
    ]
    assert missing == []


def test_missing_references_are_found() -> None:
    # The name is assembled at run time, because the test above reads this file, too.
    absent = "absent" + ".md"
    text = (
        "See docs/guides/async.md, guides/async.md#halt, *.md and docs/*.md, and `tests/check.py`.\n"
        f"See `docs/{absent}`, [a page]({absent}).\n"
    )
    assert missing_references(text, ROOT / "btcore") == [f"2: docs/{absent}", f"2: {absent}"]
    assert missing_references(f"https://example.org/{absent}\n", ROOT) == []


def test_references_may_be_relative_to_the_file() -> None:
    page = "vff" + ".md"
    assert missing_references(f"{page}\n../book/{page}\n", ROOT / "docs" / "book") == []
    assert missing_references(f"{page}\n", ROOT / "docs") == [f"1: {page}"]


def unknown_names(text: str, words: Set[str]) -> list[str]:
    """Return the names in *text* that contain a word which is not one of *words*, the words of the code."""
    return [name for name in NAME.findall(text) if not words.issuperset(name.split("."))]


def test_names_in_readmes_of_packages_exist() -> None:
    files = [path for path in text_files() if "tests" not in path.relative_to(ROOT).parts]
    code = (path.read_text(encoding="utf-8") for path in files if path.suffix == ".py")
    words = {word for text in code for word in re.findall(r"\w+", text)}
    readmes = [path for path in files if path.name == "README.md" and ROOT / "packaging" not in path.parents]
    assert len(readmes) > 10
    unknown = [
        f"{path.relative_to(ROOT)}: {name}"
        for path in readmes
        for name in unknown_names(path.read_text(encoding="utf-8"), words)
    ]
    assert unknown == []


def test_unknown_names_are_found() -> None:
    text = "`halt`, `tree.halt(node)`, `tree.stop()`, `XEvent`, `halt.py`, `btcore run`, `Tree`"
    assert unknown_names(text, {"halt", "tree"}) == ["tree.stop", "Tree"]
