"""A first file of declarations for a tree, in which everything is a comment."""

import json
from collections.abc import Iterable, Mapping

from btcore.engine.node import TreeNode
from btcore.tree.tree import Tree
from btcore_proof.entry_names import name_in_main_tree, names_of_entry
from btcore_proof.model_leaves import ModelDecorator, model_leaf_model


def template_of(tree: Tree) -> str:
    """Return a file with all that can be declared for a tree, with the present values as comments.

    Args:
        tree: The tree, with model leaves.
    """
    nodes = tree.nodes
    leaves = {node.config.id: node for node in nodes if model_leaf_model(node) is not None}
    written = {key: type_name for node in nodes for key, type_name in _outputs(node).items()}
    read = sorted({key for node in nodes for key in _inputs(node)} - written.keys())
    unknown = sorted(key for key, type_name in written.items() if type_name != "bool")
    first = next((leaf.name for leaf in leaves.values()), "Move")
    lines = [
        "# Declarations for `btcore prove`. Remove the # of what is true, and change it.",
        "",
        "# Entries that the program sets before the first tick. No output port writes these:",
        f"# given = {_text(read)}",
        "",
        "# What the code of each leaf guarantees; below are the present models.",
        *(line for id, leaf in sorted(leaves.items()) for line in _lines_of_model(id, leaf)),
        "# The values that leaves may write to entries; otherwise they are not known.",
        "# [entries]",
        *(f"# {_key(key)} = []" for key in unknown),
        "",
        "# Questions of your own.",
        "# [questions]",
        f"# example = {json.dumps(f'never {_name(first)} is FAILURE', ensure_ascii=False)}",
    ]
    return "\n".join([*lines, ""])


def _lines_of_model(id: str, leaf: TreeNode) -> list[str]:
    model = model_leaf_model(leaf)
    assert model is not None
    if isinstance(leaf, ModelDecorator):
        # Declared results are those that a decorator returns without its child.
        return [f"# [leaves.{_key(id)}]", f"# lasts = {_text(model.lasts)}", ""]
    values: Mapping[str, object] = {
        "results": [status.name for status in model.results],
        "lasts": model.lasts,
        "at_once": model.at_once,
        "endless": model.endless,
        "uses": sorted(model.uses),
        "hands_over": model.hands_over,
        "optional": sorted(model.optional),
        "early": model.early,
        "writes": sorted(model.writes),
        "on_halt": sorted(model.on_halt),
    }
    return [f"# [leaves.{_key(id)}]", *(f"# {key} = {_text(value)}" for key, value in values.items()), ""]


def _inputs(node: TreeNode) -> Iterable[str]:
    """Return the names of the entries that a node reads, in the main tree."""
    for port in node.config.inputs.values():
        name = None if port.key is None else name_in_main_tree(port.blackboard, port.key)
        if name is not None:
            yield name


def _outputs(node: TreeNode) -> dict[str, str]:
    """Return the outermost names of the entries that a node writes, and the types of the ports."""
    outputs = [output for output in node.config.outputs.values() if output.key is not None]
    return {names_of_entry(port.blackboard, port.key or "")[-1]: port.type.name for port in outputs}


def _text(value: object) -> str:
    return json.dumps(value, ensure_ascii=False)


def _key(name: str) -> str:
    """Return a key of TOML."""
    return name if name.isascii() and name.replace("_", "").replace("-", "").isalnum() else _text(name)


def _name(name: str) -> str:
    """Return the name of a node in a question."""
    return name if name.isidentifier() else f"'{name}'"
