"""What `btcore run` changes in a tree before its first tick: `--outcomes`, `--substitute` and `--set`."""

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from btcore.blackboard.entry_texts import value_from_text
from btcore.blackboard.ports import Port, braced_key
from btcore.cli import terminal
from btcore.errors import BlackboardError, ConversionError
from btcore.registry.registry import Registry, SubstitutionRule
from btcore.suggestions import did_you_mean, join_names
from btcore.tree.tree import Tree
from btcore.xml.plan.plan import Plans, reachable_trees

if TYPE_CHECKING:
    from btcore.registry.mock_leaves import Outcomes

_NAMED_OUTCOMES: Final = re.compile(r"(.+?)=([^=]*|[RSFKX|]*\(.*)", re.DOTALL)
"""Names may contain `=`, and so may the outputs of outcomes."""


class TreeChanges:
    """The outcomes of leaves without code, the substitution rules, and the entries of the blackboard.

    Args:
        outcomes: The values of `--outcomes`.
        substitute: The values of `--substitute`.
        set: The values of `--set`.

    Attributes:
        resources: Objects for the leaves.
    """

    def __init__(self, outcomes: Sequence[str], substitute: Sequence[Path], set: Sequence[str]) -> None:
        self._outcomes = _parse_outcomes(outcomes) if outcomes else None
        self._rules = _load_rules(substitute) if substitute else {}
        self._entries = _parse_entries(set)
        self.resources = [] if self._outcomes is None else [self._outcomes]

    def with_rules(self, nodes: Registry) -> Registry:
        """Return *nodes*, or a copy with the substitution rules."""
        if self._rules:
            nodes = nodes.copy()
            nodes.substitutions.update(self._rules)
        return nodes

    def check(self, plans: Plans) -> None:
        """Check that each `--outcomes` applies to a leaf of the tree that has no code."""
        if self._outcomes is None:
            return
        try:
            self._outcomes.check(_ports_of_mock_leaves(plans))
        except ValueError as error:
            raise click.UsageError(f"--outcomes: {error}. Mock leaves are leaves from a --model.") from error

    def apply_to(self, tree: Tree, plans: Plans) -> None:
        """Write the entries to the blackboard of *tree*, and warn if substitution rules match no node.

        A key that no port or script uses is written too, with a warning.
        """
        board = tree.blackboard
        without_port = [key for key in self._entries if board.find(key) is None]
        if without_port:
            _warn_unused_keys(without_port, plans)
        for key, text in self._entries.items():
            entry = board.find(key)
            declared = entry.declared if entry is not None and entry.declared.strong else None
            try:
                board.set(key, value_from_text(text, declared, tree.format), declared)
            except (BlackboardError, ConversionError) as error:
                raise click.UsageError(f"--set {key}={text}: {error}.") from error
        if self._rules:
            _warn_unused_rules(tree, self._rules.values())


def _load_rules(files: Iterable[Path]) -> dict[str, SubstitutionRule]:
    from btcore.testing.substitution_rules import SubstitutionError, load_substitution_rules

    nodes = Registry()
    for file in files:
        try:
            load_substitution_rules(nodes, file)
        except OSError as error:
            raise click.UsageError(f"--substitute {file}: cannot read the file: {error.strerror}.") from error
        except SubstitutionError as error:
            raise click.UsageError(f"--substitute {file}: {error}.") from error
    return nodes.substitutions


def _parse_outcomes(texts: Sequence[str]) -> "Outcomes":
    """Return the outcomes in texts of the form NAME=OUTCOMES."""
    from btcore.registry.mock_leaves import Outcomes  # most runs do not need it
    from btcore.registry.outcome_grammar import parse_outcomes  # most runs do not need it

    leaves: dict[str, str] = {}
    for text in texts:
        match = _NAMED_OUTCOMES.fullmatch(text)
        if match is None:
            raise click.UsageError(
                f"--outcomes '{text}' is invalid: write NAME=OUTCOMES, for example Move=RRS|F."
            )
        name, outcomes = match.groups()
        if name in leaves:
            raise click.UsageError(f"--outcomes: '{name}' has outcomes more than once.")
        try:
            parse_outcomes(outcomes)
        except ValueError as error:
            raise click.UsageError(f"--outcomes '{text}': {error}.") from error
        leaves[name] = outcomes
    return Outcomes(leaves=leaves)


def _ports_of_mock_leaves(plans: Plans) -> dict[str, Mapping[str, Port]]:
    from btcore.registry.mock_leaves import MockAction

    leaves: dict[str, Mapping[str, Port]] = {}
    assert plans.main_tree is not None
    for tree in reachable_trees(plans.trees, plans.main_tree):
        for node in tree.node_plans():
            if issubclass(node.manifest.cls, MockAction):
                for name in (node.name or node.id, node.id):
                    leaves.setdefault(name, node.manifest.ports)
    return leaves


def _warn_unused_rules(tree: Tree, rules: Iterable[SubstitutionRule]) -> None:
    configs = [node.config for node in tree.nodes]
    unused = [rule.filter for rule in rules if not any(rule.matches(config) for config in configs)]
    if not unused:
        return
    names = [name for config in configs for name in (config.id, config.name, config.path)]
    rules_match = "the rule {} matches" if len(unused) == 1 else "the rules {} match"
    message = f"--substitute: {rules_match.format(join_names(map(repr, unused)))} no node"
    terminal.print_warning(message + did_you_mean(unused[0], names))


def _parse_entries(texts: Iterable[str]) -> dict[str, str]:
    """Return the keys and texts of assignments KEY=VALUE or `{KEY}=VALUE`."""
    entries: dict[str, str] = {}
    for text in texts:
        left_side, equals, value = text.partition("=")
        key = braced_key(left_side) or left_side.strip()
        if not equals or not key:
            raise click.UsageError(
                f"--set '{text}' is not an assignment: write KEY=VALUE, for example --set laps=3."
            )
        if key in entries:
            raise click.UsageError(f"--set: '{key}' is set more than once.")
        entries[key] = value
    return entries


def _warn_unused_keys(keys: Iterable[str], plans: Plans) -> None:
    from btcore.lint.dry_run import DryRun  # most runs do not need it

    assert plans.main_tree is not None
    dry_run = DryRun(plans, plans.main_tree)
    board = dry_run.blackboard
    for key in keys:
        hint = did_you_mean(key, board.visible_keys())
        # A leaf that takes the whole blackboard may use any key.
        if board.find(key) is None and (hint or not dry_run.has_untracked_access):
            terminal.print_warning(f"--set {key}: no port or script of the tree uses '{key}'{hint}")
