"""Lay out boxes of any size as a tidy tree: levels in rows, parents centred over their children.

*Breadth* is the axis of siblings, *depth* is the axis from parent to child. A framed box has a rectangle
around its descendants, which other boxes don't overlap.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field


@dataclass(slots=True, eq=False)
class LayoutBox:
    """A box with its size, its children, and (after `layout_tree`) its position, in px.

    *breadth* and *depth* are sizes. *middle* is its centre along the breadth, *top* its start along the
    depth. *frame* is (min breadth, min depth, max breadth, max depth) of the frame around its descendants.
    """

    breadth: float
    depth: float
    framed: bool = False
    children: list["LayoutBox"] = field(default_factory=list)
    level: int = 0
    middle: float = 0.0
    top: float = 0.0
    frame: tuple[float, float, float, float] | None = None
    _offset: float = 0.0
    _sides: tuple[float, float] = (0.0, 0.0)
    _last: int = 0
    _nested: int = 0


@dataclass(frozen=True, slots=True)
class Spacing:
    """Distances in px: between *siblings*, between *levels*, and from a *frame* to its content."""

    siblings: float
    levels: float
    frame: float


# For each level, from a box's own level on: where its descendants begin and end along the breadth,
# relative to the middle of the box.
_Contour = list[tuple[float, float]]


def layout_tree(root: LayoutBox, gaps: Spacing) -> tuple[float, float]:
    """Place a box and its descendants, from the origin (0, 0) on.

    Returns:
        The breadth and the depth of the layout in px.
    """
    boxes: list[LayoutBox] = []
    contour = _place(root, 0, gaps, boxes)
    left = min(side[0] for side in contour)
    tops, thickness = _levels(boxes, gaps)
    root.middle = -left
    for box in boxes:
        for child in box.children:
            child.middle = box.middle + child._offset
        box.top = tops[box.level]
        # The drawing may omit the children of a call.
        if box.framed and box.children:
            start, end = box._sides
            below = tops[box._last] + thickness[box._last] + gaps.frame * box._nested
            box.frame = (
                box.middle + start,
                tops[box.level + 1] - gaps.frame,
                box.middle + end,
                below,
            )
    bottom = max([box.frame[3] for box in boxes if box.frame is not None], default=0.0)
    deepest = len(tops) - 1
    return max(side[1] for side in contour) - left, max(bottom, tops[deepest] + thickness[deepest])


def _place(box: LayoutBox, level: int, gaps: Spacing, boxes: list[LayoutBox]) -> _Contour:
    box.level = box._last = level
    boxes.append(box)
    half = box.breadth / 2
    own = (-half, half)
    if not box.children:
        return [own]
    contours = [_place(child, level + 1, gaps, boxes) for child in box.children]
    below = _side_by_side(box.children, contours, gaps.siblings)
    box._last = max(child._last for child in box.children)
    nested = [child._nested for child in box.children if child._last == box._last]
    box._nested = max(nested)
    if box.framed:
        box._nested += 1
        start = min(side[0] for side in below) - gaps.frame
        end = max(side[1] for side in below) + gaps.frame
        box._sides = (start, end)
        below = [(start, end)] * len(below)
    return [own, *below]


def _side_by_side(children: Sequence[LayoutBox], contours: Sequence[_Contour], gap: float) -> _Contour:
    """Place *children* as close to each other as possible. Return their common contour."""
    merged = list(contours[0])
    children[0]._offset = 0.0
    for child, contour in zip(children[1:], contours[1:], strict=True):
        # Only levels that both sides have can collide.
        shared = zip(merged, contour, strict=False)
        shift = max(left_side[1] - right_side[0] for left_side, right_side in shared) + gap
        child._offset = shift
        for level, (left, right) in enumerate(contour):
            if level < len(merged):
                merged[level] = (merged[level][0], right + shift)
            else:
                merged.append((left + shift, right + shift))
    centre = (children[0]._offset + children[-1]._offset) / 2
    for child in children:
        child._offset -= centre
    return [(left - centre, right - centre) for left, right in merged]


def _levels(boxes: Sequence[LayoutBox], gaps: Spacing) -> tuple[list[float], list[float]]:
    """Return the start and the size (px) of each level along the depth."""
    count = max(box.level for box in boxes) + 1
    # Frames need additional space above the level where they begin, and below the level where they end.
    thickness = [0.0] * count
    opening = [0.0] * count
    closing = [0.0] * count
    for box in boxes:
        thickness[box.level] = max(thickness[box.level], box.depth)
        if box.framed and box.children:
            opening[box.level + 1] = gaps.frame
            closing[box._last] = max(closing[box._last], gaps.frame * box._nested)
    tops = [0.0]
    for level in range(1, count):
        before = tops[-1] + thickness[level - 1] + closing[level - 1]
        tops.append(before + gaps.levels + opening[level])
    return tops, thickness
