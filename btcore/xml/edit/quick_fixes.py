"""Quick fixes: edits of a document's text, made from the fixes of diagnostics."""

import re
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from typing import Final, NamedTuple

from btcore import fixes
from btcore.diagnostic_codes import DiagnosticCode
from btcore.diagnostics import Diagnostic
from btcore.names import SCRIPT_ATTRIBUTES, is_port_name
from btcore.suggestions import nearest_name, shortened
from btcore.xml.edit.editor import DocumentEditor, Edit, apply_edits, escape_value
from btcore.xml.read.positions import LineIndex
from btcore.xml.read.scan import Place, ScannedElement, scan
from btcore.xml.read.tags import EXPLICIT_TAGS
from btcore.xml.read.tinyxml2_compat import BARE_MARKUP_CHARACTER

MAX_FIXES: Final = 20
"""Maximum number of fixes of one diagnostic."""
MAX_TITLE: Final = 60
"""Maximum length of a text in the title of a fix."""
_shown: Final = partial(shortened, most=MAX_TITLE)

_ASSIGNMENT: Final = re.compile(r"\s*(=)")


class QuickFix(NamedTuple):
    """A fix of a diagnostic, as edits of the text with a title.

    Attributes:
        title: What the fix does, for menus: "Change to <Sleep>".
        edits: The edits; they do not overlap.
        is_safe: See `btcore.fixes.Fix`.
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

    def fixes_of(self, diagnostic: Diagnostic) -> list[QuickFix]:
        """Return the fixes of *diagnostic*, which must be about the text; the best fix comes first."""
        if not diagnostic.fixes or not diagnostic.line:
            return []
        start = self.lines.offset(diagnostic.line, max(1, diagnostic.column))
        problem = _Problem(self._editor, start, start + diagnostic.width)
        quick_fixes: dict[str, QuickFix] = {}
        for fix in diagnostic.fixes:
            for title, edits in _titled_edits(fix, problem):
                quick_fixes.setdefault(title, QuickFix(title, tuple(edits), fix.is_safe))
        return list(quick_fixes.values())[:MAX_FIXES]


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
    """

    def __init__(self, editor: DocumentEditor, start: int, end: int) -> None:
        self.editor = editor
        self.start = start
        self.end = end
        # A diagnostic about an element begins at its "<", where a cursor is still in the text before it.
        inside = start + 1 if editor.text[start : start + 1] == "<" else start
        self.place: Place = editor.scan.element_at(inside)

    @property
    def marked(self) -> str:
        return self.editor.text[self.start : self.end]

    @property
    def marks_value(self) -> bool:
        """Whether the whole value of an attribute is marked. Only its first line can be marked."""
        place, text = self.place, self.editor.text
        is_whole = self.end >= place.end or text[self.end] in "\r\n"
        return place.kind == "value" and self.start == place.start and is_whole


_TitledEdits = Iterator[tuple[str, Sequence[Edit]]]


def _titled_edits(fix: fixes.Fix, problem: _Problem) -> _TitledEdits:
    """Yield the edits of a fix, each list with its title; nothing if the text does not permit the fix."""
    editor, element, attribute = problem.editor, problem.place.element, problem.place.attribute
    match fix:
        # Fixes of the marked characters, or of another place.
        case fixes.Rename():
            yield from _renamed(fix.text, problem)
        case fixes.ReplaceText():
            yield f"Write {_shown(fix.text.strip())}", [Edit(problem.start, problem.end, fix.text)]
        case fixes.CreateEntry():
            assignment = _ASSIGNMENT.match(editor.text, problem.end)
            if assignment is not None:
                yield "Create the entry with :=", [Edit(*assignment.span(1), ":=")]
        case fixes.SetFormat() if editor.scan.roots:
            edit = editor.set_attribute(editor.scan.roots[0], "BTCPP_format", str(fix.format))
            yield f'Write BTCPP_format="{fix.format}"', [edit]
        case fixes.Connect():
            elements = editor.scan.elements
            if fix.index < len(elements) and elements[fix.index].get("ID") == fix.tree:
                edit = editor.set_attribute(elements[fix.index], fix.key, fix.value)
                yield f"Connect {_shown(fix.key)} in the SubTree of '{_shown(fix.tree)}'", [edit]
        case fixes.WriteEndTag():
            yield from _with_end_tag(fix.text, problem)
        case fixes.CloseTag() if problem.marked.startswith("</"):
            yield "Close the tag", [Edit(problem.end, problem.end, ">")]
        case fixes.CloseTag() if element is not None and not element.is_complete:
            end = element.attributes[-1].end if element.attributes else element.tag_end
            for ending in ("/>", ">"):
                yield f"Close the tag with {ending}", [Edit(end, end, ending)]
        # Fixes of the marked attribute.
        case fixes.RemoveAttribute() if element is not None and attribute is not None:
            yield f"Remove {attribute.name}", [editor.remove_attribute(element, attribute.name)]
        case fixes.RenameAttribute() if (
            element is not None and attribute is not None and element.attribute(fix.text) is None
        ):
            edit = Edit(attribute.start, attribute.name_end, fix.text)
            yield f"Write {fix.text} instead of {attribute.name}", [edit]
        case fixes.Escape() if attribute is not None:
            matches = BARE_MARKUP_CHARACTER.finditer(editor.text, attribute.value_start, attribute.value_end)
            edits = [Edit(*match.span(), escape_value(match[0])) for match in matches]
            names = " and ".join(dict.fromkeys(edit.text for edit in edits))
            yield f"Write {names}", edits
        case fixes.SetValue() if attribute is not None and attribute.is_closed:
            nearest = nearest_name(attribute.value or "", fix.values) if len(fix.values) > 1 else None
            for value in sorted(fix.values, key=lambda value: value != nearest):
                yield f"Write {_shown(value)}", [editor.set_value(attribute, value)]
        # Fixes of the marked element.
        case _ if element is not None:
            yield from _edits_of_element(fix, editor, element)


def _edits_of_element(fix: fixes.Fix, editor: DocumentEditor, element: ScannedElement) -> _TitledEdits:
    """Yield the edits of a fix that changes the marked element or adds something for it."""
    match fix:
        case fixes.RemoveElement():
            yield f"Remove <{_shown(element.tag)}>", [editor.remove(element)]
        case fixes.RenameElement():
            yield f"Change to <{_shown(fix.text)}>", editor.rename_element(element, fix.text)
        case fixes.SetAttributes():
            edits = [editor.set_attribute(element, name, value) for name, value in fix.values]
            written = " ".join(f'{name}="{value}"' for name, value in fix.values)
            yield f"Write {_shown(written)}", edits
        case fixes.NameTree():
            trees = (tree for root in editor.scan.roots for tree in root.iter("BehaviorTree"))
            known = {tree.get("ID") for tree in trees}
            number = next(number for number in range(1, len(known) + 2) if f"Tree{number}" not in known)
            yield from _edits_of_element(fixes.SetAttributes({"ID": f"Tree{number}"}), editor, element)
        case fixes.CallTree():
            start, *end = editor.rename_element(element, "SubTree")
            call = f'SubTree ID="{escape_value(element.tag)}"'
            yield f"Change to <{_shown(call)}>", [start._replace(text=call), *end]
        case fixes.CreateTree():
            root, step = _root_and_step(editor, element)
            tag = f'BehaviorTree ID="{escape_value(fix.text)}"'
            lines = (f"{step}<{tag}>", f"{step * 2}<AlwaysSuccess/>", f"{step}</BehaviorTree>")
            yield f"Create the tree '{_shown(fix.text)}'", [editor.append_lines(root, lines)]
        case fixes.DeclareNode():
            title = f"Declare <{_shown(fix.text)}> in the <TreeNodesModel>"
            yield title, [_declared_node(fix.text, editor, element)]
        case fixes.AddChildren():
            title = "Add a child" if fix.count == 1 else f"Add {fix.count} children"
            separator = "" if editor.indent(element) is None else "\n"
            children = separator.join(["<AlwaysSuccess/>"] * fix.count)
            yield title, [editor.insert(element, len(element.children), children)]
        case fixes.RemoveChildren() if element.children:
            yield "Remove the children", [editor.remove_children(element)]
        case fixes.WrapChildren():
            wrapped = element.children[fix.first :]
            which = "the children" if fix.first == 0 else f"the last {len(wrapped)} children"
            yield f"Put {which} into a <{fix.tag}>", editor.wrap(wrapped, fix.tag)


def _renamed(name: str, problem: _Problem) -> _TitledEdits:
    place, title = problem.place, f"Change to '{_shown(name)}'"
    if place.kind == "tag":
        yield from _titled_edits(fixes.RenameElement(name), problem)
    elif place.kind == "attribute":
        yield title, [Edit(place.start, place.end, name)]
    elif place.kind == "value":
        start, end = (place.start, place.end) if problem.marks_value else (problem.start, problem.end)
        value = problem.editor.text[start:end].strip()
        is_entry = value.startswith("{") and value.endswith("}")
        yield title, [Edit(start, end, escape_value(f"{{{name}}}" if is_entry else name))]


def _declared_node(id: str, editor: DocumentEditor, element: ScannedElement) -> Edit:
    """Return the edit that adds a model for the node *id*, with the attributes of *element* as ports."""
    tag = element.tag
    if tag not in EXPLICIT_TAGS:
        tag = ("Action", "Decorator", "Control")[min(len(element.children), 2)]
    ports = [
        (attribute.name, (attribute.value or "").startswith("{"))
        for attribute in element.attributes
        if is_port_name(attribute.name) and attribute.name not in ("ID", "name", *SCRIPT_ATTRIBUTES)
    ]
    root, step = _root_and_step(editor, element)
    lines = [f'{step * 2}<{tag} ID="{escape_value(id)}"' + (">" if ports else "/>")]
    for name, is_entry in ports:
        lines.append(f'{step * 3}<{"inout" if is_entry else "input"}_port name="{escape_value(name)}"/>')
    if ports:
        lines.append(f"{step * 2}</{tag}>")
    models = next((child for child in root.children if child.tag == "TreeNodesModel"), None)
    if models is not None and models.end_tag_start >= 0:
        return editor.append_lines(models, lines)
    lines = [f"{step}<TreeNodesModel>", *lines, f"{step}</TreeNodesModel>"]
    if models is not None:
        return Edit(models.start, models.end, editor.line_break.join(lines).lstrip())
    return editor.append_lines(root, lines)


def _root_and_step(editor: DocumentEditor, element: ScannedElement) -> tuple[ScannedElement, str]:
    """Return the root of the document, and the indentation of its children."""
    root = [element, *element.ancestors()][-1]
    step = editor.indent(root.children[0]) if root.children else None
    return root, editor.step() if step is None else step


def _with_end_tag(name: str, problem: _Problem) -> _TitledEdits:
    end_tag = f"</{name}>"
    if not problem.marked.startswith("</"):  # a start tag whose end tag is missing
        end = len(problem.editor.text.rstrip())
        yield f"Insert {end_tag}", [Edit(end, end, f"{problem.editor.line_break}{end_tag}")]
        return
    change = (f"Change to {end_tag}", [Edit(problem.start, problem.end, end_tag)])
    insert = (f"Insert {end_tag}", [_inserted_end_tag(problem, name)])
    # An end tag with a start tag is in its place, and the end tag of an element inside is missing.
    yield from (insert, change) if problem.place.element is not None else (change, insert)


def _inserted_end_tag(problem: _Problem, name: str) -> Edit:
    """Return the edit that inserts an end tag before the marked tag, in a line of its own if that fits."""
    editor, at = problem.editor, problem.start
    inside = problem.place.element.iter(name) if problem.place.element is not None else ()
    unclosed = [element for element in inside if element.end_tag_start < 0 and not element.is_empty]
    own = editor.indent(unclosed[-1]) if unclosed else None
    before = editor.indent_at(at)
    if own is None or before is None:
        return Edit(at, at, f"</{name}>")
    line_start = at - len(before)
    return Edit(line_start, line_start, f"{own}</{name}>{editor.line_break}")
