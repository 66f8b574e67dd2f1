"""Convert the XML of a Groot 2 FULLTREE reply to an `ObservedTree`, and back.

The XML comes from the network and is not trusted. A document with a document type declaration is rejected
before parsing, so there are no entities to expand, and the parser fetches nothing. The number of nodes and
the lengths of names are limited.
"""

import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from lxml import etree

from btcore_monitor.events import NodeTypeName, ObservedNode, ObservedTree, infer_node_type
from btcore_monitor.wire.errors import ProtocolError, describe_value

NODE_TYPE_OF_TAG: Final[dict[str, NodeTypeName]] = {
    "Action": "action",
    "Condition": "condition",
    "Control": "control",
    "Decorator": "decorator",
    "SubTree": "subtree",
}
"""Node types by the tags in a TreeNodesModel. Nodes in the explicit form (`<Action ID="…"/>`) have these
tags, too."""

_INVALID_IN_XML: Final = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")
_MAX_NODES: Final = 65_535
"""Maximum nodes of a tree: a uid of Groot 2's protocol has 16 bits."""
_MAX_NAME: Final = 1_000
_MAX_PATH: Final = 4_000
"""Maximum characters of a node's name and of its path. The paths of all nodes are kept."""

_TAGS: Final = {node_type: tag for tag, node_type in NODE_TYPE_OF_TAG.items()}
_NOT_PORTS: Final = frozenset({"name", "ID", "_uid", "_fullpath"})


def read_fulltree(xml: bytes, tree_id: str) -> ObservedTree:
    """Return the tree that *xml* describes.

    Args:
        xml: The second frame of a FULLTREE reply, in UTF-8.
        tree_id: The UUID in the reply's header, as 32 hexadecimal digits.

    Raises:
        ProtocolError: *xml* is not a FULLTREE document.
    """
    root = _parse(xml)
    trees: dict[str, etree._Element] = {}
    for element in root.iterchildren("BehaviorTree"):
        path = element.get("_fullpath")
        if path is None:
            raise ProtocolError("expected _fullpath on every <BehaviorTree>, and it is missing")
        if path in trees:
            raise ProtocolError(
                f"expected a single <BehaviorTree> with _fullpath {describe_value(path)}, and got two"
            )
        trees[path] = element
    if not trees:
        raise ProtocolError("expected a <BehaviorTree> in the full tree, and got none")
    node_types = {
        str(model.get("ID")): NODE_TYPE_OF_TAG[str(model.tag)]
        for models in root.iterchildren("TreeNodesModel")
        for model in models.iterchildren(*NODE_TYPE_OF_TAG)
    }
    main = next(iter(trees))
    nodes = tuple(_Reader(trees, node_types).read(main))
    names = {path: str(element.get("ID") or "") for path, element in trees.items()}
    return ObservedTree(tree_id, names[main], nodes, names, xml)


def write_fulltree(tree: ObservedTree) -> bytes:
    """Return the XML that the robot sent for *tree*. If it sent none, build the XML from the known nodes.

    The names of Groot 1's protocol may have any characters. Those that are invalid in XML are escaped, and
    ports whose names are invalid in XML are left out.
    """
    if tree.xml:
        return tree.xml
    root = etree.Element("root", BTCPP_format="4")
    trees: dict[str, etree._Element] = {}
    above: dict[int, etree._Element] = {}
    models = etree.Element("TreeNodesModel")
    known: set[str] = set()
    for node in tree.nodes:
        if node.subtree not in trees:
            tree_id = tree.subtrees.get(node.subtree, tree.name)
            place = {"ID": _valid(tree_id), "_fullpath": _valid(node.subtree)}
            trees[node.subtree] = etree.SubElement(root, "BehaviorTree", place)
        parent = above.get(node.parent)
        if parent is None or tree.by_uid[node.parent].type == "subtree":
            parent = trees[node.subtree]
        tag = "SubTree"
        own = {"ID": _valid(tree.subtrees.get(node.path, node.name)), "_fullpath": _valid(node.path)}
        if node.type != "subtree":
            tag, own = node.id, {"name": _valid(node.name)}
            if not _is_xml_name(tag):
                tag, own["ID"] = _TAGS[node.type], _valid(node.id)
        ports = {name: _valid(text) for name, text in node.ports.items() if _is_xml_name(name)}
        above[node.uid] = etree.SubElement(parent, tag, {**ports, **own, "_uid": str(node.uid)})
        # Without a model, a reader could not infer the type of a node with one child or none.
        if node.type != "subtree" and node.id not in known:
            known.add(node.id)
            etree.SubElement(models, _TAGS[node.type], ID=_valid(node.id))
    root.append(models)
    etree.indent(root, "    ")
    return etree.tostring(root, encoding="utf-8") + b"\n"


def _is_xml_name(name: str) -> bool:
    """Return whether *name* is valid as the name of an element or an attribute without a namespace."""
    try:
        etree.QName(name)
    except ValueError:
        return False
    return not name.startswith("{") and ":" not in name


def _valid(text: str) -> str:
    """Return *text* with the characters that are invalid in XML as escape sequences of Python."""
    return _INVALID_IN_XML.sub(lambda match: ascii(match[0])[1:-1], text)


def _parse(xml: bytes) -> etree._Element:
    try:
        xml.decode("utf-8")
    except UnicodeDecodeError as error:
        raise ProtocolError(
            f"expected the full tree in UTF-8, and got {error.reason} at byte {error.start}"
        ) from None
    if b"<!DOCTYPE" in xml:
        raise ProtocolError("the full tree declares a document type, which no publisher writes: rejected")
    # huge_tree lifts libxml2's limits of depth and size, which a big tree exceeds. Without a document type
    # there are no entities, so the limits are not needed for security.
    parser = etree.XMLParser(
        encoding="utf-8",
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        huge_tree=True,
        remove_comments=True,
        remove_pis=True,
    )
    try:
        root = etree.fromstring(xml, parser)
    except etree.XMLSyntaxError as error:
        raise ProtocolError(f"expected the full tree as XML, and got: {error.msg}") from None
    if root.tag != "root":
        raise ProtocolError(f"expected <root> around the full tree, and got {describe_value(root.tag)}")
    return root


class _Reader:
    """Reads the nodes of all subtree instances, depth first.

    The reader does not recurse, because a tree may be deeper than Python's recursion limit.
    """

    def __init__(self, trees: dict[str, etree._Element], node_types: dict[str, NodeTypeName]) -> None:
        self._trees = trees
        self._node_types = node_types
        self._read: set[str] = set()
        self._uids: set[int] = set()

    def read(self, main: str) -> Iterator[ObservedNode]:
        """Yield the nodes of the instance *main* and of the instances below it, in pre-order."""
        children: dict[int, list[int]] = {0: []}
        nodes: list[ObservedNode] = []
        self._read.add(main)
        waiting = [(_find_root(self._trees[main]), 0, main)]
        while waiting:
            element, parent, subtree = waiting.pop()
            if len(nodes) >= _MAX_NODES:
                raise ProtocolError(f"expected a full tree of at most {_MAX_NODES} nodes, and got more")
            node = self._read_node(element, parent, subtree)
            nodes.append(node)
            children[parent].append(node.uid)
            children[node.uid] = []
            child_subtree = subtree
            below = list(element.iterchildren(etree.Element))
            if node.type == "subtree":
                # <SubTree> has no child elements: its content is the <BehaviorTree> with the same _fullpath.
                child_subtree = node.path
                below = [self._find_content(child_subtree)]
            # Reversed, because the last item of the list is read next.
            waiting.extend((child, node.uid, child_subtree) for child in reversed(below))
        # The type of a node without a model depends on its number of children, which is known only now.
        for node in nodes:
            below_node = tuple(children[node.uid])
            known = node.id in self._node_types or node.type == "subtree"
            node_type = node.type if known else infer_node_type(len(below_node))
            yield replace(node, type=node_type, children=below_node)

    def _find_content(self, path: str) -> etree._Element:
        if path not in self._trees:
            raise ProtocolError(
                f"expected a <BehaviorTree> with _fullpath {describe_value(path)}, and it is missing"
            )
        if path in self._read:
            raise ProtocolError(
                f"expected a single <SubTree> with _fullpath {describe_value(path)}, and got two"
            )
        self._read.add(path)
        return _find_root(self._trees[path])

    def _read_node(self, element: etree._Element, parent: int, subtree: str) -> ObservedNode:
        tag = str(element.tag)
        for name in (tag, element.get("name", ""), element.get("ID", "")):
            if len(name) > _MAX_NAME:
                raise ProtocolError(f"expected names of at most {_MAX_NAME} characters, and got {len(name)}")
        text = element.get("_uid", "")
        # A limited length, because int() takes quadratic time for thousands of digits.
        if not (text.isascii() and text.isdigit()) or len(text) > 10:
            raise ProtocolError(f"expected a number as _uid of <{tag}>, and got {describe_value(text)}")
        uid = int(text)
        if uid == 0 or uid in self._uids:
            raise ProtocolError(f"expected unique values of _uid from 1 on, and <{tag}> has {uid}")
        self._uids.add(uid)
        ports = {str(key): str(value) for key, value in element.attrib.items() if key not in _NOT_PORTS}
        if tag == "SubTree":
            path = element.get("_fullpath")
            if path is None:
                raise ProtocolError(f"expected _fullpath on the <SubTree> with _uid {uid}")
            if len(path) > _MAX_PATH:
                raise ProtocolError(f"expected paths of at most {_MAX_PATH} characters, and got {len(path)}")
            # The element of a subtree has no name attribute. BehaviorTree.CPP appends "::uid" to the path of
            # a subtree that has no name of its own.
            name = path.removeprefix(subtree + "/" if subtree else "")
            name = name.removesuffix(f"::{uid}")
            return ObservedNode(uid, name, "SubTree", "subtree", path, parent, (), ports, subtree)
        node_id = str(element.get("ID", tag)) if tag in NODE_TYPE_OF_TAG else tag
        name = str(element.get("name", node_id))
        # The document has no paths of leaves; this is the rule of BehaviorTree.CPP's src/xml_parsing.cpp.
        path = name if name != node_id else f"{name}::{uid}"
        if subtree:
            path = f"{subtree}/{path}"
        if len(path) > _MAX_PATH:
            raise ProtocolError(f"expected paths of at most {_MAX_PATH} characters, and got {len(path)}")
        node_type = self._node_types.get(node_id, "action")
        if tag in NODE_TYPE_OF_TAG and node_id not in self._node_types:
            node_type = self._node_types[node_id] = NODE_TYPE_OF_TAG[tag]
        return ObservedNode(uid, name, node_id, node_type, path, parent, (), ports, subtree)


def _find_root(tree: etree._Element) -> etree._Element:
    roots = list(tree.iterchildren(etree.Element))
    if len(roots) != 1:
        name = describe_value(tree.get("ID"))
        raise ProtocolError(f"expected one node in the <BehaviorTree> {name}, and got {len(roots)} nodes")
    return roots[0]
