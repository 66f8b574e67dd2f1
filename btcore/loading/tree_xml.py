"""Write a running tree as XML, for Groot 2 monitors and for loading it again."""

from collections.abc import Iterator

from btcore.engine.node import TreeNode
from btcore.names import SCRIPT_ATTRIBUTES, is_port_name
from btcore.status import NodeType
from btcore.tree.tree import Subtree, Tree
from btcore.xml.models.tree_nodes_model import model_lines, quoted

_STEP = "    "


def tree_to_xml(tree: Tree, metadata: bool = True, builtin_models: bool = True) -> str:
    """Return a tree as XML, as WriteTreeToXML in BehaviorTree.CPP's src/xml_parsing.cpp writes it.

    Every instance of a subtree becomes a separate `<BehaviorTree>`, in order of creation, with its path
    as `_fullpath`. Every node has the compact form, with the texts of its ports including defaults.

    Args:
        tree: The tree.
        metadata: Whether to write the `_uid` of each node and the `_fullpath` of each SubTree.
        builtin_models: Whether the TreeNodesModel includes the built-in nodes.

    Examples:
        >>> import btcore
        >>> from btcore.loading.tree_xml import tree_to_xml
        >>> b = btcore.Builder()
        >>> print(tree_to_xml(b.build(b.Inverter(b.AlwaysSuccess())), builtin_models=False), end="")
        <root BTCPP_format="4">
            <BehaviorTree ID="Main" _fullpath="">
                <Inverter name="Inverter" _uid="1">
                    <AlwaysSuccess name="AlwaysSuccess" _uid="2"/>
                </Inverter>
            </BehaviorTree>
            <TreeNodesModel>
            </TreeNodesModel>
        </root>
    """
    instances = {subtree.path: subtree for subtree in tree.subtrees}
    lines = ['<root BTCPP_format="4">']
    for subtree in tree.subtrees:
        id, path = quoted(subtree.id), quoted(subtree.path)
        lines.append(f"{_STEP}<BehaviorTree ID={id} _fullpath={path}>")
        _write(subtree.root, 2, instances, metadata, lines)
        lines.append(f"{_STEP}</BehaviorTree>")
    manifests = tree.registry.manifests_of(tree.format).values()
    lines += model_lines(item for item in manifests if builtin_models or item.library != "btcore")
    return "\n".join([*lines, "</root>"]) + "\n"


def _write(
    node: TreeNode, depth: int, instances: dict[str, Subtree], metadata: bool, lines: list[str]
) -> None:
    is_call = node.spec.node_type is NodeType.SUBTREE
    tag = "SubTree" if is_call else node.config.id
    pairs = _call(node, instances[node.config.path], metadata) if is_call else _attributes(node, metadata)
    indent, words = _STEP * depth, [tag, *(f"{key}={quoted(text)}" for key, text in pairs)]
    children = () if is_call else node.children
    lines.append(f"{indent}<{' '.join(words)}{'>' if children else '/>'}")
    for child in children:
        _write(child, depth + 1, instances, metadata, lines)
    if children:
        lines.append(f"{indent}</{tag}>")


def _attributes(node: TreeNode, metadata: bool) -> Iterator[tuple[str, str]]:
    config = node.config
    yield "name", node.name
    if metadata:
        yield "_uid", str(config.uid)
    yield from ((key, port.text) for key, port in config.inputs.items())
    yield from ((key, port.text) for key, port in config.outputs.items() if key not in config.inputs)
    yield from _scripts(node)


def _call(node: TreeNode, instance: Subtree, metadata: bool) -> Iterator[tuple[str, str]]:
    """Yield the attributes of a SubTree, which is written without a name."""
    config = node.config
    yield "ID", instance.id
    if metadata:
        yield "_fullpath", instance.path
        yield "_uid", str(config.uid)
    # A SubTree of format 3 has the outer key without braces.
    bare = config.format == 3 and config.id == "SubTree"
    for key, text in config.attributes.items():
        if is_port_name(key):
            yield key, f"{{{text}}}" if bare else text
    yield from _scripts(node)


def _scripts(node: TreeNode) -> Iterator[tuple[str, str]]:
    for key in SCRIPT_ATTRIBUTES:
        if key in node.config.conditions:
            yield key, node.config.conditions[key]
