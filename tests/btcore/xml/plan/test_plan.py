"""Plans of documents: the order of errors, warnings, files that include files, installed libraries."""

from collections.abc import Callable
from pathlib import Path
from textwrap import dedent

import pytest

from btcore import Registry, action, loads
from btcore.errors import TreeError, UnknownNodeError, XmlSyntaxError
from btcore.lint.validate import validate_document
from btcore.loading.instantiate import instantiate
from btcore.xml.plan import hints
from btcore.xml.plan.plan import plan_document
from btcore.xml.read.read import parse_file, parse_text

Write = Callable[..., str]
Refused = Callable[[object], TreeError]


def test_all_errors_are_reported_together_in_document_order(nodes: Registry, document: Write) -> None:
    text = document(
        '<Sequence>\n<Drvie/>\n<Drive sped="1" speed="fast"/>\n<Inverter _skipIf="1 +"/>\n</Sequence>',
        {"Unused": "<Nonsense/>"},
    )
    with pytest.raises(TreeError) as caught:
        instantiate(plan_document(parse_text(text, "t.xml"), nodes))
    assert [(one.code, one.line) for one in caught.value.diagnostics] == [
        ("E101", 4), ("E201", 5), ("E202", 5), ("E104", 6), ("E206", 6), ("E101", 9),
    ]  # fmt: skip


def test_a_call_is_an_error_in_a_registry_without_the_node_of_calls(document: Write) -> None:
    nodes = Registry()
    nodes.add(action(lambda: True), ID="Leaf")
    with pytest.raises(UnknownNodeError, match="E101 unknown node <SubTree>"):
        loads(document('<SubTree ID="Inner"/>', {"Inner": "<Leaf/>"}), nodes=nodes)


# --- warnings


def test_in_format_4_the_later_of_two_trees_with_one_id_is_used(nodes: Registry, document: Write) -> None:
    text = document("<AlwaysFailure/>", {"Main": "<AlwaysSuccess/>"})
    assert instantiate(plan_document(parse_text(text), nodes)).root.id == "AlwaysSuccess"
    plans = plan_document(parse_text(text, "t.xml"), nodes)
    assert [str(one) for one in plans.diagnostics.warnings] == [
        dedent(
            """\
            t.xml:5:21: W102 duplicate tree 'Main': it replaces the tree at t.xml:2
               5 |    <BehaviorTree ID="Main"><AlwaysSuccess/></BehaviorTree>
                 |                      ^^^^
                  rename or remove one of the two trees"""
        )
    ]


def test_in_format_3_the_first_of_two_trees_with_one_id_is_used(nodes: Registry, document: Write) -> None:
    text = document("<AlwaysFailure/>", {"Main": "<AlwaysSuccess/>"}, 'main_tree_to_execute="Main"')
    assert instantiate(plan_document(parse_text(text), nodes)).root.id == "AlwaysFailure"
    (warning,) = plan_document(parse_text(text, "t.xml"), nodes).diagnostics.warnings
    assert str(warning).startswith(
        "t.xml:5:21: W102 duplicate tree 'Main': it is ignored, the tree at t.xml:2 is used"
    )


def test_the_obsolete_root_element_of_groot_1_is_skipped(nodes: Registry, document: Write) -> None:
    text = document("<Root/><Say/>", {}, 'main_tree_to_execute="Main"')
    assert instantiate(plan_document(parse_text(text), nodes)).root.id == "Say"
    (warning,) = plan_document(parse_text(text, "t.xml"), nodes).diagnostics.warnings
    assert str(warning).startswith("t.xml:3:5: W103 the obsolete <Root> is ignored")


# --- files that include files


def test_files_that_include_each_other_are_refused(tmp_path: Path, nodes: Registry) -> None:
    (tmp_path / "a.xml").write_text('<root BTCPP_format="4"><include path="b.xml"/></root>')
    (tmp_path / "b.xml").write_text('<root BTCPP_format="4">\n  <include path="a.xml"/>\n</root>')
    with pytest.raises(XmlSyntaxError) as caught:
        instantiate(plan_document(parse_file(tmp_path / "a.xml"), nodes))
    assert str(caught.value.diagnostics[0]) == (
        f"{tmp_path}/b.xml:2:18: E007 the files include each other: a.xml → b.xml → a.xml\n"
        '   2 |    <include path="a.xml"/>\n'
        "     |                   ^^^^^"
    )


def test_error_in_an_included_file_names_that_file(tmp_path: Path, nodes: Registry, document: Write) -> None:
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "charge.xml").write_text(
        '<root BTCPP_format="4">\n  <BehaviorTree ID="Charge"><Sya/></BehaviorTree>\n</root>'
    )
    main = tmp_path / "main.xml"
    main.write_text(document('<SubTree ID="Charge"/>', '<include path="lib/charge.xml"/>'))
    found = validate_document(parse_file(main), nodes=nodes)
    assert [(one.file, one.line, one.column, one.code) for one in found] == [
        (f"{tmp_path}/lib/charge.xml", 2, 29, "E101")
    ]


def test_node_of_an_installed_library(document: Write) -> None:
    with pytest.raises(UnknownNodeError) as caught:
        loads(document("<RosActionCall/>"))
    assert caught.value.diagnostics[0].hint == (
        "the installed library btcore_ros2 provides it: call "
        "nodes.add_installed_libraries() of the registry, and pass nodes=nodes"
    )


def test_library_that_is_not_loaded(document: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    information = tmp_path / "arm-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: arm\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text("[btcore.nodes]\narm = arm_leaves\n")
    (tmp_path / "arm_leaves.py").write_text("import arm_driver\n")
    monkeypatch.syspath_prepend(tmp_path)
    hints._installed_nodes.cache_clear()
    try:
        with pytest.raises(UnknownNodeError) as caught:
            loads(document("<Grasp/>"))
    finally:
        hints._installed_nodes.cache_clear()
    assert (
        "; node libraries that cannot be loaded were not searched ('arm'): the module 'arm_driver' is not "
        "installed (from the distribution 'arm')"
    ) in str(caught.value.diagnostics[0].hint)
