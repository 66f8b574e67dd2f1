"""W108: text between the elements of a tree."""

from tests.btcore.lint.conftest import Checker
from tests.btcore.lint.documents import dedented


def test_text_between_elements_is_reported_at_its_position(check: Checker) -> None:
    assert check("<Sequence>\n  first  charge <!-- a comment --><Drive/></Sequence>") == dedented(
        """
        t.xml:4:3: W108 the text 'first charge' between the elements of a tree is ignored
           4 |    first  charge <!-- a comment --><Drive/></Sequence>
             |    ^^^^^^^^^^^^
              pass values to a node in its attributes; write comments as <!-- … -->
        """
    )


def test_comments_and_model_descriptions_are_not_reported_as_text(check: Checker) -> None:
    model = '<TreeNodesModel><Action ID="Say"><input_port name="text">what to say</input_port></Action>'
    more = f"<!-- loose > text -->{model}</TreeNodesModel>\n"
    assert check("<Drive _skipIf=\"1 &gt; 2 &amp;&amp; 'a>b' == 'c'\"/>", more) == ""


def test_the_start_of_a_comment_in_a_value_hides_no_text(check: Checker) -> None:
    found = check('<Sequence>\n  <Say text="a <!-- b"/>\n  stray <!-- c --><Drive/></Sequence>')
    assert "t.xml:5:3: W108 the text 'stray' between the elements" in found
