"""Questions about a tree that is edited: the entry point of the group `btcore.proofs`, for the studio."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from btcore.registry.registry import Registry
from btcore.xml.define import Definitions
from btcore.xml.plan.plan import plan
from btcore_proof.declarations import Declarations, declarations_beside
from btcore_proof.model_leaves import with_model_leaves
from btcore_proof.prover import Report
from btcore_proof.search import SearchLimits
from btcore_proof.state_graph import StateGraph
from btcore_proof.tree_files import prover_of

MEMORY_MB: Final = 1000
"""The memory (MB) at which a search for a page ends."""
MAX_STATES: Final = 200_000
"""The maximum number of states of a search for a page, also where the memory is not known."""


def answer_questions(
    definitions: Definitions,
    nodes: Registry,
    file: Path | None,
    questions: Sequence[str],
    given: Sequence[str],
    time_s: float,
    progress: Callable[[int, int, int], object],
) -> Report:
    """Answer the standard questions and others about all possible runs of a tree, in this process.

    Args:
        definitions: The definitions of the tree, and of the trees that it calls.
        nodes: The available nodes. Models replace leaves with code, as in `btcore_proof.prove`.
        file: The file of the tree, beside which its declarations are; None if there is no file.
        questions: The questions, in addition to the standard questions and to the declared ones.
        given: The keys that the program sets before the first tick, in addition to the declared ones.
        time_s: The time (s) after which the search ends with the answers so far.
        progress: Called from time to time with the numbers of the states that were searched, of the states
            that were found, and of the ticks that were run.

    Raises:
        TreeError: The tree has errors.
        ModelError: A declaration is invalid.
        QuestionError: A text is not a question.
        NodeError: The state of a node cannot be saved.
    """
    declared = Declarations() if file is None else declarations_beside(file)
    plans = plan(definitions, with_model_leaves(nodes, declared.leaves))
    plans.diagnostics.raise_errors()

    def report(graph: StateGraph) -> None:
        progress(graph.expanded, graph.states, graph.transitions)

    limits = SearchLimits(time_s=time_s, memory=MEMORY_MB, jobs=1, states=MAX_STATES)
    return prover_of(plans, questions, declared, given).answer(limits, report)
