"""Pictures of small state graphs: DOT for Graphviz, and SVG with a layout of its own.

Every state is drawn on the layer of its depth, and the label of every edge on a layer between two layers of
states, so that labels do not overlap. Long edges get a place on each layer that they cross.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final, NamedTuple

from btcore.errors import BtcoreError
from btcore.escaping import escape_controls, escape_text
from btcore.status import RUNNING
from btcore.xml.render.node_card import text_width
from btcore_proof.counterexample import names_of
from btcore_proof.exploration import Explorer
from btcore_proof.prover import Prover
from btcore_proof.state_graph import RAISED, RESULT_OF, Outcome

MOST_STATES: Final = 100
"""The number of states of the biggest graph that is drawn."""
_MOST_LEAVES: Final = 4
_WIDEST: Final = 24
_SIZE: Final = 11.0
_LINE: Final = 14.0
_GAP: Final = 22.0
_MARGIN: Final = 24.0
_SWEEPS: Final = 12
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
    """A state of a picture: its key, its kind (a key of the colours), its layer, and its text."""

    key: str
    kind: str
    layer: int
    text: str


class DrawnEdge(NamedTuple):
    """An edge of a picture, with the lines of its label."""

    source: str
    target: str
    labels: list[str]


def draw_graph(prover: Prover) -> tuple[list[DrawnState], list[DrawnEdge]]:
    """Return the states and the edges of the graph that a prover has searched.

    Raises:
        PictureError: The graph has more than `MOST_STATES` states.
    """
    explorer, graph = prover.explorer, prover.explorer.graph
    count = graph.states
    if count > MOST_STATES:
        raise PictureError(f"the graph has {count:,} states; pictures show at most {MOST_STATES}")
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
        states.append(DrawnState(keys[number], kind, graph.depths[number], _short(text)))
    ends: dict[str, int] = {}
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
                ends[target] = max(ends.get(target, 0), graph.depths[number] + 1)
            found = outcomes.setdefault((keys[number], target), [])
            outcome = _outcome(explorer, signals, names)
            if outcome not in found:
                found.append(outcome)
    states += [DrawnState(name, name, layer, name) for name, layer in ends.items()]
    return states, [DrawnEdge(*pair, _lines(found)) for pair, found in outcomes.items()]


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
    text = escape_controls(text, one_line=True)
    return text if len(text) <= _WIDEST else f"{text[: _WIDEST - 1]}…"


def _lines(outcomes: list[list[str]]) -> list[str]:
    """Return the lines of a label: the shortest of the ticks that lead to a state, and how many others do."""
    first = min(outcomes, key=len)
    if len(first) > _MOST_LEAVES:
        first = [*first[: _MOST_LEAVES - 1], f"and {len(first) - _MOST_LEAVES + 1} more"]
    others = len(outcomes) - 1
    return [*first, f"or {others} other{'s' if others > 1 else ''}"] if others else first


def graph_to_dot(states: Sequence[DrawnState], edges: Sequence[DrawnEdge]) -> str:
    """Return a graph in the language of Graphviz.

    Args:
        states: The states.
        edges: The edges.
    """
    lines = ["digraph states {", '  node [shape=box, style="rounded,filled", fontname=Helvetica];']
    for state in states:
        fill, line = _COLOURS[state.kind]
        text = json.dumps(state.text, ensure_ascii=False)
        lines.append(f'  "{state.key}" [label={text}, fillcolor="{fill}", color="{line}"];')
    for edge in edges:
        label = json.dumps("\n".join(edge.labels), ensure_ascii=False)
        lines.append(f'  "{edge.source}" -> "{edge.target}" [label={label}];')
    return "\n".join([*lines, "}"]) + "\n"


# --- SVG


@dataclass(eq=False)
class _Item:
    """Something with a place on a layer: a state, a label, or a point of a long edge."""

    layer: int
    lines: list[str]
    neighbours: list["_Item"] = field(default_factory=list)
    x: float = 0.0
    y: float = 0.0

    @property
    def width(self) -> float:
        """The width (px)."""
        return max((text_width(line, _SIZE) for line in self.lines), default=0.0) + 16

    @property
    def height(self) -> float:
        """The height (px)."""
        return _LINE * len(self.lines) + 10


def graph_to_svg(states: Sequence[DrawnState], edges: Sequence[DrawnEdge]) -> str:
    """Return a drawing of a graph as a self-contained SVG document.

    Args:
        states: The states.
        edges: The edges.
    """
    items = {state.key: _Item(2 * state.layer, [state.text]) for state in states}
    routes = [_route(items[edge.source], items[edge.target], edge.labels) for edge in edges]
    between = [item for route in routes for item in route[1:-1]]
    layers = _layers([*items.values(), *between])
    for route in routes:
        for first, second in pairwise(route):
            first.neighbours.append(second)
            second.neighbours.append(first)
    width, height = _place(layers)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
        f'viewBox="0 0 {width:.1f} {height:.1f}" role="img">',
        "<title>States</title>",
        f"<style>text {{ font: {_SIZE:g}px Inter, 'Segoe UI', Helvetica, Arial, 'DejaVu Sans', sans-serif; "
        "text-anchor: middle; fill: #1b2330 } .edge { fill: none; stroke: #8a96a8; stroke-width: 1.3 }"
        "</style>",
        '<defs><marker id="arrow" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="7" markerHeight="7" '
        'orient="auto"><path d="M0 0L10 5L0 10z" fill="#8a96a8"/></marker></defs>',
        '<rect width="100%" height="100%" fill="#f7f8fb"/>',
        *(_path(route) for route in routes),
    ]
    for item in between:
        if item.lines:
            lines.append(_box(item, "#f7f8fb", "none"))
    for state in states:
        lines.append(_box(items[state.key], *_COLOURS[state.kind], is_light=state.kind == "exception"))
    return "\n".join([*lines, "</svg>"]) + "\n"


def _route(source: _Item, target: _Item, labels: list[str]) -> list[_Item]:
    """Return the items through which an edge runs: its ends, its label, and points on the layers between."""
    if target.layer > source.layer:
        label = source.layer + 1
        crossed = list(range(label + 1, target.layer))
    else:
        # An edge to the same layer turns below it; an edge upwards arrives from below.
        label = source.layer + 1 if target.layer == source.layer else target.layer + 1
        crossed = list(range(source.layer - 1, label, -1))
    points = [_Item(layer, []) for layer in crossed]
    middle = _Item(label, labels)
    return (
        [source, middle, *points, target]
        if target.layer >= source.layer
        else [source, *points, middle, target]
    )


def _layers(items: Sequence[_Item]) -> list[list[_Item]]:
    layers: list[list[_Item]] = [[] for _ in range(1 + max(item.layer for item in items))]
    for item in items:
        layers[item.layer].append(item)
    return layers


def _place(layers: list[list[_Item]]) -> tuple[float, float]:
    """Place all items near their neighbours, in layers from the top down. Return the width and height."""
    for layer in layers:
        _spread(layer, [0.0] * len(layer))
    for sweep in range(_SWEEPS):
        for layer in layers if sweep % 2 == 0 else layers[::-1]:
            wanted = {
                id(item): sum(other.x for other in item.neighbours) / len(item.neighbours)
                if item.neighbours
                else item.x
                for item in layer
            }
            layer.sort(key=lambda item: wanted[id(item)])
            _spread(layer, [wanted[id(item)] for item in layer])
    left = min(item.x - item.width / 2 for layer in layers for item in layer)
    right = max(item.x + item.width / 2 for layer in layers for item in layer)
    # Edges that run far to the side need space, so that they are not flat.
    gap = max(_GAP, (right - left) / 40)
    y = _MARGIN
    for layer in layers:
        height = max((item.height for item in layer), default=0.0)
        for item in layer:
            item.x += _MARGIN - left
            item.y = y + height / 2
        y += height + gap
    return right - left + 2 * _MARGIN, y - gap + _MARGIN


def _spread(layer: list[_Item], wanted: Sequence[float]) -> None:
    """Place the items of a layer in their order, without overlap, near the places that are wanted."""
    least: list[float] = []
    most: list[float] = []
    for number, item in enumerate(layer):
        gap = (layer[number - 1].width + item.width) / 2 + _GAP if number else 0.0
        least.append(max(wanted[number], least[-1] + gap) if number else wanted[number])
    for number in reversed(range(len(layer))):
        after = number + 1
        gap = (layer[number].width + layer[after].width) / 2 + _GAP if after < len(layer) else 0.0
        most.append(min(wanted[number], most[-1] - gap) if most else wanted[number])
    # Both orders keep the distances, and so does their mean.
    for item, first, second in zip(layer, least, reversed(most), strict=True):
        item.x = (first + second) / 2


def _path(route: list[_Item]) -> str:
    source, target = route[0], route[-1]
    leaves_upwards = route[1].y < source.y
    arrives_from_below = route[-2].y > target.y
    points = [(item.x, item.y) for item in route[1:-1]]
    shift = 12.0 if source is target else 0.0
    start = (source.x - shift, source.y + (-source.height if leaves_upwards else source.height) / 2)
    end = (target.x + shift, target.y + (target.height if arrives_from_below else -target.height) / 2)
    text = f"M{start[0]:.1f} {start[1]:.1f}"
    for (x0, y0), (x1, y1) in zip([start, *points], [*points, end], strict=True):
        middle = (y0 + y1) / 2
        text += f"C{x0:.1f} {middle:.1f} {x1:.1f} {middle:.1f} {x1:.1f} {y1:.1f}"
    return f'<path class="edge" d="{text}" marker-end="url(#arrow)"/>'


def _box(item: _Item, fill: str, stroke: str, is_light: bool = False) -> str:
    x, y = item.x - item.width / 2, item.y - item.height / 2
    box = (
        f'<rect x="{x:.1f}" y="{y:.1f}" width="{item.width:.1f}" height="{item.height:.1f}" rx="7" '
        f'fill="{fill}" stroke="{stroke}"/>'
    )
    colour = ' style="fill: #ffffff"' if is_light else ""
    texts = [
        f'<text x="{item.x:.1f}" y="{y + 5 + _LINE * (number + 0.75):.1f}"{colour}>{escape_text(line)}</text>'
        for number, line in enumerate(item.lines)
    ]
    return box + "".join(texts)
