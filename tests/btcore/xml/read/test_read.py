"""Documents that include other documents."""

from pathlib import Path

import pytest

from btcore import Registry, Status, TreeError, load, loads
from btcore.lint.validate import validate_document
from btcore.xml.read.document import parse_file


def write(path: Path, *trees: str, include: str = "", main: str = "") -> Path:
    """Write a document of *trees*, each `ID=element`, into the file *path*."""
    named = "".join(
        f'<BehaviorTree ID="{id}">{element}</BehaviorTree>'
        for id, _, element in (tree.partition("=") for tree in trees)
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


def test_main_tree_of_an_included_document_is_ignored(tmp_path: Path) -> None:
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


# --- hostile includes


@pytest.mark.parametrize(
    "content", [b"root:x:0:0:secret\n", b"<settings password='secret'>\n", b"\xff secret", b"<a secret"]
)
def test_an_include_that_is_no_tree_is_reported_without_its_content(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "passwd").write_bytes(content)
    main = write(tmp_path / "m.xml", "M=<AlwaysSuccess/>", include='<include path="passwd"/>')
    with pytest.raises(TreeError) as caught:
        load(main)
    (fault,) = caught.value.diagnostics
    assert (fault.code, fault.file) == ("E007", str(main))
    assert fault.message == f"the included file '{tmp_path}/passwd': not an XML document of trees"
    assert "secret" not in str(caught.value)


def test_syntax_error_of_an_included_tree_is_shown_with_its_line(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text("<root>\n  <Sequence></root>")
    main = write(tmp_path / "m.xml", "M=<AlwaysSuccess/>", include='<include path="a.xml"/>')
    with pytest.raises(TreeError, match=r"a\.xml:2:13: E002 expected </Sequence>, but found </root>"):
        load(main)


@pytest.mark.parametrize("path", ["../outside.xml", "{tmp}/outside.xml", "link.xml", "linked/outside.xml"])
def test_confined_tree_cannot_include_files_outside_of_its_folder(tmp_path: Path, path: str) -> None:
    write(tmp_path / "outside.xml", "A=<AlwaysFailure/>")
    path = path.format(tmp=tmp_path)
    main = write(
        tmp_path / "inside" / "m.xml", 'M=<SubTree ID="A"/>', include=f'<include path="{path}"/>', main="M"
    )
    (tmp_path / "inside" / "link.xml").symlink_to("../outside.xml")
    (tmp_path / "inside" / "linked").symlink_to("..")
    assert load(main).tick_once() is Status.FAILURE
    with pytest.raises(TreeError, match="E007 the included file is outside of the folder of the main file"):
        load(main, confined=True)


def test_confined_tree_includes_files_below_its_folder(tmp_path: Path) -> None:
    write(tmp_path / "b.xml", "B=<AlwaysFailure/>")
    write(tmp_path / "lib" / "a.xml", 'A=<SubTree ID="B"/>', include='<include path="../b.xml"/>')
    include = '<include path="lib/a.xml"/>'
    main = write(tmp_path / "m.xml", 'M=<SubTree ID="A"/>', include=include, main="M")
    assert load(main, confined=True).tick_once() is Status.FAILURE


def test_files_that_a_confined_tree_includes_are_confined_too(tmp_path: Path) -> None:
    write(tmp_path / "outside.xml", "B=<AlwaysFailure/>")
    write(
        tmp_path / "in" / "lib" / "a.xml",
        'A=<SubTree ID="B"/>',
        include='<include path="../../outside.xml"/>',
    )
    include = '<include path="lib/a.xml"/>'
    main = write(tmp_path / "in" / "m.xml", 'M=<SubTree ID="A"/>', include=include, main="M")
    assert load(main).tick_once() is Status.FAILURE
    with pytest.raises(TreeError, match=r"a\.xml:1:\d+: E007 the included file is outside"):
        load(main, confined=True)


def test_packages_outside_of_the_folder_are_refused_for_a_confined_tree(tmp_path: Path) -> None:
    write(tmp_path / "share" / "a.xml", "A=<AlwaysFailure/>")
    include = '<include ros_pkg="nav" path="a.xml"/>'
    main = write(tmp_path / "in" / "m.xml", 'M=<SubTree ID="A"/>', include=include, main="M")
    assert load(main, packages=lambda name: tmp_path / "share").tick_once() is Status.FAILURE
    with pytest.raises(TreeError, match="E007 the included file is outside"):
        load(main, packages=lambda name: tmp_path / "share", confined=True)


def test_confined_text_includes_files_below_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path / "a.xml", "A=<AlwaysFailure/>")
    (tmp_path / "in").mkdir()
    write(tmp_path / "in" / "b.xml", "A=<AlwaysFailure/>")
    monkeypatch.chdir(tmp_path / "in")
    text = '<root BTCPP_format="4"><include path="{}"/></root>'
    assert loads(text.format("b.xml"), tree="A", confined=True).tick_once() is Status.FAILURE
    with pytest.raises(TreeError, match="E007 the included file is outside"):
        loads(text.format("../a.xml"), tree="A", confined=True)


def test_very_long_chain_of_includes_is_refused(tmp_path: Path) -> None:
    for index in range(110):
        (tmp_path / f"{index}.xml").write_text(
            f'<root BTCPP_format="4"><include path="{index + 1}.xml"/></root>'
        )
    with pytest.raises(TreeError, match="E007 includes are nested more than 100 deep"):
        load(tmp_path / "0.xml")


def test_include_that_is_a_loop_of_links_is_refused(tmp_path: Path) -> None:
    (tmp_path / "loop.xml").symlink_to("loop.xml")
    main = write(tmp_path / "m.xml", "M=<AlwaysSuccess/>", include='<include path="loop.xml"/>')
    with pytest.raises(TreeError, match="can't be read: too many levels of symbolic links"):
        load(main)
