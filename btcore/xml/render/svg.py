"""Draw a tree as a self-contained SVG, without embedded fonts, scripts or external files."""

from collections.abc import Iterator
from typing import Final, NamedTuple

from btcore.escaping import escape_text
from btcore.status import NodeType
from btcore.xml.render.node_card import FAMILY_COLOURS, Card, card_of, text_width
from btcore.xml.render.tidy_layout import LayoutBox, Spacing, layout_tree
from btcore.xml.render.tree_drawing import DiagramNode

_MARGIN: Final = 28.0
_HEAD: Final = 52.0
_FOOT: Final = 40.0
_WIDEST: Final = 1700.0
_GAPS_DOWN: Final = Spacing(siblings=18, levels=44, frame=14)
_GAPS_RIGHT: Final = Spacing(siblings=12, levels=58, frame=14)
_CORNER: Final = 8.0
# The widths of the cards fit these fonts. resvg, which makes the PNG, omits a text if it finds none of them.
_SANS: Final = (
    "Inter, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, 'Liberation Sans', 'Noto Sans', 'DejaVu Sans', "
    "sans-serif"
)
_MONO: Final = (
    f"'JetBrains Mono', 'SF Mono', Menlo, Consolas, 'DejaVu Sans Mono', 'Liberation Mono', monospace, {_SANS}"
)
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
    .pill {{ fill: #ffffff; stroke: #a9b2c1; stroke-width: 1.3; }}
    .count {{ font-size: 11px; font-weight: 700; text-anchor: middle; fill: #6a7485; }}
"""


class _PlacedNode(NamedTuple):
    """A node with its card, and the box of the layout that holds the card."""

    node: DiagramNode
    card: Card
    box: LayoutBox


def drawing_style() -> str:
    """Return the style sheet of all drawings, for a page that shows drawings without their own."""
    return f"{_STYLE}{_colours()}"


def diagram_to_svg(root: DiagramNode, title: str, format: int = 4, styled: bool = True) -> str:
    """Return a drawing of a tree as an SVG document.

    Cards are coloured by kind, and show the attributes of the node. The content of a SubTree has a frame.
    Children are placed below their parents, or to the right of them if the drawing becomes too wide. The
    group of each card has the number of the node as `data-uid`.

    Args:
        format: The format of the tree, 3 or 4.
        styled: Whether the document contains `drawing_style()`.
    """
    placed, width, height = _layout(root, down=True)
    down = width <= _WIDEST
    if not down:
        placed, width, height = _layout(root, down=False)
    style = f"<style>{drawing_style()}</style>" if styled else ""
    return _document(placed, title, format, width, height, down, style)


def _layout(root: DiagramNode, down: bool) -> tuple[list[_PlacedNode], float, float]:
    """Return the placed nodes in pre-order, and the width and height of the drawing in px."""
    placed: list[_PlacedNode] = []

    def box_of(node: DiagramNode) -> LayoutBox:
        card = card_of(node)
        sizes = (card.width, card.height) if down else (card.height, card.width)
        box = LayoutBox(*sizes, framed=node.type is NodeType.SUBTREE)
        placed.append(_PlacedNode(node, card, box))
        box.children = [box_of(child) for child in node.children]
        return box

    breadth, depth = layout_tree(box_of(root), _GAPS_DOWN if down else _GAPS_RIGHT)
    return (placed, breadth, depth) if down else (placed, depth, breadth)


def _document(
    placed: list[_PlacedNode],
    title: str,
    format: int,
    drawing_width: float,
    height: float,
    down: bool,
    style: str,
) -> str:
    count = len(placed) + sum(item.node.hidden for item in placed)
    about = f"format {format} · {count} node{'' if count == 1 else 's'}"
    kinds = [kind for kind in FAMILY_COLOURS if any(item.node.type is kind for item in placed)]
    title_width = text_width(title, 19, bold=True)
    width = max(drawing_width, title_width + 10, 92.0 * len(kinds)) + 2 * _MARGIN
    height += _HEAD + _FOOT + _MARGIN
    left = (width - drawing_width) / 2
    # The number of nodes is written after the title, or below it if there is no space.
    beside = title_width + text_width(about, 12) + 12 <= width - 2 * _MARGIN
    place = f'x="{_MARGIN + title_width + 12:.1f}" y="36"' if beside else f'x="{_MARGIN:g}" y="51"'
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
        f'viewBox="0 0 {width:.1f} {height:.1f}" role="img" data-direction="{"down" if down else "right"}">',
        f"<title>{escape_text(title)}</title>",
        style,
        '<rect class="sheet" width="100%" height="100%" fill="#f7f8fb"/>',
        f'<text class="title" x="{_MARGIN:g}" y="36">{escape_text(title)}</text>',
        f'<text class="about" {place}>{about}</text>',
        f'<g transform="translate({left:.1f} {_HEAD + 14:g})">',
    ]
    # Later elements cover earlier elements: cards are drawn last.
    lines += [_frame(*item.box.frame, down) for item in placed if item.box.frame is not None]
    for item in placed:
        lines += _edges(item.box, down)
    for node, card, box in placed:
        x, y = (box.middle - card.width / 2, box.top) if down else (box.top, box.middle - card.height / 2)
        place = f'data-uid="{node.uid}" transform="translate({x:.1f} {y:.1f})"'
        badge = _hidden_badge(node.hidden, card, down) if node.hidden else ""
        lines.append(f"<g {place}>{''.join(card.drawing)}{badge}</g>")
    return "\n".join([*lines, "</g>", _legend(kinds, height - 18), "</svg>"]) + "\n"


def _hidden_badge(count: int, card: Card, down: bool) -> str:
    """Return the badge of a card whose *count* descendants are omitted, at the edge towards them."""
    width = text_width(f"+{count}", 11, bold=True) + 12
    # Beside the card, the badge must not cover the ID.
    x, y = (card.width / 2, card.height) if down else (card.width + width / 2 - 5, card.height / 2)
    pill = f'<rect class="pill" x="{-width / 2:.1f}" y="-8" width="{width:.1f}" height="16" rx="8"/>'
    words = f'<title>{count} hidden</title>{pill}<text class="count" y="4">+{count}</text>'
    return f'<g class="fold" transform="translate({x:.1f} {y:.1f})">{words}</g>'


def _colours() -> str:
    """Return the style rules for the kinds of nodes."""
    return "".join(
        f"    .card.{name} {{ stroke: {colour}; }} .badge.{name}, .id.{name} {{ fill: {colour}; }}\n"
        for name, colour in FAMILY_COLOURS.values()
    )


def _frame(b0: float, d0: float, b1: float, d1: float, down: bool) -> str:
    x0, y0, x1, y1 = (b0, d0, b1, d1) if down else (d0, b0, d1, b1)
    size = f'width="{x1 - x0:.1f}" height="{y1 - y0:.1f}"'
    return f'<rect class="frame" x="{x0:.1f}" y="{y0:.1f}" {size} rx="12"/>'


def _edges(box: LayoutBox, down: bool) -> Iterator[str]:
    """Yield the edges from *box* to its children."""
    gaps = _GAPS_DOWN if down else _GAPS_RIGHT
    for child in box.children:
        turn = child.top - (gaps.frame if box.framed else 0) - gaps.levels / 2
        yield _edge(box.middle, box.top + box.depth, child.middle, child.top, turn, down)


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
