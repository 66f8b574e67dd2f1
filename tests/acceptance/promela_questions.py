"""The questions about a tree as formulas of temporal logic, for spin."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from promela_tree import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, Entries, Node, UntranslatableError

_ATOM: Final = re.compile(
    r"\{(?P<key>\w+)\}\s*(?P<compare>[=!<>]=?)\s*(?:'(?P<text>[^']*)'|(?P<number>-?\d+))"
    r"|(?P<name>[A-Za-z_]\w*)(?:\s+(?:is\s+(?P<status>[A-Z]+)|(?P<event>ticked|halted)))?"
)


@dataclass
class Translation:
    """A Promela program, and how its formulas answer the questions.

    Attributes:
        program: The text of the program.
        proofs: For each question the names of the formulas that hold in all runs if it is proved.
        witnesses: For each question the names of the formulas that must not hold in all runs.
        runs_forever: The name of a formula that holds if the tree never ends, provided that it contains nodes
            that are declared to run forever; the question whether it ends is then proved; else None.
    """

    program: str
    proofs: dict[str, list[str]] = field(default_factory=dict)
    witnesses: dict[str, list[str]] = field(default_factory=dict)
    runs_forever: str | None = None


class Questions:
    """The formulas of the questions, and the statements that update their propositions after each tick."""

    def __init__(self, nodes: Sequence[Node], entries: Entries) -> None:
        self._nodes = nodes
        self._entries = entries
        self._timers = [node for node in nodes if node.duration is not None]
        self._leaves = [(node.number, node.model) for node in nodes if node.model is not None]
        self.result = Translation("")
        self.variables: list[str] = []
        self.start: list[str] = []
        self.updates: list[str] = []
        self.formulas: list[str] = []
        self._add_fairness()

    def add_standard(self) -> None:
        """Add the standard questions."""
        self._add_ends()
        self._add_leaves()
        no_error = "error == 0 && "
        self._add_never(
            "everything that runs is halted when its parent ends", no_error + self._left_running()
        )
        self._add_never("no two leaves use the same resource at once", "clash")
        self._add_never("every mandatory input is written before it is read", "error == UNWRITTEN")
        self._add_never("no node raises an exception", "error == RAISED")
        self._add_never("no reactive node keeps two children running", self._two_running())

    def add(self, question: str) -> None:
        """Add a question of the user."""
        if question.startswith("never "):
            self._add_never(question, self._proposition(question.removeprefix("never ")))
            return
        within = re.search(r" within (\d+) ticks?$", question)
        body = question[: within.start()] if within else question
        for kind in (" leads to ", " before "):
            first, found, second = body.partition(kind)
            if found:
                break
        else:
            raise UntranslatableError(f"the question '{question}'")
        a = self._latch(self._proposition(first))
        b = self._latch(self._proposition(second))
        if kind == " before ":
            formula = f"[] !{b} || (!{b} U {a})"
        elif within:
            formula = f"[] !{self._late(a, b, int(within[1]))}"
        else:
            formula = f"(<>[] !ceased && []<> round) -> [] ({a} -> <> {b})"
        self.result.proofs[question] = [self._formula(formula)]

    def _add_never(self, question: str, proposition: str) -> None:
        self.result.proofs[question] = [self._formula(f"[] !{self._latch(proposition)}")]

    def _add_fairness(self) -> None:
        """Declare `ceased` and `round` for fair runs, and `barred` and `whole_round` for runs to the end.

        An action that is not endless and is ticked again and again ends, and every timer expires. The tree
        must end in fair runs in which no leaf fails forever: a condition ceases to fail, and an action that
        fails again and again succeeds again and again. Time in nodes that are meant to run forever is
        excluded.
        """
        fair = [
            (f"(called[{i}] > 0)", f"!({self._kept(i)})")
            for i, model in self._leaves
            if model.lasts and not model.endless
        ]
        fair += [("", f"!(left_{node.number} > 0 && !fresh_{node.number})") for node in self._timers]
        improving = [
            (f"returned_failure[{i}]", f"returned_success[{i}]")
            for i, model in self._leaves
            if not model.is_condition
        ]
        excluded = [f"returned_failure[{i}]" for i, model in self._leaves if model.is_condition]
        excluded += [f"st[{number}] == RUNNING" for number in self._endless()]
        self.variables += ["bool ceased, barred, round, whole_round;", "byte turn, whole_turn;"]
        masks: list[str] = []
        ceased: list[str] = []
        for number, (cause, _) in enumerate([*fair, *improving]):
            if cause:
                self.variables.append(f"bool ceases_{number};")
                masks.append(f"if :: ceases_{number} = false :: ceases_{number} = true fi;")
                ceased.append(f"(ceases_{number} && {cause})")
        self.start = ["atomic {", *masks, "skip }"]
        own = " || ".join(
            text for number, text in enumerate(ceased) if number < sum(bool(c) for c, _ in fair)
        )
        self.updates += [
            f"ceased = !over && ({own or 'false'});",
            f"barred = !over && ({' || '.join([*ceased, *excluded]) or 'false'});",
        ]
        self._add_round("turn", "round", fair)
        self._add_round("whole_turn", "whole_round", [*fair, *improving])

    def _add_round(self, turn: str, done: str, conditions: Sequence[tuple[str, str]]) -> None:
        """Add statements that set *done* when the effects of all *conditions* have happened in turn."""
        for number, (cause, effect) in enumerate(conditions):
            met = f"(ceases_{number} || {effect})" if cause else effect
            self.updates.append(f"if :: ({turn} == {number} && {met}) -> {turn}++ :: else fi;")
        count = len(conditions)
        self.updates.append(
            f"if :: (over || {turn} == {count}) -> {turn} = 0; {done} = true :: else -> {done} = false fi;"
        )

    def _kept(self, number: int) -> str:
        """Return whether a leaf was RUNNING during the whole tick: it neither completed nor was halted."""
        ended = f"halted[{number}] || succeeded[{number}] || failed[{number}]"
        return f"was_running[{number}] && st[{number}] == RUNNING && !({ended})"

    def _endless(self) -> list[int]:
        """Return the numbers of the nodes that are meant to run forever."""
        endless = [number for number, model in self._leaves if model.endless]
        for node in self._nodes:
            limit = node.attributes.get("num_cycles") or node.attributes.get("num_attempts")
            if node.tag == "KeepRunningUntilFailure" or limit == "-1":
                endless.append(node.number)
        return endless

    def _add_ends(self) -> None:
        question = "the tree ends"
        formula = "(<>[] !barred && []<> whole_round) -> <> over"
        self.result.proofs[question] = [self._formula(formula)]
        if self._endless():
            ended = self._latch("over && !error")
            self.result.runs_forever = self._formula(f"[] !{ended}")

    def _add_leaves(self) -> None:
        models = dict(self._leaves)
        wanted: list[str] = []
        for node in self._nodes:
            if node.children:
                continue
            i = node.number
            wanted.append(f"succeeded[{i}] || failed[{i}] || ran[{i}]")
            if i in models:
                results = models[i].results
                wanted += [f"succeeded[{i}]"] * (SUCCESS in results) + [f"failed[{i}]"] * (FAILURE in results)
        names = [self._formula(f"[] !{self._latch(each)}") for each in wanted]
        self.result.witnesses["every leaf is ticked, and can succeed and fail"] = names

    def _left_running(self) -> str:
        pairs = [
            f"(st[{child.number}] == RUNNING && st[{node.number}] != RUNNING)"
            for node in self._nodes
            for child in node.children
        ]
        return f"({' || '.join(pairs) or 'false'})"

    def _two_running(self) -> str:
        found = [
            f"((st[{first.number}] == RUNNING) && (st[{second.number}] == RUNNING))"
            for node in self._nodes
            if node.tag.startswith("Reactive")
            for number, first in enumerate(node.children)
            for second in node.children[number + 1 :]
        ]
        return f"({' || '.join(found) or 'false'})"

    def _late(self, first: str, second: str, within: int) -> str:
        """Return a variable that is true if *second* has not followed *first* within a number of ticks."""
        late, due = f"late_{len(self.formulas)}", f"due_{len(self.formulas)}"
        self.variables.append(f"bool {late}; byte {due};")
        self.updates += [
            f"if :: {second} -> {due} = 0",
            f":: (!{second} && {due} > 0) -> {due}--; if :: ({due} == 0) -> {late} = true :: else fi",
            f":: (!{second} && {due} == 0 && {first}) -> {due} = {within};",
            f"if :: ({within} == 0) -> {late} = true :: else fi",
            ":: else fi;",
            f"if :: (over && {due} > 0) -> {late} = true :: else fi;",
        ]
        return late

    def _latch(self, expression: str) -> str:
        """Return a variable that holds the value that an expression had after the last tick."""
        name = f"p{len(self.variables)}"
        self.variables.append(f"bool {name};")
        self.updates.append(f"{name} = ({expression});")
        return name

    def _formula(self, formula: str) -> str:
        name = f"f{len(self.formulas)}"
        self.formulas.append(f"ltl {name} {{ {formula} }}")
        return name

    def _proposition(self, text: str) -> str:
        """Return a Promela expression for a proposition of a question."""

        def atom(match: "re.Match[str]") -> str:
            if match["key"]:
                entry = self._entries.variable(self._nodes[0].scope, match["key"])
                value = match["number"] or self._entries.number(match["text"])
                return f"({entry} != UNSET && {entry} {match['compare']} {value})"
            found = [node.number for node in self._nodes if node.name == match["name"]]
            if len(found) != 1:
                raise UntranslatableError(f"the name '{match['name']}'")
            if match["event"]:
                return f"{match['event']}[{found[0]}]"
            status = match["status"] or RUNNING
            if status in (RUNNING, IDLE):
                return f"(st[{found[0]}] == {status})"
            array = {SUCCESS: "succeeded", FAILURE: "failed", SKIPPED: "skipped"}[status]
            return f"{array}[{found[0]}]"

        return _ATOM.sub(atom, re.sub(r"[&|]+", lambda sign: sign[0][0] * 2, text))
