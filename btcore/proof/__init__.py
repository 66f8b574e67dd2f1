"""Exhaustive search over the states of a tree, to prove what holds in every run.

`prove` answers questions about all possible runs, `assert_proved` does so in a test. The page on proofs
explains the questions, the models of leaves, and what a proof means.
"""

from btcore.proof.counterexample import Counterexample, LeafTick, RunTick
from btcore.proof.leaf_models import ModelError
from btcore.proof.planned_run import PlanError
from btcore.proof.propositions import QuestionError
from btcore.proof.prover import Answer, Report
from btcore.proof.tree_files import assert_holds_in_run, assert_proved, prove

__all__ = [
    "Answer",
    "Counterexample",
    "LeafTick",
    "ModelError",
    "PlanError",
    "QuestionError",
    "Report",
    "RunTick",
    "assert_holds_in_run",
    "assert_proved",
    "prove",
]
