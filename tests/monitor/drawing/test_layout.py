"""The layout of a tree's nodes."""

import itertools
import math
import random
import time
from collections.abc import Sequence, Set

import pytest
from hypothesis import given
from hypothesis import strategies as st

from btcore_drawing.layout import FRAME_PAD, GAP_X, Box, TreeLayout, lay_out

HEIGHT = 42.0
COMFORT = 28 * HEIGHT
PROTOTYPE = {100: (2849, 1976), 1000: (12151, 7438)}
"""The sizes of the prototype's layouts, which a layout must not exceed."""


def tree_of(
    parents: list[int],
    widths: list[float],
    framed: Set[int] = frozenset(),
    heights: Sequence[float] = (HEIGHT,),
) -> list[Box]:
    """Return boxes in depth-first order; *parents* has the parent of each node except the root."""
    children: list[list[int]] = [[] for _ in range(len(parents) + 1)]
    for node, parent in enumerate(parents, start=1):
        children[parent].append(node)
    order, waiting = [], [0]
    while waiting:
        node = waiting.pop()
        order.append(node)
        waiting.extend(reversed(children[node]))
    place = {node: at for at, node in enumerate(order)}
    return [
        Box(widths[at], heights[at % len(heights)], tuple(place[c] for c in children[at]), at in framed)
        for at in order
    ]


def random_tree(count: int, seed: int = 7) -> list[Box]:
    """A tree as people write them: some levels, two to six children, names of 6 to 24 letters."""
    rng = random.Random(seed)
    parents, open_nodes = [], [0]
    load = {0: 0}
    for node in range(1, count):
        parent = rng.choice(open_nodes[:60])
        parents.append(parent)
        load[parent] += 1
        if load[parent] >= rng.randint(2, 6):
            open_nodes.remove(parent)
        load[node] = 0
        if rng.random() < 0.45 or not open_nodes:
            open_nodes.append(node)
    return tree_of(parents, [rng.uniform(90, 300) for _ in range(count)])


@st.composite
def trees(draw: st.DrawFn) -> list[Box]:
    count = draw(st.integers(1, 60))
    back = draw(st.lists(st.integers(0, 9), min_size=count - 1, max_size=count - 1))
    parents = [max(0, node - steps) for node, steps in enumerate(back)]
    some = draw(st.lists(st.floats(50, 400), min_size=1, max_size=9))
    widths = list(itertools.islice(itertools.cycle(some), count))
    framed = draw(st.sets(st.integers(0, count - 1), max_size=4))
    heights = draw(st.lists(st.floats(10, 120), min_size=1, max_size=5))
    return tree_of(parents, widths, framed, heights)


def pill(width: float, *children: int) -> Box:
    return Box(width, HEIGHT, children)


def areas(boxes: list[Box], layout: TreeLayout) -> list[tuple[float, float, float, float]]:
    return [
        (place.x, place.y - box.height / 2, place.x + place.width, place.y + box.height / 2)
        for box, place in zip(boxes, layout.places, strict=True)
    ]


def overlap(a: tuple[float, ...], b: tuple[float, ...], slack: float = 0.01) -> bool:
    return a[0] < b[2] - slack and b[0] < a[2] - slack and a[1] < b[3] - slack and b[1] < a[3] - slack


def below(boxes: list[Box], index: int) -> set[int]:
    found, waiting = set(), [index]
    while waiting:
        current = waiting.pop()
        found.add(current)
        waiting.extend(boxes[current].children)
    return found


def check_that_no_two_pills_overlap(boxes: list[Box], layout: TreeLayout) -> None:
    drawn = areas(boxes, layout)
    for at, place in enumerate(drawn):
        assert not any(overlap(place, other) for other in drawn[:at])


def check_that_root_is_on_top_and_children_are_under_parents(boxes: list[Box], layout: TreeLayout) -> None:
    placed = areas(boxes, layout)
    for box, place in zip(boxes, placed, strict=True):
        for child in box.children:
            assert placed[child][1] >= place[3]


def check_that_children_keep_their_order_to_the_right_or_downwards(
    boxes: list[Box], layout: TreeLayout
) -> None:
    placed = areas(boxes, layout)
    for box in boxes:
        for child, following in itertools.pairwise(box.children):
            to_the_right = placed[following][0] >= placed[child][2]
            under = placed[following][1] >= placed[child][3]
            assert to_the_right or under


def check_that_every_line_joins_parent_and_child_and_crosses_no_pill(
    boxes: list[Box], layout: TreeLayout
) -> None:
    drawn = areas(boxes, layout)
    for parent, box in enumerate(boxes):
        for child in box.children:
            line = layout.edges[child]
            assert drawn[parent][0] <= line[0][0] <= drawn[parent][2]
            assert line[0][1] == pytest.approx(drawn[parent][3])
            end = line[-1]
            at_the_top = abs(end[1] - drawn[child][1]) < 0.01 and drawn[child][0] <= end[0] <= drawn[child][2]
            at_the_left = abs(end[0] - drawn[child][0]) < 0.01 and drawn[child][1] < end[1] < drawn[child][3]
            assert at_the_top or at_the_left
            for (x0, y0), (x1, y1) in itertools.pairwise(line):
                segment = (min(x0, x1) - 0.5, min(y0, y1) - 0.5, max(x0, x1) + 0.5, max(y0, y1) + 0.5)
                crossed = {at for at, pill in enumerate(drawn) if overlap(segment, pill, slack=0.6)}
                assert crossed <= {parent, child}


def check_that_a_frame_holds_its_subtree_and_nothing_else(boxes: list[Box], layout: TreeLayout) -> None:
    drawn = areas(boxes, layout)
    assert {frame[0] for frame in layout.frames} == {at for at, box in enumerate(boxes) if box.has_frame}
    for index, x0, y0, x1, y1 in layout.frames:
        inside = below(boxes, index)
        for at, pill in enumerate(drawn):
            if at in inside:
                assert x0 <= pill[0] < pill[2] <= x1
                assert y0 <= pill[1] < pill[3] <= y1
            else:
                assert not overlap((x0, y0, x1, y1), pill)


def check_that_a_layout_stays_within_its_size(boxes: list[Box], layout: TreeLayout) -> None:
    width, height = layout.size
    for x0, y0, x1, y1 in areas(boxes, layout):
        assert -0.01 <= x0 < x1 <= width + 0.01
        assert -0.01 <= y0 < y1 <= height + 0.01


@given(trees(), st.floats(0.4, 4.0), st.sampled_from([COMFORT, math.inf]), st.booleans())
def test_a_layout_is_deterministic_and_has_its_properties(
    boxes: list[Box], aspect: float, comfort: float, is_quick: bool
) -> None:
    """The layouts are searched, quick, or in levels without wrapping."""
    layout = lay_out(boxes, aspect, comfort, is_quick)
    assert layout == lay_out(boxes, aspect, comfort, is_quick)
    check_that_no_two_pills_overlap(boxes, layout)
    check_that_root_is_on_top_and_children_are_under_parents(boxes, layout)
    check_that_children_keep_their_order_to_the_right_or_downwards(boxes, layout)
    check_that_every_line_joins_parent_and_child_and_crosses_no_pill(boxes, layout)
    check_that_a_frame_holds_its_subtree_and_nothing_else(boxes, layout)
    check_that_a_layout_stays_within_its_size(boxes, layout)


def test_a_small_tree_has_a_row_for_each_level_and_centred_parents() -> None:
    boxes = [pill(120, 1, 4), pill(100, 2, 3), pill(90), pill(90), pill(110)]
    places = lay_out(boxes, 1.6, COMFORT).places
    assert places[2].y == places[3].y > places[1].y == places[4].y > places[0].y
    assert places[0].centre == (places[1].centre + places[4].centre) / 2
    assert places[1].centre == (places[2].centre + places[3].centre) / 2


def test_a_parent_is_directly_above_a_child_that_is_nearly_in_the_middle() -> None:
    boxes = [pill(150, 1, 2, 3), pill(100), pill(90), pill(112)]
    layout = lay_out(boxes, 1.6, COMFORT)
    assert layout.places[0].centre == layout.places[2].centre
    assert len(layout.edges[2]) == 2


def test_big_trees_are_no_larger_than_the_prototypes_layouts() -> None:
    for count, (width, height) in PROTOTYPE.items():
        layouts = [lay_out(random_tree(count, seed), width / height, COMFORT) for seed in range(5)]
        needed = sorted(max(layout.size[0] / width, layout.size[1] / height) for layout in layouts)
        assert needed[2] <= 1.0


@pytest.mark.parametrize("count", [2, 3, 30, 150, 400])
def test_a_chain_and_a_broom_of_any_length_are_laid_out(count: int) -> None:
    chain = tree_of(list(range(count - 1)), [100.0] * count)
    assert len(lay_out(chain, 1.6, COMFORT).places) == count
    broom = tree_of([0] * (count - 1), [100.0] * count)
    width, height = lay_out(broom, 1.6, COMFORT).size
    assert count < 30 or 0.4 < width / height < 6.0


def test_the_time_of_a_layout_grows_about_linearly_with_the_nodes() -> None:
    def seconds(count: int) -> float:
        boxes = random_tree(count)
        best = float("inf")
        for _ in range(2):
            start = time.thread_time()
            lay_out(boxes, 1.6, COMFORT)
            best = min(best, time.thread_time() - start)
        return best

    assert seconds(1200) < 10 * seconds(300)


def test_an_only_child_is_below_its_parent_in_a_big_tree() -> None:
    boxes = random_tree(300)
    places = lay_out(boxes, 1.6, COMFORT).places
    single_children = [(at, box.children[0]) for at, box in enumerate(boxes) if len(box.children) == 1]
    assert len(single_children) > 10
    for parent, child in single_children:
        assert places[child].y > places[parent].y
        assert places[child].x < places[parent].x + places[parent].width
        assert places[parent].x < places[child].x + places[child].width


def test_children_in_a_column_and_an_only_child_below_share_their_left_edge() -> None:
    boxes = [
        pill(120, 1, 2, 3, 4),
        *[pill(120)] * 3,
        pill(120, 5),
        pill(120, 6, 7),
        *[pill(90)] * 2,
    ]
    places = lay_out(boxes, 0.6, comfort=HEIGHT).places
    assert len({place.y for place in places[1:5]}) == 4
    assert places[6].y == places[7].y > places[5].y
    assert {place.x for place in places[1:6]} == {places[1].x}


def test_a_tree_is_wrapped_when_it_is_wider_than_comfortable() -> None:
    boxes = [pill(120, *range(1, 13)), *[pill(200)] * 12]
    as_on_paper = lay_out(boxes, 1.6, comfort=100 * HEIGHT)
    assert len({place.y for place in as_on_paper.places[1:]}) == 1
    wrapped = lay_out(boxes, 1.6, comfort=20 * HEIGHT)
    assert wrapped.size[0] < as_on_paper.size[0] / 2


def test_subtrees_without_frames_are_packed_by_their_contours() -> None:
    boxes = [pill(100, 1, 2), pill(100), pill(100, 3, 4, 5), *[pill(100)] * 3]
    assert lay_out(boxes, 1.6, COMFORT).size[0] == 3 * 100 + 2 * GAP_X
    boxes[2] = boxes[2]._replace(has_frame=True)
    assert lay_out(boxes, 1.6, COMFORT).size[0] == 4 * 100 + 3 * GAP_X + 2 * FRAME_PAD


def test_an_unwrapped_layout_has_a_row_for_each_level_of_cards_of_any_height() -> None:
    boxes = [pill(100, 1, 3), pill(100, 2), pill(100), Box(100, 90, (4, 5)), pill(100), pill(100)]
    placed = areas(boxes, lay_out(boxes, 1.6, math.inf))
    assert placed[1][1] == placed[3][1] < placed[2][1] == placed[4][1] == placed[5][1]


def test_a_quick_layout_is_not_much_wider_than_comfortable_and_takes_little_time() -> None:
    boxes = random_tree(1000)
    times = []
    for _ in range(3):  # a collection of garbage may take longer than a layout
        start = time.thread_time()
        layout = lay_out(boxes, 1.6, COMFORT, is_quick=True)
        times.append(time.thread_time() - start)
    assert layout.size[0] < 1.5 * COMFORT
    start = time.thread_time()
    lay_out(boxes, 1.6, COMFORT)
    assert min(times) < (time.thread_time() - start) / 5


def test_no_nodes_give_an_empty_layout() -> None:
    assert lay_out([], 1.6, COMFORT) == TreeLayout((), (), (), (0.0, 0.0))
