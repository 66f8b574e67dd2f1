"""Documents are read as by the XML library of BehaviorTree.CPP; invalid XML is refused with its position."""

from pathlib import Path
from textwrap import dedent

import pytest

import btcore
from btcore.errors import TreeError, XmlSyntaxError
from btcore.xml.read.read import parse_file, parse_text
from tests.btcore.message_cases import read_cases


def tree_error(text: str) -> str:
    with pytest.raises(XmlSyntaxError) as caught:
        parse_text(text, "t.xml")
    return str(caught.value)


def message(text: str) -> str:
    return dedent(text).strip("\n")


# --- lenient reading


@pytest.mark.parametrize(
    ("written", "value"),
    [
        ('code="a < b"', "a < b"),
        ('code="a && b"', "a && b"),
        ("code='a < \"b\" & c'", 'a < "b" & c'),
        ('code="a &lt; b &amp;&amp; c"', "a < b && c"),
        ('code="&foo; &bar"', "&foo; &bar"),
        ('code="&#65;&#x42;"', "AB"),
        ('code="a > b"', "a > b"),
        ('code="a:=1;\n\tb:=2"', "a:=1;\n\tb:=2"),
        ('code="a:=1;\r\nb:=2"', "a:=1;\nb:=2"),
        ('code="é < 漢"', "é < 漢"),
        ('code=""', ""),
    ],
)
def test_attribute_value_is_the_intended_text(written: str, value: str) -> None:
    document = parse_text(f"<root><Script {written}/></root>")
    assert document.root.children[0].get("code") == value


def test_lenient_reading_warns_with_the_escaped_form() -> None:
    document = parse_text(
        '<root>\n  <Script name="s" code="a < b && c" x="fine &amp; well"/>\n</root>', "t.xml"
    )
    assert [str(one) for one in document.warnings] == [
        message(
            """
            t.xml:2:28: W101 unescaped '<' in an attribute value is read as text
               2 |    <Script name="s" code="a < b && c" x="fine &amp; well"/>
                 |                             ^
                  other XML tools reject it; write code="a &lt; b &amp;&amp; c"
            """
        )
    ]


def test_a_well_formed_document_has_no_warnings() -> None:
    assert parse_text('<root><A x="a &lt; b\nc"/></root>').warnings == []


def test_declarations_comments_and_cdata_may_contain_anything() -> None:
    document = parse_text('<?pi <x y="&?><!-- <a x="<> --><root><![CDATA[<b z="<"]]><A x="<"/></root>')
    assert document.root.children[0].tag is not None
    assert [child.tag for child in document.root.children] == ["A"]
    assert len(document.warnings) == 1


def test_declared_encoding_is_ignored_for_a_text() -> None:
    assert parse_text('<?xml version="1.0" encoding="ISO-8859-1"?><root n="é"/>').root.get("n") == "é"


def test_doctype_that_only_names_the_root_is_accepted() -> None:
    assert parse_text("<!DOCTYPE root><root/>").root.tag == "root"


# --- invalid XML

MESSAGES = read_cases(Path(__file__).with_name("messages.txt"))


@pytest.mark.parametrize("case", MESSAGES)
def test_invalid_xml_is_refused_with_its_position(case: str) -> None:
    text, expected = MESSAGES[case]
    assert tree_error(text.rstrip("\n")) == expected


def test_nul_character_is_refused() -> None:
    expected = "t.xml:2:1: E002 invalid XML: the text contains a NUL character"
    assert tree_error("<root>\n\x00</root>").splitlines() == [
        expected,
        "   2 |  \\x00</root>",
        "     |  ^^^^",
    ]


def test_positions_refer_to_the_original_text_after_escaping() -> None:
    text = '<root>\n<A x="a < b & c && d"/><B y=1/>\n</root>'
    assert tree_error(text).startswith("t.xml:2:29: E002 an attribute's value must be in quotes")


# --- documents that BehaviorTree.CPP's parser accepts although they are not well-formed


@pytest.mark.parametrize(
    ("text", "expected_message"),
    [
        ('<root><A x="1"y="2"/></root>', "t.xml:1:15: W109 missing white space before the attribute y"),
        ("<root><!-- a -- b --><A/></root>", "t.xml:1:14: W109 '--' inside a comment"),
        ("<root><!-- a ---><A/></root>", "t.xml:1:14: W109 '--' inside a comment"),
        (
            "\n<?xml version='1.0'?><root><A/></root>",
            "t.xml:2:1: W109 <?xml …?> is not at the very start of the document",
        ),
        (
            "<?xml version='1.0'?>\n<?xml version='1.0'?><root><A/></root>",
            "t.xml:2:1: W109 <?xml …?> is not at the very start of the document",
        ),
        ("draft <root><A/></root>", "t.xml:1:1: W109 the text outside of the root is ignored"),
        (
            "<root><A/></root>\n<root><B/></root>",
            "t.xml:2:1: W109 the second outermost element <root> is ignored",
        ),
        ('<root><A x:y="1"/></root>', "t.xml:1:10: W109 the prefix x: of x:y is not defined"),
        (
            '<root><A x="&#1;"/></root>',
            "t.xml:1:13: W109 &#1; is a control character, which is invalid in XML",
        ),
        ('<root><A x="\x01"/></root>', "t.xml:1:13: W109 U+0001 is a control character"),
        ("<root>a & b<A/></root>", "t.xml:1:9: W109 unescaped '&' in text"),
        ("<root>< A/></root>", "t.xml:1:7: W109 white space between '<' and the name"),
        ("<root><A></A x='1'></root>", "t.xml:1:10: W109 the end tag is more than a name"),
        (
            "<root><A/></root></root><B",
            "t.xml:1:18: W109 </root> has no start tag: the rest of the document is ignored",
        ),
    ],
)
def test_markup_that_tinyxml2_accepts_is_read_with_a_warning(text: str, expected_message: str) -> None:
    document = parse_text(text, "t.xml")
    assert [child.tag for child in document.root.children] == ["A"]
    assert len(document.warnings) == 1
    assert str(document.warnings[0]).startswith(expected_message)
    assert "other XML tools reject it; " in document.warnings[0].hint


def test_values_of_lenient_markup_are_read_as_by_tinyxml2() -> None:
    text = '<root><A x:y="1"z="&#1;&#x1F600;"x=\'\n\r\t\' é="&#99999999;"/></root><root><B/></root>'
    values = {"x:y": "1", "z": "\x01😀", "x": "\n\t", "é": "&#99999999;"}
    assert parse_text(text).root.children[0].attributes == values


def test_tree_of_format_3_reads_a_reference_to_a_control_character(tmp_path: Path) -> None:
    (tmp_path / "t.xml").write_text(
        '<root><BehaviorTree ID="M"><SetBlackboard value="a&#1;b" output_key="k"/></BehaviorTree></root>'
    )
    tree = btcore.load(tmp_path / "t.xml")
    tree.tick_once()
    assert tree.blackboard["k"] == "a\x01b"


def test_declared_prefixes_cause_no_warning() -> None:
    document = parse_text('<root xmlns:x="u" x:y="1"><A x:z="1" xml:lang="en"/></root>')
    assert document.warnings == []
    assert document.root.attributes == {"xmlns:x": "u", "x:y": "1"}


# --- hostile documents


def test_entity_bomb_is_refused_without_expansion() -> None:
    bomb = '<!DOCTYPE root [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;">]>\n<root x="&b;"/>'
    assert tree_error(bomb) == message(
        """
        t.xml:1:1: E005 a document type that defines or fetches something is not supported
           1 |  <!DOCTYPE root [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;">]>
             |  ^^^^^^^^^
              trees need no <!DOCTYPE …>: remove it, and replace its entities by their text
        """
    )


def test_an_external_entity_is_refused_and_not_fetched(tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("secret")
    text = f'<!DOCTYPE root [<!ENTITY a SYSTEM "{secret}">]><root>&a;</root>'
    expected_message = tree_error(text)
    assert (
        "t.xml:1:1: E005 a document type that defines or fetches something is not supported"
        in expected_message
    )
    assert "E005" in tree_error(f'<!DOCTYPE root SYSTEM "{secret}"><root/>')


def test_elements_nested_too_deep_are_refused() -> None:
    expected_message = tree_error("<root>" + "<A>" * 5000 + "</A>" * 5000 + "</root>")
    assert "E002 elements are nested more than 2048 deep" in expected_message
    assert expected_message.endswith("split the tree into subtrees")


@pytest.mark.parametrize("piece", ["<", "<!--", "<a ", '<a x="', "</a", "<![CDATA[", "<?", "&", "<a>"])
def test_long_garbage_is_refused_quickly(piece: str) -> None:
    assert "E002" in tree_error(piece * 50_000)


# --- invalid files


def test_missing_file_is_reported_with_a_suggestion(tmp_path: Path) -> None:
    (tmp_path / "patrolling.xml").write_text("<root/>")
    with pytest.raises(TreeError) as caught:
        parse_file(tmp_path / "patroling.xml")
    assert type(caught.value) is TreeError  # the XML has no error: there is no XML
    assert str(caught.value) == (
        f"{tmp_path}/patroling.xml: E003 no such file\n      did you mean {tmp_path}/patrolling.xml?"
    )


def test_xml_text_instead_of_a_path_and_vice_versa_is_reported() -> None:
    with pytest.raises(TreeError) as caught:
        btcore.load('<root BTCPP_format="4"/>')
    assert str(caught.value) == (
        "<text>: E003 expected the path of a file, but got XML text\n"
        "      to load a text, use btcore.loads(text)"
    )
    with pytest.raises(XmlSyntaxError, match=r"E002 [^$]*use btcore\.load\(path\)"):
        btcore.loads("trees/patrol.xml")


def test_folder_is_reported_with_its_files(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text("<root/>")
    with pytest.raises(TreeError) as caught:
        parse_file(tmp_path)
    assert str(caught.value) == (
        f"{tmp_path}: E003 is a folder, not a file\n      did you mean a file in it: a.xml?"
    )


def test_file_that_is_not_utf_8_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "latin.xml"
    path.write_bytes("<root>\n  <A n='é'/></root>".encode("latin-1"))
    with pytest.raises(XmlSyntaxError) as caught:
        parse_file(path)
    assert str(caught.value).startswith(f"{path}:2:9: E004 the byte 0xE9 is not valid UTF-8\n")


def test_utf_16_file_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "wide.xml"
    path.write_bytes("<root/>".encode("utf-16"))
    with pytest.raises(XmlSyntaxError) as caught:
        parse_file(path)
    assert str(caught.value) == (
        f"{path}: E004 the file is encoded as UTF-16, not as UTF-8\n      save it as UTF-8"
    )


def test_utf_8_byte_order_mark_is_accepted(tmp_path: Path) -> None:
    path = tmp_path / "marked.xml"
    path.write_bytes(b"\xef\xbb\xbf<root/>")
    assert parse_file(path).root.tag == "root"


def test_a_reference_with_thousands_of_digits_is_text() -> None:
    name = f"a < &#{'1' * 5000};"
    tree = btcore.loads(
        f'<root BTCPP_format="4"><BehaviorTree ID="M"><AlwaysSuccess name="{name}"/></BehaviorTree></root>'
    )
    assert tree.root.name == name
