"""Documents that include other documents."""

from pathlib import Path

import pytest

from btcore import Registry, Status, TreeError, load, loads
from btcore.xml.lint.validate import validate_document
from btcore.xml.read.document import parse_file


def write(path: Path, *trees: str, include: str = "", main: str = "") -> Path:
    """Write a document of *trees*, each `ID=element`, into the file *path*."""
    named = "".join(
        f'<BehaviorTree ID="{ID}">{element}</BehaviorTree>'
        for ID, _, element in (tree.partition("=") for tree in trees)
    )
    attribute = f' main_tree_to_execute="{main}"' if main else ""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f'<root BTCPP_format="4"{attribute}>{include}{named}</root>', encoding="utf-8")
    return path


def test_later_tree_replaces_an_included_tree_with_the_same_id(tmp_path: Path) -> None:
    write(tmp_path / "a.xml", "A=<AlwaysFailure/>")
    main = write(
        tmp_path / "m.xml",
        'M=<SubTree ID="A"/>',
        "A=<AlwaysSuccess/>",
        include='<include path="a.xml"/>',
        main="M",
    )
    assert load(main).tick_once() is Status.SUCCESS


def test_nested_include_is_searched_beside_the_including_file(tmp_path: Path) -> None:
    write(tmp_path / "one" / "two" / "c.xml", "C=<AlwaysFailure/>")
    write(tmp_path / "one" / "b.xml", 'B=<SubTree ID="C"/>', include='<include path="two/c.xml"/>')
    main = write(tmp_path / "m.xml", 'M=<SubTree ID="B"/>', include='<include path="one/b.xml"/>')
    tree = load(main, tree="M")
    assert [one.id for one in tree.subtrees] == ["M", "B", "C"]
    assert tree.tick_once() is Status.FAILURE


def test_includes_of_a_text_are_searched_in_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path / "lib" / "a.xml", "A=<AlwaysFailure/>")
    monkeypatch.chdir(tmp_path)
    text = '<root BTCPP_format="4"><include path="lib/a.xml"/></root>'
    assert loads(text, tree="A").tick_once() is Status.FAILURE


def test_main_tree_of_an_included_document_is_ignored(
    tmp_path: Path,
) -> None:
    write(tmp_path / "a.xml", "A=<AlwaysFailure/>", "B=<AlwaysFailure/>", main="A")
    include = '<include path="a.xml"/>'
    named = write(
        tmp_path / "named.xml", "M=<AlwaysSuccess/>", "N=<AlwaysFailure/>", include=include, main="M"
    )
    assert load(named).id == "M"
    alone = write(tmp_path / "alone.xml", "M=<AlwaysSuccess/>", include=include)
    assert load(alone).id == "M"


def test_include_without_a_path_is_reported_with_its_position(tmp_path: Path) -> None:
    main = write(tmp_path / "m.xml", "M=<AlwaysSuccess/>", include="\n  <include/>")
    with pytest.raises(TreeError) as caught:
        load(main)
    (fault,) = caught.value.diagnostics
    assert (fault.code, fault.line, fault.column) == ("E007", 2, 3)


def test_package_with_an_absolute_path_is_ignored_with_a_warning(tmp_path: Path) -> None:
    other = write(tmp_path / "elsewhere" / "a.xml", "A=<AlwaysFailure/>")
    include = f'<include ros_pkg="nav" path="{other}"/>'
    main = write(tmp_path / "m.xml", 'M=<SubTree ID="A"/>', include=include, main="M")
    assert load(main).tick_once() is Status.FAILURE
    assert [one.code for one in validate_document(parse_file(main), nodes=Registry.standard())] == ["W107"]


def test_unknown_package_is_refused(tmp_path: Path) -> None:
    main = write(tmp_path / "m.xml", "M=<AlwaysSuccess/>", include='<include ros_pkg="nav" path="a.xml"/>')
    with pytest.raises(TreeError, match="unknown ROS package 'nav'"):
        load(main, packages=lambda name: None)
