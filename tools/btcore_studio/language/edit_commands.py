"""Apply the operations of a page to drafts, and refuse what the rules of the language forbid.

An operation is refused with a reason and a way out. A document that has errors already stays editable: only
errors that the operation would add are reasons, and a node may lack children while a tree is being built.
"""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Final

from msgspec.structs import replace

from btcore.diagnostic_codes import (
    FIRST_TICK_REFUSED,
    MISSING_PORT,
    MISSING_SUBTREE_PORT,
    WRONG_CHILD_COUNT,
)
from btcore.diagnostics import Diagnostic
from btcore.xml.edit.editor import EditError
from btcore_studio.language import model_edits, node_edits, tree_edits
from btcore_studio.language.clipboard import copy_elements
from btcore_studio.language.diagnostics import report_of
from btcore_studio.language.drawing import draw_document
from btcore_studio.language.edit_drafts import Draft, Drafts, Rules, by_draft
from btcore_studio.language.node_edits import OF_PASTED_NODES
from btcore_studio.language.project import Project
from btcore_studio.language.studio_protocol import (
    Add,
    AddTree,
    AnyCommand,
    ChangeType,
    Disable,
    DrawingParams,
    Duplicate,
    EditResult,
    Enable,
    Extract,
    Inline,
    Move,
    NewWarnings,
    Paste,
    Place,
    Preview,
    Problem,
    Range,
    Remove,
    RemoveModel,
    RemoveTree,
    SetAttribute,
    SetMainTree,
    SetModel,
    TextEdit,
    Unwrap,
    WorkspaceEdit,
    Wrap,
)
from btcore_studio.language.tree_reading import TreeReading, read_trees

MAX_CHECKED: Final = 300
"""Number of elements of a document up to which each operation returns its new warnings: about 10 ms."""
MAX_PREVIEWED: Final = 1_000
"""Number of elements of a document up to which a preview has new warnings: about 50 ms."""
_MAX_WARNINGS: Final = 10
_UNFINISHED: Final = frozenset({WRONG_CHILD_COUNT, FIRST_TICK_REFUSED, MISSING_PORT, MISSING_SUBTREE_PORT})
"""Errors of a tree that is being built."""


def compute_edit(project: Project, command: AnyCommand, drawing: DrawingParams | None = None) -> EditResult:
    """Return the edit of an operation on the documents of a project. The documents remain.

    Args:
        drawing: What to draw after the edit, or None. With a drawing, the result lacks the new warnings:
            `last_warnings` returns them, because the search takes as long as the drawing.

    Raises:
        EditError: The operation cannot be applied; the message is the reason.
    """
    operation = _Operation(project, command)
    result = operation.result()
    if drawing is None or [*result.edit.changes] != [drawing.text_document.uri]:
        return replace(result, notes=list(dict.fromkeys([*result.notes, *operation.warnings()])))
    project.find_new_warnings = operation.warnings
    edited = operation.drafts.draft(drawing.text_document.uri).source
    return replace(result, drawing=draw_document(project, edited, drawing))


def last_warnings(project: Project) -> NewWarnings:
    """Return the new warnings of the last edit that was returned with a drawing."""
    find, project.find_new_warnings = project.find_new_warnings, list
    return NewWarnings(find())


def copy_nodes(project: Project, places: Sequence[Place]) -> str:
    """Return nodes as XML, with the nodes below them, and the trees and the models that they need.

    Raises:
        EditError: A place is not that of a node.
    """
    nodes = Drafts(project).outermost(places)
    return "".join(copy_elements(draft.reading, elements) for draft, elements in by_draft(nodes))


def preview_edit(project: Project, command: AnyCommand) -> Preview:
    """Return the problems that an operation would add. The documents remain.

    Raises:
        EditError: The operation cannot be applied; the message is the reason.
    """
    operation = _Operation(project, command)
    operation.result()
    return Preview(operation.problems(command))


def _apply(drafts: Drafts, command: AnyCommand) -> Rules:
    """Apply an operation, and return the rules for its result."""
    match command:
        case Add():
            return node_edits.add(drafts, command)
        case Paste():
            return node_edits.paste(drafts, command)
        case Move():
            node_edits.move(drafts, command)
        case Remove():
            node_edits.remove(drafts.outermost(command.nodes))
        case Duplicate():
            node_edits.duplicate(drafts.outermost(command.nodes))
        case Wrap():
            node_edits.wrap(drafts.outermost(command.nodes), command.id)
        case Unwrap():
            node_edits.unwrap(drafts.node(command.node))
        case ChangeType():
            node_edits.change_type(drafts.node(command.node), command.id)
        case SetAttribute():
            return node_edits.set_attribute(drafts.element(command.node), command.name, command.text)
        case Disable() | Enable():
            node_edits.toggle(drafts.nodes(command.nodes), isinstance(command, Disable))
        case Extract():
            tree_edits.extract(drafts.node(command.node), command.id)
        case Inline():
            tree_edits.inline(drafts.node(command.node))
        case AddTree():
            tree_edits.add_tree(drafts.document(command.uri), command.id)
        case RemoveTree():
            return tree_edits.remove_tree(drafts.project, drafts.draft(command.uri), command.id)
        case SetMainTree():
            tree_edits.set_main_tree(drafts.draft(command.uri), command.id)
        case SetModel():
            return model_edits.set_model(drafts, command)
        case RemoveModel():
            model_edits.remove_model(drafts.project, drafts.draft(command.uri), command.id)
    return Rules()


class _Operation:
    """An operation that was applied to drafts of the documents."""

    def __init__(self, project: Project, command: AnyCommand) -> None:
        self.drafts = Drafts(project)
        self._rules = _apply(self.drafts, command)

    def result(self) -> EditResult:
        """Return the edits, if they add no error that prevents the operation.

        Raises:
            EditError: The result has an error that the documents have not.
        """
        changes: dict[str, list[TextEdit]] = {}
        selected: list[Place] = []
        notes = [*self._rules.notes]
        for uri, draft in self.drafts.by_uri.items():
            source, before = draft.source, draft.reading.source
            if source.text != before.text:
                notes += self._check(draft)
                changes[uri] = [
                    TextEdit(Range(before.position(start), before.position(end)), text)
                    for start, end, text in draft.edits
                ]
            for offset in dict.fromkeys(draft.selected):
                selected.append(Place(uri, source.position(offset)))
        return EditResult(WorkspaceEdit(changes), selected, list(dict.fromkeys(notes)))

    def _check(self, draft: Draft) -> Iterator[str]:
        """Yield the tolerated errors that the edits add.

        Raises:
            EditError: The edits add another error.
        """
        before = draft.reading
        if before.broken:
            if any(edit.end > before.fault for edit in draft.edits):
                raise before.not_xml_error()
            return
        after = read_trees(self.drafts.project, draft.source)
        if after.broken:
            raise EditError(f"the result would not be XML ({after.broken})")
        if self._rules.is_renaming:
            return  # the other documents of the project have the old names
        for error in draft.new(after.plans.diagnostics.errors, lambda: before.plans.diagnostics.errors):
            if error.code not in _UNFINISHED | self._rules.tolerated:
                raise EditError(f"{error.message}: {error.hint}" if error.hint else error.message)
            if error.code not in OF_PASTED_NODES and not self._is_to_be_completed(draft, error):
                yield error.message

    def warnings(self) -> list[str]:
        """Return the warnings that the edits of the operation add. Call `result` first."""
        return [message for draft in self.drafts.by_uri.values() for message in self._warnings_about(draft)]

    def _warnings_about(self, draft: Draft) -> Iterator[str]:
        before = draft.reading
        if before.broken or not draft.edits or self._rules.is_renaming:
            return
        after = read_trees(self.drafts.project, draft.source)
        if self._rules.always_warns or after.size <= MAX_CHECKED:
            new = draft.new(after.diagnostics.warnings, lambda: before.diagnostics.warnings)
            if before.plans.diagnostics.errors:
                # Not all warnings of a document with errors are known: elsewhere, a warning may be old.
                new = [item for item in new if draft.marks(item)]
            yield from (item.message for item in new[:_MAX_WARNINGS])

    def _is_to_be_completed(self, draft: Draft, item: Diagnostic) -> bool:
        """Return whether a diagnostic is about the attributes or missing children of a new node."""
        is_missing = bool(item.attributes) or item.code in _UNFINISHED
        return self._rules.adds_node and is_missing and draft.marks(item)

    def problems(self, command: AnyCommand) -> list[Problem]:
        """Return the problems that the edits of the operation add.

        A new node is to be completed, in its form. The text of an attribute keeps the problems that it has.
        """
        attribute = command.name if isinstance(command, SetAttribute) else ""
        problems: dict[str, Problem] = {}
        for draft in self.drafts.by_uri.values():
            if draft.reading.broken or not draft.edits:
                continue
            after = read_trees(self.drafts.project, draft.source)
            is_large = after.size > MAX_PREVIEWED
            found = _found_in(after, is_large)
            new = draft.new(found, partial(_found_in, draft.reading, is_large))
            kept = [item for item in found if attribute in item.attributes and draft.marks(item)]
            shown = [*kept, *(item for item in new if not self._is_to_be_completed(draft, item))]
            reports = [report_of(item) for item in shown[:_MAX_WARNINGS]]
            problems |= {report.message: report.problem() for report in reports}
        return sorted(problems.values(), key=lambda problem: problem.severity)


def _found_in(reading: TreeReading, is_large: bool) -> list[Diagnostic]:
    """Return the errors and warnings about a document; without warnings, if it is large."""
    if is_large:
        return list(reading.plans.diagnostics.errors)
    return [*reading.diagnostics.errors, *reading.diagnostics.warnings]
