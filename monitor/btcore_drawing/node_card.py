"""Draw one node of a tree as a card with a badge, names, ports and scripts."""

from functools import lru_cache
from typing import Final, NamedTuple

from btcore.escaping import escape_text
from btcore.status import NodeType
from btcore.suggestions import shortened
from btcore_drawing.diagram import DiagramNode
from btcore_drawing.symbols import symbol_path

NODE_TYPE_COLOURS: Final = {
    NodeType.CONTROL: ("control", "#2f66c8"),
    NodeType.DECORATOR: ("decorator", "#7c4fd0"),
    NodeType.CONDITION: ("condition", "#0b8a80"),
    NodeType.ACTION: ("action", "#3d8b3d"),
    NodeType.SUBTREE: ("subtree", "#c2730a"),
    NodeType.UNDEFINED: ("unknown", "#6b7280"),
}
_NAME_SIZE: Final = 13.0
_ID_SIZE: Final = 10.5
_PORT_SIZE: Final = 10.5
_PORT_LINE: Final = 15.0
_MARGIN: Final = 10.0
_BADGE: Final = 11.0
_TEXT_AT: Final = _MARGIN + 2 * _BADGE + 8
_MAX_TEXT: Final = 46
_MONO: Final = 0.602  # the advance width of most monospaced fonts, in em
_NARROW: Final = frozenset("ijlftrI.,:;'|!()[] ")
_WIDE: Final = frozenset("mwMWQO@%—→")


class Card(NamedTuple):
    """The card of a node: *width* and *height* in px, and its *drawing* without the number, SVG at (0, 0)."""

    width: float
    height: float
    drawing: str

    def number(self, text: str) -> str:
        """Return the SVG of the number at the upper right."""
        return f'<text class="uid" x="{self.width - 9:.1f}" y="15">{text}</text>'


@lru_cache(maxsize=1 << 15)
def text_width(text: str, size: float, bold: bool = False) -> float:
    """Return an upper estimate of the width of a text in a common sans-serif font, in px.

    Args:
        size: Font size in px.
    """
    # Widths in em, rounded up, because the viewer's font is unknown.
    units = 0.0
    for char in text:
        if char in _NARROW:
            units += 0.34
        elif char in _WIDE:
            units += 0.92
        elif char.isupper():
            units += 0.7
        elif ord(char) > 0x2E80:  # ideographs are square
            units += 1.0
        else:
            units += 0.575
    return units * size * (1.07 if bold else 1.0)


def card_of(node: DiagramNode) -> Card:
    """Return the card of *node*, without its children."""
    type_name = NODE_TYPE_COLOURS[node.type][0]
    second = _second_name(node)
    number_room = text_width(str(node.uid), 9) + 14
    head = 46.0 if second else 36.0
    lines = [
        _script_line(name, text) if direction == "script" else _port_line(name, text, direction)
        for name, text, direction in node.ports
    ]
    lines += [_script_line(name, text) for name, text in node.conditions.items()]
    name = _one_line(node.name)
    width = _TEXT_AT + text_width(name, _NAME_SIZE, bold=True) + number_room
    if second:
        width = max(width, _TEXT_AT + text_width(second, _ID_SIZE) + _MARGIN)
    for length, _ in lines:
        width = max(width, 2 * _MARGIN + length * _MONO * _PORT_SIZE + 2)
    height = head + (len(lines) * _PORT_LINE + 8 if lines else 0)
    # Cards of conditions have round ends.
    corner = 17 if node.type is NodeType.CONDITION else 7
    drawing = [f"<title>{escape_text(_hover(node))}</title>"]
    size = f'width="{width:.1f}" height="{height:.1f}" rx="{corner}"'
    drawing.append(f'<rect class="card {type_name}" {size}/>')
    drawing.append(_badge(node, head / 2))
    baseline = head / 2 + (-1 if second else 4.5)
    drawing.append(f'<text class="name" x="{_TEXT_AT:g}" y="{baseline:g}">{escape_text(name)}</text>')
    if second:
        drawing.append(
            f'<text class="id {type_name}" x="{_TEXT_AT:g}" y="{baseline + 14:g}">'
            f"{escape_text(second)}</text>"
        )
    if lines:
        drawing.append(f'<path class="rule" d="M{_MARGIN:g} {head:g}H{width - _MARGIN:.1f}"/>')
    for row, (_, words) in enumerate(lines):
        y = head + 15 + row * _PORT_LINE
        drawing.append(f'<text class="port" x="{_MARGIN + 1:g}" y="{y:g}">{words}</text>')
    return Card(width, height, "".join(drawing))


def _second_name(node: DiagramNode) -> str:
    """Return the text under the name: the ID, unless it equals the name."""
    if node.type is NodeType.SUBTREE:
        return node.id if node.tree == node.name else f"{node.id} {node.tree}"
    return node.id if node.id != node.name else ""


def _hover(node: DiagramNode) -> str:
    """Return the tooltip: name, ID, ports and scripts without abbreviation, and the description."""
    lines = [f"{node.name} <{node.id}>"]
    lines += (f'{name}="{text}"' for name, text, _ in node.ports)
    lines += (f'{name}="{text}"' for name, text in node.conditions.items())
    return "\n".join([*lines, *([node.about] if node.about else [])])


def _badge(node: DiagramNode, middle: float) -> str:
    type_name = NODE_TYPE_COLOURS[node.type][0]
    at = f"translate({_MARGIN + _BADGE:g} {middle:g})"
    disc = f'<circle class="badge {type_name}" r="{_BADGE:g}"/>'
    glyph = f'<path class="glyph" d="{symbol_path(node.id, type_name, node.symbol)}"/>'
    return f'<g transform="{at}">{disc}{glyph}</g>'


def _one_line(text: str) -> str:
    return shortened(" ".join(text.split()), _MAX_TEXT)


def _port_line(name: str, text: str, direction: str) -> tuple[int, str]:
    """Return the number of characters of a port line, and its SVG text."""
    sign = {"output": "←", "inout": "↔"}.get(direction, "→")
    shown = _one_line(text) or "″″"
    css_class = "key" if shown.startswith(("{", "=", "${")) else "value"
    words = f'<tspan class="dim">{sign} {escape_text(name)}</tspan>'
    words += f'<tspan class="{css_class}" dx="6">{escape_text(shown)}</tspan>'
    return len(name) + len(shown) + 3, words


def _script_line(name: str, text: str) -> tuple[int, str]:
    shown = _one_line(text)
    words = f'<tspan class="dim">{escape_text(name)}</tspan>'
    words += f'<tspan class="script" dx="6">{escape_text(shown)}</tspan>'
    return len(name) + len(shown) + 1, words
