"""Substitution rules, which replace nodes of a tree by other nodes, as in BehaviorTree.CPP."""

import re
from collections.abc import Mapping

from btcore.engine.node_config import NodeConfig
from btcore.errors import NodeError
from btcore.registry.manifest import Manifest
from btcore.status import NodeType
from btcore.suggestions import did_you_mean


class SubstitutionRule:
    """A rule by which nodes that match *filter* are created from *by*, a manifest or a registered node's ID.

    *filter* is a registration ID, an instance name, or a full path in which `*` stands for any text
    and `?` for any character.
    """

    def __init__(self, filter: str, by: "Manifest | str") -> None:
        self.filter = filter
        self.by = by
        parts = [".*" if char == "*" else "." if char == "?" else re.escape(char) for char in filter]
        self._path = re.compile("".join(parts), re.DOTALL)

    def matches(self, config: NodeConfig) -> bool:
        """Return whether the rule applies to the node of *config*."""
        return (
            self.filter == config.name
            or self.filter == config.id
            or self._path.fullmatch(config.path) is not None
        )

    def replacement_manifest(
        self, config: NodeConfig, children: int, known: Mapping[str, Manifest]
    ) -> Manifest:
        """Return the manifest from which a node that matches the rule is created.

        Args:
            known: The registered nodes by ID.
        """
        manifest = self.by if isinstance(self.by, Manifest) else known.get(self.by)
        rule = f"the substitution rule '{self.filter}' replaces <{config.id}>"
        if manifest is None:
            hint = did_you_mean(str(self.by), known)
            raise NodeError(f"{rule} by '{self.by}', but no node is registered with this ID{hint}")
        if manifest.type in (NodeType.DECORATOR, NodeType.SUBTREE) and children != 1:
            needed = "exactly one child"
        elif manifest.type is NodeType.CONTROL and not children:
            needed = "children"
        else:
            return manifest
        has = f"<{config.id}> has {children or 'none'}"
        raise NodeError(f"{rule} by <{manifest.id}>, which needs {needed}, but {has}")

    def __repr__(self) -> str:
        by = self.by if isinstance(self.by, str) else self.by.cls.__name__
        return f"<SubstitutionRule '{self.filter}' → {by}>"


def first_matching_rule(rules: dict[str, SubstitutionRule], config: NodeConfig) -> SubstitutionRule | None:
    """Return the rule that applies to the node of *config*: the first in the order of *rules*, or None."""
    for rule in rules.values():
        if rule.matches(config):
            return rule
    return None
