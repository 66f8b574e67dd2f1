"""The layout of a tree: root on top, children in order, wrapped so that big trees stay legible.

Without wrapping, a tree of 100 nodes is 9,000 units wide. In this layout, a node's children either stand in
columns below the node (columns of a single node give the usual row), or they fill rows as words fill lines,
and hang from a spine, a vertical line below the parent's left end. Along columns or rows, children keep their
order, and nothing overlaps. Nodes are drawn as cards of any size, with a badge (a disc with a symbol) at the
left end.

The best arrangement of a node depends on its surroundings. So every node offers a few shapes, from narrow and
tall to wide and low (bottom-up). Then the root's best shape for the window is taken, which determines the
shapes of all nodes below (top-down).
"""

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final, TypeVar

GAP_X: Final = 22.0
GAP_Y: Final = 36.0
"""Distance between a parent and the row below it, with room for the horizontal line that connects them."""
CHAIN_Y: Final = 26.0
"""Distance between a parent and its only child."""
HANG_Y: Final = 13.0
"""Distance between the nodes of a column."""
INDENT: Final = 42.0
"""Distance from a parent's left end to children that hang from its spine."""
COLUMN_INDENT: Final = 24.0
"""Distance from the left of a column with several cards to the cards; the column's spine is in between."""
SPINE: Final = 21.0
"""Distance from a parent's left end to its spine, which is below the centre of the badge."""
JOINT: Final = 21.0
"""Greatest distance from a card's top to the line that meets its left side, which is beside the badge."""
FRAME_PAD: Final = 15.0
_SNAP: Final = 16.0
"""Greatest distance that a parent moves to be exactly above a child, which avoids a line with a kink."""
ROWS_FROM: Final = 10
"""Smallest number of children that flow into rows; fewer children are easier to find in a row or a column."""
_OFFERS: Final = 40
"""Greatest number of shapes that a node offers."""
_EVEN_TRIES: Final = 4
"""Number of heights that are tried to make columns even."""
_TRIES: Final = 18
"""Number of widths, and of heights, that are tried for a node's children."""

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Box:
    """A node to be placed: the size of its card, its *children* (indices), and whether it has a frame.

    A frame encloses the card and everything below it.
    """

    width: float
    height: float
    children: tuple[int, ...]
    has_frame: bool = False

    @property
    def joint(self) -> float:
        """The distance from the top to the line that meets the left side."""
        return min(JOINT, self.height / 2)


@dataclass(frozen=True, slots=True)
class Place:
    """The place of a card: (x, y) is the middle of its left end, *width* its length; y points down."""

    x: float
    y: float
    width: float

    @property
    def centre(self) -> float:
        """The x of the card's middle."""
        return self.x + self.width / 2


Line = tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class TreeLayout:
    """The layout of a tree.

    *places* and *edges* have an item for each node, in the order of the boxes. An edge is the line from the
    parent, empty for the root. *frames* are (index of the node, x0, y0, x1, y1), and *size* is (width,
    height) with the upper left corner at (0, 0).
    """

    places: tuple[Place, ...]
    edges: tuple[Line, ...]
    frames: tuple[tuple[int, float, float, float, float], ...]
    size: tuple[float, float]


@dataclass(frozen=True, slots=True)
class _Shape:
    """A way to draw a node and all nodes below it.

    *width* and *height* are the size of its area, and *anchor* is the distance from the area's left edge to
    the card. *groups* are the shapes of the children, in rows if *is_hung*, otherwise in columns.
    The first column begins *shift* to the right of the area's left edge.
    """

    width: float
    height: float
    anchor: float
    groups: tuple[tuple["_Shape", ...], ...] = ()
    is_hung: bool = False
    shift: float = 0.0


def lay_out(boxes: Sequence[Box], aspect: float, comfort: float) -> TreeLayout:
    """Return the layout that looks best in a window. The same boxes always give the same layout.

    Args:
        boxes: The nodes; index 0 is the root, and parents precede their children.
        aspect: The window's width divided by its height.
        comfort: The window width at which the tree is still legible without wrapping.
    """
    if not boxes:
        return TreeLayout((), (), (), (0.0, 0.0))
    plain = _offers(boxes, wrap=False)[0]
    if _cost(plain, aspect) > comfort:
        offered = _offers(boxes, wrap=True)
        plain = min(offered, key=lambda shape: (_cost(shape, aspect), shape.width))
    return _Drawing(boxes).draw(plain)


def _cost(shape: _Shape, aspect: float) -> float:
    """Return the width of the smallest window of *aspect* that holds *shape*.

    This width determines the scale of the drawing.
    """
    return max(shape.width, shape.height * aspect)


def _offers(boxes: Sequence[Box], wrap: bool) -> list[_Shape]:
    """Return the shapes that the root offers, narrowest first."""
    offered: list[list[_Shape]] = [[] for _ in boxes]
    # From the last box to the first: children follow their parents.
    for index in range(len(boxes) - 1, -1, -1):
        box = boxes[index]
        below = [offered[child] for child in box.children]
        widths = [boxes[child].width for child in box.children]
        if not below:
            shapes = [_Shape(box.width, box.height, 0.0)]
        elif not wrap:
            shapes = [_in_columns(box, widths, [[offers[0]] for offers in below])]
        else:
            shapes = _best(_wrapped(box, widths, below))
        offered[index] = [_framed(shape) for shape in shapes] if box.has_frame else shapes
    return offered[0]


def _wrapped(box: Box, widths: Sequence[float], below: Sequence[Sequence[_Shape]]) -> Iterable[_Shape]:
    heights = {shape.height for offered in below for shape in offered}
    total = sum(offered[0].height + HANG_Y for offered in below)
    limits = _spread(sorted(heights), _TRIES) + _steps(max(heights), total)
    for limit in limits:
        lowest = [_lowest_within(offered, limit) for offered in below]
        yield _in_columns(box, widths, _stacked(lowest, limit))
    yield _in_columns(box, widths, [[offered[-1]] for offered in below])
    if len(below) == 1:
        return
    narrowest = [offered[0] for offered in below]
    widest = [offered[-1] for offered in below]
    least = max(shape.width for shape in narrowest)
    most = sum(shape.width for shape in widest) + GAP_X * (len(below) - 1)
    for max_width in _steps(least, most):
        for chosen in (_widest_within, _smallest_within):
            shapes = [chosen(offered, max_width) for offered in below]
            yield _flowed(box, shapes, max_width if len(below) >= ROWS_FROM else 0.0)


def _steps(low: float, high: float) -> list[float]:
    """Return _TRIES sizes from *low* to *high* in a geometric progression."""
    # 0.01 more than the exact size, so that rounding errors do not exclude a shape that just fits.
    ratio = max(1.0, high / low) ** (1 / (_TRIES - 1))
    return [low * ratio**step + 0.01 for step in range(_TRIES)]


def _stacked(shapes: Sequence[_Shape], limit: float) -> list[list[_Shape]]:
    """Put neighbours into columns of similar height, each at most *limit* high."""
    heights = [shape.height for shape in shapes]
    columns = _fill(shapes, heights, HANG_Y, limit)
    total = sum(heights) + HANG_Y * (len(shapes) - len(columns))
    least = max(total / len(columns), *heights)
    for step in range(_EVEN_TRIES):
        even = _fill(shapes, heights, HANG_Y, least + (limit - least) * step / _EVEN_TRIES)
        if len(even) <= len(columns):
            return even
    return columns


def _fill(shapes: Sequence[_Shape], sizes: Sequence[float], gap: float, limit: float) -> list[list[_Shape]]:
    """Put neighbours into lines, and fill each line up to *limit*, as words fill the lines of a text."""
    lines: list[list[_Shape]] = []
    used = limit
    for shape, size in zip(shapes, sizes, strict=True):
        if lines and used + gap + size <= limit:
            lines[-1].append(shape)
            used += gap + size
        else:
            lines.append([shape])
            used = size
    return lines


def _spread(items: list[T], most: int) -> list[T]:
    """Return at most *most* of *items*, spread evenly."""
    if len(items) <= most:
        return items
    return [items[round(step * (len(items) - 1) / (most - 1))] for step in range(most)]


def _lowest_within(shapes: Sequence[_Shape], limit: float) -> _Shape:
    """Return the narrowest shape of height *limit* or less, or the lowest shape if all are higher.

    Shapes are sorted by width, and a wider shape is lower.
    """
    return next((shape for shape in shapes if shape.height <= limit), shapes[-1])


def _widest_within(shapes: Sequence[_Shape], max_width: float) -> _Shape:
    """Return the widest, and so lowest, shape that fits into *max_width*."""
    return shapes[max(0, bisect_right(shapes, max_width, key=lambda shape: shape.width) - 1)]


def _smallest_within(shapes: Sequence[_Shape], max_width: float) -> _Shape:
    """Return the shape with the smallest area that fits into *max_width*."""
    fitting = shapes[: max(1, bisect_right(shapes, max_width, key=lambda shape: shape.width))]
    return min(fitting, key=lambda shape: shape.width * shape.height)


def _best(shapes: Iterable[_Shape]) -> list[_Shape]:
    """Return the Pareto-optimal shapes (by width and height), narrowest first, thinned to _OFFERS."""
    front: list[_Shape] = []
    # By width: a wider shape is only useful if it is lower.
    for shape in sorted(shapes, key=lambda shape: (shape.width, shape.height, shape.is_hung)):
        if not front or shape.height < front[-1].height - 0.01:
            front.append(shape)
    return _spread(front, _OFFERS)


def _framed(shape: _Shape) -> _Shape:
    pad = FRAME_PAD
    return replace(
        shape, width=shape.width + 2 * pad, height=shape.height + 2 * pad, anchor=shape.anchor + pad
    )


def _in_columns(box: Box, widths: Sequence[float], columns: Sequence[Sequence[_Shape]]) -> _Shape:
    """Return the shape with children in columns side by side, and the parent centred above them."""
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
    near = min(middles, key=lambda x: abs(x - middle))
    if abs(near - middle) < _SNAP:
        middle = near
    anchor = middle - box.width / 2
    shift = max(0.0, -anchor)
    width = max(across + shift, anchor + shift + box.width)
    gap = CHAIN_Y if len(box.children) == 1 else GAP_Y
    groups = tuple(tuple(column) for column in columns)
    return _Shape(width, box.height + gap + down, anchor + shift, groups, False, shift)


def _column_width(column: Sequence[_Shape]) -> float:
    widest = max(shape.width for shape in column)
    return widest if len(column) == 1 else widest + COLUMN_INDENT


def _flowed(box: Box, children: Sequence[_Shape], max_width: float) -> _Shape:
    """Return the shape with children in rows, at most *max_width* wide, that hang from the spine."""
    rows = _fill(children, [shape.width for shape in children], GAP_X, max_width)
    gap = HANG_Y if len(rows) == len(children) else GAP_Y
    across = max(sum(shape.width for shape in row) + GAP_X * (len(row) - 1) for row in rows)
    down = box.height + sum(gap + max(shape.height for shape in row) for row in rows)
    return _Shape(max(box.width, INDENT + across), down, 0.0, tuple(tuple(row) for row in rows), True)


class _Drawing:
    """The conversion of the root's shape to places and lines."""

    def __init__(self, boxes: Sequence[Box]) -> None:
        self._boxes = boxes
        self._places: list[Place] = [Place(0.0, 0.0, 0.0)] * len(boxes)
        self._edges: list[Line] = [()] * len(boxes)
        self._frames: list[tuple[int, float, float, float, float]] = []

    def draw(self, root: _Shape) -> TreeLayout:
        # Not recursive, because a tree may be deeper than Python's recursion limit.
        waiting = [(0, root, 0.0, 0.0)]
        while waiting:
            index, shape, left, top = waiting.pop()
            box = self._boxes[index]
            pad = self._pad(index)
            if box.has_frame:
                inset = 2.0
                right, bottom = left + shape.width - inset, top + shape.height - inset
                self._frames.append((index, left + inset, top + inset, right, bottom))
            place = Place(left + shape.anchor, top + pad + box.height / 2, box.width)
            self._places[index] = place
            lay = self._hang if shape.is_hung else self._columns
            waiting.extend(lay(box, shape, place, left + pad))
        self._frames.sort()
        return TreeLayout(
            tuple(self._places), tuple(self._edges), tuple(self._frames), (root.width, root.height)
        )

    def _pad(self, index: int) -> float:
        return FRAME_PAD if self._boxes[index].has_frame else 0.0

    def _top(self, child: int, shape: _Shape, x: float, y: float) -> tuple[float, float]:
        """Return the point where a line from above meets the card of *child*, whose area begins at (x, y)."""
        return x + shape.anchor + self._boxes[child].width / 2, y + self._pad(child)

    def _columns(
        self, box: Box, shape: _Shape, place: Place, left: float
    ) -> Iterable[tuple[int, _Shape, float, float]]:
        under = place.y + box.height / 2
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
                start = place.centre
                if len(box.children) == 1:
                    # The line goes straight down, if a place is above the child and below the parent.
                    joint, end = self._boxes[child].joint, at + below.anchor + self._boxes[child].width
                    straight = min(max(start, at + below.anchor + joint), end - joint)
                    if box.joint <= straight - place.x <= box.width - box.joint:
                        start, spine, top = straight, straight, (straight, top[1])
                line: list[tuple[float, float]] = [(start, under)]
                if abs(spine - start) > 0.01:
                    line += [(start, bus), (spine, bus)]
                if single:
                    line.append(top)
                else:
                    level = top[1] + self._boxes[child].joint
                    line += [(spine, level), (at + below.anchor, level)]
                self._edges[child] = tuple(line)
                yield child, below, at, y
                y += below.height + HANG_Y
            x += _column_width(column) + GAP_X

    def _hang(
        self, box: Box, shape: _Shape, place: Place, left: float
    ) -> Iterable[tuple[int, _Shape, float, float]]:
        single = len(shape.groups) == len(box.children)
        spine, under = place.x + SPINE, place.y + box.height / 2
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
                    level = top[1] + self._boxes[child].joint
                    self._edges[child] = ((spine, under), (spine, level), (x + below.anchor, level))
                else:
                    bus = y + gap / 2
                    self._edges[child] = ((spine, under), (spine, bus), (top[0], bus), top)
                yield child, below, x, y + gap
                x += below.width + GAP_X
            y += gap + max(below.height for below in row)

    def _leftmost(self, index: int, shape: _Shape) -> _Shape:
        """Return *shape* with its card above the first child instead of the middle.

        Nodes on a spine begin at the left, and a line from there to the middle of a wide shape would be long.
        """
        if shape.is_hung or not shape.groups:
            return shape
        box, first, start = self._boxes[index], shape.groups[0], self._pad(index) + shape.shift
        if len(box.children) == 1:
            first = (self._leftmost(box.children[0], first[0]),)
            return replace(shape, groups=(first,), anchor=self._pad(index), shift=0.0)
        middle = start + COLUMN_INDENT / 3
        if len(first) == 1:
            middle = start + first[0].anchor + self._boxes[box.children[0]].width / 2
        return replace(shape, anchor=max(self._pad(index), min(middle - box.width / 2, shape.anchor)))
