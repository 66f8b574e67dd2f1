"""`btcore run --substitute`: replace nodes by BehaviorTree.CPP's substitution rules."""

from collections.abc import Sequence
from pathlib import Path

import click

from btcore.cli import terminal
from btcore.registry.registry import Registry
from btcore.suggestions import join_names, nearest_name
from btcore.tree.tree import Tree


def add_rules(nodes: Registry, files: Sequence[Path]) -> None:
    """Add the substitution rules in *files* to a registry.

    Raises:
        click.UsageError: A file cannot be read, or contains invalid rules.
    """
    if not files:
        return
    from btcore.testing.substitution_rules import SubstitutionError, load_substitution_rules

    for file in files:
        try:
            load_substitution_rules(nodes, file)
        except OSError as error:
            raise click.UsageError(f"--substitute {file}: cannot read the file: {error.strerror}.") from error
        except SubstitutionError as error:
            raise click.UsageError(f"--substitute {file}: {error}.") from error


def warn_unused_rules(tree: Tree) -> None:
    """Print a warning if substitution rules match no node of *tree*."""
    rules = tree.registry.substitutions.values()
    configs = [node.config for node in tree.nodes] if rules else []
    unused = [rule.filter for rule in rules if not any(rule.matches(config) for config in configs)]
    if not unused:
        return
    names = [name for config in configs for name in (config.id, config.name, config.path)]
    rules_match = "the rule {} matches" if len(unused) == 1 else "the rules {} match"
    message = f"--substitute: {rules_match.format(join_names(map(repr, unused)))} no node"
    nearest = nearest_name(unused[0], names)
    terminal.print_warning(f"{message}; did you mean '{nearest}'?" if nearest is not None else message)
