"""Leaves that a proof never calls, and provers of trees with such leaves."""

from collections.abc import Mapping, Sequence

from btcore import Condition, Registry, StatefulAction, SyncAction, TreeNode, loads
from btcore.clock import Clock
from btcore.tree.tree import Tree
from btcore_proof.model_leaves import Choices, ModelPrompt, with_model_leaves
from btcore_proof.propositions import parse_question
from btcore_proof.prover import Answer, Prover
from btcore_proof.search import SearchLimits


class InstantLeaf(SyncAction):
    def tick(self) -> bool:
        raise AssertionError


class ConditionLeaf(Condition):
    def tick(self) -> bool:
        raise AssertionError


class LastingLeaf(StatefulAction):
    def on_start(self) -> bool:
        raise AssertionError

    on_running = on_start


def prover_of(
    body: str,
    *questions: str,
    leaves: Sequence[type[TreeNode]],
    declared: Mapping[str, Mapping[str, object]] | None = None,
    entries: Mapping[str, object] | None = None,
    domains: Mapping[str, tuple[str, ...]] | None = None,
    format: int = 4,
    instant_leaves: bool = False,
) -> Prover:
    """Return a prover of the tree *body* with *entries* on its blackboard."""
    nodes = Registry.standard()
    nodes.add(*leaves)
    models = with_model_leaves(nodes, declared or {})
    root = f'<root BTCPP_format="{format}" main_tree_to_execute="T">'
    xml = f'{root}<BehaviorTree ID="T">{body}</BehaviorTree></root>'

    def make(choices: Choices, clock: Clock) -> Tree:
        tree = loads(xml, nodes=models, resources=[choices, ModelPrompt(choices)], clock=clock)
        for key, value in (entries or {}).items():
            tree.blackboard.set(key, value)
        return tree

    return Prover(make, [*map(parse_question, questions)], domains, instant_leaves=instant_leaves)


def answers_of(prover: Prover, jobs: int = 1) -> dict[str, Answer]:
    """Return the answers by question."""
    return {answer.question: answer for answer in prover.answer(SearchLimits(jobs=jobs)).answers}
