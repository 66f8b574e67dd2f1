"""Find problems of the built site: dead links, pages without a link to them, requests to other hosts."""

from pathlib import Path
from urllib.parse import unquote, urlsplit

from lxml import html

# Attributes whose address a browser requests while it shows a page.
REQUESTED = {"src", "srcset", "data", "poster"}


def link_problems(site: Path) -> list[str]:
    """Return a description of each problem in the pages below the folder *site*."""
    pages = {page: html.parse(str(page)).getroot() for page in sorted(site.rglob("*.html"))}
    anchors = {page: {*root.xpath("//@id"), *root.xpath("//a/@name")} for page, root in pages.items()}
    linked = {site / "index.html", site / "404.html"}
    problems: list[str] = []
    for page, root in pages.items():
        if page.name == "404.html":
            continue  # its links are absolute: a server may show it at any address
        for element, attribute, link, _ in root.iterlinks():
            address = urlsplit(link)
            if address.scheme or address.netloc:
                if address.scheme != "data" and (attribute in REQUESTED or element.tag == "link"):
                    problems.append(f"{page.relative_to(site)}: requests {link}")
                continue
            target = (page.parent / unquote(address.path)).resolve() if address.path else page
            target = target / "index.html" if target.is_dir() else target
            fragment = unquote(address.fragment)
            if not target.is_file():
                problems.append(f"{page.relative_to(site)}: dead link {link}")
            elif fragment and target in anchors and fragment not in anchors[target]:
                problems.append(f"{page.relative_to(site)}: no anchor for {link}")
            if target != page:
                linked.add(target)
    problems += [f"{page.relative_to(site)}: no page links to it" for page in pages if page not in linked]
    return problems
