"""Read what a document defines and names: trees, calls of trees, models, includes, and blackboard keys.

The symbols are read from the scan of the text, so a document that is being edited has symbols as well.
"""

import enum
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Final

from btcore.blackboard.ports import SCRIPT_ROLES, Port, braced_key, remapped_key
from btcore.names import SCRIPT_ATTRIBUTES
from btcore.registry.manifest import Manifest
from btcore.registry.registry import Registry
from btcore.script import lexer
from btcore.xml.define import parse_format
from btcore.xml.plan.key_uses import (
    NON_KEY_ATTRIBUTES,
    READING,
    WRITING,
    AccessKind,
    find_name_uses,
    port_uses,
)
from btcore.xml.plan.tree_plan import SubtreeCall
from btcore.xml.read.scan import Scan, ScannedAttribute, ScannedElement, value_offsets
from btcore.xml.read.tags import EXPLICIT_TAGS, PORT_TAGS, SUBTREE_TAGS

_CALL_TAGS: Final = SUBTREE_TAGS[3]


class KeyForm(enum.Enum):
    """How a key is written.

    - BRACED: in braces, as `{key}`.
    - OF_PORT: as `=` or `{=}`, which stand for the name of the port.
    - SCRIPT: as a name in a script.
    - BARE: as the whole text of a port, without braces.
    - ATTRIBUTE: as the name of an attribute of a SubTree element.
    - MODEL: as the name of a port in the model of a subtree.
    - DEFAULT: not written: the key is the default of a port that the document does not set.
    """

    BRACED = enum.auto()
    OF_PORT = enum.auto()
    SCRIPT = enum.auto()
    BARE = enum.auto()
    ATTRIBUTE = enum.auto()
    MODEL = enum.auto()
    DEFAULT = enum.auto()


@dataclass(slots=True, eq=False)  # not frozen: a document has thousands of uses, and creating them takes time
class KeyUse:
    """One place that names a blackboard key.

    Attributes:
        file: The file.
        key: The key.
        start: The offset of the first character of the written key.
        end: The offset after the written key.
        form: How the key is written.
        element: The element that contains the place.
        reads: Whether the entry is read.
        writes: Whether the entry is written.
        port: Name of the port of the element, or of the attribute with the script.
    """

    file: str
    key: str
    start: int
    end: int
    form: KeyForm
    element: ScannedElement
    reads: bool = False
    writes: bool = False
    port: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class CallPort:
    """A key of a called tree that the SubTree element, or the model of the tree, connects.

    Attributes:
        inner: The key of the called tree.
        outer: The key of the calling tree; None if the inner key is set to a constant.
    """

    inner: KeyUse
    outer: KeyUse | None


@dataclass(frozen=True, slots=True, eq=False)
class TreeCall:
    """A SubTree element.

    Attributes:
        caller: The tree that contains the element.
        id: The ID of the called tree.
        element: The element.
        ports: The places that the element connects, by inner key.
        connections: The connected keys, without the defaults of the tree's model.
    """

    caller: "TreeSymbol"
    id: str
    element: ScannedElement
    ports: dict[str, CallPort]
    connections: SubtreeCall


@dataclass(frozen=True, slots=True, eq=False)
class TreeSymbol:
    """A `<BehaviorTree>` element.

    Attributes:
        file: The file.
        id: The ID, or "".
        element: The element.
        nodes: The elements of the nodes, in the order of the text.
        uses: The keys that its nodes use, except for the attributes of SubTree elements.
        calls: Its SubTree elements.
    """

    file: str
    id: str
    element: ScannedElement
    nodes: list[ScannedElement] = field(default_factory=list)
    uses: list[KeyUse] = field(default_factory=list)
    calls: list[TreeCall] = field(default_factory=list)


@dataclass(frozen=True, slots=True, eq=False)
class ModelPort:
    """A port in the model of a node.

    Attributes:
        name: The name as a key of the called tree, if the node is a subtree.
        default: The key of the calling tree that the default names, or None.
        text: The text of the default, or None.
    """

    name: KeyUse
    default: KeyUse | None
    text: str | None


@dataclass(frozen=True, slots=True, eq=False)
class ModelElement:
    """An element of a `<TreeNodesModel>`.

    Attributes:
        file: The file.
        id: The ID of the node, or of the subtree if the tag is `SubTree`.
        element: The element.
        ports: The ports by name.
    """

    file: str
    id: str
    element: ScannedElement
    ports: dict[str, ModelPort] = field(default_factory=dict)

    @property
    def is_subtree(self) -> bool:
        """Whether the model describes a tree, and not a node."""
        return self.element.tag not in EXPLICIT_TAGS


@dataclass(frozen=True, slots=True, eq=False)
class FileSymbols:
    """The symbols of one file.

    Attributes:
        file: The file.
        scan: The scan of its text.
        format: The XML format, 3 or 4.
        main_tree: The attribute `main_tree_to_execute`, or None.
        includes: The `<include>` elements.
        trees: The trees.
        models: The models.
    """

    file: str
    scan: Scan
    format: int
    main_tree: ScannedAttribute | None
    includes: list[ScannedElement]
    trees: list[TreeSymbol]
    models: list[ModelElement]

    def key_uses(self) -> Iterator[KeyUse]:
        """Yield all places of the file that name a key, except for defaults, which are not written."""
        for tree in self.trees:
            yield from (use for use in tree.uses if use.form is not KeyForm.DEFAULT)
            for call in tree.calls:
                for port in call.ports.values():
                    yield port.inner
                    if port.outer is not None:
                        yield port.outer
        for model in self.models:
            for declared in model.ports.values():
                yield declared.name
                if declared.default is not None:
                    yield declared.default

    def key_at(self, offset: int) -> KeyUse | None:
        """Return the place that names a key at *offset*, or None. A cursor at its end is on the key, too."""
        return next((use for use in self.key_uses() if use.start <= offset <= use.end), None)


def node_id(element: ScannedElement) -> str:
    """Return the ID of the node that *element* names: its tag, or the ID of an explicit tag."""
    return (element.get("ID") or "") if element.tag in EXPLICIT_TAGS else element.tag


def is_call(element: ScannedElement) -> bool:
    """Return whether *element* calls a tree."""
    return element.tag in _CALL_TAGS


def stated_format(scan: Scan) -> str | None:
    """Return the attribute `BTCPP_format` of the outermost element."""
    return scan.roots[0].get("BTCPP_format") if scan.roots else None


def written_format(scan: Scan) -> int:
    """Return the XML format of a document; 4 if it is unknown, or if there is no `<root>`."""
    has_root = bool(scan.roots) and scan.roots[0].tag == "root"
    return (parse_format(stated_format(scan)) or 4) if has_root else 4


ScriptNames = list[tuple[str, int, bool, bool]]
"""The names in a script: the name, its index in the script, and whether the entry is read and written."""


def read_symbols(
    file: str, scan: Scan, format: int, registry: Registry, scripts: dict[str, ScriptNames] | None = None
) -> FileSymbols:
    """Return the symbols of one file.

    Args:
        file: The name of the file.
        scan: The scan of its text.
        format: The XML format, 3 or 4.
        registry: The known nodes and enums.
        scripts: The names in known scripts. The names in further scripts are added.
    """
    return _SymbolReader(file, scan, format, registry, {} if scripts is None else scripts).read()


class _SymbolReader:
    def __init__(
        self, file: str, scan: Scan, format: int, registry: Registry, scripts: dict[str, ScriptNames]
    ) -> None:
        self._known_scripts = scripts
        self._file = file
        self._text = scan.text
        self._format = format
        self._registry = registry
        self._enums = registry.types.enums
        self._symbols = FileSymbols(file, scan, format, _main_tree(scan), [], [], [])

    def read(self) -> FileSymbols:
        symbols = self._symbols
        trees: dict[ScannedElement, TreeSymbol] = {}
        models: dict[ScannedElement, ModelElement | None] = {}
        for element in symbols.scan.elements:
            parent = element.parent
            tag = element.tag
            if tag == "BehaviorTree":
                trees[element] = tree = TreeSymbol(self._file, element.get("ID") or "", element)
                symbols.trees.append(tree)
            elif tag == "TreeNodesModel":
                models[element] = None
            elif tag == "include":
                symbols.includes.append(element)
            elif parent in models:
                models[element] = self._model(element, models[parent])
            elif parent in trees:
                trees[element] = tree = trees[parent]
                tree.nodes.append(element)
                if is_call(element):
                    tree.calls.append(self._call(tree, element))
                    tree.uses.extend(self._scripts(element))
                else:
                    tree.uses.extend(self._node(element))
        return symbols

    # --- models

    def _model(self, element: ScannedElement, model: ModelElement | None) -> ModelElement | None:
        """Read an element of a TreeNodesModel: a model, or a port of *model*. Returns the model."""
        if model is None:
            model = ModelElement(self._file, element.get("ID") or "", element)
            self._symbols.models.append(model)
        elif element.tag in PORT_TAGS:
            name, default = element.attribute("name"), element.attribute("default")
            if name is not None and name.value:
                text = default.value if default is not None else None
                key = braced_key(text or "", self._format) if model.is_subtree else None
                outer = self._braced(element, default, key) if default is not None and key else None
                use = KeyUse(
                    self._file, name.value, name.value_start, name.value_end, KeyForm.MODEL, element,
                    writes=bool(text) and outer is None, port=name.value,
                )  # fmt: skip
                model.ports[name.value] = ModelPort(use, outer, text)
        return model

    # --- SubTree elements

    def _call(self, tree: TreeSymbol, element: ScannedElement) -> TreeCall:
        call = SubtreeCall(element.parsed(), self._format, {})
        ports: dict[str, CallPort] = {}
        for attribute in element.attributes:
            name = attribute.name
            if name in call.port_texts and name not in ports and name not in NON_KEY_ATTRIBUTES:
                inner = KeyUse(
                    self._file, name, attribute.start, attribute.name_end, KeyForm.ATTRIBUTE, element,
                    writes=name in call.constants, port=name,
                )  # fmt: skip
                outer = call.remaps.get(name)
                ports[name] = CallPort(inner, self._outer_use(element, attribute, outer) if outer else None)
        return TreeCall(tree, call.tree_id, element, ports, call)

    def _outer_use(self, element: ScannedElement, attribute: ScannedAttribute, key: str) -> KeyUse:
        """Return the use of *key* of the calling tree, which the text of *attribute* names."""
        if element.tag == "SubTree" and self._format == 3:  # its texts are keys without braces
            return self._use(element, attribute, key, 0, len(key), KeyForm.BARE)
        return self._remapped(element, attribute, key)

    # --- other nodes

    def _node(self, element: ScannedElement) -> Iterator[KeyUse]:
        manifest = self._registry.get(node_id(element), self._format)
        yield from self._scripts(element)
        set_names: set[str] = set()
        for attribute in element.attributes:
            name = attribute.name
            if attribute.value is None or name in set_names:
                continue
            set_names.add(name)
            port = manifest.ports.get(name) if manifest is not None else None
            if port is not None:
                yield from self._port(element, attribute, port)
            elif manifest is None and name not in ("ID", "name") and name[:1] != "_":
                # The ports of an unknown node are unknown, but braces always mean a key.
                key = remapped_key(attribute.value, name, self._format)
                if key is not None:
                    yield self._remapped(element, attribute, key)
        if manifest is not None:
            yield from self._defaults(element, manifest, set_names)

    def _port(self, element: ScannedElement, attribute: ScannedAttribute, port: Port) -> Iterator[KeyUse]:
        text = attribute.value or ""
        key, accesses = port_uses(port, text, True, self._format)
        reads, writes = _reads(accesses), _writes(accesses)
        if key is None:
            yield from self._script(element, attribute) if port.role in SCRIPT_ROLES else ()
        elif remapped_key(text, port.name, self._format) is not None:
            yield self._remapped(element, attribute, key, reads, writes)
        else:
            yield self._use(element, attribute, text, 0, len(text), KeyForm.BARE, reads, writes)

    def _defaults(self, element: ScannedElement, manifest: Manifest, set_names: set[str]) -> Iterator[KeyUse]:
        """Yield the keys of the ports that have a key as default, and that *element* does not set."""
        for port in manifest.ports.values():
            if port.default is None or port.name in set_names:
                continue
            key, accesses = port_uses(port, port.default, False, self._format)
            if key is not None and accesses:
                yield KeyUse(
                    self._file, key, element.tag_start, element.tag_end, KeyForm.DEFAULT, element,
                    _reads(accesses), _writes(accesses), port.name,
                )  # fmt: skip

    def _scripts(self, element: ScannedElement) -> Iterator[KeyUse]:
        for attribute in element.attributes:
            if attribute.name in SCRIPT_ATTRIBUTES and self._format == 4:
                yield from self._script(element, attribute)

    def _script(self, element: ScannedElement, attribute: ScannedAttribute) -> list[KeyUse]:
        script = attribute.value or ""
        names = self._known_scripts.get(script)
        if names is None:
            names = self._known_scripts[script] = self._names_in(script)
        if not names:
            return []
        offset = self._offsets(attribute)
        return [
            KeyUse(
                self._file, name, offset(at), offset(at + len(name)), KeyForm.SCRIPT, element,
                reads, writes, attribute.name,
            )
            for name, at, reads, writes in names
        ]  # fmt: skip

    def _names_in(self, script: str) -> ScriptNames:
        uses = find_name_uses(script, self._enums)
        if uses:
            return [(use.name, use.column - 1, use.access in READING, use.access in WRITING) for use in uses]
        # An invalid script has no uses, but its names can be listed.
        return [
            (token.text, token.start, False, False)
            for token in lexer.tokenize(script)
            if token.type == lexer.NAME and token.text not in self._enums
        ]

    # --- places of keys

    def _remapped(
        self,
        element: ScannedElement,
        attribute: ScannedAttribute,
        key: str,
        reads: bool = False,
        writes: bool = False,
    ) -> KeyUse:
        """Return the use of *key*, which the text of a port points to."""
        text = attribute.value or ""
        if text == "=" or (self._format == 4 and braced_key(text) == "="):
            return self._use(element, attribute, key, 0, len(text), KeyForm.OF_PORT, reads, writes)
        return self._braced(element, attribute, key, reads, writes)

    def _braced(
        self,
        element: ScannedElement,
        attribute: ScannedAttribute,
        key: str,
        reads: bool = False,
        writes: bool = False,
    ) -> KeyUse:
        start = (attribute.value or "").index("{") + 1
        return self._use(element, attribute, key, start, start + len(key), KeyForm.BRACED, reads, writes)

    def _use(
        self,
        element: ScannedElement,
        attribute: ScannedAttribute,
        key: str,
        first: int,
        last: int,
        form: KeyForm,
        reads: bool = False,
        writes: bool = False,
    ) -> KeyUse:
        """Return the use of *key*, which is written from character *first* to *last* of the value."""
        offset = self._offsets(attribute)
        start, end = offset(first), offset(last)
        return KeyUse(self._file, key, start, end, form, element, reads, writes, attribute.name)

    def _offsets(self, attribute: ScannedAttribute) -> Callable[[int], int]:
        """Return the function from an index in the value to the offset in the text."""
        start = attribute.value_start
        if attribute.value_end - start == len(attribute.value or ""):
            return start.__add__
        return value_offsets(self._text, attribute).__getitem__


def _reads(accesses: tuple[AccessKind, ...]) -> bool:
    return any(access in READING for access in accesses)


def _writes(accesses: tuple[AccessKind, ...]) -> bool:
    return any(access in WRITING for access in accesses)


def _main_tree(scan: Scan) -> ScannedAttribute | None:
    return scan.roots[0].attribute("main_tree_to_execute") if scan.roots else None
