"""The folder that agents may read, and the size of what they get."""

import json
from pathlib import Path

import pytest

from btcore_studio.agents.result_size import MAX_RESULT, to_bounded_json
from btcore_studio.served_folder import LOGS, MAX_LISTED, TREES, RefusedError, ServedFolder


@pytest.fixture
def folder(tmp_path: Path) -> ServedFolder:
    served = tmp_path / "served"
    (served / "sub").mkdir(parents=True)
    (served / ".git").mkdir()
    for name in ("gut.xml", "sub/türe.XML", "run.btlog", ".git/hidden.xml", "notes.txt"):
        (served / name).write_text("12345", encoding="utf-8")
    (tmp_path / "secret.xml").write_text("secret", encoding="utf-8")
    return ServedFolder(served)


def test_files_in_the_folder_are_found_and_listed(folder: ServedFolder) -> None:
    assert folder.files(TREES) == ["gut.xml", "sub/türe.XML"]
    assert folder.files(LOGS) == ["run.btlog"]
    assert folder.find("sub/türe.XML", TREES, 5) == folder.root / "sub" / "türe.XML"
    assert folder.read_tree("gut.xml") == "12345"
    assert folder.find_tree("bumpgo").name == "bumpgo.xml"
    for number in range(MAX_LISTED):
        (folder.root / f"z{number}.xml").touch()
    assert len(folder.files(TREES)) == MAX_LISTED


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("../secret.xml", "without '..'"),
        ("sub\\..\\..\\secret.xml", "without '..'"),
        ("/etc/passwd.xml", "relative to the served folder"),
        ("C:secret.xml", "relative to the served folder"),
        ("~/secret.xml", "relative to the served folder"),
        ("gut.xml\0", "control characters"),
        ("", "length"),
        ("x" * 501, "length"),
        ("notes.txt", "must end with .xml"),
        ("sub", "must end with .xml"),
        ("guut.xml", "did you mean 'gut.xml'?"),
    ],
)
def test_other_names_are_refused(folder: ServedFolder, name: str, reason: str) -> None:
    with pytest.raises(RefusedError) as raised:
        folder.find(name, TREES, 1000)
    assert reason in str(raised.value)


def test_links_out_of_the_folder_and_large_files_are_refused(folder: ServedFolder) -> None:
    (folder.root / "link.xml").symlink_to(folder.root.parent / "secret.xml")
    (folder.root / "out").symlink_to(folder.root.parent)
    for name in ("link.xml", "out/secret.xml"):
        with pytest.raises(RefusedError, match="leads out of the served folder"):
            folder.find(name, TREES, 1000)
    with pytest.raises(RefusedError, match="5 bytes; at most 4 are permitted"):
        folder.find("gut.xml", TREES, 4)
    with pytest.raises(RefusedError, match="there is no folder"):
        ServedFolder(folder.root / "missing")


def test_large_results_are_shortened_and_stay_valid_json() -> None:
    small = {"ü": [1, 2.5, None, "x"]}
    assert json.loads(to_bounded_json(small)) == small
    rows = {f"node {number}": {"text": "x" * 100, "list": list(range(50))} for number in range(5000)}
    text = to_bounded_json({"nodes": rows})
    assert len(text) <= MAX_RESULT
    assert json.loads(text)["nodes"]["…"] == "4,900 more"
    assert json.loads(to_bounded_json("y" * 100_000)) == "y" * 4000 + "… (96,000 more characters)"
