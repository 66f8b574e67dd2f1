"""Complete tags, ports, values, scripts and blackboard keys."""

import re
from collections.abc import Iterable, Iterator
from os.path import relpath
from typing import Final, NamedTuple

from lsprotocol import types
from lsprotocol.types import CompletionItemKind as Kind

from btcore.blackboard.ports import KEY_ROLES, Port, PortRole
from btcore.names import is_port_name
from btcore.registry.manifest import Manifest, takes_children
from btcore.script import lexer
from btcore.status import NodeType
from btcore.values import BOOL, ValueType
from btcore.values.types import literals_of
from btcore.xml.models.tree_nodes_model import quoted
from btcore.xml.read.scan import Place, ScannedAttribute, ScannedElement
from btcore.xml.read.tags import EXPLICIT_TAGS, PORT_TAGS, SUBTREE_TAGS
from btcore_studio.language.descriptions import (
    CONDITION_ATTRIBUTES,
    ELEMENTS,
    SHARING_ATTRIBUTES,
    is_mandatory,
    node_markdown,
    port_markdown,
    port_signature,
    type_name,
)
from btcore_studio.language.entries import entry_facts, keys_of
from btcore_studio.language.key_links import KeyLinks, TreeKey, links_of
from btcore_studio.language.node_attributes import (
    file_symbols,
    is_in_tree,
    node_element,
    script_tokens,
    tree_of,
)
from btcore_studio.language.project import PROJECT_SUFFIX, Project, SourceDocument
from btcore_studio.language.project_symbols import ProjectSymbols, symbols_of
from btcore_studio.language.symbols import FileSymbols, KeyForm, TreeSymbol, is_call

TRIGGERS: Final = ("<", "/", " ", '"', "'", "{")
"""The characters after which a client requests completion."""

MAX_ITEMS: Final = 1_000
"""Maximum number of completion items. If there are more, items without the typed text are left out."""

_KIND_OF_NODE: Final = {
    NodeType.ACTION: Kind.Function,
    NodeType.CONDITION: Kind.Event,
    NodeType.CONTROL: Kind.Class,
    NodeType.DECORATOR: Kind.Interface,
}
# What a script can name: other keys can only be used by ports.
_NAME: Final = re.compile(r"[A-Za-z_@][A-Za-z0-9_]*")
# Characters with a meaning in snippets, and in the choices of a snippet.
_SPECIAL: Final = re.compile(r"[$}\\]")
_CHOICE: Final = re.compile(r"[,|\\$}]")
_CONTENT: Final = "\n\t$0\n"
_ROOT: Final = 'root BTCPP_format="4">\n\t<BehaviorTree ID="${1:Main}">\n\t\t$0\n\t</BehaviorTree>\n</root>'
_PROJECT: Final = 'root BTCPP_format="4" project_name="$1">\n\t<include path="$2"/>$0\n</root>'
_IN_ROOT: Final = {
    "BehaviorTree": f'BehaviorTree ID="$1">{_CONTENT}</BehaviorTree>',
    "include": 'include path="$1"/>$0',
    "TreeNodesModel": f"TreeNodesModel>{_CONTENT}</TreeNodesModel>",
}
_ATTRIBUTES: Final = {
    "root": {"BTCPP_format": "the XML format", "main_tree_to_execute": "the ID of the main tree"},
    "BehaviorTree": {"ID": "the ID of the tree"},
    "include": {"path": "a file relative to this file", "ros_pkg": "the ROS package that contains the file"},
    **{tag: {"name": "the name", "type": "the type", "default": "the default"} for tag in PORT_TAGS},
}
"""The attributes of elements outside of trees, with their descriptions."""


class _Item(NamedTuple):
    """A completion item, before its place in the list and the replaced range are known.

    Attributes:
        label: The shown name. It is inserted unless *inserted* or *snippet* is given.
        kind: The kind of the item.
        rank: The place of the item in the list; items of the same rank are sorted by label.
        detail: A short text after the label.
        about: The documentation in Markdown, or "".
        snippet: The inserted snippet, or "".
        value: The placeholder for the value of an attribute.
        inserted: The inserted text if there is no snippet or the client does not support snippets, or "".
        filter: The text that the client compares with the typed text; "" = the label.
    """

    label: str
    kind: Kind
    rank: int = 0
    detail: str = ""
    about: str = ""
    snippet: str = ""
    value: str = "$1"
    inserted: str = ""
    filter: str = ""


class _Replacement(NamedTuple):
    """The range of the text that the accepted item replaces, and the items."""

    start: int
    end: int
    items: Iterable[_Item]


def complete(
    project: Project,
    document: SourceDocument,
    offset: int,
    trigger: str = "",
    snippets: bool = True,
    markdown: bool = True,
) -> types.CompletionList:
    """Return the completion items at the cursor.

    Args:
        project: The project of the document.
        offset: The offset of the character after the cursor.
        trigger: The typed character that made the client request completion; "" = the user requested it.
        snippets: Whether the client supports snippets.
        markdown: Whether the client shows documentation as Markdown.
    """
    completion = _Completion(project, document, offset, trigger).find()
    if completion is None:
        return types.CompletionList(is_incomplete=False, items=[])
    ranked = sorted(completion.items, key=lambda item: (item.rank, item.label))
    is_incomplete = len(ranked) > MAX_ITEMS
    if is_incomplete:
        typed = document.text[completion.start : offset].casefold()
        ranked = [item for item in ranked if typed in (item.filter or item.label).casefold()]
    range = document.positions.range(completion.start, completion.end)
    if range.start.line != range.end.line:
        range = document.positions.range(offset, offset)  # a client replaces text in one line only
    items = [
        _completion_item(item, range, number, snippets, markdown)
        for number, item in enumerate(ranked[:MAX_ITEMS])
    ]
    return types.CompletionList(is_incomplete, items)


def _completion_item(
    item: _Item, range: types.Range, number: int, snippets: bool, markdown: bool
) -> types.CompletionItem:
    is_snippet = bool(item.snippet) and snippets
    about: types.MarkupContent | str | None = item.about or None
    if about and markdown:
        about = types.MarkupContent(types.MarkupKind.Markdown, item.about)
    return types.CompletionItem(
        item.label,
        kind=item.kind,
        detail=item.detail or None,
        documentation=about,
        sort_text=f"{number:04}",
        filter_text=item.filter or None,
        insert_text_format=types.InsertTextFormat.Snippet if is_snippet else types.InsertTextFormat.PlainText,
        text_edit=types.TextEdit(range, item.snippet if is_snippet else item.inserted or item.label),
    )


class _Completion:
    """The search for the items at one place.

    Attributes:
        project: The project.
        document: The document.
        offset: The offset of the character after the cursor.
        trigger: The typed character, or "".
        place: What the cursor is in.
    """

    def __init__(self, project: Project, document: SourceDocument, offset: int, trigger: str) -> None:
        self.project = project
        self.document = document
        self.offset = offset
        self.trigger = trigger
        self.text = document.text
        self.place: Place = document.scan.element_at(offset)
        self.symbols: ProjectSymbols = symbols_of(project)
        self.file: FileSymbols = file_symbols(project, document)
        self.format = self.file.format
        self.registry = project.registry

    def find(self) -> _Replacement | None:
        """Return the items; None if nothing can be completed here."""
        place, offset = self.place, self.offset
        before = self.text[offset - 1 : offset]
        if place.kind == "text":
            if self.trigger:
                return None  # a space or a quote in a text is no request
            start = self._word_start(place.start)
            return _Replacement(start, offset, self._tags("<"))
        if place.kind == "tag":
            end = place.end if place.element is not None else offset
            return _Replacement(place.start, max(end, offset), self._tags())
        if place.kind == "end_tag":
            return self._end_tag()
        element = place.element
        if element is None:
            return None
        if place.attribute is not None and place.kind == "attribute" and offset > place.start:
            return _Replacement(place.start, place.end, self._attributes(element, place.attribute))
        if place.kind in ("in_tag", "attribute") and before.isspace():
            return _Replacement(offset, offset, self._attributes(element, None))
        if place.kind == "value":
            return self._value(element)
        return None

    def _word_start(self, first: int) -> int:
        """Return the start of the word before the cursor, which does not begin before *first*."""
        at = self.offset
        while at > first and not self.text[at - 1].isspace() and self.text[at - 1] != ">":
            at -= 1
        return at

    # --- tags

    def _tags(self, opening: str = "") -> Iterator[_Item]:
        """Yield the tags that the element around the cursor may contain.

        Args:
            opening: "<" if it is not typed yet.
        """
        parent, element = self.place.parent, self.place.element
        if element is not None and (element.is_complete or element.attributes):
            # Only the name of a written tag is replaced.
            for item in self._children(parent, element):
                yield item._replace(snippet="", inserted="")
            return
        for item in self._children(parent, element):
            snippet = f"{opening}{item.snippet}" if item.snippet else ""
            filter = item.filter or item.label
            yield item._replace(
                snippet=snippet, inserted=f"{opening}{item.inserted or item.label}", filter=filter
            )
        if parent is not None and parent.end_tag_start < 0:
            end_tag = f"/{parent.tag}>"
            yield _Item(end_tag, Kind.Keyword, 9, "end tag", inserted=f"{opening}{end_tag}")

    def _children(self, parent: ScannedElement | None, edited: ScannedElement | None) -> Iterator[_Item]:
        if parent is None:
            if all(root is edited for root in self.document.scan.roots):
                path = self.document.path
                snippet = _PROJECT if path is not None and path.suffix == PROJECT_SUFFIX else _ROOT
                yield _Item("root", Kind.Struct, about=ELEMENTS["root"], snippet=snippet)
        elif parent.tag == "TreeNodesModel":
            for tag in (*EXPLICIT_TAGS, "SubTree"):
                yield _Item(tag, Kind.Struct, detail="model", snippet=f'{tag} ID="$1">{_CONTENT}</{tag}>')
        elif parent.parent is not None and parent.parent.tag == "TreeNodesModel":
            for tag in PORT_TAGS:
                yield _Item(tag, Kind.Field, snippet=f'{tag} name="$1" type="$2"/>')
        elif is_in_tree(parent):
            if self._takes_child(parent, edited):
                yield from self._nodes()
        elif parent.parent is None:
            for tag, snippet in _IN_ROOT.items():
                yield _Item(tag, Kind.Struct, about=ELEMENTS[tag], snippet=snippet)

    def _takes_child(self, parent: ScannedElement, edited: ScannedElement | None) -> bool:
        """Return whether one more child, in place of *edited*, is allowed in *parent*."""
        others = sum(child is not edited for child in parent.children)
        if parent.tag == "BehaviorTree":
            return others == 0
        if is_call(parent):
            return False
        manifest = node_element(parent, self.format, self.registry).manifest
        if manifest is None:
            return True
        most = manifest.spec.child_count_at_load[1]
        return most is None or others < most

    def _nodes(self) -> Iterator[_Item]:
        for manifest in self.registry.manifests_of(self.format).values():
            if manifest.type in _KIND_OF_NODE:
                kind = _KIND_OF_NODE[manifest.type]
                detail = manifest.type.name.lower()
                yield _Item(manifest.id, kind, 1, detail, node_markdown(manifest), _node_snippet(manifest))
        for tag in sorted(SUBTREE_TAGS[self.format]):
            yield _Item(tag, Kind.Module, 1, "call of a tree", snippet=f'{tag} ID="$1"/>$0')
            for id, is_visible in self._tree_ids():
                ports = self._inputs(id)
                snippet = f"{tag} ID={_in_snippet(quoted(id))}"
                for number, name in enumerate(ports, 1):
                    snippet += f' {_in_snippet(name)}="{self._outer_key_snippet(tag, name, number)}"'
                label = f"{tag} ID={quoted(id)}"
                yield _Item(
                    label,
                    Kind.Module,
                    2 if is_visible else 4,
                    "call of a tree",
                    snippet=f"{snippet}/>$0",
                    inserted=f"{label}/>",
                )
        for tag, type in EXPLICIT_TAGS.items():
            if self.registry.get(tag, self.format) is None:
                yield _Item(tag, _KIND_OF_NODE[type], 5, "explicit tag", snippet=f'{tag} ID="$1"/>$0')

    def _end_tag(self) -> _Replacement | None:
        place = self.place
        element = place.element if place.element is not None else place.parent
        if element is None:
            return None
        start = self.text.index("/", place.start) + 1
        is_closed = self.text[place.end - 1] == ">"
        end = place.end - 1 if is_closed else self.offset
        if not start <= self.offset <= end:
            return None
        item = _Item(
            element.tag, Kind.Keyword, detail="end tag", inserted=element.tag + ("" if is_closed else ">")
        )
        return _Replacement(start, end, [item])

    # --- attributes

    def _attributes(self, element: ScannedElement, edited: ScannedAttribute | None) -> Iterator[_Item]:
        """Yield the attributes that *element* does not have yet.

        Args:
            edited: The attribute whose name the item replaces; None for a new attribute.
        """
        present = {attribute.name for attribute in element.attributes if attribute is not edited}
        has_value = edited is not None and edited.value is not None
        for item in self._attributes_of(element):
            if item.label in present:
                continue
            if has_value:
                yield item
            else:
                gap = (
                    " " if self.text[self.offset : self.offset + 1].isidentifier() and edited is None else ""
                )
                snippet = f'{item.label}="{item.value}"$0{gap}'
                yield item._replace(snippet=snippet, inserted=f'{item.label}=""{gap}')

    def _attributes_of(self, element: ScannedElement) -> Iterator[_Item]:
        """Yield the attributes of *element*."""
        if tree_of(element) is not None:
            node = node_element(element, self.format, self.registry)
            if node.is_call:
                yield from self._attributes_of_call(element)
            elif node.manifest is not None:
                for port in node.manifest.ports.values():
                    rank = 0 if is_mandatory(node.manifest, port) else 1
                    signature, about = port_signature(port), port_markdown(node.manifest, port)
                    yield _Item(port.name, Kind.Field, rank, signature, about, value=_port_snippet(port, 1))
            if element.tag in EXPLICIT_TAGS:
                yield _Item("ID", Kind.Property, 0, "the ID of the node")
            yield _Item("name", Kind.Property, 2, "the name of the node")
            if self.format == 4:
                for name, about in CONDITION_ATTRIBUTES.items():
                    yield _Item(name, Kind.Operator, 3, "script", about)
            return
        for name, detail in _ATTRIBUTES.get(element.tag, {}).items():
            yield _Item(name, Kind.Property, 0, detail)
        if element.parent is not None and element.parent.tag == "TreeNodesModel":
            yield _Item("ID", Kind.Property, 0, "the ID of the node or tree")

    def _attributes_of_call(self, element: ScannedElement) -> Iterator[_Item]:
        id = element.get("ID") or ""
        yield _Item("ID", Kind.Property, 0, "the ID of the called tree")
        ports = self._model_ports(id)
        for name, default in ports.items():
            detail = f"= {default}" if default else "required by the model of the tree"
            value = self._outer_key_snippet(element.tag, name)
            yield _Item(name, Kind.Field, 1 if default else 0, detail, value=value)
        for tree in self.symbols.trees_called(id, self.file.file):
            links = links_of(self.project)
            for key in keys_of(links, tree):
                if key not in ports and _can_be_connected(key):
                    value = self._outer_key_snippet(element.tag, key)
                    yield _Item(key, Kind.Field, 1, self._type_of_key(links, tree, key), value=value)
        sharing = "__autoremap" if element.tag == "SubTreePlus" else "__shared_blackboard"
        name = "_autoremap" if self.format == 4 else sharing
        yield _Item(name, Kind.Property, 2, "bool", SHARING_ATTRIBUTES[name], value="true")

    def _takes_bare_keys(self, tag: str) -> bool:
        """Return whether a SubTree element takes keys without braces, as `<SubTree>` in format 3 does."""
        return self.format == 3 and tag == "SubTree"

    def _outer_key_snippet(self, tag: str, key: str, number: int = 1) -> str:
        if self._takes_bare_keys(tag):
            return f"${{{number}:{_in_snippet(_escape(key))}}}"
        return _key_snippet(key, number)

    def _model_ports(self, id: str) -> dict[str, str | None]:
        """Return the ports in the models of a tree with their defaults."""
        models = self.symbols.models(id, self.file.file, of_subtree=True)
        return {name: port.text for model in models for name, port in model.ports.items()}

    def _inputs(self, id: str) -> list[str]:
        """Return the keys that a call of a tree must connect: the mandatory ports of the tree's models.

        A tree without models needs the keys that it reads, but neither writes nor passes to another tree.
        """
        ports = self._model_ports(id)
        if ports:
            return [name for name, default in ports.items() if not default]
        read: dict[str, None] = {}
        for tree in self.symbols.trees_called(id, self.file.file):
            written = {use.key for use in tree.uses if use.writes}
            links = (port.outer for call in tree.calls for port in call.ports.values())
            known = written | {use.key for use in links if use is not None}
            uses = [use for use in tree.uses if use.reads and use.form is not KeyForm.DEFAULT]
            read |= dict.fromkeys(use.key for use in uses if use.key not in known)
        return [key for key in read if _can_be_connected(key)]

    def _type_of_key(self, links: KeyLinks, tree: TreeSymbol, key: str) -> str:
        entry_type = entry_facts(links, [TreeKey(tree, key)]).type
        return type_name(entry_type) if entry_type is not None else ""

    # --- values

    def _value(self, element: ScannedElement) -> _Replacement | None:
        attribute = self.place.attribute
        assert attribute is not None, "a value belongs to an attribute"
        name = attribute.name
        if tree_of(element) is None:
            return self._whole_value(self._values_outside_of_trees(element, name))
        if name == "ID":
            return self._whole_value(self._ids(element))
        node = node_element(element, self.format, self.registry)
        key_start = self._key_start()
        if node.is_script(name) and key_start is None:
            return self._names_in_script()
        port = node.port(name)
        if node.is_call:
            if name in SHARING_ATTRIBUTES:
                return self._whole_value(_literals(BOOL))
            port_type = self._type_of_called_key(element, name)
        else:
            port_type = port.type if port is not None else None
        is_port = port is not None or node.is_call or node.manifest is None
        if name == "name" or not is_port:
            return None
        if key_start is not None:
            return self._key_in_braces(key_start, name, port_type)
        takes_name = node.is_call and self._takes_bare_keys(element.tag)
        if port is not None:
            takes_name = port.role in KEY_ROLES and port.role is not PortRole.WATCHED_ENTRY
        return self._whole_value(self._port_values(port, name, port_type, takes_name))

    def _whole_value(self, items: Iterable[_Item]) -> _Replacement:
        return _Replacement(self.place.start, self.place.end, items)

    def _values_outside_of_trees(self, element: ScannedElement, name: str) -> Iterator[_Item]:
        if name == "BTCPP_format":
            yield _Item("4", Kind.Value, 0, "BehaviorTree.CPP 4, Groot 2")
            yield _Item("3", Kind.Value, 1, "BehaviorTree.CPP 3, Groot 1")
        elif name == "main_tree_to_execute" or (element.tag == "SubTree" and name == "ID"):
            yield from self._id_items()
        elif element.tag in PORT_TAGS and name == "type":
            manifests = self.registry.manifests_of(self.format).values()
            names = {port.type.name for manifest in manifests for port in manifest.ports.values()}
            yield from (_Item(_escape(type_name), Kind.TypeParameter) for type_name in names)
        elif element.tag == "include" and name == "path" and self.document.path is not None:
            for path in self.project.files:
                if path != self.document.path and path.suffix != PROJECT_SUFFIX:
                    yield _Item(_escape(relpath(path, self.document.path.parent)), Kind.File)

    def _ids(self, element: ScannedElement) -> Iterator[_Item]:
        """Yield the IDs that the `ID` of a SubTree element or an explicit tag can have."""
        if is_call(element):
            yield from self._id_items()
        elif element.tag in EXPLICIT_TAGS:
            for manifest in self.registry.manifests_of(self.format).values():
                if manifest.type is EXPLICIT_TAGS[element.tag]:
                    kind = _KIND_OF_NODE[manifest.type]
                    yield _Item(manifest.id, kind, 0, manifest.library, node_markdown(manifest))

    def _id_items(self) -> Iterator[_Item]:
        for id, is_visible in self._tree_ids():
            detail = "" if is_visible else "in a file that is not included"
            yield _Item(_escape(id), Kind.Module, 0 if is_visible else 1, detail)

    def _tree_ids(self) -> Iterator[tuple[str, bool]]:
        """Yield the IDs of all trees but the current tree, and whether this file can call the tree."""
        current = self._tree()
        for id, is_visible in self.symbols.tree_ids(self.file.file).items():
            if current is None or id != current.id:
                yield id, is_visible

    def _tree(self) -> TreeSymbol | None:
        """Return the tree that contains the cursor."""
        inside = self.place.element if self.place.element is not None else self.place.parent
        if inside is not None and inside.tag != "BehaviorTree":
            inside = tree_of(inside)
        return next((tree for tree in self.file.trees if tree.element is inside), None)

    # --- ports and keys

    def _port_values(
        self, port: Port | None, name: str, port_type: ValueType | None, takes_name: bool
    ) -> Iterator[_Item]:
        """Yield the literals and keys that the value of a port can be.

        Args:
            port: The port; None for an attribute of a SubTree element or of an unknown node.
            name: The name of the attribute.
            port_type: The type of the port; None if it is unknown.
            takes_name: Whether the value is the name of an entry, without braces.
        """
        if port_type is not None and not takes_name and (port is None or port.reads):
            yield from _literals(port_type)
        if port is not None and port.default and port.default not in literals_of(port.type):
            yield _Item(_escape(port.default), Kind.Value, 1, "default")
        for item in self._keys(port_type, "" if takes_name else name):
            yield item if takes_name else item._replace(label=f"{{{item.label}}}")
        if not takes_name:
            yield _Item("{=}" if self.format == 4 else "=", Kind.Variable, 6, f"the key {name}")

    def _key_start(self) -> int | None:
        """Return the offset after the brace before the cursor; None if the cursor is not in braces."""
        brace = self.text.rfind("{", self.place.start, self.offset)
        if brace < 0 or "}" in self.text[brace : self.offset]:
            return None
        return brace + 1

    def _key_in_braces(self, start: int, name: str, port_type: ValueType | None) -> _Replacement:
        closing = self.text.find("}", self.offset, self.place.end)
        end = closing if closing >= 0 else self.offset
        ending = "" if closing >= 0 else "}"
        items = (item._replace(inserted=item.label + ending) for item in self._keys(port_type, name))
        return _Replacement(start, end, items)

    def _keys(self, port_type: ValueType | None, name: str = "") -> Iterator[_Item]:
        """Yield the keys of the tree.

        Args:
            port_type: The type of the port: keys whose entries have this type come first.
            name: The name of the port: a key with this name comes first, too, or is offered as a new key.
        """
        tree = self._tree()
        links = links_of(self.project)
        if tree is None:
            return
        own = keys_of(links, tree)
        is_known = False
        for number, (key, uses) in enumerate(own.items()):
            # A key that is only being typed at the cursor is no candidate.
            if any(not use.start <= self.offset <= use.end or use.file != self.file.file for use in uses):
                is_searched = number < MAX_ITEMS  # the search for types takes time
                type = entry_facts(links, [TreeKey(tree, key)]).type if is_searched else None
                yield self._key_item(key, type, port_type, name)
                is_known = is_known or key == name
        for key in sorted({key.key for key in links.uses if key.key.startswith("@")} - own.keys()):
            yield self._key_item(key, None, port_type)
        if name and not is_known:
            yield _Item(_escape(name), Kind.Variable, 4, "new key")

    def _key_item(
        self, key: str, entry_type: ValueType | None, port_type: ValueType | None, name: str = ""
    ) -> _Item:
        """Return the item of a key, whose rank depends on *port_type* and the port's *name*."""
        rank = 2 if key == name else 3
        if entry_type is not None and port_type is not None:
            if entry_type.name == port_type.name:
                rank = 2
            elif port_type.strong:
                rank = 5
        detail = type_name(entry_type) if entry_type is not None else ""
        return _Item(_escape(key), Kind.Variable, rank, detail)

    def _type_of_called_key(self, element: ScannedElement, key: str) -> ValueType | None:
        links = links_of(self.project)
        for tree in self.symbols.trees_called(element.get("ID") or "", self.file.file):
            entry_type = entry_facts(links, [TreeKey(tree, key)]).type
            if entry_type is not None:
                return entry_type
        return None

    # --- scripts

    def _names_in_script(self) -> _Replacement | None:
        attribute = self.place.attribute
        assert attribute is not None, "a script is the value of an attribute"
        start = end = self.offset
        for token, token_start, token_end in script_tokens(self.text, attribute):
            if not token_start < self.offset <= token_end:
                continue
            is_inside_text = token.type == lexer.STRING and self.offset < token_end
            if token.type in (lexer.NAME, lexer.BOOLEAN):
                start, end = token_start, token_end
            elif is_inside_text or token.type in (lexer.INTEGER, lexer.REAL, lexer.MALFORMED):
                return None
        return _Replacement(start, end, self._script_items())

    def _script_items(self) -> Iterator[_Item]:
        for item in self._keys(None):
            if _NAME.fullmatch(item.label) is not None:
                yield item
        for name, number in self.registry.types.enums.items():
            yield _Item(name, Kind.EnumMember, 6, f"= {number}")
        yield from (_Item(word, Kind.Keyword, 7) for word in ("true", "false"))


def _can_be_connected(key: str) -> bool:
    """Return whether an attribute of a SubTree element can connect *key* of the called tree."""
    return key[:1] not in ("@", "_") and is_port_name(key)


def _literals(value_type: ValueType) -> Iterator[_Item]:
    item_kind = Kind.EnumMember if value_type is not BOOL else Kind.Value
    return (_Item(_escape(text), item_kind, 0, type_name(value_type)) for text in literals_of(value_type))


def _escape(text: str) -> str:
    """Return *text* as it is written in an attribute's value."""
    return quoted(text)[1:-1]


# --- snippets


def _node_snippet(manifest: Manifest) -> str:
    """Return a snippet of the element of a node with its mandatory ports, without the first `<`."""
    mandatory = [port for port in manifest.ports.values() if is_mandatory(manifest, port)]
    ports = "".join(
        f' {port.name}="{_port_snippet(port, number)}"' for number, port in enumerate(mandatory, 1)
    )
    if takes_children(manifest):
        return f"{manifest.id}{ports}>{_CONTENT}</{manifest.id}>"
    return f"{manifest.id}{ports}/>$0"


def _port_snippet(port: Port, number: int) -> str:
    """Return a placeholder for the value of a port.

    Args:
        number: The number of the placeholder in the snippet.
    """
    if port.role in KEY_ROLES:
        return f"${{{number}:key}}"
    literals = literals_of(port.type)
    is_literal = literals or port.type.converts or not port.type.strong
    if not port.reads or not is_literal:
        return _key_snippet(port.name, number)
    if literals:
        choices = ",".join(_CHOICE.sub(r"\\\g<0>", _escape(text)) for text in literals)
        return f"${{{number}|{choices}|}}"
    return f"${number}"


def _key_snippet(key: str, number: int = 1) -> str:
    """Return a placeholder for a key in braces."""
    return f"{{${{{number}:{_in_snippet(_escape(key))}}}}}"


def _in_snippet(text: str) -> str:
    """Return *text* as plain text of a snippet."""
    return _SPECIAL.sub(r"\\\g<0>", text)
