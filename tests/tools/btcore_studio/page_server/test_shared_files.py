"""The shared texts lose no edit, of whomever it is, and write only what they may."""

import os
import random
import re
from pathlib import Path
from typing import Any

import pytest
from lsprotocol.types import Position

from btcore.xml.edit.editor import Edit, apply_edits
from btcore_studio.language.text_positions import TextPositions
from btcore_studio.page_server.session import Shown
from btcore_studio.page_server.shared_files import line_edits, merge_edits
from tests.tools.btcore_studio.page_server.conftest import TREE, PageClient, Studio, running_studio

REFUSED, STALE = -32803, -32801


def text_edit(text: str, start: int, end: int, new: str) -> dict[str, Any]:
    positions = TextPositions(text)
    first, last = positions.position(start), positions.position(end)
    return {
        "range": {
            "start": {"line": first.line, "character": first.character},
            "end": {"line": last.line, "character": last.character},
        },
        "newText": new,
    }


def replace(text: str, old: str, new: str) -> dict[str, Any]:
    start = text.index(old)
    return text_edit(text, start, start + len(old), new)


def apply(text: str, edits: list[dict[str, Any]]) -> str:
    positions = TextPositions(text)

    def offset(place: dict[str, int]) -> int:
        return positions.offset(Position(place["line"], place["character"]))

    return apply_edits(
        text,
        [
            Edit(offset(edit["range"]["start"]), offset(edit["range"]["end"]), edit["newText"])
            for edit in edits
        ],
    )


def push(page: PageClient, uri: str, version: int, *edits: dict[str, Any]) -> int:
    version_after: int = page.request("btcore/push", {"uri": uri, "version": version, "edits": edits})[
        "version"
    ]
    return version_after


def test_edit_reaches_the_other_page_and_the_disk(studio: Studio, previous: Path) -> None:
    uri = studio.uri("tree.xml")
    with studio.page() as page, studio.page() as other:
        shared = page.request("btcore/read", {"uri": uri})
        assert shared == {"text": TREE, "version": 1, "unsaved": False}
        other.request("btcore/read", {"uri": uri})
        edit = replace(TREE, "Küche", "Bad 𝒙")
        assert push(page, uri, 1, edit) == 2
        assert other.notification("btcore/pushed") == {"uri": uri, "version": 1, "edits": [edit]}
        files = [{"uri": uri, "name": "tree.xml", "unsaved": True}]
        assert page.request("btcore/files") == other.notification("btcore/files") == files
        assert (studio.folder / "tree.xml").read_text(encoding="utf-8") == TREE
        assert page.request("btcore/save", {"uri": uri}) is True
        after = TREE.replace("Küche", "Bad 𝒙")
        assert (studio.folder / "tree.xml").read_text(encoding="utf-8") == after
        assert other.notification("btcore/files")[0]["unsaved"] is False
        assert other.request("btcore/read", {"uri": uri}) == {"text": after, "version": 2, "unsaved": False}
    assert [file.read_bytes() for file in previous.iterdir()] == [TREE.encode()]


def test_edit_of_an_older_version_is_refused(studio: Studio) -> None:
    uri = studio.uri("tree.xml")
    with studio.page() as page, studio.page() as other:
        for each in (page, other):
            each.request("btcore/read", {"uri": uri})
        edit = replace(TREE, "tempo", "speed")
        push(page, uri, 1, edit)
        assert other.error("btcore/push", {"uri": uri, "version": 1, "edits": [edit]})[0] == STALE
        # The edits of the others come before the refusal.
        assert other.notifications[0]["method"] == "btcore/pushed"


@pytest.mark.parametrize(
    "edits",
    [
        [(0, 5, "a"), (3, 8, "b")],
        [(0, 5, "\ud800")],
        [(0, 0, "x" * (8 << 20))],
        [(0, 0, "")] * 10_001,
    ],
)
def test_invalid_edits_change_nothing(studio: Studio, edits: list[tuple[int, int, str]]) -> None:
    uri = studio.uri("tree.xml")
    with studio.page() as page:
        page.request("btcore/read", {"uri": uri})
        params = {"uri": uri, "version": 1, "edits": [text_edit(TREE, *edit) for edit in edits]}
        assert page.error("btcore/push", params)[0] == REFUSED
        assert page.request("btcore/read", {"uri": uri})["text"] == TREE


@pytest.mark.parametrize("name", ["line", "character"])
def test_an_edit_at_a_negative_position_changes_nothing(studio: Studio, name: str) -> None:
    uri = studio.uri("tree.xml")
    with studio.page() as page:
        page.request("btcore/read", {"uri": uri})
        edit = text_edit(TREE, 0, 0, "x")
        edit["range"]["start"][name] = -1
        assert page.error("btcore/push", {"uri": uri, "version": 1, "edits": [edit]})[0] == REFUSED
        assert page.request("btcore/read", {"uri": uri})["text"] == TREE


@pytest.mark.parametrize(
    "text",
    [
        "\ufeff" + TREE,
        TREE.replace("\n", "\r\n"),
        "\ufeff" + TREE.replace("\n", "\r\n", 3).replace("/>\n", "/>\r"),
        TREE.rstrip("\n"),
        TREE.replace("Rounds", "a\u2028b\u0085c\x0bd"),
    ],
)
def test_bytes_outside_of_an_edit_are_kept(studio: Studio, text: str) -> None:
    file, uri = studio.folder / "tree.xml", studio.uri("tree.xml")
    file.write_bytes(text.encode())
    with studio.page() as page:
        shown = page.request("btcore/read", {"uri": uri})["text"]
        assert shown == text.removeprefix("\ufeff")
        push(page, uri, 1, replace(shown, "tempo", "speed"))
        page.request("btcore/save", {"uri": uri})
    assert file.read_bytes() == text.replace("tempo", "speed").encode()


def test_unsaved_text_outlives_its_page(studio: Studio) -> None:
    uri = studio.uri("tree.xml")
    with studio.page() as page:
        page.request("btcore/read", {"uri": uri})
        push(page, uri, 1, replace(TREE, "tempo", "speed"))
    with studio.page() as page:
        shared = page.request("btcore/read", {"uri": uri})
        assert shared == {"text": TREE.replace("tempo", "speed"), "version": 2, "unsaved": True}


# --- changes on disk


def test_change_on_disk_is_pushed_as_a_small_edit(studio: Studio) -> None:
    uri = studio.uri("tree.xml")
    with studio.page() as page:
        page.request("btcore/read", {"uri": uri})
        after = TREE.replace("Küche", "Bad").replace("<AlwaysSuccess/>", "<AlwaysFailure/>")
        (studio.folder / "tree.xml").write_bytes(after.encode())
        pushed = page.notification("btcore/pushed")
        assert apply(TREE, pushed["edits"]) == after
        assert [edit["newText"] for edit in pushed["edits"]] == ["Bad", "Failure"]
        assert page.request("btcore/read", {"uri": uri}) == {"text": after, "version": 2, "unsaved": False}


def test_line_ends_that_change_on_disk(studio: Studio) -> None:
    uri = studio.uri("tree.xml")
    with studio.page() as page:
        page.request("btcore/read", {"uri": uri})
        text = TREE
        for after in (TREE.replace("\n", "\r\n"), TREE.replace("\n", "\r"), TREE):
            (studio.folder / "tree.xml").write_bytes(after.encode())
            text = apply(text, page.notification("btcore/pushed")["edits"])
            assert text == after == page.request("btcore/read", {"uri": uri})["text"]


def test_change_on_disk_is_merged_with_unsaved_changes(studio: Studio) -> None:
    file, uri = studio.folder / "tree.xml", studio.uri("tree.xml")
    with studio.page() as page:
        page.request("btcore/read", {"uri": uri})
        push(page, uri, 1, replace(TREE, "tempo", "speed"))
        file.write_bytes(TREE.replace("<AlwaysSuccess/>", "<AlwaysFailure/>").encode())
        page.notification("btcore/pushed")
        merged = TREE.replace("tempo", "speed").replace("<AlwaysSuccess/>", "<AlwaysFailure/>")
        assert page.request("btcore/read", {"uri": uri}) == {"text": merged, "version": 3, "unsaved": True}
        page.request("btcore/save", {"uri": uri})
    assert file.read_bytes() == merged.encode()


def test_save_is_never_a_silent_overwrite(studio: Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    # The regular check does not see the change before the page saves.
    monkeypatch.setattr(studio.session.files, "check_disk", lambda: None)
    file, uri = studio.folder / "tree.xml", studio.uri("tree.xml")
    with studio.page() as page:
        page.request("btcore/read", {"uri": uri})
        push(page, uri, 1, replace(TREE, "tempo", "speed"))
        file.write_bytes(TREE.replace("<AlwaysSuccess/>", "<AlwaysFailure/>").encode())
        code, message = page.error("btcore/save", {"uri": uri})
        assert (code, "check the merged text" in message) == (REFUSED, True)
        assert "speed" not in file.read_text(encoding="utf-8")
        page.request("btcore/save", {"uri": uri})
        assert "speed" in (text := file.read_text(encoding="utf-8"))
        assert "AlwaysFailure" in text


@pytest.mark.parametrize("keep", ["disk", "page"])
def test_overlapping_changes_are_asked_about(studio: Studio, previous: Path, keep: str) -> None:
    file, uri = studio.folder / "tree.xml", studio.uri("tree.xml")
    mine, theirs = TREE.replace("tempo := 3", "tempo := 4"), TREE.replace("tempo := 3", "tempo := 5")
    with studio.page() as page:
        page.request("btcore/read", {"uri": uri})
        push(page, uri, 1, replace(TREE, "tempo := 3", "tempo := 4"))
        file.write_bytes(theirs.encode())
        assert page.notification("btcore/disk") == {"uri": uri, "text": theirs}
        assert page.error("btcore/save", {"uri": uri})[0] == REFUSED
        with studio.page() as other:
            other.request("btcore/read", {"uri": uri})
            assert other.notification("btcore/disk")["text"] == theirs
        assert file.read_bytes() == theirs.encode()
        page.request("btcore/resolve", {"uri": uri, "keep": keep})
        shared = page.request("btcore/read", {"uri": uri})
        assert (shared["text"], shared["unsaved"]) == ((theirs, False) if keep == "disk" else (mine, True))
        page.request("btcore/save", {"uri": uri})
        assert file.read_bytes() == (theirs if keep == "disk" else mine).encode()
        assert [kept.read_bytes() for kept in previous.iterdir()] == (
            [] if keep == "disk" else [theirs.encode()]
        )


@pytest.mark.parametrize("content", [b"\xff\xfe", b" " * (9 << 20)])
def test_content_that_is_not_shown_is_not_overwritten(studio: Studio, content: bytes) -> None:
    file, uri = studio.folder / "tree.xml", studio.uri("tree.xml")
    with studio.page() as page:
        page.request("btcore/read", {"uri": uri})
        push(page, uri, 1, replace(TREE, "tempo", "speed"))
        file.write_bytes(content)
        assert page.error("btcore/save", {"uri": uri})[0] == REFUSED
        assert file.read_bytes() == content
        if len(content) < 10:
            page.error("btcore/resolve", {"uri": uri, "keep": "disk"})
            page.request("btcore/resolve", {"uri": uri, "keep": "page"})
            page.request("btcore/save", {"uri": uri})
            assert file.read_text(encoding="utf-8") == TREE.replace("tempo", "speed")


def test_deleted_file_is_unsaved_and_can_be_saved(studio: Studio) -> None:
    file, uri = studio.folder / "tree.xml", studio.uri("tree.xml")
    with studio.page() as page:
        page.request("btcore/read", {"uri": uri})
        file.unlink()
        while not page.notification("btcore/files")[0]["unsaved"]:
            pass
        page.request("btcore/save", {"uri": uri})
    assert file.read_bytes() == TREE.encode()


def test_encoding_of_the_declaration(studio: Studio) -> None:
    text = '<?xml version="1.0" encoding="ISO-8859-1"?>\n<root BTCPP_format="4"/>\n'
    with studio.page() as page:
        uri = page.request("btcore/create", {"name": "latin.xml", "text": text})["uri"]
        page.request("btcore/read", {"uri": uri})
        push(page, uri, 1, replace(text, "<root", "<!-- ü --><root"))
        assert "ISO-8859-1" in page.error("btcore/save", {"uri": uri})[1]
    assert (studio.folder / "latin.xml").read_bytes() == text.encode()


# --- what may be read and written


@pytest.mark.parametrize(
    "name",
    [
        "../outside.xml",
        "sub/../../outside.xml",
        "/tmp/outside.xml",
        "link/outside.xml",
        "link.xml",
        "~/outside.xml",
        "C:outside.xml",
        "tree.xml",
        "tree.xml/new.xml",
        "missing/new.xml",
        "new.txt",
        "new.py",
        "conftest.py",
        "a_node.py/new_node.py",
        "../a_node.py",
        "new",
        ".hidden.xml",
        ".git/new.xml",
        "new\x00.xml",
        "new\n.xml",
        "",
        "x" * 600 + ".xml",
    ],
)
def test_file_is_created_only_in_the_folder(studio: Studio, tmp_path: Path, name: str) -> None:
    (studio.folder / ".git").mkdir()
    (studio.folder / "link").symlink_to(tmp_path, target_is_directory=True)
    (studio.folder / "link.xml").symlink_to(tmp_path / "outside.xml")
    before = sorted(tmp_path.rglob("*"))
    with studio.page() as page:
        assert page.error("btcore/create", {"name": name, "text": "x"})[0] == REFUSED
    assert sorted(tmp_path.rglob("*")) == before
    assert (studio.folder / "tree.xml").read_bytes() == TREE.encode()


@pytest.mark.parametrize(
    "uri",
    [
        "file:///etc/passwd",
        "file://{folder}/../outside.xml",
        "file://{folder}/%2e%2e/outside.xml",
        "file://{folder}/link.xml",
        "file://{folder}/link/outside.xml",
        "file://{folder}/notes.txt",
        "file://{folder}/%00.xml",
        "file://{folder}/pipe.xml",
        "file://{folder}/folder.xml",
        "file://{folder}/missing.xml",
        "file://{folder}/latin.xml",
        "file://{folder}/large.xml",
        "file://evil.example{folder}/tree.xml",
        "http://127.0.0.1/tree.xml",
        "tree.xml",
        "",
    ],
)
@pytest.mark.skipif(os.name != "posix", reason="named pipes")
def test_file_is_read_only_in_the_folder(studio: Studio, tmp_path: Path, uri: str) -> None:
    (tmp_path / "outside.xml").write_text(TREE)
    (studio.folder / "link").symlink_to(tmp_path, target_is_directory=True)
    (studio.folder / "link.xml").symlink_to(tmp_path / "outside.xml")
    (studio.folder / "notes.txt").write_text("x")
    (studio.folder / "folder.xml").mkdir()
    (studio.folder / "latin.xml").write_bytes(TREE.encode("latin-1"))
    (studio.folder / "large.xml").write_bytes(b" " * (9 << 20))
    os.mkfifo(studio.folder / "pipe.xml")
    uri = uri.replace("{folder}", str(studio.folder))
    with studio.page() as page:
        assert page.error("btcore/read", {"uri": uri})[0] == REFUSED
        for method, params in (
            ("btcore/push", {"version": 1, "edits": []}),
            ("btcore/save", {}),
            ("btcore/resolve", {"keep": "page"}),
        ):
            assert page.error(method, {"uri": uri, **params})[0] == REFUSED


def test_file_that_becomes_a_link_is_not_written(studio: Studio, tmp_path: Path) -> None:
    file, uri = studio.folder / "tree.xml", studio.uri("tree.xml")
    (tmp_path / "outside.xml").write_bytes(TREE.encode())
    with studio.page() as page:
        page.request("btcore/read", {"uri": uri})
        push(page, uri, 1, replace(TREE, "tempo", "speed"))
        file.unlink()
        file.symlink_to(tmp_path / "outside.xml")
        assert page.error("btcore/save", {"uri": uri})[0] == REFUSED
    assert (tmp_path / "outside.xml").read_bytes() == TREE.encode()


def test_link_inside_the_folder_is_the_same_text(studio: Studio) -> None:
    (studio.folder / "alias.xml").symlink_to("tree.xml")
    with studio.page() as page, studio.page() as other:
        page.request("btcore/read", {"uri": studio.uri("alias.xml")})
        other.request("btcore/read", {"uri": studio.uri("tree.xml")})
        push(page, studio.uri("alias.xml"), 1, replace(TREE, "tempo", "speed"))
        assert other.notification("btcore/pushed")["uri"] == studio.uri("tree.xml")


def test_read_only_studio_writes_nothing(folder: Path, built: Path, previous: Path) -> None:
    with running_studio(Shown(folder, is_read_only=True), previous, built) as studio, studio.page() as page:
        uri = studio.uri("tree.xml")
        assert page.request("btcore/start")["readOnly"] is True
        page.request("btcore/read", {"uri": uri})
        for method, params in (
            ("btcore/push", {"uri": uri, "version": 1, "edits": []}),
            ("btcore/save", {"uri": uri}),
            ("btcore/create", {"name": "new.xml", "text": ""}),
            ("btcore/resolve", {"uri": uri, "keep": "page"}),
        ):
            code, message = page.error(method, params)
            assert (code, "read-only" in message) == (REFUSED, True)
        assert [file.name for file in folder.iterdir()] == ["tree.xml"]


# --- random edits


class EditingPage:
    """A page that edits at random, and rebases its edits as the page's script does."""

    def __init__(self, page: PageClient, uri: str, name: str, seed: int) -> None:
        self.page, self.uri, self.name = page, uri, name
        self.random = random.Random(seed)
        self.confirmed: str = page.request("btcore/read", {"uri": uri})["text"]
        self.version = 1
        self.edits: list[tuple[int, int, str]] = []  # each of the text after the edits before it
        self.inserted = 0
        self.pushed = 0

    @property
    def text(self) -> str:
        text = self.confirmed
        for start, end, new in self.edits:
            text = text[:start] + new + text[end:]
        return text

    def edit(self) -> None:
        """Insert a new character, or delete a blank."""
        text = self.text
        at = self.random.randint(0, len(text))
        blanks = [match.span() for match in re.finditer("[ \n]", text)]
        if self.random.random() < 0.3 and blanks:
            start, end = self.random.choice(blanks)
            self.edits.append((start, end, ""))
        else:
            self.edits.append((at, at, self.mark(self.inserted)))
            self.inserted += 1

    def mark(self, number: int) -> str:
        """Return a character that no other edit inserts; those of the second page have two UTF-16 units."""
        return chr({"a": 0xE000, "b": 0xF0000}[self.name] + number)

    def send(self) -> None:
        """Push the first edit."""
        if self.edits:
            edit = text_edit(self.confirmed, *self.edits[0])
            reply = self.page.reply_to(
                "btcore/push", {"uri": self.uri, "version": self.version, "edits": [edit]}
            )
            self.receive()
            if "result" in reply:
                start, end, new = self.edits.pop(0)
                self.confirmed = self.confirmed[:start] + new + self.confirmed[end:]
                self.version = reply["result"]["version"]
                self.pushed += 1
            else:
                assert reply["error"]["code"] == STALE

    def receive(self) -> None:
        """Apply the edits of others that have arrived, and rebase the own edits."""
        for message in self.page.notifications:
            if message["method"] == "btcore/pushed":
                pushed = message["params"]
                assert pushed["version"] == self.version
                after = apply(self.confirmed, pushed["edits"])
                positions = TextPositions(self.confirmed)
                assert len(pushed["edits"]) == 1
                place = pushed["edits"][0]["range"]
                theirs = (
                    positions.offset(Position(**place["start"])),
                    positions.offset(Position(**place["end"])),
                    pushed["edits"][0]["newText"],
                )
                for index, own in enumerate(self.edits):
                    self.edits[index], theirs = moved(own, theirs, True), moved(theirs, own, False)
                self.confirmed, self.version = after, pushed["version"] + 1
        self.page.notifications.clear()


def moved(edit: tuple[int, int, str], by: tuple[int, int, str], is_first: bool) -> tuple[int, int, str]:
    """Return *edit* as an edit of the text after *by*.

    Args:
        is_first: Whether *edit* is first if both insert at the same place.
    """
    start, end, new = edit
    other_start, other_end, other_new = by

    def position(offset: int, is_before: bool) -> int:
        if offset < other_start or (offset == other_start and is_before):
            return offset
        return offset + len(other_new) - (other_end - other_start) if offset >= other_end else other_start

    first = position(start, is_before=start == end and is_first)
    return first, max(first, position(end, is_before=True)), new


@pytest.mark.parametrize("seed", range(5))
def test_two_pages_lose_no_edit(studio: Studio, seed: int) -> None:
    uri = studio.uri("tree.xml")
    with studio.page() as one, studio.page() as two:
        pages = [EditingPage(one, uri, "a", seed), EditingPage(two, uri, "b", 1_000 + seed)]
        choose = random.Random(seed)
        for _ in range(300):
            page = choose.choice(pages)
            choose.choice((page.edit, page.send, page.receive))()
        while any(page.edits for page in pages):
            for page in pages:
                page.send()
        final = one.request("btcore/read", {"uri": uri})["text"]
        for page in pages:
            page.page.request("btcore/start")
            page.receive()
            assert page.text == final
            for number in range(page.inserted):
                assert page.mark(number) in final
        one.request("btcore/save", {"uri": uri})
        assert (studio.folder / "tree.xml").read_bytes() == final.encode()


# --- edits between texts


def test_line_edits_and_merges_of_random_texts() -> None:
    choose = random.Random(1)
    merged_count = 0
    for _ in range(2_000):
        lines = [
            choose.choice("abc") + choose.choice(("\n", "\r\n", "\r", ""))
            for _ in range(choose.randint(0, 8))
        ]
        base = "".join(lines)

        def changed(lines: list[str] = lines) -> str:
            after = list(lines)
            for _ in range(choose.randint(0, 2)):
                at = choose.randint(0, len(after))
                after[at : at + choose.randint(0, 1)] = [choose.choice(("x\n", "y\r\n", "\r", "\n", ""))]
            return "".join(after)

        disk, text = changed(), changed()
        assert apply_edits(base, line_edits(base, disk)) == disk
        merged = merge_edits(base, disk, text)
        if merged is not None:
            merged_count += 1
            assert base != text or apply_edits(text, merged) == disk
            assert base != disk or merged == []
    assert merged_count > 500
