"""Parts of documents that the tests of the validator check."""

from textwrap import dedent


def children(node: str, *of: str) -> str:
    """Return *node* with one child per line; the children stand in lines 4, 5, 6 …"""
    return "\n      ".join((f"<{node}>", *of)) + f"\n    </{node.split()[0]}>"


def sequence(*of: str) -> str:
    """Return a Sequence with one child per line."""
    return children("Sequence", *of)


def tree(id: str, body: str = "<AlwaysSuccess/>") -> str:
    return f'  <BehaviorTree ID="{id}">\n    {body}\n  </BehaviorTree>\n'


def dedented(text: str) -> str:
    return dedent(text).lstrip("\n")
