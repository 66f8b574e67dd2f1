"""The pictures of terminals in the gallery show what the commands print."""

import html
import importlib.util
import re
import shlex
import subprocess
from pathlib import Path

import pytest

from tests.docs.test_docs import environment, files

ROOT = Path(__file__).parent.parent.parent
GALLERY = (ROOT / "docs/gallery.md").read_text(encoding="utf-8")
IMAGES = ROOT / "docs/images"
BLOCK = re.compile(r"```console[^\n]*\n([^`]*)```\n\n!\[[^]]*\]\(images/(terminal_\w+\.svg)\)")
spec = importlib.util.spec_from_file_location("terminal_picture", ROOT / "docs/site/terminal_picture.py")
assert spec is not None
assert spec.loader is not None
terminal_picture = importlib.util.module_from_spec(spec)
spec.loader.exec_module(terminal_picture)


def text_of(svg: str) -> str:
    """Return the words of a picture, without colours and positions, which depend on the version of rich."""
    return " ".join(html.unescape(re.sub(r"<style>.*?</style>|<[^>]*>", " ", svg, flags=re.DOTALL)).split())


def test_every_terminal_picture_shows_last_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Messages list the node libraries that can be loaded.
    pytest.importorskip("cv2")
    for name, texts in files(GALLERY).items():
        (tmp_path / name).write_text(texts[0], encoding="utf-8")
    for name, value in environment(tmp_path).items():
        monkeypatch.setenv(name, value)
    outdated, found = [], []
    for block, picture in BLOCK.findall(GALLERY):
        *before, last = re.findall(r"^\$ (.*)$", block, re.MULTILINE)
        for command in before:
            subprocess.run(["bash", "-c", command], cwd=tmp_path, capture_output=True, check=True)
        svg = terminal_picture.draw(last, terminal_picture.run(shlex.split(last), tmp_path))
        found.append(picture)
        if text_of(svg) != text_of((IMAGES / picture).read_text(encoding="utf-8")):
            outdated.append(f"python docs/site/terminal_picture.py docs/images/{picture} {last}")
    assert sorted(found) == sorted(file.name for file in IMAGES.glob("terminal_*.svg"))
    assert outdated == []


def test_a_picture_has_the_colours_of_the_terminal_and_loads_nothing() -> None:
    svg = terminal_picture.draw("cmd", "\x1b[31mred\x1b[0m plain\n")
    assert "#cc555a" in svg
    assert "url(" not in svg.replace("url(#", "")
    assert re.search(r">red<.*>&#160;plain<", svg, re.DOTALL)
