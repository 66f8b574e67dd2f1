"""Find problems of the built site: dead links, pages without a link to them, requests to other hosts."""

from functools import cache
from pathlib import Path
from urllib.parse import unquote, urlsplit

from lxml import html

# Attributes whose address a browser requests while it shows a page.
REQUESTED = {"src", "srcset", "data", "poster"}


def link_problems(site: Path) -> list[str]:
    """Return a description of each problem in the pages below the folder *site*."""

    @cache  # most links of a page are in the navigation, which its neighbours have, too
    def find(folder: Path, address: str) -> tuple[Path, bool]:
        target = (folder / unquote(address)).resolve()
        target = target / "index.html" if target.is_dir() else target
        return target, target.is_file()

    pages = {page: html.parse(str(page)).getroot() for page in sorted(site.rglob("*.html"))}
    anchors = {page: {*root.xpath("//@id"), *root.xpath("//a/@name")} for page, root in pages.items()}
    linked = {site / "index.html", site / "404.html"}
    problems: list[str] = []
    for page, root in pages.items():
        if page.name == "404.html":
            continue  # its links are absolute: a server may show it at any address
        for tag, attribute, link in dict.fromkeys((each[0].tag, *each[1:3]) for each in root.iterlinks()):
            address = urlsplit(link)
            if address.scheme or address.netloc:
                if address.scheme != "data" and (attribute in REQUESTED or tag == "link"):
                    problems.append(f"{page.relative_to(site)}: requests {link}")
                continue
            target, exists = find(page.parent, address.path) if address.path else (page, True)
            fragment = unquote(address.fragment)
            if not exists:
                problems.append(f"{page.relative_to(site)}: dead link {link}")
            elif fragment and target in anchors and fragment not in anchors[target]:
                problems.append(f"{page.relative_to(site)}: no anchor for {link}")
            if target != page:
                linked.add(target)
    problems += [f"{page.relative_to(site)}: no page links to it" for page in pages if page not in linked]
    return problems
