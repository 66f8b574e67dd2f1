"""Code lenses: run, prove and show each tree. The client provides the commands."""

from typing import Final

from lsprotocol import types

from btcore_studio.language.project import Project, SourceDocument

COMMANDS: Final = {"btcore.run": "▶ Run", "btcore.prove": "Prove", "btcore.show": "Show"}
"""The commands of the client, and their titles. Their arguments are the URI and the ID of the tree."""


def code_lenses(project: Project, document: SourceDocument) -> list[types.CodeLens]:
    """Return a code lens per command for each tree of *document*."""
    lenses: list[types.CodeLens] = []
    trees = [tree for root in document.scan.roots for tree in root.children if tree.tag == "BehaviorTree"]
    for tree in trees:
        id = tree.get("ID")
        if id:
            range = document.positions.range(tree.start, tree.start_tag_end)
            lenses += (
                types.CodeLens(range, types.Command(title, command, arguments=[document.uri, id]))
                for command, title in COMMANDS.items()
            )
    return lenses
