"""The checks and rewritings of docs/site, without the site generator."""

import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
pytest.importorskip("griffe")
sys.path.insert(0, str(ROOT / "docs" / "site"))

import build_site  # noqa: E402
import field_defaults  # noqa: E402
import griffe  # noqa: E402
import links  # noqa: E402


def site(folder: Path, **pages: str) -> Path:
    """Write the bodies *pages* as HTML files into *folder*; index.html links to all but "lost"."""
    (folder / "assets").mkdir()
    (folder / "assets" / "a.css").write_text("", encoding="utf-8")
    head = '<head><link rel="stylesheet" href="assets/a.css"></head>'
    index = "".join(f'<a href="{name}.html">{name}</a>' for name in pages if name != "lost")
    for name, body in {"index": index, **pages}.items():
        (folder / f"{name}.html").write_text(f"<html>{head}<body>{body}</body></html>", encoding="utf-8")
    return folder


def test_a_site_without_problems(tmp_path: Path) -> None:
    body = '<h1 id="top">A</h1><a href="#top">up</a> <a href="index.html">home</a> <a href="https://x.org/">x</a>'
    assert links.link_problems(site(tmp_path, a=body, b='<a href="a.html#top">a</a>')) == []


@pytest.mark.parametrize(
    ("name", "body", "problem"),
    [
        ("a", '<a href="gone.html">x</a>', "a.html: dead link gone.html"),
        ("a", '<img src="gone.png">', "a.html: dead link gone.png"),
        ("a", '<a href="#gone">x</a>', "a.html: no anchor for #gone"),
        ("a", '<a href="index.html#gone">x</a>', "a.html: no anchor for index.html#gone"),
        ("a", '<script src="https://x.org/a.js"></script>', "a.html: requests https://x.org/a.js"),
        ("lost", "nothing", "lost.html: no page links to it"),
    ],
)
def test_problems_are_found(name: str, body: str, problem: str, tmp_path: Path) -> None:
    assert links.link_problems(site(tmp_path, **{name: body})) == [problem]


def test_fences_of_the_site_have_no_notes_for_tests_and_file_names_are_titles() -> None:
    page = "```python\n```\n```console unrun: it is slow\n```\n  ```xml tree.xml\n```\n"
    assert build_site.FENCE.sub(build_site.with_title, page) == (
        '```python\n```\n```console\n```\n  ```xml title="tree.xml"\n```\n'
    )


def test_trees_of_the_site_have_links_to_the_studio() -> None:
    tree = '<root BTCPP_format="4">\n  <include path="go.xml"/>\n  <BehaviorTree ID="Ü"/>\n</root>\n'
    part = '```xml title="go.xml"\n<Sequence/>\n```\n'
    indented = "".join(f"    {line}\n" for line in tree.splitlines())
    page = f'{part}\n1. See:\n\n    ```xml\n{indented}    ```\n\n```xml title="{"a" * 99}.xml"\n{tree}```\n'
    shown = build_site.with_try_links(page)
    (link,) = re.findall(r"^    \[Try it in the studio\]\((.*)\)", shown, re.MULTILINE)
    assert link == build_site.link_to({"tree.xml": tree, "go.xml": "<Sequence/>\n"})
    assert re.sub(r"\n *\[Try it.*\n", "", shown) == page
    # A diff, and a file that the page would refuse, have no link.
    assert shown.count("Try it") == 1
    assert "Try it" not in build_site.with_try_links(f"````markdown\n+```xml\n+{tree}+```\n````\n")


def test_blocks_without_text_are_not_shown(tmp_path: Path) -> None:
    page = tmp_path / "page"
    page.write_text("# E001\n\n```xml E001\n```\n\n```xml\n<a/>\n```\n", encoding="utf-8")
    assert build_site.for_site(page) == "# E001\n\n\n```xml\n<a/>\n```\n"


def test_links_to_other_files_of_the_repository_lead_to_the_repository() -> None:
    public_api = build_site.with_site_links(ROOT / "docs/reference/public_api.md")
    assert "(../CHANGELOG.md)" in public_api
    assert "guides/batch.md)" in public_api
    conformance = build_site.with_site_links(ROOT / "docs/reference/conformance.md")
    assert (
        f"({build_site.PROJECT['urls']['Repository']}/blob/main/tests/btcore/nodes/test_loop.py)"
        in conformance
    )


def test_parameters_of_the_navigation_have_plain_defaults() -> None:
    extensions = griffe.load_extensions(field_defaults.FieldDefaults)
    folder = ROOT / "robot_nodes"
    module = griffe.load(
        "btcore_navigation.parameters", search_paths=[folder], extensions=extensions, allow_inspection=False
    )
    assert isinstance(module, griffe.Module)
    defaults = {it.name: str(it.default) for it in module["AmclParameters"].parameters}
    assert (defaults["alpha1"], defaults["max_particles"]) == ("0.2", "2000")
