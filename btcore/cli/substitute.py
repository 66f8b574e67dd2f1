"""``btcore run --substitute``: other nodes in the place of some, by the rules of BehaviorTree.CPP."""

from collections.abc import Sequence
from pathlib import Path

import click

from btcore.cli import terminal
from btcore.registry.registry import Registry
from btcore.suggestions import join_names, nearest_name
from btcore.testing.substitution_rules import SubstitutionError, load_substitution_rules
from btcore.tree.tree import Tree

substitute_option = click.option(
    "--substitute",
    "substitutes",
    multiple=True,
    type=click.Path(path_type=Path),
    metavar="FILE.json",
    help="Substitution rules, as BehaviorTree.CPP's JSON: nodes that are replaced by others, or by a "
    "TestNode; may be given several times.",
)


def add_rules(nodes: Registry, files: Sequence[Path]) -> None:
    """Give *nodes* the rules of *files*. Raises :class:`click.UsageError` for a file that has none."""
    for file in files:
        try:
            load_substitution_rules(nodes, file)
        except OSError as fault:
            raise click.UsageError(f"--substitute {file}: it can't be read: {fault.strerror}.") from fault
        except UnicodeDecodeError as fault:
            raise click.UsageError(f"--substitute {file}: it is no text in UTF-8.") from fault
        except SubstitutionError as fault:
            raise click.UsageError(f"--substitute {file}: {fault}.") from fault


def warn_unused_rules(tree: Tree) -> None:
    """Warn of the rules that no node of *tree* is met by."""
    rules = tree.registry.substitutions.values()
    configs = [node.config for node in tree.nodes] if rules else []
    idle = [rule.filter for rule in rules if not any(rule.matches(config) for config in configs)]
    if not idle:
        return
    names = [name for config in configs for name in (config.id, config.name, config.path)]
    rules_say = "the rule" if len(idle) == 1 else "the rules"
    said = f"--substitute: no node is met by {rules_say} {join_names([repr(one) for one in idle])}"
    meant = nearest_name(idle[0], names)
    terminal.print_warning(f"{said}; did you mean '{meant}'?" if meant is not None else said)
