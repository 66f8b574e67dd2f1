"""Seeded mistakes in good trees: `btcore prove` finds each, and the ordinary engine shows the fault.

``python tests/acceptance/mistakes.py`` proves that twelve trees are good, and seeds a hundred mistakes in
them, one at a time. At least one question about each wrong tree must be refuted. Each counterexample is run
again by leaves of this file, which know nothing of the prover, and the fault is looked for in what happens.
The test that the prover writes must fail with the wrong tree and pass with the good one, and the recording
that it runs must be repeated exactly. ``--sample 10`` takes some of the mistakes, by ``--seed``. The script
exits with 1 if anything else happens.
"""

import argparse
import contextlib
import random
import re
import sys
import tempfile
import time
import tomllib
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from seeded_mistakes import TREES, GoodTree, registry

import btcore
from btcore import NodeExecutionError, SimClock, StatefulAction, Status
from btcore.engine.leaf import Condition
from btcore.xml.models.model_file import add_models
from btcore_proof import Answer, Counterexample, RunTick, assert_holds_in_run, prove
from btcore_proof.declarations import declarations_beside
from btcore_proof.tree_files import _plans, record_counterexample
from btcore_recorder.verification import verify

CYCLES = 20
RANDOM_RUNS = 30
RANDOM_TICKS = 12


def document(tree: GoodTree, replaced: Sequence[str] = ()) -> str:
    """Return the XML of a tree, after the replacements.

    It also declares the leaves, which `GoodTree.leaves` lists as in `IsNear? <limit:double; Look >count:int`.
    """
    xml = tree.xml + "</BehaviorTree>" + tree.more
    for old, new in zip(replaced[::2], replaced[1::2], strict=True):
        assert old in xml, f"the tree does not contain {old!r}"
        xml = xml.replace(old, new)
    models: list[str] = []
    for leaf in tree.leaves.split(";"):
        name, *ports = leaf.split()
        tag = "Condition" if name.endswith("?") else "Action"
        declared = ""
        for port in ports:
            key, _, kind = port[1:].partition(":")
            of_type = f' type="{kind or "std::string"}"'
            declared += f'<{"output" if port[0] == ">" else "input"}_port name="{key}"{of_type}/>'
        models.append(f'<{tag} ID="{name.rstrip("?")}">{declared}</{tag}>')
    return (
        f'<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main">{xml}'
        f"<TreeNodesModel>{''.join(models)}</TreeNodesModel></root>"
    )


def write(folder: Path, tree: GoodTree, replaced: Sequence[str] = ()) -> Path:
    """Write a tree and its declarations, and return the file of the tree."""
    file = folder / "tree.xml"
    file.write_text(document(tree, replaced), encoding="utf-8")
    lines = [line.strip() for line in tree.declarations.splitlines()]
    file.with_suffix(".proof.toml").write_text("\n".join(lines), encoding="utf-8")
    return file


# --- the ordinary engine, with leaves that repeat a counterexample


def nodes_with_leaves(
    file: Path, take: Callable[[Any], Status], halted: Callable[[Any], None] = lambda leaf: None
) -> btcore.Registry:
    """Return the nodes of a tree whose leaves call *take* in each tick, and *halted* when they are halted."""
    nodes = registry()
    own = set(nodes.manifests)
    add_models(nodes, file)

    def tick_leaf(leaf: Any) -> Status:
        for port in leaf.config.inputs:
            leaf.get_input(port)
        return take(leaf)

    def leaf_class(manifest: Any) -> type:
        ports = list(manifest.ports.values())

        class Leaf(StatefulAction):
            provided_ports = staticmethod(lambda: ports)

            def on_start(self) -> Status:
                return tick_leaf(self)

            def on_running(self) -> Status:
                return tick_leaf(self)

            def on_halted(self) -> None:
                halted(self)

        class Check(Condition):
            provided_ports = staticmethod(lambda: ports)

            def tick(self) -> Status:
                return tick_leaf(self)

        return Check if manifest.type is btcore.NodeType.CONDITION else Leaf

    for id, manifest in list(nodes.manifests.items()):
        if id not in own:
            nodes.remove(id)
            nodes.add(leaf_class(manifest), ID=id)
    return nodes


class Replay:
    """Runs a tree with leaves that do what a counterexample shows, and records what happens."""

    def __init__(self, file: Path) -> None:
        self.expected: deque[tuple[str, Status, dict[str, str]]] = deque()
        self.results: dict[str, list[Status]] = {}
        self.halted: set[str] = set()
        self.error: NodeExecutionError | None = None
        self.clock = SimClock()
        nodes = nodes_with_leaves(file, self._take, lambda leaf: self.halted.add(leaf.name))
        self.tree = btcore.load(file, nodes=nodes, clock=self.clock)
        for node in self.tree.nodes:
            node.set_post_tick_function(self._record)

    def _take(self, leaf: Any) -> Status:
        path, result, written = self.expected.popleft()
        assert path == leaf.path, f"{leaf.path} is ticked instead of {path}"
        for port, text in written.items():
            leaf.set_output(port, leaf.config.outputs[port].type.from_text(text))
        return result

    def _record(self, node: btcore.TreeNode, status: Status) -> Status:
        self.results.setdefault(node.name, []).append(status)
        return status

    def tick(self, at: float, tick: RunTick) -> Status | None:
        """Run a tick at a time (s)."""
        self.clock.advance(at - self.clock.now() / 1e9)
        self.results.clear()
        self.halted.clear()
        self.expected.extend((leaf.path, leaf.result, dict(leaf.written)) for leaf in tick.leaves)
        try:
            result = self.tree.tick_exactly_once()
        except NodeExecutionError as error:
            self.error = error
            result = None
        assert not self.expected, "a leaf was not ticked"
        return result

    def holds(self, proposition: str) -> bool:
        """Return whether a proposition holds after the last tick."""
        names = {node.name for node in self.tree.nodes}
        text = proposition.replace("!=", "≠").replace("!", " not ").replace("≠", "!=")
        text = text.replace("&", " and ").replace("|", " or ")
        text = re.sub(r"\{(\w+)\}", r"entry('\1')", text)
        text = re.sub(r"(\w+) ticked", r"('\1' in results)", text)
        text = re.sub(r"(\w+) halted", r"('\1' in halted)", text)
        text = re.sub(r"(\w+) is (\w+)", r"(Status.\2 in results.get('\1', []))", text)
        text = re.sub(rf"(?<!['\w])({'|'.join(sorted(names))})(?!['\w])", r"running('\1')", text)
        scope = {
            "entry": self._entry,
            "results": self.results,
            "halted": self.halted,
            "Status": Status,
            "running": lambda name: self.tree.node(name).status is Status.RUNNING,
            "true": True,
            "false": False,
        }
        return bool(eval(text, scope))

    def _entry(self, key: str) -> object:
        value = self.tree.blackboard.get(key)
        # An entry that is not written fulfils no comparison.
        return Missing() if value is None else value


class Missing:
    """Stands for an entry that is not written."""

    def _never(self, other: object) -> bool:
        return False

    __eq__ = __ne__ = __lt__ = __gt__ = __le__ = __ge__ = _never
    __hash__ = None  # type: ignore[assignment]


class Question(NamedTuple):
    """A question of a user; of a standard question, only the text.

    Attributes:
        text: The whole question.
        kind: "never", "before" or "leads to"; "" for a standard question.
        first: The first proposition.
        second: The second proposition, or "".
        max_ticks: The limit of "leads to" in ticks, or None.
    """

    text: str
    kind: str = ""
    first: str = ""
    second: str = ""
    max_ticks: int | None = None


def parse_question(text: str) -> Question:
    """Return the parts of a question."""
    match = re.fullmatch(r"(.*?) leads to (.*?)(?: within (\d+) ticks)?", text)
    if match is not None:
        return Question(text, "leads to", match[1], match[2], int(match[3]) if match[3] else None)
    if " before " in text and not text.startswith(("every", "no ")):
        first, second = text.split(" before ")
        return Question(text, "before", first, second)
    if text.startswith("never "):
        return Question(text, "never", text.removeprefix("never "))
    return Question(text)


def shows(file: Path, answer: Answer) -> bool:
    """Return whether a normal run with the results of a counterexample shows the fault."""
    run = answer.counterexample
    if run is None:
        return never_happens(file, answer.detail)
    replay = Replay(file)
    premise = False
    question = parse_question(answer.question)
    pending = -1
    result: Status | None = Status.RUNNING
    ticks = [(tick.time, tick) for tick in run.ticks]
    if run.cycle is not None:
        repeated = ticks[run.cycle :]
        for number in range(1, CYCLES):
            ticks += [(at + number * run.period, tick) for at, tick in repeated]
    for at, tick in ticks:
        assert result is Status.RUNNING
        result = replay.tick(at, tick)
        if question.kind == "leads to":
            if replay.holds(question.second):
                pending = -1
            elif pending >= 0:
                pending += 1
            elif replay.holds(question.first):
                pending = 0
        if question.kind == "before":
            premise = premise or replay.holds(question.first)
    if question.kind == "never":
        return replay.holds(question.first)
    if question.kind == "before":
        return replay.holds(question.second) and not premise
    if question.kind == "leads to":
        too_late = question.max_ticks is not None and pending >= question.max_ticks
        return pending >= 0 and (too_late or result is not Status.RUNNING or run.cycle is not None)
    return violates_question(replay, answer.question, run, result)


def violates_question(replay: Replay, question: str, run: Counterexample, result: Status | None) -> bool:
    """Return whether the last tick violates a standard question."""
    tree = replay.tree
    if question == "the tree ends":
        return result is Status.RUNNING and run.cycle is not None
    if question in ("no node raises an exception", "every mandatory input is written before it is read"):
        return replay.error is not None
    if question == "everything that runs is halted when its parent ends":
        pairs = [(parent, child) for parent in tree.nodes for child in parent.children]
        return any(child.status is Status.RUNNING is not parent.status for parent, child in pairs)
    running = [node.name for node in tree.nodes if node.status is Status.RUNNING]
    if question == "no two leaves use the same resource at once":
        return {"Drive", "Stop"} <= {*running, *replay.results}
    if question == "no reactive node keeps two children running":
        return any(
            sum(child.status is Status.RUNNING for child in node.children) > 1
            for node in tree.nodes
            if node.id.startswith("Reactive")
        )
    raise AssertionError(f"unknown question {question!r}")


def never_happens(file: Path, detail: str) -> bool:
    """Return whether random runs agree with an answer on leaves that are never ticked, succeed or fail."""
    claims = re.findall(r"'([^']*)' is never (ticked)|'([^']*)' never (succeeds|fails)", detail)
    assert claims, detail
    happened: set[tuple[str, str]] = set()
    rng = random.Random(0)
    names = {Status.SUCCESS: "succeeds", Status.FAILURE: "fails"}
    declared = tomllib.loads(file.with_suffix(".proof.toml").read_text(encoding="utf-8"))

    def take(leaf: Any) -> Status:
        model = declared.get("leaves", {}).get(leaf.id, {})
        results = [Status[name] for name in model.get("results", ["SUCCESS", "FAILURE"])]
        if model.get("lasts", True) and leaf.type is not btcore.NodeType.CONDITION:
            results.append(Status.RUNNING)
        result = rng.choice(results)
        if not model.get("at_once", True) and leaf.status is not Status.RUNNING:
            result = Status.RUNNING
        happened.update({(leaf.path, "ticked"), (leaf.path, names.get(result, ""))})
        for port, output in leaf.config.outputs.items() if result is Status.SUCCESS else ():
            texts = declared.get("entries", {}).get(output.key, ["true", "false"])
            leaf.set_output(port, output.type.from_text(str(rng.choice(texts))))
        return result

    nodes = nodes_with_leaves(file, take)
    for _ in range(RANDOM_RUNS):
        clock = SimClock()
        tree = btcore.load(file, nodes=nodes, clock=clock)
        with contextlib.suppress(NodeExecutionError):
            for _ in range(RANDOM_TICKS):
                if tree.tick_exactly_once() is not Status.RUNNING:
                    break
                clock.advance(rng.choice([0.0, 0.1, 2.0]))
    return not any((never or other, what or act) in happened for never, what, other, act in claims)


def main() -> None:
    """Prove the good trees, and find the mistakes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sample", type=int, help="how many mistakes; default all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", help="only this tree")
    options = parser.parse_args()
    cases = [
        (name, mistake)
        for name, tree in TREES.items()
        for mistake in tree.mistakes
        if options.only in (None, name)
    ]
    if options.sample is not None:
        cases = random.Random(options.seed).sample(cases, options.sample)
    started = time.process_time()
    faults: list[str] = []
    refuted = 0
    with tempfile.TemporaryDirectory() as text:
        good_folder, folder = Path(text) / "good", Path(text) / "wrong"
        good_folder.mkdir()
        folder.mkdir()
        for name in dict.fromkeys(name for name, _ in cases):
            tree = TREES[name]
            file = write(good_folder, tree)
            report = prove(file, *tree.questions, nodes=registry(), models=[file])
            for answer in report.answers:
                if answer.answer != "proved" or answer.is_vacuous:
                    faults.append(f"{name}: {answer.question}: {answer.answer}, {answer.detail}")
        for name, mistake in cases:
            tree = TREES[name]
            good, file = write(good_folder, tree), write(folder, tree, tree.mistakes[mistake])
            place = f"{name}: {mistake}"
            try:
                report = prove(file, *tree.questions, nodes=registry(), models=[file])
            except btcore.BtcoreError as error:
                faults.append(f"{place}: {error}")
                continue
            found = [answer for answer in report.answers if answer.answer == "refuted"]
            if not found:
                faults.append(f"{place}: not found")
            refuted += len(found)
            for answer in found:
                check_answer(good, file, answer, place, faults)
    for fault in faults:
        print(f"✘ {fault}")
    print(
        f"{len(cases)} mistakes in {len({name for name, _ in cases})} trees, {refuted} refuted questions, "
        f"{len(faults)} faults, {time.process_time() - started:.1f} s"
    )
    sys.exit(1 if faults else 0)


def check_answer(good: Path, file: Path, answer: Answer, place: str, faults: list[str]) -> None:
    """Check the counterexample of an answer, and the test that is made of it."""
    try:
        if not shows(file, answer):
            faults.append(f"{place}: {answer.question}: the normal run does not show it")
    except (AssertionError, btcore.BtcoreError) as error:
        faults.append(f"{place}: {answer.question}: the normal run differs: {error}")
    run = answer.counterexample
    if run is None:
        return
    recording = file.parent / "run.btrec.txt"
    declared = declarations_beside(file)
    plans = _plans(file, registry(), [file], None, None, declared)
    if not record_counterexample(plans, answer, declared, recording):
        faults.append(f"{place}: {answer.question}: nothing is saved")
        return
    if not (verified := verify(recording)).is_same:
        faults.append(f"{place}: {answer.question}: the recording is not repeated: {verified}")
    for tree, fails in ((file, True), (good, False)):
        failed = False
        try:
            assert_holds_in_run(
                tree, answer.question, recording, cycle=run.recorded_cycle, nodes=registry(), models=[tree]
            )
        except AssertionError:
            failed = True
        except btcore.BtcoreError as error:
            faults.append(f"{place}: {answer.question}: the test of the {tree.parent.name} tree: {error}")
            continue
        if failed is not fails:
            outcome = "fails" if failed else "passes"
            faults.append(f"{place}: {answer.question}: the test {outcome} for the {tree.parent.name} tree")


if __name__ == "__main__":
    main()
