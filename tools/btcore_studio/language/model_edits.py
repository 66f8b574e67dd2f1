"""The operations on the models of nodes and trees."""

from btcore.blackboard.ports import Port
from btcore.names import FORBIDDEN, RESERVED_IDS, port_name_error
from btcore.registry.nodes_without_code import is_mock
from btcore.registry.registration_checks import default_value_error
from btcore.xml.edit.editor import Edit, EditError, escape_value
from btcore.xml.read.scan import ScannedElement
from btcore.xml.read.tags import PORT_TAGS
from btcore_studio.language.edit_drafts import Draft, Drafts, Rules
from btcore_studio.language.element_texts import DIRECTIONS, is_port, port_text
from btcore_studio.language.node_models import type_named
from btcore_studio.language.project import Project
from btcore_studio.language.project_symbols import symbols_of
from btcore_studio.language.rename import XML_NAME, RenameError, rename_node_type
from btcore_studio.language.studio_protocol import SetModel


class FieldError(EditError):
    """A text in the form of a node type cannot be written.

    Args:
        message: The reason.
        field: "id", or "ports", the index of the port and the name of the member, such as "ports/0/name".
    """

    def __init__(self, message: str, field: str) -> None:
        super().__init__(message)
        self.field = field


def set_model(drafts: Drafts, command: SetModel) -> Rules:
    """Add or change the model of a node or a tree."""
    draft = drafts.document(command.uri)
    names = [port.name for port in command.ports]
    for number, port in enumerate(command.ports):
        if port.name in names[:number]:
            raise FieldError(
                f"two ports have the name '{port.name}': rename one of them", f"ports/{number}/name"
            )
        if error := port_name_error(port.name, draft.format):
            raise FieldError(f"'{port.name}' cannot be the name of a port: {error}", f"ports/{number}/name")
    old = command.before or command.id
    before = next(draft.models(old), None)
    is_name = XML_NAME.fullmatch(command.id) is not None or (before is not None and old == command.id)
    if not is_name or not FORBIDDEN.isdisjoint(command.id) or command.id in RESERVED_IDS:
        way_out = "use letters, digits, '_' and '-', and begin with a letter"
        raise FieldError(f"'{command.id}' cannot be the ID of a node: {way_out}", "id")
    is_renaming = False
    if command.type != "SubTree":
        known = draft.reading.nodes.get(command.id, draft.format)
        if known is not None and not is_mock(known.cls):
            reason = f"the node '{command.id}' has code, which declares its ports: choose another ID"
            raise FieldError(reason, "id")
        _check_defaults(draft, command, before)
        _check_removed_ports(drafts.project, old, before, {*names, *command.renamed})
        is_renaming = _rename_type(drafts, old, command)
    before = next(draft.models(command.id), None)
    if before is None:
        draft.insert_models([f'<{command.type} ID="{escape_value(command.id)}"/>'])
    elif before.tag != command.type:
        draft.apply(draft.editor.rename_element(before, command.type))
    _set_ports(draft, command)
    return Rules(is_renaming=is_renaming)


def _check_defaults(draft: Draft, command: SetModel, before: ScannedElement | None) -> None:
    """Refuse a new default that is not a value of its port's type."""
    nodes = draft.reading.nodes
    directions = {name: direction for direction, name in DIRECTIONS.items()}
    written = before.children if before is not None else []
    for number, port in enumerate(command.ports):
        is_written = any(
            item.get("name") == port.name and is_port(item, port, draft.text) for item in written
        )
        if not port.default or not port.type or is_written:
            continue
        declared = Port(
            port.name or "port", directions[port.direction], type_named(nodes, port.type), port.default
        )
        if error := default_value_error(declared):
            raise FieldError(
                f"'{port.default}' cannot be the default of the type {port.type}: {error}",
                f"ports/{number}/default",
            )


def _check_removed_ports(project: Project, id: str, before: ScannedElement | None, kept: set[str]) -> None:
    """Refuse to remove a port that a tree uses."""
    declared = before.children if before is not None else []
    removed = {child.get("name") or "" for child in declared if child.tag in PORT_TAGS} - kept
    symbols = symbols_of(project)
    for uri, element in symbols.nodes(id) if removed else ():
        used = next((item.name for item in element.attributes if item.name in removed), None)
        if used is not None:
            place = symbols.place(uri, element.start)
            raise EditError(
                f"<{id}> in {place} uses the port '{used}': remove this attribute, or rename the port"
            )


def _rename_type(drafts: Drafts, id: str, command: SetModel) -> bool:
    """Rename a node type and its ports in all files. Return whether there was something to rename."""
    ports = {name: new for name, new in command.renamed.items() if name != new}
    if id == command.id and not ports:
        return False
    try:
        changes = rename_node_type(drafts.project, id, command.id, ports)
    except RenameError as error:
        raise FieldError(str(error), "id") from None
    for uri, edits in changes.items():
        draft = drafts.draft(uri)
        shift = draft.reading.source.mark_length
        draft.apply([Edit(start - shift, end - shift, text) for start, end, text in edits])
    return True


def remove_model(project: Project, draft: Draft, id: str) -> None:
    """Remove the models of a node that no tree uses."""
    symbols = symbols_of(project)
    used = next(symbols.nodes(id), None)
    if used is not None:
        place = symbols.place(used[0], used[1].start)
        raise EditError(f"<{id}> is used in {place}: remove these nodes first, or change their type")
    models = list(draft.models(id))
    if not models:
        raise EditError(f"there is no model of '{id}' in this document")
    draft.apply([draft.editor.remove(model) for model in models])


def _set_ports(draft: Draft, command: SetModel) -> None:
    """Write the ports of a model. Ports that do not change keep their text."""
    model = draft.found(draft.models(command.id))
    declared = [child for child in model.children if child.tag in PORT_TAGS]
    ports = {child.get("name") or "": child for child in declared}
    wanted = {port.name: port for port in command.ports}
    if [name for name in ports if name in wanted] != [name for name in wanted if name in ports]:
        kept = set()  # their order changes
    else:
        kept = ports.keys() & wanted.keys()
    editor = draft.editor
    edits: list[Edit] = []
    for child in declared:
        name = child.get("name") or ""
        if name not in kept or child is not ports[name]:
            edits.append(editor.remove(child))
        elif not is_port(child, wanted[name], draft.text):
            edits.append(Edit(child.start, child.end, port_text(wanted[name])))
    draft.apply(edits)
    added = [port_text(port) for name, port in wanted.items() if name not in kept]
    if added:
        model = draft.found(draft.models(command.id))
        places = [index for index, child in enumerate(model.children, 1) if child.tag in PORT_TAGS]
        draft.apply([draft.editor.insert(model, places[-1] if places else 0, "\n".join(added))])
