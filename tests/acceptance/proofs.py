"""`btcore prove` gives the answers of a plain enumeration of all runs, on random trees.

``python tests/acceptance/proofs.py --trees 1000`` uses all cores. Every tree follows from its number and the
seed, so that a reported tree can be compared again alone: ``--only 1234``. For each tree:

- safety: runs of at most six ticks are enumerated (`proof_enumeration.py`) and searched. For every standard
  and random safety question the prover must refute exactly what a run violates, with a shortest run.
  If a decorator has hidden state (`proof_plugins.py`), the answers may also be unknown, and if the tree
  compares a value that is not known, they may be possible. A recording of the run must be repeated exactly.
- random runs: the ordinary engine runs the tree with the system's clock and leaves that take random times.
  No run may contradict what is proved.
- liveness: if the enumeration finds all states, the search must be complete, and its answers must be those of
  a search for fair cycles in the enumerated graph, which tries all subsets of the conditions.
"""

import argparse
import os
import random
import re
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from itertools import repeat
from pathlib import Path
from typing import NamedTuple

from proof_enumeration import (
    Arc,
    Enumeration,
    FairnessRule,
    Monitor,
    Runner,
    enumerate_graph,
    enumerate_runs,
    first_blackboard,
    has_fair_cycle,
    standard_checks,
)
from proof_plugins import DECLARED, HIDDEN
from proof_trees import DOMAINS, LEAVES, UNKNOWN_NODES, RandomQuestion, RandomTree, random_tree

from btcore.blackboard.ports import Port
from btcore.clock import Clock
from btcore.engine.leaf import Condition, LeafNode, StatefulAction, SyncAction
from btcore.errors import BtcoreError
from btcore.loading.instantiate import instantiate
from btcore.logs import open_log
from btcore.registry.registry import Registry
from btcore.status import FAILURE, SUCCESS
from btcore.tree.tree import Tree
from btcore.xml.plan.plan import plan_document
from btcore.xml.read.read import parse_text
from btcore_proof.model_leaves import Choices, ModelPrompt, with_model_leaves
from btcore_proof.propositions import parse_question
from btcore_proof.prover import POSSIBLE, PROVED, REFUTED, Answer, Prover
from btcore_proof.search import SearchLimits
from btcore_proof.standard_questions import ENDS
from btcore_proof.standard_questions import LEAVES as LEAF_QUESTION
from btcore_proof.state_graph import StateGraph
from btcore_recorder.verification import verify

TICKS = 6
TICKS_OF_RUN = 10
PROOF_S = 60.0
LEAST_RUNS, MOST_RUNS = 10, 12_000
"""A tree with fewer or more runs is replaced by another."""
MOST_RUNS_OF_GRAPH = 6_000
MOST_RUNS_OF_HIDDEN = 1_500
"""The number of runs after which the enumeration of a tree with hidden state ends."""
CHUNK = 5
_NAMES = {"S": "SUCCESS", "F": "FAILURE", "K": "SKIPPED", "R": "RUNNING"}


def _no_code(leaf: LeafNode) -> bool:
    raise AssertionError("the prover ticks only models of leaves")


def _model_nodes() -> Registry:
    """Return nodes whose leaves have no code, but declarations for the prover."""
    nodes = Registry.standard()
    bases: dict[str, type[LeafNode]] = {"condition": Condition, "sync": SyncAction, "action": StatefulAction}
    declared: dict[str, dict[str, object]] = {}
    for tag, kind in LEAVES.items():
        ports: list[Port] = [] if kind.port is None else [kind.port]
        members: dict[str, object] = {"provided_ports": staticmethod(lambda ports=ports: ports)}
        methods = ("on_start", "on_running") if kind.base == "action" else ("tick",)
        members |= dict.fromkeys(methods, _no_code)
        nodes.add(type(tag, (bases[kind.base],), members), ID=tag)
        declared[tag] = {
            "results": [_NAMES[letter] for letter in kind.results],
            "at_once": not kind.is_late,
            "endless": kind.is_endless,
            "uses": [kind.uses] if kind.uses else [],
        }
    for cls in (*DECLARED, *HIDDEN):
        nodes.add(cls)
    return with_model_leaves(nodes, declared)


MODEL_NODES = _model_nodes()


def prover_of(tree: RandomTree) -> Prover:
    """Return a prover for a random tree."""
    plans = plan_document(parse_text(tree.xml), MODEL_NODES)
    plans.diagnostics.raise_errors()

    def make(choices: Choices, clock: Clock) -> Tree:
        resources = [choices, ModelPrompt(choices)]
        board = first_blackboard(tree.format, clock)
        return instantiate(plans, resources, board, clock)

    return Prover(
        make,
        [parse_question(str(question)) for question in tree.questions],
        _domains(tree),
        instant_leaves=tree.is_instant,
    )


def _domains(tree: RandomTree) -> dict[str, tuple[str, ...]]:
    """Return the domains of the entries that a node or a question reads; leaves need not write the others."""
    writers = ("Say", "Sense")
    texts = [
        text
        for name, tag in tree.tags.items()
        if tag not in writers
        for text in tree.attributes[name].values()
    ]
    texts += map(str, tree.questions)
    return {
        key: values
        for key, values in DOMAINS.items()
        if any(re.search(rf"\b{key}\b", text) for text in texts)
    }


def safety_differences(tree: RandomTree, expected: Enumeration) -> list[str]:
    """Return where the prover's answers differ from an enumeration."""
    report = prover_of(tree).answer(SearchLimits(expected.ticks))
    answers = {answer.question: answer for answer in report.answers}
    found = [text for answer in report.answers if answer.answer == REFUTED if (text := _unrepeated(answer))]
    asked = [str(question) for question in tree.questions if _is_safety(question)]
    for question in [*standard_checks(tree), *asked]:
        answer, depth = answers[question], expected.depths.get(question)
        if tree.compares_unknown and (answer.answer == POSSIBLE or "declare its domain" in answer.detail):
            continue
        if tree.is_hidden:
            if depth is not None and answer.answer == PROVED:
                found.append(f"{question}: proved, but {depth} ticks violate it")
        elif depth is None:
            # A run that visits a state again may be longer than the runs that were enumerated.
            if answer.answer == REFUTED and answer.ticks <= expected.ticks:
                found.append(f"{question}: refuted, but no run violates it: {_shown(answer)}")
        elif answer.answer != REFUTED:
            found.append(f"{question}: {answer.answer} ({answer.detail}), but {depth} ticks violate it")
        elif answer.ticks != depth and not (tree.compares_unknown and answer.ticks > depth):
            found.append(f"{question}: {answer.ticks} ticks, but {depth} violate it: {_shown(answer)}")
    # A run that ends too early violates `leads to` without a limit, too.
    for question in tree.questions:
        if not _is_safety(question) and str(question) in expected.depths:
            answer = answers[str(question)]
            is_vague = tree.is_hidden or (tree.compares_unknown and answer.answer != PROVED)
            if answer.answer == PROVED or (answer.answer != REFUTED and not is_vague):
                found.append(f"{question}: {answer.answer} ({answer.detail}), but runs end without it")
    return found


def _unrepeated(answer: Answer) -> str:
    """Return where the replay of a recording of a counterexample differs from it, or ""."""
    shown = answer.counterexample
    if shown is None or shown.run is None:
        return ""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "run.btrec.txt"
        with ExitStack() as recordings:
            shown.run.run(lambda tree: recordings.enter_context(open_log(tree, file)))
        verified = verify(file)
    return "" if verified.is_same else f"{answer.question}: the recording is not repeated: {verified}"


def _is_safety(question: RandomQuestion) -> bool:
    return question.kind != "leads to" or question.within is not None


def _shown(answer: Answer) -> str:
    run = answer.counterexample
    if run is None:
        return answer.detail
    ticks = [
        f"{tick.time:g} s: " + ", ".join(f"{leaf.path} {leaf.result.name}" for leaf in tick.leaves)
        for tick in run.ticks
    ]
    return f"{answer.detail} [{'; '.join(ticks)}] cycle {run.cycle}"


class GraphAnswers(NamedTuple):
    """The answers of an enumerated graph.

    Attributes:
        refuted: Whether each question is refuted.
        problems: What is wrong with leaves.
        reasons: Why the tree may go on forever although it is proved to end.
        vacuous: The questions whose premise never occurs.
        raises: Whether a node raises in a run.
    """

    refuted: dict[str, bool]
    problems: str
    reasons: set[str]
    vacuous: set[str]
    raises: bool


def graph_answers(tree: RandomTree, arcs: list[Arc]) -> GraphAnswers:
    """Return the answers to the questions that need all states."""
    refuted: dict[str, bool] = {ENDS: _goes_on(tree, arcs)}
    problems = _leaf_problems(tree, arcs)
    refuted[LEAF_QUESTION] = bool(problems)
    fairness = _fairness(tree)
    for question in tree.questions:
        if _is_safety(question) or question.second is None:
            continue
        refuted[str(question)] = _is_not_followed(arcs, question, fairness)
    premises = {
        str(question): question.second if question.kind == "before" else question.first
        for question in tree.questions
        if question.second is not None
    }
    vacuous = {
        question
        for question, premise in premises.items()
        if premise is not None and not any(arc.seen.holds(premise) for arc in arcs)
    }
    raises = any(arc.seen.result is None for arc in arcs)
    return GraphAnswers(refuted, "; ".join(problems), _reasons(tree, arcs), vacuous, raises)


def _fairness(tree: RandomTree) -> list[FairnessRule]:
    """Return the conditions that actions end, and that timers expire."""
    conditions: list[FairnessRule] = []
    for name in tree.leaves:
        kind = LEAVES[tree.tags[name]]
        if "R" in kind.results and not kind.is_endless:
            conditions.append(
                (
                    lambda arc, name=name: name in arc.seen.ticked,
                    lambda arc, name=name: name not in arc.seen.kept,
                )
            )
    for name, tag in tree.tags.items():
        if tag in ("Delay", "Timeout", "Sleep", "UserTimer"):
            conditions.append((lambda arc: True, lambda arc, name=name: name not in arc.seen.kept_timers))
    return conditions


def _endless_nodes(tree: RandomTree) -> set[str]:
    return {
        name
        for name, tag in tree.tags.items()
        if tag == "KeepRunningUntilFailure"
        or "-1" in (tree.attributes[name].get("num_cycles"), tree.attributes[name].get("num_attempts"))
        or (tag in LEAVES and LEAVES[tag].is_endless)
    }


def _always(arc: Arc) -> bool:
    return True


def _goes_on(tree: RandomTree, arcs: list[Arc]) -> bool:
    """Return whether the tree goes on forever although no leaf fails forever and no endless node runs."""
    endless = _endless_nodes(tree)
    rules = [*_fairness(tree), (_always, lambda arc: not arc.seen.running & endless)]
    judges = {name for name in tree.leaves if LEAVES[tree.tags[name]].base == "condition"}
    rules += [
        (
            lambda arc, name=name: (name, FAILURE) in arc.seen.completed,
            lambda arc, name=name: (name, SUCCESS) in arc.seen.completed,
        )
        for name in set(tree.leaves) - judges
    ]
    inside = [arc for arc in arcs if not any((name, FAILURE) in arc.seen.completed for name in judges)]
    return has_fair_cycle(inside, rules) and (_can_end(arcs) or not endless)


def _can_end(arcs: list[Arc]) -> bool:
    return any(arc.seen.has_ended and arc.seen.result is not None for arc in arcs)


def _reasons(tree: RandomTree, arcs: list[Arc]) -> set[str]:
    """Return why the tree may go on forever although it is proved to end."""
    endless, fairness = _endless_nodes(tree), _fairness(tree)
    if endless and not _can_end(arcs):
        return set()
    active = [arc for arc in arcs if arc.seen.running & endless]
    found = {
        f"{name} runs forever"
        for name in endless
        if has_fair_cycle(active, [*fairness, (_always, lambda arc, name=name: name in arc.seen.running)])
    }
    pauses = (_always, lambda arc: not arc.seen.running & endless)
    for name in tree.leaves:
        fails = (_always, lambda arc, name=name: (name, FAILURE) in arc.seen.completed)
        succeeds = (_always, lambda arc, name=name: (name, SUCCESS) in arc.seen.completed)
        without = [arc for arc in arcs if (name, SUCCESS) not in arc.seen.completed]
        if has_fair_cycle(without, [*fairness, pauses, fails]):
            found.add(f"{name} fails forever")
        elif LEAVES[tree.tags[name]].base == "condition" and has_fair_cycle(
            arcs, [*fairness, pauses, fails, succeeds]
        ):
            found.add(f"{name} changes its result forever")
    return found


def _leaf_problems(tree: RandomTree, arcs: list[Arc]) -> list[str]:
    results: dict[str, set[str]] = {}
    for arc in arcs:
        for name, found in arc.seen.results.items():
            results.setdefault(name, set()).update(status.name for status in found)
        for name in arc.seen.culprits:
            results.setdefault(name, set()).add("an exception")
    problems: list[str] = []
    for name, tag in tree.tags.items():
        if f'name="{name}"' not in tree.xml or f'<{tag} name="{name}"' not in tree.xml or not _is_leaf(tag):
            continue
        found = results.get(name, set()) - {"SKIPPED"}
        if not found:
            problems.append(f"{name} is never ticked")
        elif tag in LEAVES:
            if "S" in LEAVES[tag].results and "SUCCESS" not in found:
                problems.append(f"{name} never succeeds")
            if "F" in LEAVES[tag].results and "FAILURE" not in found:
                problems.append(f"{name} never fails")
    return sorted(problems)


def _is_leaf(tag: str) -> bool:
    known = MODEL_NODES.get(tag, 4) or MODEL_NODES.get(tag, 3)
    return known is not None and known.cls.spec.child_count == (0, 0)


def _is_not_followed(arcs: list[Arc], question: RandomQuestion, fairness: list[FairnessRule]) -> bool:
    """Return whether a run exists in which the second proposition does not follow the first."""
    assert question.second is not None
    second = question.second
    waiting = [arc for arc in arcs if not arc.seen.holds(second)]
    pending = [arc for arc in waiting if arc.seen.holds(question.first)]
    states = {arc.target for arc in pending}
    growing = True
    while growing:
        found = {arc.target for arc in waiting if arc.source in states} - states
        states |= found
        growing = bool(found)
    if -1 in states:
        return True
    return has_fair_cycle([arc for arc in waiting if arc.source in states], fairness)


def liveness_differences(tree: RandomTree, expected: GraphAnswers, states: int) -> list[str]:
    """Return where the prover's answers differ from those of the enumerated graph."""

    def limit(graph: StateGraph) -> None:
        if len(graph.edges) > 20 * states + 5000:
            raise KeyboardInterrupt

    report = prover_of(tree).answer(progress=limit)
    found: list[str] = []
    for answer in report.answers:
        if tree.compares_unknown:
            found += _contradiction(answer, expected)
        elif answer.detail.startswith("not searched beyond this error"):
            if not expected.raises:
                found.append(f"{answer.question}: {answer.detail}, but no run raises")
            elif expected.refuted.get(answer.question) and answer.question != LEAF_QUESTION:
                found.append(f"{answer.question}: {answer.detail}, but refuted by the graph")
        elif expected.raises and answer.answer == PROVED:
            found.append(f"{answer.question}: proved, although a run raises")
        elif answer.answer not in (PROVED, REFUTED):
            found.append(f"{answer.question}: unknown ({answer.detail}), but there are {states} states")
        elif answer.answer == PROVED and answer.is_vacuous != (answer.question in expected.vacuous):
            found.append(f"{answer.question}: vacuous: {answer.is_vacuous}, but not by the graph")
        elif answer.question in expected.refuted:
            if (answer.answer == REFUTED) != expected.refuted[answer.question]:
                found.append(f"{answer.question}: {_shown(answer) or answer.answer}, but not by the graph")
            elif answer.question == ENDS and answer.answer == PROVED:
                reasons = re.findall(r"'([^']*)' ((?:runs|fails|changes its result) forever)", answer.detail)
                given = {_short(f"'{path}' {reason}") for path, reason in reasons}
                if given != expected.reasons:
                    found.append(f"{answer.question}: {answer.detail}, but {sorted(expected.reasons)}")
            elif answer.question == LEAF_QUESTION and answer.answer == REFUTED:
                named = sorted(_short(problem) for problem in answer.detail.split("; "))
                if "; ".join(named) != expected.problems:
                    found.append(f"{answer.question}: {answer.detail}, but {expected.problems}")
    return found


def _contradiction(answer: Answer, expected: GraphAnswers) -> list[str]:
    """Return how an answer, which may be possible, contradicts the enumerated graph, in at most one line."""
    is_refuted = expected.refuted.get(answer.question)
    if answer.answer == PROVED:
        if expected.raises:
            return [f"{answer.question}: proved, although a run raises"]
        if is_refuted:
            return [f"{answer.question}: proved, but refuted by the graph"]
        if answer.is_vacuous and answer.question not in expected.vacuous:
            return [f"{answer.question}: vacuous, but not by the graph"]
    elif answer.answer == REFUTED and is_refuted is False:
        return [f"{answer.question}: {_shown(answer)}, but not by the graph"]
    return []


def _short(problem: str) -> str:
    """Return a sentence with the name of the node instead of its path."""
    path, _, rest = problem.removeprefix("'").partition("'")
    return path.rpartition("/")[2] + rest


class Comparison(NamedTuple):
    """The comparison of one tree.

    Attributes:
        number: The number of the tree.
        skipped: Why the tree was not compared, or "".
        differences: Where prover and enumeration differ.
        is_plain: Whether every run was enumerated, without merging equal states.
        has_graph: Whether liveness was compared.
        violated: The number of questions that are violated.
        runs: The number of runs of the enumeration.
        seconds: The duration (s).
    """

    number: int
    skipped: str
    differences: list[str]
    is_plain: bool = False
    has_graph: bool = False
    violated: int = 0
    runs: int = 0
    seconds: float = 0.0


def contradictions(tree: RandomTree, runs: int, seed: str) -> list[str]:
    """Return which proved statements about a tree random runs of the engine contradict.

    Args:
        tree: The tree.
        runs: The number of runs, with the system's clock and leaves that take random times.
        seed: The seed of the runs.
    """
    tree = tree._replace(is_instant=False)
    answers = prover_of(tree).answer(SearchLimits(memory=1024, time_s=PROOF_S)).answers
    proved = {answer.question for answer in answers if answer.answer == PROVED}
    checks = {question: check for question, check in standard_checks(tree).items() if question in proved}
    asked = [question for question in tree.questions if str(question) in proved]
    rng = random.Random(seed)
    runner = Runner(tree, TICKS)
    found: dict[str, None] = {}
    for _ in range(runs if checks or asked else 0):
        memories = [0] * len(asked)
        for seen in runner.run_randomly(rng, TICKS_OF_RUN):
            found |= {question: None for question, is_violated in checks.items() if is_violated(seen)}
            for place, question in enumerate(asked):
                memories[place], wrong = Monitor.advanced(question, memories[place], seen)
                if wrong:
                    found[str(question)] = None
    return [f"{question}: proved, but a run of the engine violates it" for question in found]


def compare(number: int, seed: int, runs: int) -> Comparison:
    """Compare the answers about the random tree *number*, also with *runs* random runs."""
    began = time.perf_counter()
    tree = random_tree(f"{seed}:{number}")
    if not tree.leaves:
        return Comparison(number, "no leaf", [])
    try:
        most_runs = MOST_RUNS_OF_HIDDEN if tree.is_hidden else MOST_RUNS
        expected = enumerate_runs(tree, TICKS, most_runs)
    except BtcoreError as error:
        return Comparison(number, f"not loaded: {str(error)[:150]}", [])
    if expected is None:
        return Comparison(number, f"more than {MOST_RUNS:,} runs", [])
    if expected.runs < LEAST_RUNS:
        return Comparison(number, f"fewer than {LEAST_RUNS} runs", [])
    try:
        differences = safety_differences(tree, expected)
        graph = enumerate_graph(tree, TICKS, MOST_RUNS_OF_GRAPH)
        if graph is not None:
            arcs, states = graph
            differences += liveness_differences(tree, graph_answers(tree, arcs), states)
        differences += contradictions(tree, runs, f"{seed}:{number}")
    except Exception as error:
        differences = [f"{type(error).__name__}: {error}"]
        graph = None
    return Comparison(
        number,
        "",
        differences,
        expected.is_plain,
        graph is not None,
        len(expected.depths),
        expected.runs,
        time.perf_counter() - began,
    )


def _compare_all(numbers: range, seed: int, runs: int) -> list[Comparison]:
    return [compare(number, seed, runs) for number in numbers]


def main(arguments: list[str]) -> int:
    """Run the command line *arguments*, and return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--trees", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--runs", type=int, default=100, help="random runs of each tree")
    parser.add_argument("--only", type=int, metavar="NUMBER", help="compare one tree, and print it")
    chosen = parser.parse_args(arguments)
    if chosen.only is not None:
        print(random_tree(f"{chosen.seed}:{chosen.only}").xml)
        comparison = compare(chosen.only, chosen.seed, chosen.runs)
        print(comparison)
        return 1 if comparison.differences else 0
    if UNKNOWN_NODES:
        print(f"random trees never contain {', '.join(UNKNOWN_NODES)}: add them to NODES of proof_trees.py")
        return 1
    compared: list[Comparison] = []
    skipped: dict[str, int] = {}
    first = 0
    with ProcessPoolExecutor(chosen.jobs) as pool:
        while len(compared) < chosen.trees:
            wanted = chosen.trees - len(compared)
            chunks = [range(n, min(n + CHUNK, first + wanted)) for n in range(first, first + wanted, CHUNK)]
            first += wanted
            for results in pool.map(_compare_all, chunks, repeat(chosen.seed), repeat(chosen.runs)):
                for comparison in results:
                    if comparison.skipped:
                        skipped[comparison.skipped] = skipped.get(comparison.skipped, 0) + 1
                    else:
                        compared.append(comparison)
                    for line in comparison.differences:
                        print(f"tree {comparison.number} of seed {chosen.seed}: {line}", flush=True)
    wrong = sum(bool(comparison.differences) for comparison in compared)
    runs = sum(comparison.runs for comparison in compared)
    plain = sum(comparison.is_plain for comparison in compared)
    graphs = sum(comparison.has_graph for comparison in compared)
    violated = sum(comparison.violated for comparison in compared)
    slowest = max(comparison.seconds for comparison in compared)
    print(
        f"proofs: {len(compared)} trees, {wrong} with differences; {runs:,} runs enumerated, "
        f"of {plain} trees without merging equal states; liveness of {graphs} trees; {violated} violations; "
        f"slowest {slowest:.1f} s"
    )
    for reason, times in sorted(skipped.items()):
        print(f"  {times} further trees left out: {reason}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
