"""Exhaustive search over the states of a tree, to prove what holds in every run.

`prove` answers questions about all possible runs, `assert_proved` does so in a test. The page on proofs
explains the questions, the models of leaves, and what a proof means.
"""

from btcore_proof.counterexample import Counterexample, LeafTick, RunTick
from btcore_proof.leaf_models import ModelError
from btcore_proof.outcome_replay import OutcomesError
from btcore_proof.propositions import QuestionError
from btcore_proof.prover import Answer, Report
from btcore_proof.tree_files import assert_holds_in_run, assert_proved, prove

__all__ = [
    "Answer",
    "Counterexample",
    "LeafTick",
    "ModelError",
    "OutcomesError",
    "QuestionError",
    "Report",
    "RunTick",
    "assert_holds_in_run",
    "assert_proved",
    "prove",
]
