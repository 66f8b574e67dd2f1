"""``btcore run --plan``: what the nodes give whose code isn't here."""

import re
from collections.abc import Mapping, Sequence
from typing import Final

import click

from btcore.status import NodeType
from btcore.suggestions import join_names, nearest_name
from btcore.xml.models.stand_ins import StubAction, StubCondition
from btcore.xml.plan.document_checks import DocumentAnalysis, nodes_of, reachable_plans

_LETTERS: Final = re.compile(r"[RSFK]+(\|[RSFK]+)*")


def _parsed(ctx: click.Context, parameter: click.Parameter, texts: Sequence[str]) -> dict[str, str]:
    plans: dict[str, str] = {}
    for text in texts:
        name, _, letters = text.rpartition("=")
        if not name or not _LETTERS.fullmatch(letters):
            raise click.UsageError(
                f"--plan '{text}' is no plan: write NAME=LETTERS, say Move=RRS|F; the letters are "
                "R (RUNNING), S (SUCCESS), F (FAILURE) and K (SKIPPED), and | stands between two starts."
            )
        if name in plans:
            raise click.UsageError(f"--plan: '{name}' has two plans; give one.")
        plans[name] = letters
    return plans


plan_option = click.option(
    "--plan",
    "plans",
    multiple=True,
    callback=_parsed,
    metavar="NAME=LETTERS",
    help="What a leaf of --model gives, by its name or ID: a letter a tick of R, S, F and K (skipped), a "
    "| between starts, say Move=RRS|F; else SUCCESS. May be given several times.",
)


def check(plans: Mapping[str, str], examined: DocumentAnalysis) -> None:
    """Raise :class:`click.UsageError` for a plan that no leaf without code follows."""
    kinds = _leaves(examined) if plans else {}
    for name, letters in plans.items():
        if name not in kinds:
            meant = nearest_name(name, kinds)
            hint = "The tree has none." if not kinds else f"Those that it has: {join_names(kinds)}."
            if meant is not None:
                hint = f"Did you mean '{meant}'?"
            raise click.UsageError(f"--plan {name}=…: the tree has no leaf '{name}' of a --model. {hint}")
        if "|" in letters and kinds[name] is NodeType.CONDITION:
            raise click.UsageError(
                f"--plan {name}={letters}: '{name}' is a condition, which takes one letter a tick and "
                "never starts; leave out the |."
            )


def _leaves(examined: DocumentAnalysis) -> dict[str, NodeType]:
    """The leaves that follow plans, by name and by ID."""
    found: dict[str, NodeType] = {}
    assert examined.main is not None
    for plan in reachable_plans(examined.planner, examined.main):
        for node in nodes_of(plan):
            manifest = node.manifest
            if manifest is not None and issubclass(manifest.cls, (StubAction, StubCondition)):
                found.setdefault(node.name or node.id, manifest.type)
                found.setdefault(node.id, manifest.type)
    return found
