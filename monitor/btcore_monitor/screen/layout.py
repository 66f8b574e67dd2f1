"""Where the nodes of a tree go: root on top, children in order, wrapped so that big trees stay legible.

A plain tidy tree of 100 nodes is 9,000 units wide. Here a node's children stand either in columns under it
(of one each, that is the row that people draw), or flow into rows like words into lines and hang from a spine
under the parent's left end. Read along columns or rows, children keep their order; nothing overlaps.

Which of these is best depends on what stands around it, so every node offers a few shapes, from narrow and
tall to wide and low (bottom-up), the root's best for the window is taken, and so the choice of every node
below it (top-down).
"""

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

GAP_X: Final = 22.0
GAP_Y: Final = 36.0
"""Between a parent and the row under it: room for the bus that joins them."""
CHAIN_Y: Final = 26.0
"""Between a parent and its only child."""
HANG_Y: Final = 13.0
"""Between those that stand in a column."""
INDENT: Final = 42.0
"""From a parent's left end to children that hang from its spine."""
COLUMN_INDENT: Final = 24.0
"""From a column's left to its pills, when it has several; its own spine is in between."""
SPINE: Final = 21.0
"""From a parent's left end to its spine: the centre of its badge."""
FRAME_PAD: Final = 15.0
_SNAP: Final = 16.0
"""A parent moves so far to stand right above a child: better than a line with a kink."""
COMFORT: Final = 28.0
"""Pill heights that a window may be wide: up to there a tree is drawn without wrapping, as on paper."""
ROWS_FROM: Final = 10
"""Children that may flow into rows like words; fewer are quicker found in one row or one column."""
_OFFERS: Final = 40
"""Shapes that a node offers at most."""
_EVEN_TRIES: Final = 4
"""Heights that are tried to make columns even."""
_TRIES: Final = 18
"""Widths, and heights, that are tried for a node's children."""


@dataclass(frozen=True, slots=True)
class Box:
    """What is to be placed: a pill's *width*, indices of *children*, whether a frame goes round it all."""

    width: float
    children: tuple[int, ...]
    framed: bool = False


@dataclass(frozen=True, slots=True)
class Place:
    """A pill: (x, y) is the middle of its left end, *width* its length; y points down."""

    x: float
    y: float
    width: float

    @property
    def centre(self) -> float:
        """The middle's x."""
        return self.x + self.width / 2


Line = tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class Layout:
    """Places by index; *edges* by index (the line from the parent; the root's is empty); *frames* as
    (index, x0, y0, x1, y1); *size* as (width, height) with the upper left corner at (0, 0).
    """

    places: tuple[Place, ...]
    edges: tuple[Line, ...]
    frames: tuple[tuple[int, float, float, float, float], ...]
    size: tuple[float, float]


@dataclass(frozen=True, slots=True)
class _Shape:
    """One way to draw a node and all below it: *width* and *height* of its area, *anchor* from the area's
    left to the pill, and the children's shapes: in rows if *hung* from the spine, else in columns, of
    which the first begins *shift* to the right of the area's left.
    """

    width: float
    height: float
    anchor: float
    groups: tuple[tuple["_Shape", ...], ...] = ()
    hung: bool = False
    shift: float = 0.0


def lay_out(boxes: Sequence[Box], height: float, aspect: float = 1.6, comfort: float = COMFORT) -> Layout:
    """Place *boxes* (index 0 is the root; parents before children), pills *height* high, to look best in
    a window *aspect* times as wide as high, in which *comfort* pill heights are still legible side by side.
    The same boxes give the same layout.
    """
    if not boxes:
        return Layout((), (), (), (0.0, 0.0))
    plain = _offers(boxes, height, wrap=False)[0]
    if _cost(plain, aspect) > comfort * height:
        offered = _offers(boxes, height, wrap=True)
        plain = min(offered, key=lambda shape: (_cost(shape, aspect), shape.width))
    return _Drawing(boxes, height).draw(plain)


def _cost(shape: _Shape, aspect: float) -> float:
    """Width of the window of *aspect* that *shape* just fits: what decides how small things are drawn."""
    return max(shape.width, shape.height * aspect)


def _offers(boxes: Sequence[Box], height: float, wrap: bool) -> list[_Shape]:
    """Shapes of the root, narrowest first."""
    offered: list[list[_Shape]] = [[] for _ in boxes]
    for index in range(len(boxes) - 1, -1, -1):
        box = boxes[index]
        below = [offered[child] for child in box.children]
        widths = [boxes[child].width for child in box.children]
        if not below:
            shapes = [_Shape(box.width, height, 0.0)]
        elif not wrap:
            shapes = [_in_columns(box, height, widths, [[one[0]] for one in below])]
        else:
            shapes = _best(_wrapped(box, height, widths, below))
        offered[index] = [_framed(shape) for shape in shapes] if box.framed else shapes
    return offered[0]


def _wrapped(
    box: Box, height: float, widths: Sequence[float], below: Sequence[Sequence[_Shape]]
) -> Iterable[_Shape]:
    heights = {shape.height for one in below for shape in one}
    total = sum(one[0].height + HANG_Y for one in below)
    limits = _spread(heights) + _steps(max(heights), total)
    for limit in limits:
        lowest = [_lowest_within(one, limit) for one in below]
        yield _in_columns(box, height, widths, _stacked(lowest, limit))
    yield _in_columns(box, height, widths, [[one[-1]] for one in below])
    if len(below) == 1:
        return
    narrowest = [one[0] for one in below]
    widest = [one[-1] for one in below]
    least = max(shape.width for shape in narrowest)
    most = sum(shape.width for shape in widest) + GAP_X * (len(below) - 1)
    for room in _steps(least, most):
        for chosen in (_widest_within, _smallest_within):
            shapes = [chosen(one, room) for one in below]
            yield _flowed(box, height, shapes, room if len(below) >= ROWS_FROM else 0.0)


def _steps(low: float, high: float) -> list[float]:
    """_TRIES sizes from *low* to *high*, each the same ratio above the one before."""
    ratio = max(1.0, high / low) ** (1 / (_TRIES - 1))
    return [low * ratio**step + 0.01 for step in range(_TRIES)]


def _stacked(shapes: Sequence[_Shape], limit: float) -> list[list[_Shape]]:
    """Neighbours in columns at most *limit* high, and of much the same height."""
    columns = _filled(shapes, limit)
    total = sum(shape.height for shape in shapes) + HANG_Y * (len(shapes) - len(columns))
    least = max(total / len(columns), max(shape.height for shape in shapes))
    for step in range(_EVEN_TRIES):
        even = _filled(shapes, least + (limit - least) * step / _EVEN_TRIES)
        if len(even) <= len(columns):
            return even
    return columns


def _filled(shapes: Sequence[_Shape], limit: float) -> list[list[_Shape]]:
    """Neighbours in columns, each filled up to *limit*."""
    columns: list[list[_Shape]] = []
    used = limit
    for shape in shapes:
        if columns and used + HANG_Y + shape.height <= limit:
            columns[-1].append(shape)
            used += HANG_Y + shape.height
        else:
            columns.append([shape])
            used = shape.height
    return columns


def _spread(values: set[float]) -> list[float]:
    """At most _TRIES of *values*, spread evenly."""
    ordered = sorted(values)
    if len(ordered) <= _TRIES:
        return ordered
    return [ordered[round(step * (len(ordered) - 1) / (_TRIES - 1))] for step in range(_TRIES)]


def _lowest_within(shapes: Sequence[_Shape], limit: float) -> _Shape:
    """The narrowest shape at most *limit* high (they get lower as they get wider); the lowest if none is."""
    return next((shape for shape in shapes if shape.height <= limit), shapes[-1])


def _widest_within(shapes: Sequence[_Shape], room: float) -> _Shape:
    """The widest, and so lowest, shape that fits *room*."""
    return shapes[max(0, bisect_right(shapes, room, key=lambda shape: shape.width) - 1)]


def _smallest_within(shapes: Sequence[_Shape], room: float) -> _Shape:
    """The shape of the smallest area that fits *room*."""
    fitting = shapes[: max(1, bisect_right(shapes, room, key=lambda shape: shape.width))]
    return min(fitting, key=lambda shape: shape.width * shape.height)


def _best(shapes: Iterable[_Shape]) -> list[_Shape]:
    """Those that no other beats in both directions, narrowest first, thinned to _OFFERS."""
    front: list[_Shape] = []
    for shape in sorted(shapes, key=lambda one: (one.width, one.height, one.hung)):
        if not front or shape.height < front[-1].height - 0.01:
            front.append(shape)
    if len(front) > _OFFERS:
        front = [front[round(step * (len(front) - 1) / (_OFFERS - 1))] for step in range(_OFFERS)]
    return front


def _framed(shape: _Shape) -> _Shape:
    return _Shape(
        shape.width + 2 * FRAME_PAD,
        shape.height + 2 * FRAME_PAD,
        shape.anchor + FRAME_PAD,
        shape.groups,
        shape.hung,
        shape.shift,
    )


def _in_columns(
    box: Box, height: float, widths: Sequence[float], columns: Sequence[Sequence[_Shape]]
) -> _Shape:
    """Children in columns side by side, the parent centred above them."""
    across, down, middles, first = -GAP_X, 0.0, [], 0
    for column in columns:
        x = across + GAP_X
        if len(column) == 1:
            middles.append(x + column[0].anchor + widths[first] / 2)
        else:
            middles.append(x + COLUMN_INDENT / 3)
        across = x + _column_width(column)
        down = max(down, sum(shape.height for shape in column) + HANG_Y * (len(column) - 1))
        first += len(column)
    middle = (middles[0] + middles[-1]) / 2
    near = min(middles, key=lambda one: abs(one - middle))
    if abs(near - middle) < _SNAP:
        middle = near
    anchor = middle - box.width / 2
    shift = max(0.0, -anchor)
    width = max(across + shift, anchor + shift + box.width)
    gap = CHAIN_Y if len(box.children) == 1 else GAP_Y
    groups = tuple(tuple(column) for column in columns)
    return _Shape(width, height + gap + down, anchor + shift, groups, False, shift)


def _column_width(column: Sequence[_Shape]) -> float:
    widest = max(shape.width for shape in column)
    return widest if len(column) == 1 else widest + COLUMN_INDENT


def _flowed(box: Box, height: float, children: Sequence[_Shape], room: float) -> _Shape:
    """Children in rows of at most *room*, or of one each, hung from the spine."""
    rows: list[list[_Shape]] = []
    used = room
    for shape in children:
        if rows and used + GAP_X + shape.width <= room:
            rows[-1].append(shape)
            used += GAP_X + shape.width
        else:
            rows.append([shape])
            used = shape.width
    gap = HANG_Y if len(rows) == len(children) else GAP_Y
    across = max(sum(shape.width for shape in row) + GAP_X * (len(row) - 1) for row in rows)
    down = height + sum(gap + max(shape.height for shape in row) for row in rows)
    return _Shape(max(box.width, INDENT + across), down, 0.0, tuple(tuple(row) for row in rows), True)


class _Drawing:
    """From the root's shape to places and lines."""

    def __init__(self, boxes: Sequence[Box], height: float) -> None:
        self._boxes = boxes
        self._height = height
        self._places: list[Place] = [Place(0.0, 0.0, 0.0)] * len(boxes)
        self._edges: list[Line] = [()] * len(boxes)
        self._frames: list[tuple[int, float, float, float, float]] = []

    def draw(self, root: _Shape) -> Layout:
        waiting = [(0, root, 0.0, 0.0)]
        while waiting:
            index, shape, left, top = waiting.pop()
            box = self._boxes[index]
            pad = self._pad(index)
            if box.framed:
                inset = 2.0
                right, bottom = left + shape.width - inset, top + shape.height - inset
                self._frames.append((index, left + inset, top + inset, right, bottom))
            place = Place(left + shape.anchor, top + pad + self._height / 2, box.width)
            self._places[index] = place
            lay = self._hang if shape.hung else self._columns
            waiting.extend(lay(box, shape, place, left + pad))
        self._frames.sort()
        return Layout(tuple(self._places), tuple(self._edges), tuple(self._frames), (root.width, root.height))

    def _pad(self, index: int) -> float:
        return FRAME_PAD if self._boxes[index].framed else 0.0

    def _top(self, child: int, shape: _Shape, x: float, y: float) -> tuple[float, float]:
        """Where a line from above meets the pill of *child*, whose area begins at (x, y)."""
        return x + shape.anchor + self._boxes[child].width / 2, y + self._pad(child)

    def _columns(
        self, box: Box, shape: _Shape, place: Place, left: float
    ) -> Iterable[tuple[int, _Shape, float, float]]:
        under = place.y + self._height / 2
        gap = CHAIN_Y if len(box.children) == 1 else GAP_Y
        x, bus = left + shape.shift, under + gap / 2
        children = iter(box.children)
        for column in shape.groups:
            single = len(column) == 1
            y = under + gap
            for below in column:
                child = next(children)
                at = x if single else x + COLUMN_INDENT
                top = self._top(child, below, at, y)
                spine = top[0] if single else x + COLUMN_INDENT / 3
                if len(box.children) == 1:
                    # Straight down, wherever it meets the child's pill or frame.
                    reach = self._boxes[child].width / 2 - self._height / 2
                    if abs(top[0] - place.centre) < reach:
                        spine, top = place.centre, (place.centre, top[1])
                line: list[tuple[float, float]] = [(place.centre, under)]
                if abs(spine - place.centre) > 0.01:
                    line += [(place.centre, bus), (spine, bus)]
                if single:
                    line.append(top)
                else:
                    level = top[1] + self._height / 2
                    line += [(spine, level), (at + below.anchor, level)]
                self._edges[child] = tuple(line)
                yield child, below, at, y
                y += below.height + HANG_Y
            x += _column_width(column) + GAP_X

    def _hang(
        self, box: Box, shape: _Shape, place: Place, left: float
    ) -> Iterable[tuple[int, _Shape, float, float]]:
        single = len(shape.groups) == len(box.children)
        spine, under = place.x + SPINE, place.y + self._height / 2
        children = iter(box.children)
        y = under
        for row in shape.groups:
            gap = HANG_Y if single else GAP_Y
            x = left + INDENT
            for offered in row:
                child = next(children)
                below = self._leftmost(child, offered) if single else offered
                top = self._top(child, below, x, y + gap)
                if single:
                    level = top[1] + self._height / 2
                    self._edges[child] = ((spine, under), (spine, level), (x + below.anchor, level))
                else:
                    bus = y + gap / 2
                    self._edges[child] = ((spine, under), (spine, bus), (top[0], bus), top)
                yield child, below, x, y + gap
                x += below.width + GAP_X
            y += gap + max(below.height for below in row)

    def _leftmost(self, index: int, shape: _Shape) -> _Shape:
        """*shape* with its pill above the first child instead of the middle: what hangs from a spine begins
        there, and a line to the middle of something wide would be long.
        """
        if shape.hung or not shape.groups:
            return shape
        box, first, start = self._boxes[index], shape.groups[0], self._pad(index) + shape.shift
        if len(box.children) == 1:
            first = (self._leftmost(box.children[0], first[0]),)
            return replace(shape, groups=(first,), anchor=self._pad(index), shift=0.0)
        middle = start + COLUMN_INDENT / 3
        if len(first) == 1:
            middle = start + first[0].anchor + self._boxes[box.children[0]].width / 2
        return replace(shape, anchor=max(self._pad(index), min(middle - box.width / 2, shape.anchor)))
