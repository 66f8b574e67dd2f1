"""The layout of a tree: root on top, children in order, wrapped so that big trees stay legible.

Without wrapping, a tree of 100 nodes is 9,000 units wide. In this layout, a node's children either stand in
columns below the node (columns of a single node give the usual row), or they fill rows as words fill lines,
and hang from a spine, a vertical line below the parent's left end. Along columns or rows, children keep their
order, and nothing overlaps. Nodes are drawn as cards of any size, with a badge (a disc with a symbol) at the
left end. In a tree without wrapping, the cards of a level are at the same height, and contours are packed.

The best arrangement of a node depends on its surroundings. So every node offers a few shapes, from narrow and
tall to wide and low (bottom-up). Then the root's best shape for the window is taken, which determines the
shapes of all nodes below (top-down).
"""

import math
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import accumulate
from operator import add
from typing import Final, NamedTuple, TypeVar

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


class Box(NamedTuple):
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

    @property
    def pad(self) -> float:
        """The distance from the frame to the card."""
        return FRAME_PAD if self.has_frame else 0.0

    @property
    def gap(self) -> float:
        """The distance to the row below."""
        return CHAIN_Y if len(self.children) == 1 else GAP_Y


class Place(NamedTuple):
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


class _Shape(NamedTuple):
    """A way to draw a node and all nodes below it.

    *width* and *height* are the size of its area, and *anchor* is the distance from the area's left edge to
    the card. *groups* are the shapes of the children, in rows if *is_hung*, otherwise in columns.
    *starts* are the distances from the area's left edge to the columns, *drop* from the card to their tops.
    """

    width: float
    height: float
    anchor: float
    groups: tuple[tuple["_Shape", ...], ...] = ()
    is_hung: bool = False
    starts: tuple[float, ...] = ()
    drop: float = 0.0


@dataclass(slots=True)
class _Side:
    """The left or right side of a contour.

    *parts* are (y of the lower end, x) from the bottom up, and *x* is added to the x of all parts. The gap
    above a card belongs to the part of the card, so there are no gaps between the parts.
    """

    parts: list[tuple[float, float]]
    x: float = 0.0

    def distance(self, left: "_Side") -> float:
        """Return how far *left* must move to the right so that it touches this right side."""
        ours, theirs, most = len(self.parts) - 1, len(left.parts) - 1, -math.inf
        while ours >= 0 and theirs >= 0:
            (y, x), (other_y, other_x) = self.parts[ours], left.parts[theirs]
            most = max(most, x - other_x)
            ours -= y <= other_y
            theirs -= other_y <= y
        return most + self.x - left.x

    def above(self, lower: "_Side") -> "_Side":
        """Return this side, followed by the parts of *lower* that are below it. It consumes both sides."""
        if not self.parts or not lower.parts or lower.parts[0][0] <= self.parts[0][0]:
            return self if self.parts else lower
        # This takes the time of the shorter side, so all calls together are linear in the nodes.
        while lower.parts[-1][0] <= self.parts[0][0]:
            lower.parts.pop()
        lower.parts += [(y, x + self.x - lower.x) for y, x in self.parts]
        return lower


def lay_out(boxes: Sequence[Box], aspect: float, comfort: float, is_quick: bool = False) -> TreeLayout:
    """Return the layout that looks best in a window. The same boxes always give the same layout.

    Args:
        boxes: The nodes; index 0 is the root, and parents precede their children.
        aspect: The window's width divided by its height.
        comfort: The window width at which the tree is still legible without wrapping.
        is_quick: Whether to wrap to *comfort* without the search for the best shape, which takes 20 times as
            long.
    """
    if not boxes:
        return TreeLayout((), (), (), (0.0, 0.0))
    plain = _in_levels(boxes, comfort if is_quick else math.inf)
    if not is_quick and _cost(plain, aspect) > comfort:
        offered = _offers(boxes)
        plain = min(offered, key=lambda shape: (_cost(shape, aspect), shape.width))
    return _Drawing(boxes).draw(plain)


def _cost(shape: _Shape, aspect: float) -> float:
    """Return the width of the smallest window of *aspect* that holds *shape*.

    This width determines the scale of the drawing.
    """
    return max(shape.width, shape.height * aspect)


class _Level(NamedTuple):
    """The nodes at a depth; the y of their tops, of the lowest end of a card, and of the next level."""

    nodes: list[int]
    top: float
    end: float
    below: float


def _levels(boxes: Sequence[Box]) -> list[_Level]:
    levels, nodes, top = [], [0], 0.0
    while nodes:
        inner = [boxes[index] for index in nodes if boxes[index].children]
        end = top + max([boxes[index].pad + boxes[index].height for index in nodes])
        below = end + max([box.gap for box in inner], default=0.0)
        levels.append(_Level(nodes, top, end, below))
        nodes, top = [child for box in inner for child in box.children], below
    return levels


def _in_levels(boxes: Sequence[Box], limit: float) -> _Shape:
    """Return the root's shape with children in rows, and the cards of a level at the same height.

    Subtrees without frames are packed by their contours. Children hang from a spine if their row would be
    wider than *limit*. The time is linear in the number of boxes.
    """
    shapes: list[_Shape] = [_Shape(0.0, 0.0, 0.0)] * len(boxes)
    sides: list[tuple[_Side, _Side]] = [(_Side([]), _Side([]))] * len(boxes)
    for level in reversed(_levels(boxes)):
        for index in level.nodes:
            box = boxes[index]
            children = [shapes[child] for child in box.children]
            starts, left, right = _packed([sides[child] for child in box.children])
            shape = _Shape(box.width, box.height, 0.0)
            if children:
                widths = [boxes[child].width for child in box.children]
                drop = level.below - level.top - box.pad - box.height
                shape = _in_columns(box, widths, [[child] for child in children], starts, drop)
            is_wide = shape.width > limit and len(children) > 1
            if is_wide:
                shape = _flowed(box, children, limit if len(children) >= ROWS_FROM else 0.0)
            if box.has_frame:
                shape = _framed(shape)
            if is_wide or box.has_frame:
                bottom = level.top + shape.height
                left, right = _Side([(bottom, 0.0)]), _Side([(bottom, shape.width)])
            else:
                for side, x in ((left, shape.anchor), (right, shape.anchor + box.width)):
                    side.x += shape.starts[0] if children else 0.0
                    side.parts.append((level.end, x - side.x))
            shapes[index], sides[index] = shape, (left, right)
    return shapes[0]


def _packed(contours: Sequence[tuple[_Side, _Side]]) -> tuple[list[float], _Side, _Side]:
    """Return the x of areas side by side, and the sides of all together. It consumes *contours*."""
    starts: list[float] = []
    left, right = _Side([]), _Side([])
    for child_left, child_right in contours:
        start = right.distance(child_left) + GAP_X if starts else 0.0
        starts.append(start)
        child_left.x += start
        child_right.x += start
        left, right = left.above(child_left), child_right.above(right)
    return starts, left, right


def _offers(boxes: Sequence[Box]) -> list[_Shape]:
    """Return the shapes that the root offers, narrowest first."""
    offered: list[list[_Shape]] = [[] for _ in boxes]
    # From the last box to the first: children follow their parents.
    for index in range(len(boxes) - 1, -1, -1):
        box = boxes[index]
        below = [offered[child] for child in box.children]
        widths = [boxes[child].width for child in box.children]
        if not below:
            shapes = [_Shape(box.width, box.height, 0.0)]
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
    return shape._replace(
        width=shape.width + 2 * pad, height=shape.height + 2 * pad, anchor=shape.anchor + pad
    )


def _in_columns(
    box: Box,
    widths: Sequence[float],
    columns: Sequence[Sequence[_Shape]],
    starts: Sequence[float] = (),
    drop: float = 0.0,
) -> _Shape:
    """Return the shape with children in columns side by side, and the parent centred above them.

    Args:
        starts: The x of the columns, by default as far from each other as their areas require.
        drop: The distance from the card to the columns, by default the gap.
    """
    drop = drop or box.gap
    starts = starts or list(
        accumulate([_column_width(column) + GAP_X for column in columns[:-1]], initial=0.0)
    )
    down, middles, first = 0.0, [], 0
    for x, column in zip(starts, columns, strict=True):
        if len(column) == 1:
            middles.append(x + column[0].anchor + widths[first] / 2)
        else:
            middles.append(x + COLUMN_INDENT / 3)
        down = max(down, sum(shape.height for shape in column) + HANG_Y * (len(column) - 1))
        first += len(column)
    middle = (middles[0] + middles[-1]) / 2
    near = min(middles, key=lambda x: abs(x - middle))
    if abs(near - middle) < _SNAP:
        middle = near
    anchor = middle - box.width / 2
    left = min(anchor, *starts)
    right = max(anchor + box.width, *map(add, starts, map(_column_width, columns)))
    groups = tuple(map(tuple, columns))
    starts = tuple([x - left for x in starts])
    return _Shape(right - left, box.height + drop + down, anchor - left, groups, False, starts, drop)


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
            if box.has_frame:
                inset = 2.0
                right, bottom = left + shape.width - inset, top + shape.height - inset
                self._frames.append((index, left + inset, top + inset, right, bottom))
            place = Place(left + shape.anchor, top + box.pad + box.height / 2, box.width)
            self._places[index] = place
            lay = self._hang if shape.is_hung else self._columns
            waiting.extend(lay(box, shape, place, left + box.pad))
        self._frames.sort()
        return TreeLayout(
            tuple(self._places), tuple(self._edges), tuple(self._frames), (root.width, root.height)
        )

    def _top(self, child: int, shape: _Shape, x: float, y: float) -> tuple[float, float]:
        """Return the point where a line from above meets the card of *child*, whose area begins at (x, y)."""
        return x + shape.anchor + self._boxes[child].width / 2, y + self._boxes[child].pad

    def _columns(
        self, box: Box, shape: _Shape, place: Place, left: float
    ) -> Iterable[tuple[int, _Shape, float, float]]:
        under = place.y + box.height / 2
        bus = under + shape.drop - box.gap / 2
        children = iter(box.children)
        for start_x, column in zip(shape.starts, shape.groups, strict=True):
            x, single = left + start_x, len(column) == 1
            y = under + shape.drop
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
        box, first, start = self._boxes[index], shape.groups[0], self._boxes[index].pad + shape.starts[0]
        if len(box.children) == 1:
            first = (self._leftmost(box.children[0], first[0]),)
            return shape._replace(groups=(first,), anchor=box.pad, starts=(0.0,))
        middle = start + COLUMN_INDENT / 3
        if len(first) == 1:
            middle = start + first[0].anchor + self._boxes[box.children[0]].width / 2
        return shape._replace(anchor=max(box.pad, min(middle - box.width / 2, shape.anchor)))
