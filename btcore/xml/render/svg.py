"""Draw a tree as a self-contained SVG: without embedded fonts, scripts and external files."""

from typing import Final, Literal
from xml.sax.saxutils import escape

from btcore.status import NodeType
from btcore.tree.tree import Tree
from btcore.xml.render.node_card import FAMILY_COLOURS, Card, card_of, text_width
from btcore.xml.render.tidy_layout import LayoutBox, Spacing, layout_tree
from btcore.xml.render.tree_drawing import DiagramNode, diagram_of_tree

Direction = Literal["auto", "down", "right"]

_MARGIN: Final = 28.0
_HEAD: Final = 52.0
_FOOT: Final = 40.0
_WIDEST: Final = 1700.0
_GAPS: Final = {
    "down": Spacing(siblings=18, levels=44, frame=14),
    "right": Spacing(siblings=12, levels=58, frame=14),
}
_CORNER: Final = 8.0
_SANS: Final = "Inter, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, 'DejaVu Sans', sans-serif"
_MONO: Final = "'JetBrains Mono', 'SF Mono', Menlo, Consolas, 'DejaVu Sans Mono', monospace"
_STYLE: Final = f"""
    text {{ font-family: {_SANS}; fill: #1b2330; }}
    .title {{ font-size: 19px; font-weight: 700; }}
    .about {{ font-size: 11.5px; fill: #6a7485; }}
    .name {{ font-size: 13px; font-weight: 600; }}
    .id {{ font-size: 10.5px; }}
    .uid {{ font-size: 9px; fill: #9aa3b2; text-anchor: end; }}
    .port, .port tspan {{ font-family: {_MONO}; font-size: 10.5px; }}
    .dim {{ fill: #7b8494; }}
    .value {{ fill: #1b2330; }}
    .key {{ fill: #b45309; font-weight: 600; }}
    .script {{ fill: #a21caf; }}
    .rule {{ stroke: #e4e7ee; }}
    .card {{ fill: #ffffff; stroke-width: 1.4; }}
    .edge {{ fill: none; stroke: #a9b2c1; stroke-width: 1.6; }}
    .frame {{ fill: #f59e0b; fill-opacity: .09; stroke: #c2730a; stroke-opacity: .6; }}
    .frame {{ stroke-dasharray: 5 4; }}
    .glyph {{ fill: none; stroke: #ffffff; stroke-width: 1.9; }}
    .glyph {{ stroke-linecap: round; stroke-linejoin: round; }}
    .ring {{ fill: none; stroke: #ffffff; stroke-width: 1.1; stroke-opacity: .85; }}
"""


def tree_to_svg(tree: Tree, direction: Direction = "auto") -> str:
    """Return *tree* as an SVG document.

    Args:
        tree: The tree.
        direction: Where children are placed; see :func:`diagram_to_svg`.
    """
    return diagram_to_svg(diagram_of_tree(tree), tree.id, tree.format, direction)


def diagram_to_svg(root: DiagramNode, title: str, format: int = 4, direction: Direction = "auto") -> str:
    """Return a drawing of a tree as an SVG document.

    Cards are coloured by kind, and show the attributes of the node. The content of a SubTree has a frame.

    Args:
        root: The root of the tree.
        title: The title above the drawing.
        format: The format of the tree, 3 or 4.
        direction: Where children are placed; "auto" is "down", or "right" if "down" becomes too wide.
    """
    cards: dict[int, Card] = {}
    for node in _nodes(root):
        cards[node.uid] = card_of(node)
    if direction == "auto":
        box, sizes = _layout(root, cards, "down")
        if sizes[0] <= _WIDEST:
            return _document(root, title, format, cards, box, sizes, down=True)
        direction = "right"
    box, sizes = _layout(root, cards, direction)
    return _document(root, title, format, cards, box, sizes, down=direction == "down")


def _nodes(root: DiagramNode) -> list[DiagramNode]:
    nodes: list[DiagramNode] = []
    pending = [root]
    while pending:
        node = pending.pop()
        nodes.append(node)
        pending += reversed(node.children)
    return nodes


def _layout(
    root: DiagramNode, cards: dict[int, Card], direction: str
) -> tuple[LayoutBox, tuple[float, float]]:
    """Return the placed boxes, and the width and height of the drawing in px."""

    def box_of(node: DiagramNode) -> LayoutBox:
        card = cards[node.uid]
        sizes = (card.width, card.height) if direction == "down" else (card.height, card.width)
        children = [box_of(child) for child in node.children]
        return LayoutBox(*sizes, framed=node.type is NodeType.SUBTREE, children=children)

    box = box_of(root)
    breadth, depth = layout_tree(box, _GAPS[direction])
    return box, (breadth, depth) if direction == "down" else (depth, breadth)


def _document(
    root: DiagramNode,
    title: str,
    format: int,
    cards: dict[int, Card],
    box: LayoutBox,
    sizes: tuple[float, float],
    down: bool,
) -> str:
    nodes = _nodes(root)
    about = f"format {format} · {len(nodes)} node{'' if len(nodes) == 1 else 's'}"
    kinds = [kind for kind in FAMILY_COLOURS if any(node.type is kind for node in nodes)]
    needed = max(text_width(title, 19, bold=True) + 10, 92.0 * len(kinds))
    width = max(sizes[0], needed) + 2 * _MARGIN
    height = sizes[1] + _HEAD + _FOOT + _MARGIN
    left = (width - sizes[0]) / 2
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
        f'viewBox="0 0 {width:.1f} {height:.1f}" role="img">',
        f"<title>{escape(title)}</title>",
        f"<style>{_STYLE}{_colours()}</style>",
        '<rect width="100%" height="100%" fill="#f7f8fb"/>',
        f'<text class="title" x="{_MARGIN:g}" y="36">{escape(title)}</text>',
        f'<text class="about" x="{_MARGIN + text_width(title, 19, bold=True) + 12:.1f}" y="36">{about}</text>'
        if text_width(title, 19, bold=True) + text_width(about, 12) + 12 <= width - 2 * _MARGIN
        else f'<text class="about" x="{_MARGIN:g}" y="51">{about}</text>',
        f'<g transform="translate({left:.1f} {_HEAD + 14:g})">',
    ]
    frames: list[str] = []
    edges: list[str] = []
    drawn: list[str] = []
    for node, node_box in _pairs(root, box):
        _draw(node, node_box, cards[node.uid], down, frames, edges, drawn)
    lines += [*frames, *edges, *drawn, "</g>"]
    lines += [_legend(kinds, height - 18), "</svg>"]
    return "\n".join(lines) + "\n"


def _colours() -> str:
    """Return the style rules for the kinds of nodes."""
    return "".join(
        f"    .card.{name} {{ stroke: {colour}; }} .badge.{name}, .id.{name} {{ fill: {colour}; }}\n"
        for name, colour in FAMILY_COLOURS.values()
    )


def _pairs(root: DiagramNode, box: LayoutBox) -> list[tuple[DiagramNode, LayoutBox]]:
    pairs: list[tuple[DiagramNode, LayoutBox]] = []
    pending = [(root, box)]
    while pending:
        node, node_box = pending.pop()
        pairs.append((node, node_box))
        pending += reversed(list(zip(node.children, node_box.children, strict=True)))
    return pairs


def _draw(
    node: DiagramNode,
    box: LayoutBox,
    card: Card,
    down: bool,
    frames: list[str],
    edges: list[str],
    drawn: list[str],
) -> None:
    """Add the card of *node*, its frame, and the edges to its children."""
    x, y = (box.middle - card.width / 2, box.top) if down else (box.top, box.middle - card.height / 2)
    drawn.append(f'<g transform="translate({x:.1f} {y:.1f})">{"".join(card.drawing)}</g>')
    if box.frame is not None:
        b0, d0, b1, d1 = box.frame
        x0, y0, x1, y1 = (b0, d0, b1, d1) if down else (d0, b0, d1, b1)
        size = f'width="{x1 - x0:.1f}" height="{y1 - y0:.1f}"'
        frames.append(f'<rect class="frame" x="{x0:.1f}" y="{y0:.1f}" {size} rx="12"/>')
    if box.children:
        gap = _GAPS["down" if down else "right"].levels
        begin = box.children[0].top - (_GAPS["down"].frame if box.framed else 0)
        turn = begin - gap / 2
        for child in box.children:
            edges.append(_edge(box.middle, box.top + box.depth, child.middle, child.top, turn, down))


def _edge(b0: float, d0: float, b1: float, d1: float, turn: float, down: bool) -> str:
    """Return an edge that runs along the depth, changes its breadth at *turn*, and has round corners."""

    def at(b: float, d: float) -> str:
        return f"{b:.1f} {d:.1f}" if down else f"{d:.1f} {b:.1f}"

    if abs(b1 - b0) < 0.5:
        return f'<path class="edge" d="M{at(b0, d0)}L{at(b1, d1)}"/>'
    round_ = min(_CORNER, abs(b1 - b0) / 2, max(0.0, turn - d0), d1 - turn)
    step = round_ if b1 > b0 else -round_
    path = (
        f"M{at(b0, d0)}L{at(b0, turn - round_)}Q{at(b0, turn)} {at(b0 + step, turn)}"
        f"L{at(b1 - step, turn)}Q{at(b1, turn)} {at(b1, turn + round_)}L{at(b1, d1)}"
    )
    return f'<path class="edge" d="{path}"/>'


def _legend(kinds: list[NodeType], y: float) -> str:
    """Return the legend: the kinds of nodes in the tree, with their colours."""
    words: list[str] = []
    x = _MARGIN
    for kind in kinds:
        name = FAMILY_COLOURS[kind][0]
        words.append(f'<circle class="badge {name}" cx="{x + 5:.1f}" cy="{y - 4:.1f}" r="5"/>')
        words.append(f'<text class="about" x="{x + 15:.1f}" y="{y:.1f}">{name}</text>')
        x += text_width(name, 11.5) + 36
    return "".join(words)
