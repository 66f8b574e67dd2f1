"""Draw the SVG of a tree as a PNG with Pillow: agents can see PNG pictures, but not SVG.

Only what btcore's own drawings contain is supported: rectangles, circles, paths and texts, moved by
translations, and style rules for classes. Fonts are those of the machine; a missing glyph is an empty box.
"""

import math
import re
from collections.abc import Iterator, Mapping
from functools import lru_cache
from io import BytesIO
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

from lxml import etree

from btcore.agents.served_folder import RefusedError

if TYPE_CHECKING:
    from PIL import ImageFont
    from PIL.ImageDraw import ImageDraw

MAX_SVG: Final = 300_000
"""The maximum size of a drawing (bytes)."""
MAX_PIXELS: Final = 4_000_000
"""The maximum number of pixels of a picture; a larger drawing is made smaller."""
MAX_SIDE: Final = 4000
"""The maximum width and height of a picture (pixels), likewise."""

_SCALE: Final = 1.5
_LEAST_SCALE: Final = 0.6  # smaller texts cannot be read
_FINER: Final = 2  # the picture is drawn larger, and made smaller to smooth its edges
_STEPS: Final = 8  # lines in place of a curve
_FONTS: Final = {
    # The cards are as wide as texts in Arial; Liberation Sans has the same widths.
    "sans": ("Arial.ttf", "arial.ttf", "LiberationSans-Regular.ttf", "DejaVuSans.ttf"),
    "bold": ("Arial Bold.ttf", "arialbd.ttf", "LiberationSans-Bold.ttf", "DejaVuSans-Bold.ttf"),
    "mono": ("DejaVuSansMono.ttf", "Menlo.ttc", "consola.ttf", "LiberationMono-Regular.ttf"),
}
_RULE: Final = re.compile(r"([^{}]+)\{([^{}]*)\}")
_COMMAND: Final = re.compile(r"([A-Za-z])([^A-Za-z]*)")
_NUMBER: Final = re.compile(r"-?(?:\d+\.?\d*|\.\d+)")
_Point = tuple[float, float]
_Style = dict[str, str]


def svg_to_png(svg: bytes) -> bytes | None:
    """Return a drawing of btcore as a PNG, or None if Pillow is not installed.

    Args:
        svg: The drawing.

    Raises:
        RefusedError: The drawing is too large for a picture in which texts can be read.
    """
    try:
        from PIL import Image, ImageDraw
    except ModuleNotFoundError:
        return None
    root = etree.fromstring(svg, etree.XMLParser(resolve_entities=False, huge_tree=False))
    width, height = float(root.get("width", "1")), float(root.get("height", "1"))
    scale = min(_SCALE, MAX_SIDE / max(width, height), math.sqrt(MAX_PIXELS / (width * height)))
    if scale < _LEAST_SCALE or len(svg) > MAX_SVG:
        raise RefusedError("the tree is too large for a picture; `tree_id` selects a part of it")
    size = max(1, round(width * scale)), max(1, round(height * scale))
    picture = Image.new("RGB", (size[0] * _FINER, size[1] * _FINER), "white")
    _Drawing(ImageDraw.Draw(picture, "RGBA"), root, scale * _FINER).draw()
    data = BytesIO()
    picture.resize(size, Image.Resampling.LANCZOS).save(data, "PNG", optimize=True)
    return data.getvalue()


class _Drawing:
    """Draws the elements of an SVG document.

    Args:
        draw: Pillow's object that draws.
        root: The root of the document.
        scale: The number of pixels for each px of the document.
    """

    def __init__(self, draw: "ImageDraw", root: Any, scale: float) -> None:
        self._draw = draw
        self._root = root
        self._scale = scale
        self._rules: list[tuple[str, frozenset[str], _Style]] = []
        for style in root.iter("{*}style"):
            self._rules += _rules_of(style.text or "")

    def draw(self) -> None:
        """Draw all elements, in their order."""
        width, height = self._root.get("width"), self._root.get("height")
        elements: list[tuple[Any, _Point]] = [(self._root, (0.0, 0.0))]
        while elements:
            element, (x, y) = elements.pop()
            moved = re.match(r"translate\(([-\d.]+)[ ,]+([-\d.]+)\)", element.get("transform", ""))
            if moved is not None:
                x, y = x + float(moved[1]), y + float(moved[2])
            tag = etree.QName(element).localname
            style = self._style_of(element, {})
            if tag in ("svg", "g"):
                elements += [(child, (x, y)) for child in reversed(element)]
            elif tag == "rect":
                at = x + float(element.get("x", "0")), y + float(element.get("y", "0"))
                sides = (
                    element.get("width").replace("100%", width),
                    element.get("height").replace("100%", height),
                )
                self._rectangle(at, (float(sides[0]), float(sides[1])), float(element.get("rx", "0")), style)
            elif tag == "circle":
                radius = float(element.get("r"))
                corner = (
                    x + float(element.get("cx", "0")) - radius,
                    y + float(element.get("cy", "0")) - radius,
                )
                self._rectangle(corner, (2 * radius, 2 * radius), radius, style)
            elif tag == "path":
                size = re.match(r"scale\(([.\d]+)\)", element.get("transform", ""))
                factor = 1.0 if size is None else float(size[1])
                for line in _lines_of(element.get("d", "")):
                    self._line([(x + factor * px, y + factor * py) for px, py in line], style)
            elif tag == "text":
                self._text(
                    (x + float(element.get("x", "0")), y + float(element.get("y", "0"))), element, style
                )

    def _style_of(self, element: Any, inherited: Mapping[str, str]) -> _Style:
        """Return the style of an element: attributes, then the rules in their order."""
        tag = etree.QName(element).localname
        classes = frozenset(element.get("class", "").split())
        style = dict(inherited) | {str(key): str(value) for key, value in element.attrib.items()}
        for name, needed, declarations in self._rules:
            if name in ("", tag) and needed <= classes:
                style |= declarations
        return style

    def _rectangle(self, at: _Point, size: _Point, radius: float, style: _Style) -> None:
        x, y = at[0] * self._scale, at[1] * self._scale
        right, bottom = x + size[0] * self._scale, y + size[1] * self._scale
        radius = min(radius, size[0] / 2, size[1] / 2) * self._scale
        fill, outline = _colour(style, "fill", "#000000"), _colour(style, "stroke", None)
        width = 0 if outline is None else max(1, round(float(style.get("stroke-width", "1")) * self._scale))
        self._draw.rounded_rectangle((x, y, right, bottom), radius, fill, outline, width)

    def _line(self, points: list[_Point], style: _Style) -> None:
        colour = _colour(style, "stroke", None)
        width = max(1, round(float(style.get("stroke-width", "1")) * self._scale))
        placed = [(x * self._scale, y * self._scale) for x, y in points]
        fill = _colour(style, "fill", "#000000")
        if fill is not None and len(placed) > 2:
            self._draw.polygon(placed, fill)
        if colour is None:
            return
        self._draw.line(placed, colour, width, "curve")
        if style.get("stroke-linecap") == "round":
            half = width / 2
            for x, y in (placed[0], placed[-1]):
                self._draw.ellipse((x - half, y - half, x + half, y + half), colour)

    def _text(self, at: _Point, element: Any, style: _Style) -> None:
        """Draw a text and its spans, one after the other."""
        parts = [(element.text or "", 0.0, style)]
        for span in element:
            parts.append((span.text or "", float(span.get("dx", "0")), self._style_of(span, style)))
            parts.append((span.tail or "", 0.0, style))
        x, y = at[0] * self._scale, at[1] * self._scale
        if style.get("text-anchor") == "end":
            x -= sum(self._font(part).getlength(text) for text, _, part in parts)
        for text, gap, part in parts:
            font = self._font(part)
            x += gap * self._scale
            self._draw.text((x, y), text, _colour(part, "fill", "#000000"), font, anchor="ls")
            x += font.getlength(text)

    def _font(self, style: _Style) -> "ImageFont.FreeTypeFont | ImageFont.ImageFont":
        family = "mono" if "mono" in style.get("font-family", "").lower() else "sans"
        kind = "bold" if style.get("font-weight", "400") in ("600", "700") and family == "sans" else family
        return _font_of(kind, float(style.get("font-size", "12").removesuffix("px")) * self._scale)


@lru_cache(maxsize=64)
def _font_of(kind: str, size: float) -> "ImageFont.FreeTypeFont | ImageFont.ImageFont":
    """Return the first of the fonts for *kind* that the machine has, or Pillow's own."""
    from PIL import ImageFont

    for name in _FONTS[kind]:
        try:
            return ImageFont.truetype(name, size)
        except OSError:
            continue
    return ImageFont.load_default(size)


def _rules_of(text: str) -> Iterator[tuple[str, frozenset[str], _Style]]:
    """Yield the tag, the classes and the declarations of each selector, without its ancestors."""
    for selectors, body in _RULE.findall(text):
        pairs = (part.partition(":") for part in body.split(";") if ":" in part)
        style = {name.strip(): value.strip() for name, _, value in pairs}
        for selector in selectors.split(","):
            tag, *classes = selector.split()[-1].split(".")
            yield tag, frozenset(classes), style


def _colour(style: Mapping[str, str], name: str, default: str | None) -> tuple[int, int, int, int] | None:
    """Return the colour of a fill or a stroke with its opacity, or None."""
    text = style.get(name, default)
    if text is None or not re.fullmatch("#[0-9a-fA-F]{6}", text):
        return None
    red, green, blue = (int(text[at : at + 2], 16) for at in (1, 3, 5))
    return red, green, blue, round(255 * float(style.get(f"{name}-opacity", "1")))


def _lines_of(path: str) -> Iterator[list[_Point]]:
    """Yield the lines of a path: a list of points for each M."""
    points: list[_Point] = []
    x = y = 0.0
    control: _Point | None = None  # of the preceding curve
    for letter, text in _COMMAND.findall(path):
        numbers = [float(number) for number in _NUMBER.findall(text)]
        command, relative = letter.upper(), letter.islower()
        if command == "Z":
            if points:
                points.append(points[0])
                x, y = points[0]
            continue
        count = {"M": 2, "L": 2, "T": 2, "H": 1, "V": 1, "Q": 4, "C": 6, "A": 7}[command]
        for start in range(0, len(numbers) - count + 1, count):
            values = numbers[start : start + count]
            dx, dy = (x, y) if relative else (0.0, 0.0)
            before = x, y
            if command == "H":
                x = values[0] + dx
            elif command == "V":
                y = values[0] + dy
            else:
                x, y = values[-2] + dx, values[-1] + dy
            if command == "M" and start == 0:
                if len(points) > 1:
                    yield points
                points = [(x, y)]
                continue
            if command in ("Q", "T", "C"):
                corners = [(values[at] + dx, values[at + 1] + dy) for at in range(0, count - 2, 2)]
                if command == "T":
                    last = before if control is None else control
                    corners = [(2 * before[0] - last[0], 2 * before[1] - last[1])]
                control = corners[-1]
                points += _curve([before, *corners, (x, y)])
                continue
            control = None
            points += _arc(before, values, (x, y)) if command == "A" else [(x, y)]
    if len(points) > 1:
        yield points


def _curve(corners: list[_Point]) -> list[_Point]:
    """Return points on a Bézier curve, without its start."""
    points = []
    for step in range(1, _STEPS + 1):
        share, row = step / _STEPS, corners
        while len(row) > 1:
            row = [(a[0] + (b[0] - a[0]) * share, a[1] + (b[1] - a[1]) * share) for a, b in pairwise(row)]
        points.append(row[0])
    return points


def _arc(start: _Point, values: list[float], end: _Point) -> list[_Point]:
    """Return points on an arc of a circle, without its start; *values* are those of the command A."""
    radius, large, clockwise = values[0], bool(values[3]), bool(values[4])
    half = math.dist(start, end) / 2
    if half == 0:
        return [end]
    radius = max(radius, half)
    middle = (start[0] + end[0]) / 2, (start[1] + end[1]) / 2
    away = math.sqrt(radius**2 - half**2) / (2 * half) * (1 if large is clockwise else -1)
    # https://www.w3.org/TR/SVG11/implnote.html#ArcImplementationNotes, for equal radii
    centre = middle[0] + away * (end[1] - start[1]), middle[1] - away * (end[0] - start[0])
    first = math.atan2(start[1] - centre[1], start[0] - centre[0])
    turn = math.atan2(end[1] - centre[1], end[0] - centre[0]) - first
    if clockwise and turn <= 0:
        turn += 2 * math.pi
    elif not clockwise and turn >= 0:
        turn -= 2 * math.pi
    steps = 3 * _STEPS
    return [
        (
            centre[0] + radius * math.cos(first + turn * step / steps),
            centre[1] + radius * math.sin(first + turn * step / steps),
        )
        for step in range(1, steps + 1)
    ]
