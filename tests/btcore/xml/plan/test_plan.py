"""Errors in nodes, trees and files: the whole message, as users read it."""

from collections.abc import Callable, Iterator
from pathlib import Path
from textwrap import dedent

import pytest

from btcore import Registry, loads
from btcore.entry_points import LIMIT_VARIABLE
from btcore.errors import TreeError, UnknownNodeError, XmlSyntaxError
from btcore.lint.validate import validate_document
from btcore.loading.instantiate import instantiate
from btcore.xml.plan import hints
from btcore.xml.plan.plan import plan_document
from btcore.xml.read.read import parse_file, parse_text

Write = Callable[..., str]
Refused = Callable[[object], TreeError]


def searched(nodes: Registry) -> str:
    others = sorted({one.distribution for one in nodes.manifests.values()} - {"btcore"})
    return "searched: " + ", ".join(["btcore", *others])


PLUGIN = "; load a plugin that provides it (--plugin, or nodes.add_plugin)"


CASES = {
    "an unknown node": (
        ("<ReactiveSeqence><AlwaysSuccess/></ReactiveSeqence>",),
        UnknownNodeError,
        """
        t.xml:3:5: E101 unknown node <ReactiveSeqence>
           3 |      <ReactiveSeqence><AlwaysSuccess/></ReactiveSeqence>
             |      ^^^^^^^^^^^^^^^^^
              did you mean <ReactiveSequence>?   SEARCHED; PLUGIN
        """,
    ),
    "an unknown node by its explicit tag": (
        ('<Action ID="Drvie" speed="1"/>',),
        UnknownNodeError,
        """
        t.xml:3:17: E101 unknown node 'Drvie'
           3 |      <Action ID="Drvie" speed="1"/>
             |                  ^^^^^
              did you mean <Drive>?   SEARCHED; PLUGIN
        """,
    ),
    "several unknown nodes": (
        ("<Sequence><Driven/><Wxyz/></Sequence>",),
        UnknownNodeError,
        """
        t.xml:3:15: E101 unknown node <Driven>
           3 |      <Sequence><Driven/><Wxyz/></Sequence>
             |                ^^^^^^^
              did you mean <Drive>?   SEARCHED; PLUGIN
        t.xml:3:24: E101 unknown node <Wxyz>
           3 |      <Sequence><Driven/><Wxyz/></Sequence>
             |                         ^^^^^
              SEARCHED
        """,
    ),
    "a node of format 3 in format 4": (
        ("<SequenceStar><AlwaysSuccess/></SequenceStar>",),
        UnknownNodeError,
        """
        t.xml:3:5: E101 unknown node <SequenceStar>
           3 |      <SequenceStar><AlwaysSuccess/></SequenceStar>
             |      ^^^^^^^^^^^^^^
              use <SequenceWithMemory>, which replaces it
        """,
    ),
    "a node of format 4 in format 3": (
        ('<Script code="a := 1"/>', {}, 'main_tree_to_execute="Main"'),
        TreeError,
        """
        t.xml:1:1: E009 missing BTCPP_format: the document is read as format 3; format 4 avoids 1 error
           1 |  <root main_tree_to_execute="Main">
             |  ^^^^^
              write <root BTCPP_format="4">
        t.xml:3:5: E101 unknown node <Script>
           3 |      <Script code="a := 1"/>
             |      ^^^^^^^
              <Script> belongs to format 4: write <root BTCPP_format="4">
        """,
    ),
    "a mistake in a tree of format 3": (
        ('<Sequense _skipIf="true"/>', {}, ""),
        UnknownNodeError,
        """
        t.xml:3:5: E101 unknown node <Sequense>
           3 |      <Sequense _skipIf="true"/>
             |      ^^^^^^^^^
              did you mean <Sequence>?   SEARCHED; PLUGIN
        """,
    ),
    "a node that only a model declares": (
        ("<Weld/>", '  <TreeNodesModel><Action ID="Weld"/></TreeNodesModel>\n'),
        UnknownNodeError,
        """
        t.xml:3:5: E101 unknown node <Weld>
           3 |      <Weld/>
             |      ^^^^^
              a <TreeNodesModel> declares it, but its code is not registered: use --plugin or nodes.add, or --model t.xml to work without the code
        """,  # noqa: E501
    ),
    "a tree used as a tag": (
        ("<Charge/>", {"Charge": "<AlwaysSuccess/>"}),
        UnknownNodeError,
        """
        t.xml:3:5: E101 unknown node <Charge>
           3 |      <Charge/>
             |      ^^^^^^^
              'Charge' is a tree: write <SubTree ID="Charge"/>
        """,
    ),
    "a missing subtree": (
        ('<SubTree ID="Chrage"/>', {"Charge": "<AlwaysSuccess/>"}),
        TreeError,
        """
        t.xml:3:18: E109 unknown subtree 'Chrage'
           3 |      <SubTree ID="Chrage"/>
             |                   ^^^^^^
              did you mean 'Charge'?
        """,
    ),
    "a tree that contains itself": (
        ('<Sequence><SubTree ID="A"/></Sequence>', {"A": '<SubTree ID="B"/>', "B": '<SubTree ID="A"/>'}),
        TreeError,
        """
        t.xml:6:37: E110 the trees call each other recursively: A → B → A
           6 |    <BehaviorTree ID="B"><SubTree ID="A"/></BehaviorTree>
             |                                      ^
              a tree can't contain itself
        """,
    ),
    "a decorator with two children": (
        ("<Inverter><Say/><Say/></Inverter>",),
        TreeError,
        """
        t.xml:3:5: E104 <Inverter> has 2 children; a decorator has exactly 1
           3 |      <Inverter><Say/><Say/></Inverter>
             |      ^^^^^^^^^^
              put them into a <Sequence>
        """,
    ),
    "a control node without children": (
        ("<Sequence/>",),
        TreeError,
        """
        t.xml:3:5: E104 <Sequence> has no child; a control node needs at least 1
           3 |      <Sequence/>
             |      ^^^^^^^^^
        """,
    ),
    "a TryCatch with one child": (
        ("<TryCatch><Say/></TryCatch>",),
        TreeError,
        """
        t.xml:3:5: E104 <TryCatch> has 1 child; it needs at least 2
           3 |      <TryCatch><Say/></TryCatch>
             |      ^^^^^^^^^^
              the last child is the handler
        """,
    ),
    "an action with a child": (
        ("<Say><Say/></Say>",),
        TreeError,
        """
        t.xml:3:5: E104 <Say> has 1 child; an action has none
           3 |      <Say><Say/></Say>
             |      ^^^^^
        """,
    ),
    "a tree with two children": (
        ("<Say/><Say/>",),
        TreeError,
        """
        t.xml:2:3: E104 the tree 'Main' has 2 children; a tree has exactly 1
           2 |    <BehaviorTree ID="Main">
             |    ^^^^^^^^^^^^^
              put them into a <Sequence>
        """,
    ),
    "a SubTree with children": (
        ('<SubTree ID="A"><Say/></SubTree>', {"A": "<AlwaysSuccess/>"}),
        TreeError,
        """
        t.xml:3:5: E104 <SubTree ID="A"> has children; they belong into the <BehaviorTree> that it calls
           3 |      <SubTree ID="A"><Say/></SubTree>
             |      ^^^^^^^^
        """,
    ),
    "a missing main tree": (
        ("<Say/>", {}, 'BTCPP_format="4" main_tree_to_execute="Mian"'),
        TreeError,
        """
        t.xml:1:46: E108 unknown main tree 'Mian' in main_tree_to_execute
           1 |  <root BTCPP_format="4" main_tree_to_execute="Mian">
             |                                               ^^^^
              did you mean 'Main'?
        """,
    ),
    "several trees without a main tree": (
        ("<Say/>", {"Other": "<AlwaysSuccess/>"}, 'BTCPP_format="4"'),
        TreeError,
        """
        t.xml:1:1: E108 ambiguous main tree: the document has several trees
           1 |  <root BTCPP_format="4">
             |  ^^^^^
              write main_tree_to_execute="…" in <root>, or select a tree when loading: Main or Other
        """,
    ),
    "no tree at all": (
        '<root BTCPP_format="4"/>',
        TreeError,
        """
        t.xml:1:1: E108 missing <BehaviorTree>: the document has no tree
           1 |  <root BTCPP_format="4"/>
             |  ^^^^^
              a tree looks like: <root BTCPP_format="4"><BehaviorTree ID="Main">…</BehaviorTree></root>
        """,
    ),
    "a document with another root element": (
        "<svg/>",
        XmlSyntaxError,
        """
        t.xml:1:1: E008 the outermost element is <svg>, not <root>
           1 |  <svg/>
             |  ^^^^
              a tree looks like: <root BTCPP_format="4"><BehaviorTree ID="Main">…</BehaviorTree></root>
        """,
    ),
    "a root in capital letters": (
        '<Root BTCPP_format="4"/>',
        XmlSyntaxError,
        """
        t.xml:1:1: E008 the outermost element is <Root>, not <root>
           1 |  <Root BTCPP_format="4"/>
             |  ^^^^^
              did you mean <root>? XML is case-sensitive
        """,
    ),
    "an unknown format": (
        ("<Say/>", {}, 'BTCPP_format="5"'),
        XmlSyntaxError,
        """
        t.xml:1:21: E009 unknown BTCPP_format '5'
           1 |  <root BTCPP_format="5">
             |                      ^
              write BTCPP_format="4", or "3" for a tree of Groot 1
        """,
    ),
    "a tree named like a node": (
        ("<Say/>", {"Drive": "<AlwaysSuccess/>"}),
        TreeError,
        """
        t.xml:5:21: E105 invalid tree ID 'Drive': a node has this name
           5 |    <BehaviorTree ID="Drive"><AlwaysSuccess/></BehaviorTree>
             |                      ^^^^^
              rename the tree
        """,
    ),
    "a tree whose name has a space": (
        ("<Say/>", {"go home": "<AlwaysSuccess/>"}),
        TreeError,
        """
        t.xml:5:21: E107 invalid tree ID 'go home': ' ' is not allowed
           5 |    <BehaviorTree ID="go home"><AlwaysSuccess/></BehaviorTree>
             |                      ^^^^^^^
              use letters, digits, '_' and '-'
        """,
    ),
    "a tree with a reserved name": (
        ("<Say/>", {"root": "<Say/>"}),
        TreeError,
        """
        t.xml:5:21: E107 invalid tree ID 'root': the name is reserved
           5 |    <BehaviorTree ID="root"><Say/></BehaviorTree>
             |                      ^^^^
        """,
    ),
    "a compact node with an ID": (
        ('<Say ID="greet"/>',),
        TreeError,
        """
        t.xml:3:14: E103 unexpected ID in <Say>: only explicit tags such as <Action ID="…"> have one
           3 |      <Say ID="greet"/>
             |               ^^^^^
              to name the node, write name="…"
        """,
    ),
    "an explicit tag without an ID": (
        ("<Action/>",),
        TreeError,
        """
        t.xml:3:5: E102 the ID of the node is missing in <Action>
           3 |      <Action/>
             |      ^^^^^^^
              write <Action ID="…"/>
        """,
    ),
    "an included file that is missing": (
        ("<Say/>", '  <include path="nope.xml"/>\n'),
        XmlSyntaxError,
        """
        t.xml:5:18: E007 the included file 'nope.xml': no such file
           5 |    <include path="nope.xml"/>
             |                   ^^^^^^^^
        """,
    ),
    "an included file of a ROS package": (
        ("<Say/>", '  <include ros_pkg="nav" path="nope.xml"/>\n'),
        XmlSyntaxError,
        """
        t.xml:5:21: E007 unknown ROS package 'nav'
           5 |    <include ros_pkg="nav" path="nope.xml"/>
             |                      ^^^
              pass a package resolver, a function that returns the share directory of a package
        """,
    ),
}


@pytest.fixture
def no_installed_libraries(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Hide the node libraries of this environment, which hints about unknown nodes name."""
    monkeypatch.setenv(LIMIT_VARIABLE, "")
    hints._installed_nodes.cache_clear()
    yield
    hints._installed_nodes.cache_clear()


@pytest.mark.usefixtures("no_installed_libraries")
@pytest.mark.parametrize("case", CASES)
def test_error_message(case: str, nodes: Registry, tree_error: Refused) -> None:
    source, kind, expected_message = CASES[case]
    fault = tree_error(source)
    assert str(fault) == dedent(expected_message).strip("\n").replace("SEARCHED", searched(nodes)).replace(
        "; PLUGIN", PLUGIN
    )
    assert type(fault) is kind


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


def test_exponentially_growing_trees_are_refused(nodes: Registry, document: Write) -> None:
    doubling = {
        f"T{n}": f'<Sequence><SubTree ID="T{n + 1}"/><SubTree ID="T{n + 1}"/></Sequence>' for n in range(60)
    }
    text = document('<SubTree ID="T0"/>', doubling | {"T60": "<AlwaysSuccess/>"})
    with pytest.raises(
        TreeError, match=r"t\.xml:2:21: E117 with all its subtrees the tree has more than 65,535 nodes"
    ):
        instantiate(plan_document(parse_text(text, "t.xml"), nodes))


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
        "the installed library btcore_ros2 provides it: call nodes.add_plugins() of the registry, and pass "
        "nodes=nodes"
    )


def test_library_that_cannot_be_loaded(
    document: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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
