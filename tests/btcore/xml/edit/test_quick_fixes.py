# ruff: noqa: E501 - each case is a line
"""The fixes of diagnostics: each removes its problem. They do not depend on the messages, which are replaced."""

import inspect
from pathlib import Path

import pytest

from btcore import fixes
from btcore.diagnostics import Diagnostic
from btcore.errors import TreeError
from btcore.input_files import real_path
from btcore.lint.validate import validate_document
from btcore.registry.registry import Registry
from btcore.xml.edit import quick_fixes
from btcore.xml.edit.editor import apply_edits
from btcore.xml.edit.quick_fixes import FixMaker
from btcore.xml.read.read import parse_file

# What precedes the place of every fix must be counted in UTF-16 code units.
BEFORE = "<!-- 🤖 Grüße -->"
MAIN = '<root BTCPP_format="4">' + BEFORE + '<BehaviorTree ID="Main">{}</BehaviorTree></root>'


class Edited:
    """A document in *path*, whose *text* is checked and fixed."""

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        self.text = text

    def diagnostics(self) -> list[Diagnostic]:
        """The problems. Code takes the place of each message and hint."""
        try:
            document = parse_file(self.path, unsaved={real_path(self.path): self.text})
            found = validate_document(document, nodes=Registry.standard())
        except TreeError as error:
            found = list(error.diagnostics)
        return [item._replace(message=item.code, hint=item.code) for item in found]

    def fixes(self, code: str) -> dict[str, str]:
        """The texts that the fixes of the first problem with *code* produce, by title."""
        problem = next(item for item in self.diagnostics() if item.code == code)
        fixes = FixMaker(self.text).fixes_of(problem)
        return {fix.title: apply_edits(self.text, fix.edits) for fix in fixes}

    def codes(self) -> list[str]:
        return [str(item.code) for item in self.diagnostics()]


@pytest.mark.parametrize(
    ("code", "before", "title", "after"),
    [
        ("E101", "<Sequense><AlwaysSuccess/></Sequense>", "Change to <Sequence>", "<Sequence><AlwaysSuccess/></Sequence>"),
        ("E101", '<Action ID="Slep" msec="1"/>', "Change to 'Sleep'", '<Action ID="Sleep" msec="1"/>'),
        ("E101", "<SequenceStar><AlwaysSuccess/></SequenceStar>", "Change to <SequenceWithMemory>",
         "<SequenceWithMemory><AlwaysSuccess/></SequenceWithMemory>"),
        ("E103", '<Sleep ID="nap" msec="1"/>', "Write name instead of ID", '<Sleep name="nap" msec="1"/>'),
        ("E103", '<Sleep ID="nap" msec="1"/>', "Remove ID", '<Sleep msec="1"/>'),
        ("E104", "<Inverter/>", "Add a child", "<Inverter><AlwaysSuccess/></Inverter>"),
        ("E104", "<Sequence></Sequence>", "Add a child", "<Sequence><AlwaysSuccess/></Sequence>"),
        ("E104", "<Inverter><AlwaysFailure/><AlwaysSuccess/></Inverter>", "Put the children into a <Fallback>",
         "<Inverter><Fallback><AlwaysFailure/><AlwaysSuccess/></Fallback></Inverter>"),
        ("E104", "<AlwaysSuccess/><AlwaysFailure/>", "Put the children into a <Sequence>",
         "<Sequence><AlwaysSuccess/><AlwaysFailure/></Sequence>"),
        ("E104", '<AlwaysSuccess><Sleep msec="1"/></AlwaysSuccess>', "Remove the children", "<AlwaysSuccess/>"),
        ("E104", "<IfThenElse/>", "Add 2 children", "<IfThenElse><AlwaysSuccess/><AlwaysSuccess/></IfThenElse>"),
        ("E119", "<IfThenElse><AlwaysFailure/></IfThenElse>", "Add a child",
         "<IfThenElse><AlwaysFailure/><AlwaysSuccess/></IfThenElse>"),
        ("E119", "<IfThenElse><ScriptCondition code='true'/>" + "<AlwaysFailure/>" * 3 + "</IfThenElse>",
         "Put the last 2 children into a <Sequence>",
         "<IfThenElse><ScriptCondition code='true'/><AlwaysFailure/><Sequence><AlwaysFailure/><AlwaysFailure/>"
         "</Sequence></IfThenElse>"),
        ("E109", '<SubTree ID="Man"/>', "Create the tree 'Man'", None),
        ("E201", '<Sleep mesc="1"/>', "Change to 'msec'", '<Sleep msec="1"/>'),
        ("E202", '<Sequence><Script code="n:=2"/><Repeat num_cycles="n"><AlwaysSuccess/></Repeat></Sequence>', "Write {n}",
         '<Sequence><Script code="n:=2"/><Repeat num_cycles="{n}"><AlwaysSuccess/></Repeat></Sequence>'),
        ("E202", "<Precondition if='true' else='SUCESS'><AlwaysSuccess/></Precondition>", "Write SUCCESS",
         "<Precondition if='true' else='SUCCESS'><AlwaysSuccess/></Precondition>"),
        ("E202", "<RunOnce then_skip='yes'><AlwaysSuccess/></RunOnce>", "Write false",
         "<RunOnce then_skip='false'><AlwaysSuccess/></RunOnce>"),
        ("E205", "<Script/>", 'Write code=""', '<Script code=""/>'),
        ("E207", '<SubTree ID="Main" _autoremap="yes"/>', "Write false", '<SubTree ID="Main" _autoremap="false"/>'),
        ("W101", '<AlwaysSuccess name="a<b"/>', "Write &lt;", '<AlwaysSuccess name="a&lt;b"/>'),
        ("W109", "<Sequence>a & b<AlwaysSuccess/></Sequence>", "Write &amp;",
         "<Sequence>a &amp; b<AlwaysSuccess/></Sequence>"),
        ("W201", '<Sequence><Script code="speed:=1"/><Script code="b:=sped"/></Sequence>', "Change to 'speed'",
         '<Sequence><Script code="speed:=1"/><Script code="b:=speed"/></Sequence>'),
        ("W201", '<Sequence><Script code="nap:=1"/><Sleep msec="{nab}"/></Sequence>', "Change to 'nap'",
         '<Sequence><Script code="nap:=1"/><Sleep msec="{nap}"/></Sequence>'),
        ("W209", "<Script code='n = 1; n += 1'/>", "Create the entry with :=", "<Script code='n := 1; n += 1'/>"),
        ("W211", '<LoopString queue="a;b" value="word"><AlwaysSuccess/></LoopString>', "Write {word}",
         '<LoopString queue="a;b" value="{word}"><AlwaysSuccess/></LoopString>'),
        ("W202", "<Sleep/>", 'Write msec="{msec}"', '<Sleep msec="{msec}"/>'),
        ("W203", '<Repeat num_cycles="3.7"><AlwaysSuccess/></Repeat>', "Write 3",
         '<Repeat num_cycles="3"><AlwaysSuccess/></Repeat>'),
        ("W208", '<Sequence><Script code="a:=1"/><AlwaysSuccess _successIf="a=1"/></Sequence>', "Write ==",
         '<Sequence><Script code="a:=1"/><AlwaysSuccess _successIf="a==1"/></Sequence>'),
        ("W212", '<Sequence _skipif="true"><AlwaysSuccess/></Sequence>', "Change to '_skipIf'",
         '<Sequence _skipIf="true"><AlwaysSuccess/></Sequence>'),
    ],
)  # fmt: skip
def test_fix_removes_mistake(tmp_path: Path, code: str, before: str, title: str, after: str | None) -> None:
    edited = Edited(tmp_path / "größe.xml", MAIN.format(before))
    count = edited.codes().count(code)
    text = edited.fixes(code)[title]
    if after is not None:
        assert text == MAIN.format(after)
    edited.text = text
    assert edited.codes().count(code) == count - 1


@pytest.mark.parametrize(
    ("code", "before", "title", "after"),
    [
        ("E002", MAIN.format("<Sequence><AlwaysSuccess/>"), "Insert </Sequence>", MAIN.format("<Sequence><AlwaysSuccess/></Sequence>")),
        ("E002", '<root BTCPP_format="4"><BehaviorTree ID="A"><AlwaysSuccess/></BehaviorTree>\n', "Insert </root>",
         '<root BTCPP_format="4"><BehaviorTree ID="A"><AlwaysSuccess/></BehaviorTree>\n</root>\n'),
        ("E008", MAIN.replace("root", "Root").format("<AlwaysSuccess/>"), "Change to <root>", MAIN.format("<AlwaysSuccess/>")),
        ("E009", MAIN.replace('"4"', '"5"').format("<AlwaysSuccess/>"), 'Write BTCPP_format="4"', MAIN.format("<AlwaysSuccess/>")),
        ("E106", MAIN.format("<AlwaysSuccess/>").replace("</root>", "<BehaviorTree><AlwaysSuccess/></BehaviorTree></root>"),
         'Write ID="Tree1"', None),
        ("E108", MAIN.format("<AlwaysSuccess/>").replace('"4"', '"4" main_tree_to_execute="Mian"'), "Change to 'Main'", None),
    ],
)  # fmt: skip
def test_a_fix_of_the_document(tmp_path: Path, code: str, before: str, title: str, after: str | None) -> None:
    edited = Edited(tmp_path / "tree.xml", before)
    text = edited.fixes(code)[title]
    if after is not None:
        assert text == after
    edited.text = text
    assert code not in edited.codes()


def test_an_include_of_a_missing_file(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "küche.xml").write_text(MAIN.format("<AlwaysSuccess/>"), encoding="utf-8")
    text = '<root BTCPP_format="4"><include path="parts/kuche.xml"/></root>'
    edited = Edited(tmp_path / "main.xml", text)
    assert edited.fixes("E007") == {"Write parts/küche.xml": text.replace("kuche", "küche")}


def test_an_include_of_a_folder(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    for name in ("bad.xml", "küche.xml"):
        (tmp_path / "parts" / name).touch()
    text = '<root BTCPP_format="4"><include path="parts/"/></root>'
    fixes = Edited(tmp_path / "main.xml", text).fixes("E007")
    assert fixes == {
        f"Write parts/{name}": text.replace("parts/", f"parts/{name}") for name in ("bad.xml", "küche.xml")
    }


SECOND = '<BehaviorTree ID="Küche🤖">{}</BehaviorTree></root>'


@pytest.mark.parametrize(
    ("code", "before", "title", "after"),
    [
        # A tree that contains itself would be another error.
        ("E102", MAIN.format("<SubTree/>").replace("</root>", SECOND.format("<AlwaysSuccess/>")), 'Write ID="Küche🤖"',
         MAIN.format('<SubTree ID="Küche🤖"/>').replace("</root>", SECOND.format("<AlwaysSuccess/>"))),
        ("W205", MAIN.replace(' BTCPP_format="4"', "").format('<SubTree ID="Küche🤖" door="{tür}"/>').replace(
            "</root>", SECOND.format('<SetBlackboard value="{door}" output_key="x"/>')), "Write tür",
         MAIN.replace(' BTCPP_format="4"', "").format('<SubTree ID="Küche🤖" door="tür"/>').replace(
            "</root>", SECOND.format('<SetBlackboard value="{door}" output_key="x"/>'))),
        ("W201", MAIN.format('<SubTree ID="Küche🤖"/>').replace("</root>", SECOND.format('<Sleep msec="{zeit}"/>')),
         "Connect zeit in the SubTree of 'Küche🤖'",
         MAIN.format('<SubTree ID="Küche🤖" zeit="{zeit}"/>').replace(
            "</root>", SECOND.format('<Sleep msec="{zeit}"/>'))),
        ("E002", MAIN.format("\n  <Sequence>\n    <AlwaysSuccess/>\n"), "Insert </Sequence>",
         MAIN.format("\n  <Sequence>\n    <AlwaysSuccess/>\n  </Sequence>\n")),
        ("E002", MAIN.format("<AlwaysSuccess/>")[:-1], "Close the tag", MAIN.format("<AlwaysSuccess/>")),
        ("E002", MAIN.format("<Sequence><AlwaysSuccess/></Sequence"), "Close the tag",
         MAIN.format("<Sequence><AlwaysSuccess/></Sequence>")),
        ("E002", MAIN.format("<Sequence><Sleep msec='1'\n</Sequence>"), "Close the tag with />",
         MAIN.format("<Sequence><Sleep msec='1'/>\n</Sequence>")),
        ("E002", MAIN.format("<Sequence><AlwaysSuccess/></Sequense>"), "Change to </Sequence>",
         MAIN.format("<Sequence><AlwaysSuccess/></Sequence>")),
    ],
)  # fmt: skip
def test_the_preferred_fix_leads_to_a_valid_tree(
    tmp_path: Path, code: str, before: str, title: str, after: str
) -> None:
    edited = Edited(tmp_path / "größe.xml", before)
    fixes = edited.fixes(code)
    assert next(iter(fixes)) == title
    assert fixes[title] == after
    edited.text = after
    assert not any(item.is_error for item in edited.diagnostics())


def test_a_fix_writes_no_name_that_the_user_must_know(tmp_path: Path) -> None:
    assert Edited(tmp_path / "größe.xml", MAIN.format("<Sequence><Action/></Sequence>")).fixes("E102") == {}
    edited = Edited(tmp_path / "format.xml", MAIN.format("<AlwaysSuccess/>").replace('"4"', '"5"'))
    assert list(edited.fixes("E009")) == ['Write BTCPP_format="4"', 'Write BTCPP_format="3"']


def test_an_unused_remapping(tmp_path: Path) -> None:
    text = MAIN.format('<SubTree ID="Nap" tim="5"/>').replace(
        "</root>", '<BehaviorTree ID="Nap"><Sleep msec="{time}"/></BehaviorTree></root>'
    )
    edited = Edited(tmp_path / "main.xml", text)
    assert edited.fixes("W204") == {"Change to 'time'": text.replace(' tim="', ' time="')}


def test_wrapped_children_are_indented(tmp_path: Path) -> None:
    text = (
        '<root BTCPP_format="4">\r\n\t<BehaviorTree ID="A">\r\n\t\t<AlwaysSuccess/>\r\n\t\t<Inverter>\r\n\t\t\t'
        "<AlwaysFailure/>\r\n\t\t</Inverter>\r\n\t</BehaviorTree>\r\n</root>\r\n"
    )
    edited = Edited(tmp_path / "tree.xml", text)
    assert edited.fixes("E104")["Put the children into a <Sequence>"] == (
        '<root BTCPP_format="4">\r\n\t<BehaviorTree ID="A">\r\n\t\t<Sequence>\r\n\t\t\t<AlwaysSuccess/>\r\n\t\t\t'
        "<Inverter>\r\n\t\t\t\t<AlwaysFailure/>\r\n\t\t\t</Inverter>\r\n\t\t</Sequence>\r\n\t</BehaviorTree>\r\n"
        "</root>\r\n"
    )


def test_every_fix_has_edits() -> None:
    source = inspect.getsource(quick_fixes)
    names = [name for name, cls in vars(fixes).items() if isinstance(cls, type) and not name.startswith("_")]
    assert [name for name in names if name != "Fix" and f"case fixes.{name}()" not in source] == []
