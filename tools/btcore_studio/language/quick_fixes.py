"""Quick fixes: the changes that the hints of diagnostics describe, and the conversion to format 4."""

import posixpath
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final, NamedTuple

from lsprotocol import types

from btcore.diagnostic_codes import (
    BARE_MARKUP,
    FIRST_TICK_REFUSED,
    INCLUDE_FAILED,
    INCONVERTIBLE_TEXT,
    MISSING_ID,
    MISSING_PORT,
    NOT_A_BOOLEAN,
    NOT_XML,
    TREE_WITHOUT_ID,
    UNEXPECTED_ID,
    UNKNOWN_FORMAT,
    UNKNOWN_NODE,
    UNKNOWN_TREE,
    UNWRITTEN_KEY,
    WRONG_CHILD_COUNT,
)
from btcore.errors import TreeError
from btcore.names import is_port_name
from btcore.suggestions import nearest_name
from btcore.xml.define import parse_format
from btcore.xml.models.stubs import is_stub
from btcore.xml.models.tree_nodes_model import quoted
from btcore.xml.read.dialect import EXPLICIT_TAGS, SCRIPT_ATTRIBUTES
from btcore_studio.convert.convert import convert
from btcore_studio.language.descriptions import literals_of
from btcore_studio.language.diagnostics import Report
from btcore_studio.language.node_attributes import file_symbols, node_element, tree_of
from btcore_studio.language.project import Project, SourceDocument
from btcore_studio.language.project_symbols import symbols_of
from btcore_studio.language.scanner import Place, ScannedElement
from btcore_studio.language.symbols import is_call

MAX_FIXES: Final = 20
"""Maximum number of fixes for one diagnostic."""
INDENT: Final = "  "
"""The indentation of a child in a document that does not show another indentation."""

_SIMILAR: Final = re.compile(r"did you mean (?:<([^>]+)>|'([^']+)'|(?=\S)(.+))\?(?:\s|$)")
_REPLACEMENT: Final = re.compile(r"use <([^>]+)>, which replaces it")
_CALL: Final = re.compile(r"is a tree: write <SubTree ID=")
_OTHER_FORMAT: Final = re.compile(r'write <root BTCPP_format="([34])">')
_ATTRIBUTE: Final = re.compile(r'([\w.:-]+)="([^"]*)"')
_ENTRY: Final = re.compile(r"write (\{[^{}\s]*\})")
_NUMBER: Final = re.compile(r"write (\S+) if that is the intended value")
_REFERENCE: Final = re.compile(r"write (&amp;|&lt;|\]\]&gt;)$")
_CREATION: Final = re.compile(r"to create it, write \S+ :=")
_ASSIGNMENT: Final = re.compile(r"\s*(=)")
_COMPARISON: Final = re.compile(r"to compare, write \S+ == …")
_EXPECTED: Final = re.compile(r"expected (</[^>]+>), but found </([^>]+)>")
_NEVER_CLOSED: Final = re.compile(r"<([^>]+)> is never closed")
_CUT_OFF: Final = re.compile(r"^the tag <.* is not closed$")
_CONNECTION: Final = re.compile(r"in the SubTree\w* of '(.*)' in line (\d+) write ([\w.:-]+)=\"(.*)\"$")
_CHILDREN: Final = re.compile(r"has (no|\d+) child")
_LIMITS: Final = re.compile(r"(?:exactly|at least|needs) (\d+)(?: or (\d+))?")
_MISSING_PORTS: Final = re.compile(r"\[(\w+)\]")


# Their hints show an ID, a format or a whole script, and other fixes know what to write.
_HINTS_OF_OTHER_FIXES: Final = (MISSING_ID, TREE_WITHOUT_ID, BARE_MARKUP, UNKNOWN_FORMAT)


class Edit(NamedTuple):
    """The characters from *start* to *end* of the document are replaced by *text*."""

    start: int
    end: int
    text: str


class Fix(NamedTuple):
    """A change that removes a diagnostic."""

    title: str
    edits: Sequence[Edit]


class _Problem:
    """A report, and what its place contains."""

    def __init__(self, project: Project, document: SourceDocument, report: Report) -> None:
        self.project = project
        self.document = document
        self.report = report
        self.text = document.text
        self.start = document.positions.offset(report.range.start)
        self.end = document.positions.offset(report.range.end)
        at_start = document.scan.element_at(self.start)
        # A report about an element begins at its "<", where a cursor is still in the text before it.
        inside = (
            document.scan.element_at(self.start + 1)
            if self.text[self.start : self.start + 1] == "<"
            else at_start
        )
        self.place: Place = inside
        self.element: ScannedElement | None = inside.element

    @property
    def marked(self) -> str:
        """The marked text."""
        return self.text[self.start : self.end]


def code_actions(
    project: Project, document: SourceDocument, params: types.CodeActionParams
) -> list[types.CodeAction]:
    """Return the fixes for the reports in a range, and the conversion of a document of format 3.

    Args:
        project: The project.
        document: The document.
        params: The range, and the kinds of actions that the client wants.
    """
    actions: list[types.CodeAction] = []
    fixes: dict[tuple[Edit, ...], types.CodeAction] = {}  # a change can remove several diagnostics
    if _wants(params, types.CodeActionKind.QuickFix):
        for report in project.reports(document):
            if _overlap(report.range, params.range):
                for index, fix in enumerate(find_fixes(project, document, report)):
                    new = _action(document, fix, types.CodeActionKind.QuickFix)
                    action = fixes.setdefault(tuple(fix.edits), new)
                    action.diagnostics = [*(action.diagnostics or ()), report.diagnostic()]
                    action.is_preferred = index == 0 or action.is_preferred
        actions += fixes.values()
    if _wants(params, types.CodeActionKind.RefactorRewrite):
        conversion = convert_to_4(project, document)
        if conversion is not None:
            actions.append(_action(document, conversion, types.CodeActionKind.RefactorRewrite))
    return actions


def find_fixes(project: Project, document: SourceDocument, report: Report) -> list[Fix]:
    """Return the fixes of a report about the current text of *document*, the best first."""
    problem = _Problem(project, document, report)
    found: dict[str, Fix] = {}
    for finder in (_FIXES_OF_CODES.get(report.code), _fixes_of_hint):
        for fix in finder(problem) if finder is not None else ():
            found.setdefault(fix.title, fix)
    return list(found.values())[:MAX_FIXES]


def convert_to_4(project: Project, document: SourceDocument) -> Fix | None:
    """Return the conversion of a document of format 3; None for any other document."""
    root = next(iter(document.scan.roots), None)
    if root is None or root.tag != "root" or parse_format(root.get("BTCPP_format")) != 3:
        return None
    parsed = project.parse(document)
    if parsed is None:
        return None
    try:
        converted = convert(parsed, project.registry).text
    except TreeError:
        return None
    return Fix("Convert the document to format 4", [_difference(document.text, converted)])


def _difference(before: str, after: str) -> Edit:
    """Return the replacement of the part in which two texts differ, so that the cursor keeps its place."""
    most = min(len(before), len(after))
    start = next((index for index in range(most) if before[index] != after[index]), most)
    rest = most - start
    end = next((index for index in range(rest) if before[-1 - index] != after[-1 - index]), rest)
    return Edit(start, len(before) - end, after[start : len(after) - end])


def _wants(params: types.CodeActionParams, kind: types.CodeActionKind) -> bool:
    only = params.context.only
    return only is None or any(kind == item or kind.startswith(f"{item}.") for item in only)


def _overlap(one: types.Range, other: types.Range) -> bool:
    return one.start <= other.end and other.start <= one.end


def _action(document: SourceDocument, fix: Fix, kind: types.CodeActionKind) -> types.CodeAction:
    edits = [types.TextEdit(document.positions.range(edit.start, edit.end), edit.text) for edit in fix.edits]
    return types.CodeAction(fix.title, kind, edit=types.WorkspaceEdit({document.uri: edits}))


# --- fixes by the text of the hint


def _fixes_of_hint(problem: _Problem) -> Iterator[Fix]:
    hint = problem.report.hint
    similar = _SIMILAR.search(hint)
    if similar is not None and similar[3] is None:  # _fixes_of_include() suggests files
        yield from _rename(problem, similar[1] or similar[2])
    replacement = _REPLACEMENT.search(hint)
    if replacement is not None:
        yield from _rename(problem, replacement[1])
    element = problem.element
    if _CALL.search(hint) and element is not None:
        yield _fix_of_tag(element, "SubTree", f" ID={quoted(element.tag)}")
    other = _OTHER_FORMAT.search(hint)
    if other is not None:
        yield from _set_format(problem, other[1])
    entry = _ENTRY.search(hint)
    number = _NUMBER.search(hint)
    for match in (entry, number):
        if match is not None and problem.place.kind == "value":
            start, end = problem.place.start, problem.place.end
            yield Fix(f"Write {match[1]}", [Edit(start, end, match[1])])
    reference = _REFERENCE.search(hint)
    if reference is not None:
        yield Fix(f"Write {reference[1]}", [Edit(problem.start, problem.end, reference[1])])
    assignment = _ASSIGNMENT.match(problem.text, problem.end)
    if _CREATION.search(hint) and assignment is not None:
        yield Fix("Create the entry with :=", [Edit(assignment.start(1), assignment.end(1), ":=")])
    if _COMPARISON.search(hint):
        yield Fix("Compare with ==", [Edit(problem.start, problem.end, "==")])
    if "put them into a <Sequence>" in hint and element is not None:
        for tag in ("Sequence", "Fallback"):
            yield _wrap(problem, element, element.children, tag)
    if hint.startswith("write ") and problem.report.code not in _HINTS_OF_OTHER_FIXES:
        written = hint.removeprefix("write ").partition(", or ")[0]
        values = dict(_ATTRIBUTE.findall(written))
        if element is not None and values and _ATTRIBUTE.sub("", written).strip() == "":
            yield _write_attributes(element, values)


def _rename(problem: _Problem, name: str) -> Iterator[Fix]:
    """Replace the name at the place of the problem by *name*."""
    place, element = problem.place, problem.element
    title = f"Change to '{name}'"
    if place.kind == "tag" and element is not None:
        yield _fix_of_tag(element, name)._replace(title=f"Change to <{name}>")
    elif place.kind == "attribute":
        yield Fix(title, [Edit(place.start, place.end, name)])
    elif place.kind == "value" and problem.report.code == UNWRITTEN_KEY:
        value = problem.marked.strip()
        braces = value.startswith("{") and value.endswith("}")
        yield Fix(title, [Edit(problem.start, problem.end, f"{{{name}}}" if braces else name)])
    elif place.kind == "value":
        yield Fix(title, [Edit(place.start, place.end, quoted(name)[1:-1])])


def _fix_of_tag(element: ScannedElement, name: str, attributes: str = "") -> Fix:
    edits = [Edit(element.tag_start, element.tag_end, name + attributes)]
    if element.end_tag_start >= 0:
        edits.append(Edit(element.end_tag_start, element.end, f"</{name}>"))
    return Fix(f"Change to <{name}{attributes}>", edits)


def _set_format(problem: _Problem, format: str) -> Iterator[Fix]:
    root = next(iter(problem.document.scan.roots), None)
    if root is not None:
        yield Fix(f'Write BTCPP_format="{format}"', [_set_attribute(root, "BTCPP_format", format)])


def _set_attribute(element: ScannedElement, name: str, value: str) -> Edit:
    """Return the edit that gives an attribute of the element a value."""
    attribute = element.attribute(name)
    if attribute is None:
        return Edit(element.tag_end, element.tag_end, f" {name}={quoted(value)}")
    return Edit(attribute.start, attribute.end, f"{name}={quoted(value)}")


def _write_attributes(element: ScannedElement, values: Mapping[str, str]) -> Fix:
    """Give attributes their values. A value with "…" stands for the entry with the name of the attribute."""
    written = {name: _example(name) if "…" in value else value for name, value in values.items()}
    new = [name for name in values if element.attribute(name) is None]
    at = element.attributes[-1].end if element.attributes else element.tag_end
    edits = [_set_attribute(element, name, written[name]) for name in values if name not in new]
    if new:
        edits.append(Edit(at, at, "".join(f" {name}={quoted(written[name])}" for name in new)))
    return Fix(f"{'Add' if new else 'Write'} {' '.join(values)}", edits)


def _example(name: str) -> str:
    return {"code": "", "if": "true", "else": ""}.get(name, f"{{{name}}}")


# --- fixes by the code


def _fixes_of_missing_port(problem: _Problem) -> Iterator[Fix]:
    names = _MISSING_PORTS.findall(problem.report.message)
    if problem.element is not None and names:
        yield _write_attributes(problem.element, dict.fromkeys(names, "…"))


def _fixes_of_missing_id(problem: _Problem) -> Iterator[Fix]:
    element = problem.element
    if element is None:
        return
    ids = symbols_of(problem.project).tree_ids(problem.document.uri)
    known = [id for id, is_visible in ids.items() if is_visible]
    if element.tag == "BehaviorTree":
        number = next(number for number in range(1, len(known) + 2) if f"Tree{number}" not in known)
        names = [f"Tree{number}"]
    elif is_call(element):
        own = tree_of(element)
        names = [id for id in known if own is None or id != own.get("ID")]
    else:
        names = []  # the place does not say which node is meant
    for name in names:
        yield Fix(f'Write ID="{name}"', [_set_attribute(element, "ID", name)])


def _fixes_of_unexpected_id(problem: _Problem) -> Iterator[Fix]:
    element = problem.element
    attribute = element.attribute("ID") if element is not None else None
    if element is None or attribute is None:
        return
    if element.attribute("name") is None:
        yield Fix("Write name instead of ID", [Edit(attribute.start, attribute.name_end, "name")])
    start = (
        attribute.start - len(problem.text[: attribute.start]) + len(problem.text[: attribute.start].rstrip())
    )
    yield Fix("Remove the ID", [Edit(start, attribute.end, "")])


def _fixes_of_text(problem: _Problem) -> Iterator[Fix]:
    """Suggest the values of an enum or a Boolean, the most similar first."""
    element, attribute = problem.element, problem.place.attribute
    if element is None or attribute is None or tree_of(element) is None:
        return
    format = file_symbols(problem.project, problem.document).format
    port = node_element(element, format, problem.project.registry).port(attribute.name)
    literals = literals_of(port.type) if port is not None else []
    nearest = nearest_name(attribute.value or "", literals)
    for value in sorted(literals, key=lambda value: value != nearest):
        text = quoted(value)[1:-1]
        yield Fix(f"Write {value}", [Edit(attribute.value_start, attribute.value_end, text)])


def _fixes_of_unwritten_key(problem: _Problem) -> Iterator[Fix]:
    """Connect the key of a tree in the SubTree element that calls the tree."""
    connection = _CONNECTION.search(problem.report.hint)
    if connection is None:
        return
    id, line, name, value = connection.groups()
    number = problem.document.positions.line
    for element in problem.document.scan.elements:
        if is_call(element) and element.get("ID") == id and number(element.start) == int(line) - 1:
            fix = _write_attributes(element, {name: value.replace("…", name)})
            yield fix._replace(title=f"Connect {name} in the SubTree of '{id}'")


def _fixes_of_boolean(problem: _Problem) -> Iterator[Fix]:
    for value in ("true", "false"):
        yield Fix(f"Write {value}", [Edit(problem.place.start, problem.place.end, value)])


def _fixes_of_format(problem: _Problem) -> Iterator[Fix]:
    for format in ("4", "3"):
        yield from _set_format(problem, format)


def _fixes_of_include(problem: _Problem) -> Iterator[Fix]:
    """Suggest the names of files in the folder that the path names."""
    written = problem.text[problem.place.start : problem.place.end]
    similar = _SIMILAR.search(problem.report.hint)
    if problem.place.kind != "value" or similar is None:
        return
    folder, name = posixpath.split(written)
    suggested = str(similar[3])
    if suggested.startswith("a file in it: "):
        folder = written.rstrip("/")
        names = suggested.removeprefix("a file in it: ").split(", ")
    else:
        names = [suggested.replace("\\", "/").rpartition("/")[2]]
    for name in names:
        path = posixpath.join(folder, name)
        edit = Edit(problem.place.start, problem.place.end, quoted(path)[1:-1])
        yield Fix(f"Include {path}", [edit])


def _fixes_of_unknown_node(problem: _Problem) -> Iterator[Fix]:
    """Suggest the most similar name, and else a model of the node."""
    yield from _fixes_of_hint(problem)
    element = problem.element
    if element is None or "declares it" in problem.report.hint:
        return
    tag = element.tag
    id = element.get("ID") if tag in EXPLICIT_TAGS else tag
    if tag not in EXPLICIT_TAGS:
        tag = ("Action", "Decorator", "Control")[min(len(element.children), 2)]
    if id and is_port_name(id):
        yield Fix(f"Declare <{id}> in the <TreeNodesModel>", [_declare(problem.document, element, tag, id)])


def _declare(document: SourceDocument, element: ScannedElement, tag: str, id: str) -> Edit:
    """Return the edit that adds a model of the node to the document."""
    root = [element, *element.ancestors()][-1]
    ports = [
        (attribute.name, (attribute.value or "").startswith("{"))
        for attribute in element.attributes
        if is_port_name(attribute.name) and attribute.name not in ("ID", "name", *SCRIPT_ATTRIBUTES)
    ]
    models = next((child for child in root.children if child.tag == "TreeNodesModel"), None)
    step = _indent_of(document.text, root.children[0]) if root.children else INDENT
    step = step if step is not None else INDENT
    new_line = _line_break(document.text)
    lines = [f"{step * 2}<{tag} ID={quoted(id)}" + (">" if ports else "/>")]
    for name, is_entry in ports:
        lines.append(f"{step * 3}<{'inout' if is_entry else 'input'}_port name={quoted(name)}/>")
    if ports:
        lines.append(f"{step * 2}</{tag}>")
    if models is not None and models.end_tag_start >= 0:
        at = models.end_tag_start
        at -= len(document.text[:at]) - len(document.text[:at].rstrip(" \t"))
        return Edit(at, at, "".join(line + new_line for line in lines))
    lines = [f"{step}<TreeNodesModel>", *lines, f"{step}</TreeNodesModel>"]
    if models is not None:
        return Edit(models.start, models.end, new_line.join(lines).lstrip())
    at = root.end_tag_start if root.end_tag_start >= 0 else root.end
    return Edit(at, at, "".join(line + new_line for line in lines))


def _fixes_of_unknown_tree(problem: _Problem) -> Iterator[Fix]:
    """Suggest the most similar tree, and else a new tree."""
    yield from _fixes_of_hint(problem)
    root = next(iter(problem.document.scan.roots), None)
    id = problem.element.get("ID") if problem.element is not None else None
    if not id or root is None or root.end_tag_start < 0:
        return
    step = _indent_of(problem.text, root.children[0]) if root.children else INDENT
    step = step if step is not None else INDENT
    new_line = _line_break(problem.text)
    lines = (f"{step}<BehaviorTree ID={quoted(id)}>", f"{step * 2}<AlwaysSuccess/>", f"{step}</BehaviorTree>")
    tree = "".join(line + new_line for line in lines)
    yield Fix(f"Create the tree '{id}'", [Edit(root.end_tag_start, root.end_tag_start, tree)])


def _fixes_of_children(problem: _Problem) -> Iterator[Fix]:
    """Add missing children, wrap children that are too many, or remove the children of a leaf."""
    element, message = problem.element, problem.report.message
    if element is None:
        return
    if "has children; they belong into the <BehaviorTree>" in message:
        if element.parent is not None:
            yield _remove_children(element.parent)
        return
    has, limits = _CHILDREN.search(message), _LIMITS.search(message.partition(";")[2])
    if has is None:
        return
    if limits is None:
        if message.endswith("has none"):
            yield _remove_children(element)
        return
    count = len(element.children)
    least, most = int(limits[1]), int(limits[2] or limits[1])
    if tree_of(element) is not None:
        # More children may be needed at the first tick than to load the tree.
        format = file_symbols(problem.project, problem.document).format
        manifest = node_element(element, format, problem.project.registry).manifest
        if manifest is not None and not is_stub(manifest.cls):
            least = max(least, manifest.spec.child_count[0])
    if count < least:
        yield _add_children(problem, element, least - count)
    elif count > most and "at least" not in message:
        for tag in ("Sequence", "Fallback"):
            yield _wrap(problem, element, element.children[most - 1 :], tag)


def _remove_children(element: ScannedElement) -> Fix:
    end = element.end if element.end_tag_start >= 0 else element.children[-1].end
    return Fix("Remove the children", [Edit(element.start_tag_end - 1, end, "/>")])


def _add_children(problem: _Problem, element: ScannedElement, count: int) -> Fix:
    text, new_line = problem.text, _line_break(problem.text)
    own = _indent_of(text, element)
    step = _step(problem.document)
    child = "<AlwaysSuccess/>"
    inner = (
        "".join(f"{new_line}{own}{step}{child}" for _ in range(count)) if own is not None else child * count
    )
    before_end = f"{new_line}{own}" if own is not None else ""
    title = "Add a child" if count == 1 else f"Add {count} children"
    if element.is_empty:
        slash = element.start_tag_end - 2
        slash -= len(text[:slash]) - len(text[:slash].rstrip())
        return Fix(title, [Edit(slash, element.start_tag_end, f">{inner}{before_end}</{element.tag}>")])
    after = element.children[-1].end if element.children else element.start_tag_end
    if not element.children:
        end = element.end_tag_start if element.end_tag_start >= 0 else after
        if not text[after:end].strip():
            return Fix(title, [Edit(after, end, inner + before_end)])
    return Fix(title, [Edit(after, after, inner)])


def _wrap(problem: _Problem, element: ScannedElement, children: Sequence[ScannedElement], tag: str) -> Fix:
    """Put consecutive children into a new element, which is indented like its neighbours."""
    text, new_line = problem.text, _line_break(problem.text)
    start, end = children[0].start, children[-1].end
    inner = text[start:end]
    own = _indent_of(text, children[0])
    if own is None:
        wrapped = f"<{tag}>{inner}</{tag}>"
    else:
        step = _step(problem.document)
        lines = inner.split(new_line)
        moved = new_line.join([lines[0], *(step + line if line.strip() else line for line in lines[1:])])
        wrapped = f"<{tag}>{new_line}{own}{step}{moved}{new_line}{own}</{tag}>"
    count = len(children)
    which = "the children" if count == len(element.children) else f"the last {count} children"
    return Fix(f"Put {which} into a <{tag}>", [Edit(start, end, wrapped)])


def _fixes_of_syntax(problem: _Problem) -> Iterator[Fix]:
    expected = _EXPECTED.search(problem.report.message)
    if expected is not None:
        change = Fix(f"Change to {expected[1]}", [Edit(problem.start, problem.end, expected[1])])
        insert = Fix(f"Insert {expected[1]}", [_insert_end_tag(problem, expected[1])])
        # An end tag with a start tag is in its place, and the end tag of an element inside is missing.
        yield from (insert, change) if problem.element is not None else (change, insert)
    if _CUT_OFF.search(problem.report.message):
        yield from _close_tag(problem)
    never = _NEVER_CLOSED.search(problem.report.message)
    if never is not None:
        end = len(problem.text.rstrip())
        yield Fix(f"Insert </{never[1]}>", [Edit(end, end, f"{_line_break(problem.text)}</{never[1]}>")])


def _close_tag(problem: _Problem) -> Iterator[Fix]:
    if problem.text.startswith("</", problem.start):
        yield Fix("Close the tag", [Edit(problem.end, problem.end, ">")])
    elif problem.element is not None and not problem.element.is_complete:
        element = problem.element
        end = element.attributes[-1].end if element.attributes else element.tag_end
        for ending in ("/>", ">"):
            yield Fix(f"Close the tag with {ending}", [Edit(end, end, ending)])


def _insert_end_tag(problem: _Problem, end_tag: str) -> Edit:
    """Return the edit that inserts an end tag before the marked tag, in a line of its own if that fits."""
    text, at = problem.text, problem.start
    inside = problem.element.iter(end_tag[2:-1]) if problem.element is not None else ()
    unclosed = [element for element in inside if element.end_tag_start < 0 and not element.is_empty]
    own = _indent_of(text, unclosed[-1]) if unclosed else None
    line_start = text.rfind("\n", 0, at) + 1
    if own is None or text[line_start:at].strip():
        return Edit(at, at, end_tag)
    return Edit(line_start, line_start, f"{own}{end_tag}{_line_break(text)}")


def _fixes_of_bare_markup(problem: _Problem) -> Iterator[Fix]:
    written = {"<": "&lt;", "&": "&amp;"}.get(problem.marked)
    if written is not None:
        yield Fix(f"Write {written}", [Edit(problem.start, problem.end, written)])


_FIXES_OF_CODES: Final[dict[str, Callable[[_Problem], Iterator[Fix]]]] = {
    BARE_MARKUP: _fixes_of_bare_markup,
    FIRST_TICK_REFUSED: _fixes_of_children,
    INCLUDE_FAILED: _fixes_of_include,
    INCONVERTIBLE_TEXT: _fixes_of_text,
    MISSING_ID: _fixes_of_missing_id,
    MISSING_PORT: _fixes_of_missing_port,
    NOT_A_BOOLEAN: _fixes_of_boolean,
    NOT_XML: _fixes_of_syntax,
    TREE_WITHOUT_ID: _fixes_of_missing_id,
    UNEXPECTED_ID: _fixes_of_unexpected_id,
    UNKNOWN_FORMAT: _fixes_of_format,
    UNKNOWN_NODE: _fixes_of_unknown_node,
    UNKNOWN_TREE: _fixes_of_unknown_tree,
    UNWRITTEN_KEY: _fixes_of_unwritten_key,
    WRONG_CHILD_COUNT: _fixes_of_children,
}


# --- layout


def _indent_of(text: str, element: ScannedElement) -> str | None:
    """Return the white space before an element that begins its line; None for any other element."""
    line = text[: element.start].rpartition("\n")[2]
    return line if not line.strip() else None


def _step(document: SourceDocument) -> str:
    """Return the indentation by which a child is deeper than its parent in this document."""
    for element in document.scan.elements:
        if element.parent is not None:
            inner, outer = _indent_of(document.text, element), _indent_of(document.text, element.parent)
            if inner is not None and outer is not None and inner.startswith(outer) and inner != outer:
                return inner[len(outer) :]
    return INDENT


def _line_break(text: str) -> str:
    at = text.find("\n")
    return "\r\n" if at > 0 and text[at - 1] == "\r" else "\n"
