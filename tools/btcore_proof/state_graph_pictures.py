"""The pictures of small state graphs, in the language of Graphviz."""

import json
from collections.abc import Sequence
from typing import Final, NamedTuple

from btcore.errors import BtcoreError
from btcore.escaping import escape_controls
from btcore.status import RUNNING
from btcore.suggestions import counted, shortened
from btcore_proof.counterexample import names_of
from btcore_proof.exploration import Explorer
from btcore_proof.prover import Prover
from btcore_proof.state_graph import RAISED, RESULT_OF, Outcome

MAX_STATES: Final = 100
"""The number of states of the biggest graph that is drawn."""
_MAX_LEAVES: Final = 4
_WIDEST: Final = 24
_COLOURS: Final = {
    "state": ("#ffffff", "#5b6b86"),
    "start": ("#e8f0ff", "#2b62c4"),
    "SUCCESS": ("#e2f5e5", "#2f8f46"),
    "FAILURE": ("#fde7e5", "#c2402f"),
    "SKIPPED": ("#e2f4f7", "#23809a"),
    "exception": ("#c2402f", "#7c1f14"),
    "unknown": ("#fff4d6", "#b7860b"),
}


class PictureError(BtcoreError):
    """A state graph is too big to be drawn."""


class DrawnState(NamedTuple):
    """A state of a picture: its key, its kind (a key of the colours), and its text."""

    key: str
    kind: str
    text: str


class DrawnEdge(NamedTuple):
    """An edge of a picture, with the lines of its label."""

    source: str
    target: str
    labels: list[str]


def draw_graph(prover: Prover) -> tuple[list[DrawnState], list[DrawnEdge]]:
    """Return the states and the edges of the graph that a prover has searched.

    Raises:
        PictureError: The graph has more than `MAX_STATES` states.
    """
    explorer, graph = prover.explorer, prover.explorer.graph
    count = graph.states
    if count > MAX_STATES:
        raise PictureError(f"the graph has {count:,} states; pictures show at most {MAX_STATES}")
    names = names_of(prover.tree)
    states: list[DrawnState] = []
    vertices = [vertex for vertex in range(len(graph.edges)) if vertex not in graph.decisions]
    keys = {vertex: str(number) for number, vertex in enumerate(vertices)}
    for number in vertices:
        statuses = explorer.table.state(number).statuses
        running = [
            names[node.config.uid]
            for node, status in zip(prover.tree.nodes, statuses, strict=True)
            if status == RUNNING and not node.children
        ]
        kind = "start" if graph.parents[number] is None else "state"
        text = ", ".join(running) or ("start" if kind == "start" else "…")
        states.append(DrawnState(keys[number], kind, _short(text)))
    ends: dict[str, None] = {}
    outcomes: dict[tuple[str, str], list[list[str]]] = {}
    known: dict[int, set[Outcome]] = {}
    for number in vertices:
        for end, signals in sorted(graph.outcomes_of(number, known)):
            if end >= 0:
                target = keys[end]
            else:
                target = "exception" if end == RAISED else "unknown"
                if end in RESULT_OF:
                    target = RESULT_OF[end].name
                ends[target] = None
            lines = outcomes.setdefault((keys[number], target), [])
            outcome = _outcome(explorer, signals, names)
            if outcome not in lines:
                lines.append(outcome)
    states += [DrawnState(name, name, name) for name in ends]
    return states, [DrawnEdge(*pair, _lines(lines)) for pair, lines in outcomes.items()]


def _outcome(explorer: Explorer, bits: int, names: dict[int, str]) -> list[str]:
    """Return the results of the leaves in a tick."""
    signals = explorer.signals
    words: list[str] = []
    for number, leaf in enumerate(signals.leaves):
        if bits & signals.ticked(number):
            results = [(signals.succeeded(number), "✔"), (signals.failed(number), "✘")]
            marks = "".join(mark for bit, mark in results if bits & bit)
            words.append(f"{_short(names[leaf.config.uid])} {marks or '▶'}")
    return words or ["no leaf"]


def _short(text: str) -> str:
    return shortened(escape_controls(text, one_line=True), _WIDEST)


def _lines(outcomes: list[list[str]]) -> list[str]:
    """Return the lines of a label: the shortest of the ticks that lead to a state, and how many others do."""
    first = min(outcomes, key=len)
    if len(first) > _MAX_LEAVES:
        first = [*first[: _MAX_LEAVES - 1], f"and {len(first) - _MAX_LEAVES + 1} more"]
    others = len(outcomes) - 1
    return [*first, f"or {counted(others, 'other')}"] if others else first


def graph_to_dot(states: Sequence[DrawnState], edges: Sequence[DrawnEdge]) -> str:
    """Return a graph in the language of Graphviz."""
    lines = ["digraph states {", '  node [shape=box, style="rounded,filled", fontname=Helvetica];']
    for state in states:
        fill, line = _COLOURS[state.kind]
        text = json.dumps(state.text, ensure_ascii=False)
        lines.append(f'  "{state.key}" [label={text}, fillcolor="{fill}", color="{line}"];')
    for edge in edges:
        label = json.dumps("\n".join(edge.labels), ensure_ascii=False)
        lines.append(f'  "{edge.source}" -> "{edge.target}" [label={label}];')
    return "\n".join([*lines, "}"]) + "\n"
