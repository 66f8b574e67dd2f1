"""Rename trees, nodes and blackboard keys in all files of a project, so that the trees behave as before."""

import re
from collections.abc import Mapping
from typing import Final, NamedTuple

from lsprotocol.types import LSPErrorCodes, PrepareRenamePlaceholder, WorkspaceEdit
from pygls.exceptions import JsonRpcException

from btcore.blackboard.ports import remapped_key
from btcore.names import RESERVED_IDS, forbidden_in, port_name_error
from btcore.registry.nodes_without_code import is_mock
from btcore.script import lexer
from btcore.xml.edit.editor import Edit
from btcore.xml.models.tree_nodes_model import quoted
from btcore.xml.read.scan import ScannedAttribute, ScannedElement
from btcore.xml.read.tags import EXPLICIT_TAGS, PORT_TAGS
from btcore_studio.language.key_links import MAX_LINKS, KeyLinks, TreeKey, links_of
from btcore_studio.language.navigation import NamedKey, NamedNode, NamedTree, named_at, node_span
from btcore_studio.language.project import Project, SourceDocument
from btcore_studio.language.project_symbols import ProjectSymbols, symbols_of
from btcore_studio.language.symbols import KeyForm, KeyUse, TreeSymbol, is_call, node_id

MAX_NAME_LENGTH: Final = 1_000
"""Maximum number of characters of a new name."""
# The names of XML 1.0 without ":", which would need a declared prefix.
XML_NAME: Final = re.compile(
    "[A-Za-z_\u00c0-\u00d6\u00d8-\u00f6\u00f8-\u02ff\u0370-\u037d\u037f-\u1fff\u200c-\u200d\u2070-\u218f"
    "\u2c00-\u2fef\u3001-\ud7ff\uf900-\ufdcf\ufdf0-\ufffd\U00010000-\U000effff]"
    "[-.0-9A-Za-z_\u00b7\u00c0-\u00d6\u00d8-\u00f6\u00f8-\u037d\u037f-\u1fff\u200c-\u200d\u203f-\u2040"
    "\u2070-\u218f\u2c00-\u2fef\u3001-\ud7ff\uf900-\ufdcf\ufdf0-\ufffd\U00010000-\U000effff]*"
)


class RenameError(JsonRpcException):
    """What the cursor is on cannot be renamed, or not to the new name. The editor shows the message."""

    CODE = LSPErrorCodes.RequestFailed.value


class NodeName(NamedTuple):
    """The cursor is on the `name` of a node in a tree."""

    tree: TreeSymbol
    element: ScannedElement
    attribute: ScannedAttribute


FileEdits = dict[str, list[Edit]]
"""The edits of each file, by URI."""
_FileEdit = tuple[str, Edit]


_Target = NamedKey | NamedTree | NamedNode | NodeName


def prepare_rename(project: Project, document: SourceDocument, offset: int) -> PrepareRenamePlaceholder:
    """Return the name at the cursor and its place.

    Raises:
        RenameError: There is nothing that can be renamed.
    """
    links = links_of(project)
    target = _target_at(project, links, document, offset)
    if isinstance(target, NamedKey):
        use = target.use
        name, start, end = _plain_name(links.symbols, use), use.start, use.end
        if use.form is not KeyForm.OF_PORT:
            start += len(use.key) - len(name)
    elif isinstance(target, NodeName):
        attribute = target.attribute
        name, start, end = attribute.value or "", attribute.value_start, attribute.value_end
    else:
        name, start, end = target.id, target.start, target.end
    return PrepareRenamePlaceholder(range=document.positions.range(start, end), placeholder=name)


def rename_symbol(project: Project, document: SourceDocument, offset: int, new_name: str) -> FileEdits:
    """Return the edits of all files that rename what the cursor is on.

    A key is renamed in its tree. SubTree elements that remap the key keep the key on their other side;
    `_autoremap`, shared blackboards and `@` make several trees use one name, so it changes in all of them.
    The code of programs and leaves is not changed, nor are texts that name a key when the tree runs.

    Raises:
        RenameError: There is nothing that can be renamed, or the new name is invalid or in use.
    """
    links = links_of(project)
    target = _target_at(project, links, document, offset)
    if not new_name or len(new_name) > MAX_NAME_LENGTH:
        raise RenameError(f"a name has 1 to {MAX_NAME_LENGTH:,} characters")
    if not new_name.isprintable():
        raise RenameError(f"the name {new_name!r} contains a control character")
    if isinstance(target, NamedKey):
        edits = _rename_key(project, links, target, new_name)
    elif isinstance(target, NamedTree):
        edits = _rename_tree(links.symbols, document, target, new_name)
    elif isinstance(target, NamedNode):
        edits = _rename_node(links.symbols, target.id, new_name)
    else:
        edits = _rename_instance(document, target, new_name)
    return _by_file(edits)


def rename_node_type(project: Project, id: str, new_id: str, ports: Mapping[str, str]) -> FileEdits:
    """Return the edits of all files that rename a node type without code, and its ports.

    Args:
        id: The ID of the node type.
        new_id: The new ID, or the same.
        ports: The new name of each port that gets another name.

    Raises:
        RenameError: The node has code, or a new name is invalid or in use.
    """
    symbols = symbols_of(project)
    _check_has_no_code(project, symbols, id)
    return _by_file([*_rename_node(symbols, id, new_id), *_rename_ports(symbols, id, ports)])


def _by_file(edits: list[_FileEdit]) -> FileEdits:
    changes: FileEdits = {}
    for file, edit in sorted(set(edits)):
        changes.setdefault(file, []).append(edit)
    return changes


def _target_at(project: Project, links: KeyLinks, document: SourceDocument, offset: int) -> _Target:
    named = named_at(links, document, offset)
    if isinstance(named, NamedKey):
        _check_key(project, links, named.keys)
        return named
    if isinstance(named, NamedTree):
        places = links.symbols.places_of_tree(named.id, document.uri)
        if not any(is_definition for *_, is_definition in places):
            raise RenameError(f"no file of the project defines the tree '{named.id}'")
        return named
    if isinstance(named, NamedNode):
        _check_node(project, links.symbols, named)
        return named
    place = document.scan.element_at(offset)
    element, attribute = place.element, place.attribute
    if element is not None and attribute is not None and attribute.name == "name" and place.kind == "value":
        for tree in links.symbols.files[document.uri].trees:
            if element in tree.nodes:
                return NodeName(tree, element, attribute)
    raise RenameError("trees, blackboard keys, names of nodes, and nodes with a model can be renamed here")


# --- keys


def _check_key(project: Project, links: KeyLinks, keys: list[TreeKey]) -> None:
    """Raise a RenameError if one of the places that name the key cannot be changed."""
    if not links.is_complete:
        raise RenameError(f"the trees of the project have more than {MAX_LINKS:,} connections of keys")
    renamed = links.same_name_keys(keys)
    for use in links.uses_of(renamed):
        if use.form is KeyForm.DEFAULT:
            node = node_id(use.element)
            line = links.symbols.documents[use.file].positions.line(use.element.start) + 1
            raise RenameError(
                f"'{use.key}' is the default of the port '{use.port}' of <{node}> in line {line}: "
                f'write {use.port}="{{{use.key}}}" there first'
            )
    for key in renamed:
        if key.key in project.settings.given and links.is_outermost(key):
            raise RenameError(
                f"according to the setting 'given' the program sets '{key.key}': rename it in the program"
            )


def _rename_key(project: Project, links: KeyLinks, target: NamedKey, new_name: str) -> list[_FileEdit]:
    symbols = links.symbols
    renamed = links.same_name_keys(target.keys)
    uses = links.uses_of(renamed)
    for use in uses:
        _check_new_key(symbols, use, new_name)
    old = _plain_name(symbols, target.use)
    if old == new_name:
        return []
    for key in renamed:
        taken = TreeKey(key.tree, _renamed(symbols, key, new_name))
        is_given = new_name in project.settings.given and links.is_outermost(key)
        if taken in links.uses or is_given:
            raise RenameError(f"the tree '{key.tree.id}' uses the key '{taken.key}' already")
        if old.startswith("_") != new_name.startswith("_") and links.is_called_with_autoremap(key.tree):
            raise RenameError(
                "keys that begin with '_' are not remapped automatically: the trees would change"
            )
    edits = {use: _key_edit(symbols, use, new_name) for use in uses}
    for inner, outer in links.own_name_remaps:
        if inner in edits and outer in edits:
            del edits[outer]  # both names change: "{=}" still means the same key
        elif inner in edits:
            edits[outer] = (outer.file, Edit(outer.start, outer.end, _escaped(f"{{{outer.key}}}")))
    return list(edits.values())


def _renamed(symbols: ProjectSymbols, key: TreeKey, new_name: str) -> str:
    is_global = key.key.startswith("@") and symbols.files[key.tree.file].format == 4
    return f"@{new_name}" if is_global else new_name


def _plain_name(symbols: ProjectSymbols, use: KeyUse) -> str:
    """Return the key without the `@`, which is not part of its name."""
    return use.key.removeprefix("@") if symbols.files[use.file].format == 4 else use.key


def _key_edit(symbols: ProjectSymbols, use: KeyUse, new_name: str) -> _FileEdit:
    if use.form is KeyForm.OF_PORT:
        return use.file, Edit(use.start, use.end, _escaped(f"{{{new_name}}}"))
    start = use.start + len(use.key) - len(_plain_name(symbols, use))
    text = new_name if use.form is KeyForm.ATTRIBUTE else _escaped(new_name)
    return use.file, Edit(start, use.end, text)


def _check_new_key(symbols: ProjectSymbols, use: KeyUse, new_name: str) -> None:
    """Raise a RenameError if *use* cannot have the new name."""
    file = symbols.files[use.file]
    enums = symbols.registry.types.enums
    if new_name.startswith("@") and file.format == 4:
        raise RenameError("a key with '@' is the key of the main tree: rename it without '@'")
    if use.form is KeyForm.SCRIPT:
        tokens = lexer.tokenize(new_name)
        is_name = tokens[0].type == lexer.NAME and tokens[0].width == len(new_name)
        if not is_name or new_name in enums:
            place = symbols.place(use.file, use.start)
            raise RenameError(
                f"'{new_name}' is not a name in scripts, and {place} uses the key: "
                "use ASCII letters, digits and '_'"
            )
    elif use.form is KeyForm.ATTRIBUTE or use.form is KeyForm.MODEL:
        error = port_name_error(new_name, file.format)
        if not error and XML_NAME.fullmatch(new_name) is None:
            error = "it is not a name in XML"
        if not error and file.format == 3 and new_name in ("__autoremap", "__shared_blackboard"):
            error = "this attribute is reserved"
        if error:
            place = symbols.place(use.file, use.start)
            raise RenameError(f"'{new_name}' is not valid as an attribute, which {place} needs: {error}")
    elif new_name == "=" or not set("{}").isdisjoint(new_name):
        raise RenameError(f"'{new_name}' is not a key: '=' and braces have another meaning")


# --- trees


def _rename_tree(
    symbols: ProjectSymbols, document: SourceDocument, target: NamedTree, new_name: str
) -> list[_FileEdit]:
    if new_name == target.id:
        return []
    places = list(symbols.places_of_tree(target.id, document.uri))
    formats = {symbols.files[file].format for file, *_ in places}
    if 4 in formats:
        character = forbidden_in(new_name)
        if character:
            raise RenameError(f"invalid tree ID '{new_name}': {character!r} is not allowed")
        if new_name in RESERVED_IDS:
            raise RenameError(f"invalid tree ID '{new_name}': the name is reserved")
        if symbols.node_models(new_name) or symbols.registry.is_taken(new_name, 4):
            raise RenameError(f"invalid tree ID '{new_name}': a node has this name")
    for file in {file for file, *_ in places}:
        for other_file in symbols.files_of_tree(new_name, file):
            if other_file in symbols.visible_files(file):
                raise RenameError(f"{symbols.file_name(other_file)} names a tree '{new_name}' already")
    text = _escaped(new_name)
    return [(file, Edit(attribute.value_start, attribute.value_end, text)) for file, attribute, _ in places]


# --- nodes


def _check_node(project: Project, symbols: ProjectSymbols, named: NamedNode) -> None:
    """Raise a RenameError if the node is not declared by a model alone."""
    if named.port:
        raise RenameError(f"the code of <{named.id}> declares its port '{named.port}': rename it there")
    _check_has_no_code(project, symbols, named.id)
    if not symbols.node_models(named.id):
        raise RenameError(f"no <TreeNodesModel> of the project declares the node '{named.id}'")


def _check_has_no_code(project: Project, symbols: ProjectSymbols, id: str) -> None:
    known = project.models.get(id)
    if known is not None and known.file.endswith(".py"):
        raise RenameError(f"the Python code of <{id}> declares its ID: rename it in {known.file}")
    registered = symbols.registry.get(id, 4) or symbols.registry.get(id, 3)
    if registered is not None and not is_mock(registered.cls):
        raise RenameError(f"<{id}> is a node of {registered.library}")


def _rename_node(symbols: ProjectSymbols, id: str, new_name: str) -> list[_FileEdit]:
    if new_name == id:
        return []
    character = forbidden_in(new_name)
    if character:
        raise RenameError(f"invalid ID of a node '{new_name}': {character!r} is not allowed")
    if (
        new_name in RESERVED_IDS
        or new_name in EXPLICIT_TAGS
        or new_name in ("BehaviorTree", "TreeNodesModel")
    ):
        raise RenameError(f"invalid ID of a node '{new_name}': the name is reserved")
    is_taken = any(symbols.registry.get(new_name, format) is not None for format in (3, 4))
    if is_taken or symbols.node_models(new_name) or any(symbols.nodes(new_name)):
        raise RenameError(f"the project has a node '{new_name}' already")
    if new_name in symbols.trees:
        raise RenameError(f"the project has a tree '{new_name}' already")
    text = _escaped(new_name)
    edits: list[_FileEdit] = []
    for model in symbols.node_models(id):
        edits.append((model.file, Edit(*node_span(model.element), text)))
    for file, element in symbols.nodes(id):
        edits.append((file, Edit(*node_span(element), text)))
        if element.tag not in EXPLICIT_TAGS:
            if XML_NAME.fullmatch(new_name) is None:
                raise RenameError(f"'{new_name}' cannot be a tag: it is not a name in XML")
            if element.end_tag_start >= 0:
                at = symbols.documents[file].text.index(element.tag, element.end_tag_start)
                edits.append((file, Edit(at, at + len(element.tag), text)))
    return edits


def _rename_ports(symbols: ProjectSymbols, id: str, ports: Mapping[str, str]) -> list[_FileEdit]:
    """Return the edits of the models and of the attributes of a node."""
    edits: list[_FileEdit] = []
    for model in symbols.node_models(id):
        for port in model.element.children:
            name = port.attribute("name")
            new_name = ports.get(name.value or "") if name is not None else None
            if name is not None and new_name is not None and port.tag in PORT_TAGS:
                edit = Edit(name.value_start, name.value_end, _escaped(new_name))
                edits.append((model.file, edit))
    for file, element in symbols.nodes(id):
        for attribute in element.attributes:
            new_name = ports.get(attribute.name)
            if new_name is None:
                continue
            if XML_NAME.fullmatch(new_name) is None:
                raise RenameError(f"'{new_name}' cannot be an attribute: it is not a name in XML")
            if new_name not in ports and element.attribute(new_name) is not None:
                place = symbols.place(file, element.start)
                raise RenameError(f"<{id}> in {place} has an attribute '{new_name}': remove it first")
            edits.append((file, Edit(attribute.start, attribute.name_end, new_name)))
            format = symbols.files[file].format
            if remapped_key(attribute.value or "", "", format) == "":  # the key with the name of the port
                key = _escaped(f"{{{attribute.name}}}")
                edits.append((file, Edit(attribute.value_start, attribute.value_end, key)))
    return edits


def _rename_instance(document: SourceDocument, target: NodeName, new_name: str) -> list[_FileEdit]:
    attribute = target.attribute
    for call in target.tree.calls if is_call(target.element) else ():
        if call.element is not target.element and call.element.get("name") == new_name:
            message = f"another SubTree element of '{target.tree.id}' has the name '{new_name}' already"
            raise RenameError(message)
    return [(document.uri, Edit(attribute.value_start, attribute.value_end, _escaped(new_name)))]


# --- edits


def workspace_edit(project: Project, changes: FileEdits) -> WorkspaceEdit:
    """Return *changes* of the files of *project* as the protocol describes them."""
    documents = symbols_of(project).documents
    return WorkspaceEdit(changes={file: documents[file].text_edits(edits) for file, edits in changes.items()})


def _escaped(text: str) -> str:
    """Return *text* as it is written in an attribute with either quotes."""
    return quoted(text)[1:-1]
