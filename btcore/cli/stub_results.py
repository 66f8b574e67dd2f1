"""`btcore run --plan`: the results of leaves that have no code because they come from `--model`."""

import re
from collections.abc import Mapping, Sequence
from typing import Final

import click

from btcore.status import NodeType
from btcore.suggestions import join_names, nearest_name
from btcore.xml.models.stubs import StubAction, StubCondition
from btcore.xml.plan.plan import Plans

_LETTERS: Final = re.compile(r"[RSFK]+(\|[RSFK]+)*")


def parse_letters(texts: Sequence[str]) -> dict[str, str]:
    """Return the letters of the results in texts of the form NAME=LETTERS, by the name or ID of the leaf.

    Raises:
        click.UsageError: A text has another form, or a leaf has two plans.
    """
    letters_of: dict[str, str] = {}
    for text in texts:
        name, _, letters = text.rpartition("=")
        if not name or not _LETTERS.fullmatch(letters):
            raise click.UsageError(
                f"--plan '{text}' is invalid: write NAME=LETTERS, for example Move=RRS|F; the letters are "
                "R (RUNNING), S (SUCCESS), F (FAILURE) and K (SKIPPED); | separates the starts of the leaf."
            )
        if name in letters_of:
            raise click.UsageError(f"--plan: '{name}' has more than one plan.")
        letters_of[name] = letters
    return letters_of


def check(stub_letters: Mapping[str, str], plans: Plans) -> None:
    """Check that each `--plan` applies to a leaf of the tree that has no code.

    Args:
        stub_letters: The letters of the results, by the name or ID of the leaf.
        plans: The plans of the tree.

    Raises:
        click.UsageError: There is no such leaf, or the letters of a condition contain `|`.
    """
    kinds = _find_stub_leaves(plans) if stub_letters else {}
    for name, letters in stub_letters.items():
        if name not in kinds:
            nearest = nearest_name(name, kinds)
            hint = f"Leaves from a --model: {join_names(kinds) or 'none'}."
            if nearest is not None:
                hint = f"Did you mean '{nearest}'?"
            raise click.UsageError(f"--plan {name}=…: the tree has no leaf '{name}' from a --model. {hint}")
        if "|" in letters and kinds[name] is NodeType.CONDITION:
            raise click.UsageError(
                f"--plan {name}={letters}: '{name}' is a condition, which uses one letter for each tick and "
                "has no starts; remove the |."
            )


def _find_stub_leaves(plans: Plans) -> dict[str, NodeType]:
    """Return the types of the leaves that have no code, by name and by ID."""
    leaves: dict[str, NodeType] = {}
    assert plans.main_tree is not None
    for tree in plans.reachable(plans.main_tree):
        for node in tree.nodes():
            manifest = node.manifest
            if manifest is not None and issubclass(manifest.cls, (StubAction, StubCondition)):
                leaves.setdefault(node.name or node.id, manifest.type)
                leaves.setdefault(node.id, manifest.type)
    return leaves
