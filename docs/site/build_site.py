"""Build the documentation site: `make docs` runs this script.

The pages of docs/ and of the root folder are copied to out/docs/pages, the reference pages are generated
beside them, and Zensical builds the site in out/docs/site. Any problem that Zensical reports, such as a
missing page or anchor, fails the build. If `make studio-site` has built the studio as a site, that is copied
beside the pages.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import textwrap
import tomllib
from pathlib import Path

from api_pages import write_api_pages
from command_pages import write_command_pages
from links import link_problems
from node_pages import write_node_pages

from btcore.diagnostic_codes import ALL_CODES
from btcore.errors import BtcoreError
from btcore_studio.site.links import link_to

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
OUT = ROOT / "out" / "docs"
STUDIO = ROOT / "out" / "studio-site"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
# Pages of the repository's root folder, where GitHub expects them. README.md is the entrance on GitHub.
ROOT_PAGES = sorted(set(ROOT.glob("*.md")) - {ROOT / "README.md"})
FENCE = re.compile(r"^( *(?:`{3,}|~{3,}) *)(\w+) +(.*)$", re.MULTILINE)
EMPTY_BLOCK = re.compile(r"^```\w.*\n```\n", re.MULTILINE)
FILE_NAME = re.compile(r"[\w.]+\.\w+")
XML_BLOCK = re.compile(r'^( *)```xml(?: title="([\w.]+)")?\n(.*?)^\1```\n', re.MULTILINE | re.DOTALL)
TREE = re.compile(r"\s*(<\?xml[^>]*>\s*)?(<!--.*?-->\s*)*<root\b.*<BehaviorTree\b", re.DOTALL)
INCLUDED = re.compile(r'<include\s+path="([\w.]+)"')
LINK = re.compile(r"(?<=\]\()(?![a-z]+:)([^)#\s]+)")


def copy_pages(pages: Path) -> None:
    """Copy the pages and pictures of docs/ and the root folder's pages to the folder *pages*."""
    shutil.rmtree(pages, ignore_errors=True)
    shutil.copytree(DOCS, pages, ignore=shutil.ignore_patterns("*.py", "__pycache__", "zensical.toml"))
    (pages / "site" / "navigation.md").rename(pages / "navigation")
    for page in pages.rglob("*.md"):
        page.write_text(for_site(DOCS / page.relative_to(pages)), encoding="utf-8")
    for page in ROOT_PAGES:
        (pages / page.name).write_text(for_site(page), encoding="utf-8")


def for_site(page: Path) -> str:
    """Return the text of *page* as Zensical expects it: its links, and the words after its fences.

    A block without text, such as the example of an empty document, is only for the tests.
    """
    return FENCE.sub(with_title, EMPTY_BLOCK.sub("", with_site_links(page)))


def with_title(fence: re.Match[str]) -> str:
    """Return the first line of a fenced block, with a file name as title, and without notes for the tests."""
    title = f' title="{fence[3]}"' if FILE_NAME.fullmatch(fence[3]) else ""
    return f"{fence[1]}{fence[2]}{title}"


def with_try_links(text: str) -> str:
    """Return the *text* of a page with a link below each tree, which opens the tree in the studio.

    A tree with errors gets a link, too. Files that a tree includes are earlier blocks of the page.
    """
    files: dict[str, str] = {}

    def with_link(block: re.Match[str]) -> str:
        indent, name, text = block[1], block[2] or "tree.xml", textwrap.dedent(block[3])
        files[name] = text
        if not TREE.match(text):
            return block[0]
        included = {each: files[each] for each in INCLUDED.findall(text) if each in files}
        try:
            link = link_to({name: text, **included})
        except BtcoreError:
            return block[0]
        return f'{block[0]}\n{indent}[Try it in the studio]({link}){{ .try-it target="_blank" }}\n'

    return XML_BLOCK.sub(with_link, text)


def with_site_links(page: Path) -> str:
    """Return the text of *page*, with links to files outside docs/ replaced by links to the repository."""

    def replaced(link: re.Match[str]) -> str:
        target = (page.parent / link[1]).resolve()
        folder = DOCS if page.parent == ROOT else page.parent
        if target in ROOT_PAGES:
            return os.path.relpath(DOCS / target.name, folder)
        if target.is_relative_to(DOCS):
            return os.path.relpath(target, folder)
        return f"{PROJECT['urls']['Repository']}/blob/main/{target.relative_to(ROOT).as_posix()}"

    return LINK.sub(replaced, page.read_text(encoding="utf-8"))


def make_self_contained(site: Path) -> None:
    """Let search work in pages that are opened as files, without a script of another host.

    Browsers do not start a worker from a file. A worker can start from a text, though.
    """
    (worker,) = site.glob("assets/javascripts/workers/search.*.js")
    script = site / "assets/javascripts/search_worker.js"
    script.write_text(
        'if (location.protocol === "file:") {\n'
        f"  const text = {json.dumps(worker.read_text(encoding='utf-8'))};\n"
        '  const source = URL.createObjectURL(new Blob([text], { type: "text/javascript" }));\n'
        "  window.Worker = class extends Worker { constructor() { super(source); } };\n"
        "}\n",
        encoding="utf-8",
    )
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        address = os.path.relpath(script, page.parent)
        page.write_text(text.replace("https://unpkg.com/iframe-worker/shim", address), encoding="utf-8")


def missing_headings(site: Path) -> list[str]:
    """Return a problem for each diagnostic code whose link leads to no heading of the built *site*."""
    missing = []
    for code in ALL_CODES:
        page, _, anchor = code.url.removeprefix(PROJECT["urls"]["Documentation"]).partition("#")
        if f'id="{anchor}"' not in (site / page).read_text(encoding="utf-8"):
            missing.append(f"messages link to {code.url}, which does not exist")
    return missing


def main() -> int:
    """Build and check the site. Return the exit code: 0 if there is no problem."""
    copy_pages(OUT / "pages")
    writers = {"api": write_api_pages, "nodes": write_node_pages, "commands": write_command_pages}
    for name, write in writers.items():
        print(f"writing reference/{name}")
        write(OUT / "pages" / "reference" / name)
    for page in (OUT / "pages").rglob("*.md"):
        page.write_text(with_try_links(page.read_text(encoding="utf-8")), encoding="utf-8")
    config = (DOCS / "site" / "zensical.toml").read_text(encoding="utf-8")
    (OUT / "zensical.toml").write_text(config, encoding="utf-8")
    zensical = Path(sys.executable).with_name("zensical")
    # --clean: the cache does not notice changed docstrings.
    built = subprocess.run([zensical, "build", "--strict", "--clean"], cwd=OUT, check=False)
    if built.returncode != 0:
        return built.returncode
    make_self_contained(OUT / "site")
    problems = [*link_problems(OUT / "site"), *missing_headings(OUT / "site")]
    if STUDIO.exists():
        shutil.copytree(STUDIO, OUT / "site" / "studio")
    print("\n".join(problems), file=sys.stderr, end="\n" * bool(problems))
    return min(len(problems), 1)


if __name__ == "__main__":
    sys.exit(main())
