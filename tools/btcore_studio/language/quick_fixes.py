"""Quick fixes: the fixes of the diagnostics, and the conversion to format 4."""

from lsprotocol import types

from btcore.errors import BtcoreError
from btcore.xml.define import parse_format
from btcore.xml.edit.editor import Edit
from btcore.xml.edit.quick_fixes import QuickFix
from btcore_studio.convert.convert import convert
from btcore_studio.edit.text_edits import difference
from btcore_studio.language.project import Project, SourceDocument


def code_actions(
    project: Project, document: SourceDocument, params: types.CodeActionParams
) -> list[types.CodeAction]:
    """Return the fixes for the reports in a range, and the conversion of a document of format 3.

    Args:
        params: The range, and the kinds of actions that the client wants.
    """
    actions: list[types.CodeAction] = []
    fixes: dict[tuple[Edit, ...], types.CodeAction] = {}  # a change can remove several diagnostics
    if _wants(params, types.CodeActionKind.QuickFix):
        for report in project.reports(document):
            if _overlap(report.range, params.range):
                for index, fix in enumerate(report.fixes):
                    new = _action(document, fix, types.CodeActionKind.QuickFix)
                    action = fixes.setdefault(fix.edits, new)
                    action.diagnostics = [*(action.diagnostics or ()), report.diagnostic()]
                    action.is_preferred = index == 0 or action.is_preferred
        actions += fixes.values()
    if _wants(params, types.CodeActionKind.RefactorRewrite):
        conversion = convert_to_4(project, document)
        if conversion is not None:
            actions.append(_action(document, conversion, types.CodeActionKind.RefactorRewrite))
    return actions


def convert_to_4(project: Project, document: SourceDocument) -> QuickFix | None:
    """Return the conversion of a document of format 3; None for any other document."""
    root = next(iter(document.scan.roots), None)
    if root is None or root.tag != "root" or parse_format(root.get("BTCPP_format")) != 3:
        return None
    parsed = project.parse(document)
    if parsed is None:
        return None
    try:
        converted = convert(parsed, project.registry).text
    except BtcoreError:
        return None
    edits = (difference(document.text, converted),)  # so that the cursor keeps its place
    return QuickFix("Convert the document to format 4", edits, is_safe=False)


def _wants(params: types.CodeActionParams, kind: types.CodeActionKind) -> bool:
    only = params.context.only
    return only is None or any(kind == item or kind.startswith(f"{item}.") for item in only)


def _overlap(first: types.Range, second: types.Range) -> bool:
    return first.start <= second.end and second.start <= first.end


def _action(document: SourceDocument, fix: QuickFix, kind: types.CodeActionKind) -> types.CodeAction:
    changes = {document.uri: document.text_edits(fix.edits)}
    return types.CodeAction(fix.title, kind, edit=types.WorkspaceEdit(changes))
