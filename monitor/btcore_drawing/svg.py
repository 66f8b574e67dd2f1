"""Draw a tree as a self-contained SVG, without embedded fonts, scripts or external files, or as a PNG."""

import itertools
import re
from collections.abc import Callable
from typing import Final, NamedTuple

from btcore.errors import BtcoreError
from btcore.escaping import escape_text
from btcore.extras import install_command
from btcore.status import NodeType
from btcore.suggestions import counted
from btcore_drawing.diagram import DiagramNode
from btcore_drawing.layout import Box, Line, lay_out
from btcore_drawing.node_card import NODE_TYPE_COLOURS, Card, card_of, text_width

MAX_SIDE: Final = 2400
"""The maximum width and height of a PNG (pixels); a larger drawing is made smaller."""

_SCALE: Final = 1.5
_MIN_SCALE: Final = 0.6  # smaller texts cannot be read
_SIZE: Final = re.compile(r'<svg [^>]*?width="(\d+)" height="(\d+)"')
_MARGIN: Final = 28.0
_HEAD: Final = 52.0
_FOOT: Final = 40.0
_WIDEST: Final = 1700.0
_MAX_SEARCHED: Final = 60
"""Number of nodes up to which the best layout is searched, because the studio draws at each keystroke."""
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


class PictureError(BtcoreError):
    """Raised if a drawing cannot become a picture."""


def drawing_style() -> str:
    """Return the style sheet of all drawings, for a page that shows drawings without their own."""
    return f"{_STYLE}{_colours()}"


class DrawnCard(NamedTuple):
    """The card of a node in a picture.

    Attributes:
        uid: The number of the node.
        x: The place of the left end, in the coordinates of the cards.
        y: The place of the upper end.
        width: The width.
        height: The height.
        svg: The SVG elements, for a group at (*x*, *y*).
        edge: The path from the parent, relative to (*x*, *y*); "" for the root.
    """

    uid: int
    x: float
    y: float
    width: float
    height: float
    svg: str
    edge: str


class Picture(NamedTuple):
    """A drawing in parts, so that a page can show and replace each card alone.

    Attributes:
        head: The SVG before the edges and the cards.
        cards: The cards, in the order of the tree.
        tail: The SVG after the cards.
        left: Where the coordinates of the cards begin.
        top: Where the coordinates of the cards begin.
        width: The width of the drawing.
        height: The height of the drawing.
    """

    head: str
    cards: list[DrawnCard]
    tail: str
    left: float
    top: float
    width: float
    height: float


def diagram_to_svg(root: DiagramNode, title: str, format: int = 4) -> str:
    """Return a drawing of a tree as an SVG document.

    Cards are coloured by node type, and show the attributes of the node. A SubTree's content has a frame.
    Children are placed below their parents, and wrapped if the drawing becomes too wide. The group of each
    card has the number of the node as `data-uid`.

    Args:
        format: The format of the tree, 3 or 4.
    """
    picture = draw_diagram(root, title, format)
    # Later elements cover earlier elements: cards are drawn last.
    edges = [
        f'<path class="edge" d="M{card.x:.1f} {card.y:.1f}{card.edge}"/>'
        for card in picture.cards
        if card.edge
    ]
    cards = [
        f'<g data-uid="{card.uid}" transform="translate({card.x:.1f} {card.y:.1f})">{card.svg}</g>'
        for card in picture.cards
    ]
    return "\n".join([picture.head, *edges, *cards, picture.tail])


def draw_diagram(
    root: DiagramNode,
    title: str,
    format: int = 4,
    make_card: Callable[[DiagramNode], Card] = card_of,
    is_page: bool = False,
) -> Picture:
    """Return a drawing of a tree in parts.

    Args:
        format: The format of the tree, 3 or 4.
        make_card: Returns the card of a node.
        is_page: Whether it is for a page, which has `drawing_style()` and writes the numbers of the cards.
    """
    nodes: list[DiagramNode] = []
    cards: list[Card] = []
    boxes: dict[int, Box] = {}

    def add(node: DiagramNode, is_called: bool) -> int:
        index, card = len(nodes), make_card(node)
        nodes.append(node)
        cards.append(card)
        children = tuple([add(child, node.type is NodeType.SUBTREE) for child in node.children])
        boxes[index] = Box(card.width, card.height, children, is_called)
        return index

    add(root, False)
    ordered = [boxes[index] for index in range(len(nodes))]
    layout = lay_out(ordered, aspect=1.2, comfort=_WIDEST, is_quick=len(nodes) > _MAX_SEARCHED)
    count = len(nodes) + sum(node.hidden for node in nodes)
    about = f"format {format} · {counted(count, 'node')}"
    used = {node.type for node in nodes}
    node_types = [node_type for node_type in NODE_TYPE_COLOURS if node_type in used]
    title_width = text_width(title, 19, bold=True)
    drawing_width, height = layout.size
    width = max(drawing_width, title_width + 10, 92.0 * len(node_types)) + 2 * _MARGIN
    height += _HEAD + _FOOT + _MARGIN
    left, top = (width - drawing_width) / 2, _HEAD + 14
    # The number of nodes is written after the title, or below it if there is no space.
    beside = title_width + text_width(about, 12) + 12 <= width - 2 * _MARGIN
    place = f'x="{_MARGIN + title_width + 12:.1f}" y="36"' if beside else f'x="{_MARGIN:g}" y="51"'
    head = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
        f'viewBox="0 0 {width:.1f} {height:.1f}" role="img">',
        f"<title>{escape_text(title)}</title>",
        "" if is_page else f"<style>{drawing_style()}</style>",
        '<rect class="sheet" width="100%" height="100%" fill="#f7f8fb"/>',
        f'<text class="title" x="{_MARGIN:g}" y="36">{escape_text(title)}</text>',
        f'<text class="about" {place}>{about}</text>',
        f'<g transform="translate({left:.1f} {top:g})">',
        *(_frame(*corners) for _, *corners in layout.frames),
    ]
    drawn: list[DrawnCard] = []
    for node, card, at, line in zip(nodes, cards, layout.places, layout.edges, strict=True):
        svg = card.drawing if is_page else card.drawing + card.number(str(node.uid))
        if node.hidden:
            svg += _hidden_badge(node.hidden, card)
        x, y = round(at.x, 1), round(at.y - card.height / 2, 1)
        edge = _edge(line, x, y) if line else ""
        drawn.append(DrawnCard(node.uid, x, y, card.width, card.height, svg, edge))
    tail = "\n".join(["</g>", _legend(node_types, height - 18), "</svg>"]) + "\n"
    return Picture("\n".join(head), drawn, tail, round(left, 1), top, round(width, 1), round(height, 1))


def svg_to_png(svg: str) -> bytes:
    """Return a drawing of `diagram_to_svg` as a PNG.

    The picture uses the fonts of the machine: the first that the drawing names, and others for characters
    that it lacks. A character that no font has is an empty box.

    Raises:
        PictureError: The package resvg_py is not installed, the drawing is too large for a picture in which
            texts can be read, or the machine has none of the fonts.
    """
    try:
        import resvg_py
    except ModuleNotFoundError:
        raise PictureError(f"a PNG needs the package resvg_py: {install_command('resvg_py')}") from None
    size = _SIZE.match(svg)
    assert size is not None, "a drawing begins with its size"
    width, height = int(size[1]), int(size[2])
    scale = min(_SCALE, MAX_SIDE / max(width, height))
    if scale < _MIN_SCALE:
        raise PictureError(
            f"the drawing is too large for a PNG in which texts can be read ({width} × {height} px); draw a "
            "subtree, or an SVG"
        )
    # resvg silently omits a text without a font.
    letter, space = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="20" height="20"><style>{drawing_style()}</style>'
        f'<text y="15">{text}</text></svg>'
        for text in "x "
    )
    if resvg_py.svg_to_bytes(letter) == resvg_py.svg_to_bytes(space):
        raise PictureError("a PNG needs a font such as DejaVu Sans, which is not installed")
    return resvg_py.svg_to_bytes(svg, zoom=scale)


def _hidden_badge(count: int, card: Card) -> str:
    """Return the badge of a card whose *count* descendants are omitted, at its lower edge."""
    width = text_width(f"+{count}", 11, bold=True) + 12
    pill = f'<rect class="pill" x="{-width / 2:.1f}" y="-8" width="{width:.1f}" height="16" rx="8"/>'
    words = f'<title>{count} hidden</title>{pill}<text class="count" y="4">+{count}</text>'
    return f'<g class="fold" transform="translate({card.width / 2:.1f} {card.height:.1f})">{words}</g>'


def _colours() -> str:
    """Return the style rules for the node types."""
    return "".join(
        f"    .card.{name} {{ stroke: {colour}; }} .badge.{name}, .id.{name} {{ fill: {colour}; }}\n"
        for name, colour in NODE_TYPE_COLOURS.values()
    )


def _frame(x0: float, y0: float, x1: float, y1: float) -> str:
    size = f'width="{x1 - x0:.1f}" height="{y1 - y0:.1f}"'
    return f'<rect class="frame" x="{x0:.1f}" y="{y0:.1f}" {size} rx="12"/>'


def _edge(line: Line, x: float, y: float) -> str:
    """Return the path of an edge with round corners, relative to (x, y).

    Args:
        line: The ends of horizontal and vertical lines, which follow one another.
    """
    path, last = f"m{line[0][0] - x:.1f} {line[0][1] - y:.1f}", len(line) - 2
    turn_x = turn_y = 0.0
    for index, ((from_x, from_y), (to_x, to_y)) in enumerate(itertools.pairwise(line)):
        along_x, along_y = to_x - from_x, to_y - from_y
        length = abs(along_x) + abs(along_y)
        along_x, along_y = along_x / length, along_y / length
        radius = min(_CORNER, length / 2)
        if index:
            length -= radius
            end_x, end_y = turn_x + along_x * radius, turn_y + along_y * radius
            path += f"q{turn_x:.1f} {turn_y:.1f} {end_x:.1f} {end_y:.1f}"
        if index < last:
            length -= radius
            turn_x, turn_y = along_x * radius, along_y * radius
        path += f"l{along_x * length:.1f} {along_y * length:.1f}"
    return path


def _legend(node_types: list[NodeType], y: float) -> str:
    """Return the legend: the node types in the tree, with their colours."""
    words: list[str] = []
    x = _MARGIN
    for node_type in node_types:
        name = NODE_TYPE_COLOURS[node_type][0]
        words.append(f'<circle class="badge {name}" cx="{x + 5:.1f}" cy="{y - 4:.1f}" r="5"/>')
        words.append(f'<text class="about" x="{x + 15:.1f}" y="{y:.1f}">{name}</text>')
        x += text_width(name, 11.5) + 36
    return "".join(words)
