"""Make edits of a document's text from the fixes of diagnostics."""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Final, NamedTuple

from btcore.diagnostic_codes import DiagnosticCode
from btcore.diagnostics import Diagnostic, FixOperation
from btcore.names import SCRIPT_ATTRIBUTES, is_port_name
from btcore.suggestions import nearest_name
from btcore.xml.edit.editor import DocumentEditor, Edit, apply_edits, escape_value
from btcore.xml.read.dialect import EXPLICIT_TAGS
from btcore.xml.read.positions import LineIndex
from btcore.xml.read.scan import Place, ScannedElement, scan
from btcore.xml.read.tinyxml2_compat import BARE_MARKUP_CHARACTER

MAX_FIXES: Final = 20
"""Maximum number of fixes of one diagnostic."""
MAX_TITLE: Final = 60
"""Maximum length of a text in the title of a fix."""

_ASSIGNMENT: Final = re.compile(r"\s*(=)")


class TextFix(NamedTuple):
    """A fix of a diagnostic as edits of the text.

    Attributes:
        title: What the fix does, for menus: "Change to <Sleep>".
        edits: The edits; they do not overlap.
        is_safe: See `Fix`.
    """

    title: str
    edits: tuple[Edit, ...]
    is_safe: bool


class FixMaker:
    """Makes the fixes of the diagnostics of one text.

    Attributes:
        lines: The lines of the text.
    """

    def __init__(self, text: str) -> None:
        self._editor = DocumentEditor(scan(text))
        self.lines = LineIndex(text)

    def fixes_of(self, diagnostic: Diagnostic) -> list[TextFix]:
        """Return the fixes of *diagnostic*, which must be about the text; the best fix comes first."""
        if not diagnostic.fixes or not diagnostic.line:
            return []
        start = self.lines.offset(diagnostic.line, max(1, diagnostic.column))
        problem = _Problem(self._editor, start, start + diagnostic.width)
        fixes: dict[str, TextFix] = {}
        for fix in diagnostic.fixes:
            for title, edits in _OPERATIONS[fix.operation](problem, *fix.arguments):
                fixes.setdefault(title, TextFix(title, tuple(edits), fix.is_safe))
        return list(fixes.values())[:MAX_FIXES]


def fix_text(text: str, diagnostics: Iterable[Diagnostic]) -> tuple[str, list[DiagnosticCode]]:
    """Apply the safe fixes of *diagnostics* to a text.

    Returns:
        The new text, and the codes of the diagnostics whose fixes were applied. Of fixes that change the same
        place, only the first is applied.
    """
    maker = FixMaker(text)
    edits: list[Edit] = []
    fixed: list[DiagnosticCode] = []
    for diagnostic in diagnostics:
        safe = next((fix for fix in maker.fixes_of(diagnostic) if fix.is_safe), None)
        if safe is not None and not any(_overlap(new, edit) for new in safe.edits for edit in edits):
            edits += safe.edits
            fixed.append(diagnostic.code)
    return apply_edits(text, edits), fixed


def _overlap(first: Edit, second: Edit) -> bool:
    return first.start <= second.end and second.start <= first.end


class _Problem:
    """What a diagnostic marks.

    Attributes:
        editor: The document.
        start: The start of the marked text.
        end: The end of the marked text.
        place: What the marked text is in.
        element: The element whose tag is marked, or None.
    """

    def __init__(self, editor: DocumentEditor, start: int, end: int) -> None:
        self.editor = editor
        self.start = start
        self.end = end
        # A diagnostic about an element begins at its "<", where a cursor is still in the text before it.
        inside = start + 1 if editor.text[start : start + 1] == "<" else start
        self.place: Place = editor.scan.element_at(inside)
        self.element: ScannedElement | None = self.place.element

    @property
    def marked(self) -> str:
        """The marked text."""
        return self.editor.text[self.start : self.end]

    @property
    def marks_value(self) -> bool:
        """Whether the whole value of an attribute is marked. Only its first line can be marked."""
        place, text = self.place, self.editor.text
        is_whole = self.end >= place.end or text[self.end] in "\r\n"
        return place.kind == "value" and self.start == place.start and is_whole


_TitledEdits = Iterator[tuple[str, Sequence[Edit]]]


def _shown(text: str) -> str:
    return text if len(text) <= MAX_TITLE else f"{text[: MAX_TITLE - 1]}…"


# --- names and values


def _rename(problem: _Problem, name: str) -> _TitledEdits:
    """Replace the marked name: a tag, an attribute, an ID, or a key in braces or in a script."""
    place, title = problem.place, f"Change to '{_shown(name)}'"
    if place.kind == "tag":
        yield from _rename_element(problem, name)
    elif place.kind == "attribute":
        yield title, [Edit(place.start, place.end, name)]
    elif place.kind == "value":
        start, end = (place.start, place.end) if problem.marks_value else (problem.start, problem.end)
        value = problem.editor.text[start:end].strip()
        is_entry = value.startswith("{") and value.endswith("}")
        yield title, [Edit(start, end, escape_value(f"{{{name}}}" if is_entry else name))]


def _rename_element(problem: _Problem, name: str) -> _TitledEdits:
    """Change the tag of the marked element, and its end tag."""
    if problem.element is not None:
        yield f"Change to <{_shown(name)}>", problem.editor.rename_element(problem.element, name)


def _rename_attribute(problem: _Problem, name: str) -> _TitledEdits:
    """Rename the marked attribute, unless the element has an attribute *name*."""
    attribute, element = problem.place.attribute, problem.element
    if attribute is not None and element is not None and element.attribute(name) is None:
        yield f"Write {name} instead of {attribute.name}", [Edit(attribute.start, attribute.name_end, name)]


def _replace_text(problem: _Problem, text: str) -> _TitledEdits:
    """Replace the marked characters by *text*, which is escaped already."""
    yield f"Write {_shown(text)}", [Edit(problem.start, problem.end, text)]


def _insert_text(problem: _Problem, text: str) -> _TitledEdits:
    """Insert *text* before the marked characters."""
    yield f"Insert '{_shown(text)}'", [Edit(problem.start, problem.start, text)]


def _escape(problem: _Problem) -> _TitledEdits:
    """Escape all markup characters in the marked value."""
    attribute = problem.place.attribute
    if attribute is not None:
        matches = BARE_MARKUP_CHARACTER.finditer(
            problem.editor.text, attribute.value_start, attribute.value_end
        )
        edits = [Edit(*match.span(), escape_value(match[0])) for match in matches]
        names = " and ".join(dict.fromkeys(edit.text for edit in edits))
        yield f"Write {names}", edits


def _set_value(problem: _Problem, *values: str) -> _TitledEdits:
    """Replace the marked value. Of several values, the most similar comes first."""
    attribute = problem.place.attribute
    if attribute is not None and attribute.is_closed:
        nearest = nearest_name(attribute.value or "", values) if len(values) > 1 else None
        for value in sorted(values, key=lambda value: value != nearest):
            yield f"Write {_shown(value)}", [problem.editor.set_value(attribute, value)]


def _set_attributes(problem: _Problem, *pairs: str) -> _TitledEdits:
    """Give attributes of the marked element values; *pairs* are names and values in turn."""
    element = problem.element
    if element is not None:
        names = dict(zip(pairs[::2], pairs[1::2], strict=True))
        edits = [problem.editor.set_attribute(element, name, value) for name, value in names.items()]
        written = " ".join(f'{name}="{value}"' for name, value in names.items())
        yield f"Write {_shown(written)}", edits


def _create_entry(problem: _Problem) -> _TitledEdits:
    """Change the assignment after the marked key, which creates the entry then."""
    assignment = _ASSIGNMENT.match(problem.editor.text, problem.end)
    if assignment is not None:
        yield "Create the entry with :=", [Edit(*assignment.span(1), ":=")]


def _set_format(problem: _Problem, format: int) -> _TitledEdits:
    """Write the XML format in the root element."""
    root = next(iter(problem.editor.scan.roots), None)
    if root is not None:
        edit = problem.editor.set_attribute(root, "BTCPP_format", str(format))
        yield f'Write BTCPP_format="{format}"', [edit]


def _name_tree(problem: _Problem) -> _TitledEdits:
    """Give the marked <BehaviorTree> an ID that no tree of the text has."""
    trees = (element for root in problem.editor.scan.roots for element in root.iter("BehaviorTree"))
    known = {tree.get("ID") for tree in trees}
    number = next(number for number in range(1, len(known) + 2) if f"Tree{number}" not in known)
    yield from _set_attributes(problem, "ID", f"Tree{number}")


def _remove(problem: _Problem) -> _TitledEdits:
    """Remove the marked attribute or element."""
    attribute = problem.place.attribute
    if attribute is not None:
        assert problem.element is not None
        edit = problem.editor.remove_attribute(problem.element, attribute.name)
        yield f"Remove {attribute.name}", [edit]
    elif problem.element is not None:
        edit = problem.editor.remove(problem.element)
        yield f"Remove <{_shown(problem.element.tag)}>", [edit]


# --- trees


def _call_tree(problem: _Problem) -> _TitledEdits:
    """Make the marked element a SubTree element that calls the tree with its name."""
    element = problem.element
    if element is not None:
        start, *end = problem.editor.rename_element(element, "SubTree")
        call = f'SubTree ID="{escape_value(element.tag)}"'
        yield f"Change to <{_shown(call)}>", [start._replace(text=call), *end]


def _connect(problem: _Problem, index: int, tree: str, key: str, value: str) -> _TitledEdits:
    """Connect *key* in the element with the number *index*, which calls *tree*."""
    elements = problem.editor.scan.elements
    if index < len(elements) and elements[index].get("ID") == tree:
        edit = problem.editor.set_attribute(elements[index], key, value)
        yield f"Connect {_shown(key)} in the SubTree of '{_shown(tree)}'", [edit]


def _declare_node(problem: _Problem, id: str) -> _TitledEdits:
    """Add a model of the node of the marked element, with its attributes as ports."""
    element, editor = problem.element, problem.editor
    if element is None:
        return
    tag = element.tag
    if tag not in EXPLICIT_TAGS:
        tag = ("Action", "Decorator", "Control")[min(len(element.children), 2)]
    ports = [
        (attribute.name, (attribute.value or "").startswith("{"))
        for attribute in element.attributes
        if is_port_name(attribute.name) and attribute.name not in ("ID", "name", *SCRIPT_ATTRIBUTES)
    ]
    root, step = _root_and_step(problem)
    lines = [f'{step * 2}<{tag} ID="{escape_value(id)}"' + (">" if ports else "/>")]
    for name, is_entry in ports:
        lines.append(f'{step * 3}<{"inout" if is_entry else "input"}_port name="{escape_value(name)}"/>')
    if ports:
        lines.append(f"{step * 2}</{tag}>")
    models = next((child for child in root.children if child.tag == "TreeNodesModel"), None)
    title = f"Declare <{_shown(id)}> in the <TreeNodesModel>"
    if models is not None and models.end_tag_start >= 0:
        yield title, [editor.append_lines(models, lines)]
        return
    lines = [f"{step}<TreeNodesModel>", *lines, f"{step}</TreeNodesModel>"]
    if models is not None:
        yield title, [Edit(models.start, models.end, editor.line_break.join(lines).lstrip())]
    else:
        yield title, [editor.append_lines(root, lines)]


def _create_tree(problem: _Problem, id: str) -> _TitledEdits:
    """Add a tree *id* with one node to the document."""
    if problem.element is not None:
        root, step = _root_and_step(problem)
        tag = f'BehaviorTree ID="{escape_value(id)}"'
        lines = (f"{step}<{tag}>", f"{step * 2}<AlwaysSuccess/>", f"{step}</BehaviorTree>")
        yield f"Create the tree '{_shown(id)}'", [problem.editor.append_lines(root, lines)]


def _root_and_step(problem: _Problem) -> tuple[ScannedElement, str]:
    """Return the root of the document, and the indentation of its children."""
    assert problem.element is not None
    root = [problem.element, *problem.element.ancestors()][-1]
    step = problem.editor.indent(root.children[0]) if root.children else None
    return root, problem.editor.step() if step is None else step


# --- children


def _add_children(problem: _Problem, count: int) -> _TitledEdits:
    """Add *count* leaves after the children of the marked element."""
    if problem.element is not None:
        title = "Add a child" if count == 1 else f"Add {count} children"
        separator = "" if problem.editor.indent(problem.element) is None else "\n"
        children = separator.join(["<AlwaysSuccess/>"] * count)
        index = len(problem.element.children)
        yield title, [problem.editor.insert(problem.element, index, children)]


def _remove_children(problem: _Problem) -> _TitledEdits:
    """Remove the children of the marked element."""
    if problem.element is not None and problem.element.children:
        yield "Remove the children", [problem.editor.remove_children(problem.element)]


def _wrap_children(problem: _Problem, tag: str, first: int) -> _TitledEdits:
    """Put the children from the index *first* into a new element."""
    if problem.element is not None:
        children = problem.element.children[first:]
        which = "the children" if first == 0 else f"the last {len(children)} children"
        yield f"Put {which} into a <{tag}>", problem.editor.wrap(children, tag)


# --- tags


def _end_tag(problem: _Problem, name: str) -> _TitledEdits:
    """Write the end tag of *name* instead of the marked end tag, or before it."""
    end_tag = f"</{name}>"
    if not problem.marked.startswith("</"):  # a start tag whose end tag is missing
        end = len(problem.editor.text.rstrip())
        yield f"Insert {end_tag}", [Edit(end, end, f"{problem.editor.line_break}{end_tag}")]
        return
    change = (f"Change to {end_tag}", [Edit(problem.start, problem.end, end_tag)])
    insert = (f"Insert {end_tag}", [_inserted_end_tag(problem, name)])
    # An end tag with a start tag is in its place, and the end tag of an element inside is missing.
    yield from (insert, change) if problem.element is not None else (change, insert)


def _inserted_end_tag(problem: _Problem, name: str) -> Edit:
    """Return the edit that inserts an end tag before the marked tag, in a line of its own if that fits."""
    editor, at = problem.editor, problem.start
    inside = problem.element.iter(name) if problem.element is not None else ()
    unclosed = [element for element in inside if element.end_tag_start < 0 and not element.is_empty]
    own = editor.indent(unclosed[-1]) if unclosed else None
    before = editor.indent_at(at)
    if own is None or before is None:
        return Edit(at, at, f"</{name}>")
    line_start = at - len(before)
    return Edit(line_start, line_start, f"{own}</{name}>{editor.line_break}")


def _close_tag(problem: _Problem) -> _TitledEdits:
    """Close the marked tag, which is cut off."""
    element = problem.element
    if problem.marked.startswith("</"):
        yield "Close the tag", [Edit(problem.end, problem.end, ">")]
    elif element is not None and not element.is_complete:
        end = element.attributes[-1].end if element.attributes else element.tag_end
        for ending in ("/>", ">"):
            yield f"Close the tag with {ending}", [Edit(end, end, ending)]


_OPERATIONS: Final[dict[FixOperation, Callable[..., _TitledEdits]]] = {
    "add_children": _add_children,
    "call_tree": _call_tree,
    "close_tag": _close_tag,
    "connect": _connect,
    "create_entry": _create_entry,
    "create_tree": _create_tree,
    "declare_node": _declare_node,
    "end_tag": _end_tag,
    "escape": _escape,
    "insert_text": _insert_text,
    "name_tree": _name_tree,
    "remove": _remove,
    "remove_children": _remove_children,
    "rename": _rename,
    "rename_attribute": _rename_attribute,
    "rename_element": _rename_element,
    "replace_text": _replace_text,
    "set_attributes": _set_attributes,
    "set_format": _set_format,
    "set_value": _set_value,
    "wrap_children": _wrap_children,
}
