"""How a tree is drawn: the texts of its pills, its entities, and its legend."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun as rr

from btcore_monitor.events import ObservedNode, ObservedTree, TreeEvent
from btcore_monitor.screen.captions import create_captions
from btcore_monitor.screen.lanes import distinct_names
from btcore_monitor.screen.panels import shorten_message
from btcore_monitor.screen.row_buffer import RowBuffer
from btcore_monitor.screen.style import GROOT, MAX_NAME_CHARS, MAX_NOTE_CHARS
from btcore_monitor.screen.subtree_drawing import MAX_BRANCHES, PARTS, node_entities, split_by_subtree
from btcore_monitor.screen.tree_view import FOLD_ABOVE_NODES, TreeView

ROOM = (1000.0, 500.0)


def node(uid: int, name: str, parent: int = 0, children: tuple[int] = (), **more) -> ObservedNode:
    defaults = {"id": name, "type": "control" if children else "action", "path": f"{name}::{uid}"}
    return ObservedNode(uid, name, parent=parent, children=tuple(children), **{**defaults, **more})


def observed_tree(*nodes: ObservedNode, subtrees: Any = None) -> ObservedTree:
    return ObservedTree("f" * 32, "Main", nodes, subtrees or {"": "Main"})


NESTED = observed_tree(
    node(1, "Root", children=(2, 5)),
    node(2, "Drive", 1, (3,), id="SubTree", type="subtree", path="Drive"),
    node(3, "Steps", 2, (4,), path="Drive/Steps::3", subtree="Drive"),
    node(4, "Go", 3, path="Drive/Go::4", subtree="Drive"),
    node(5, "pills", 1, path="pills"),
    subtrees={"": "Main", "Drive": "DriveSomewhere"},
)


def note_of(node: ObservedNode, whole: ObservedTree | None = None) -> str:
    whole = whole or observed_tree(node)
    return create_captions(whole, whole, with_notes=True)[node.uid].note


@pytest.mark.parametrize(
    ("leaf", "note"),
    [
        (node(1, "Sleep"), ""),
        (node(1, "Sleep", ports={"msec": "500"}), "msec=500"),
        (node(1, "nap", id="Sleep", ports={"msec": "500"}), "Sleep  msec=500"),
        (node(1, "Script", ports={"code": " a := 1;\n b := 2 "}), "code=a := 1; b := 2"),
        (node(1, "Sleep", ports={"msec": "", "_skipIf": "x"}), ""),
    ],
)
def test_the_note_has_the_ports_and_the_id_if_it_differs_from_the_name(leaf: ObservedNode, note: str) -> None:
    assert note_of(leaf) == note


def test_the_note_of_a_subtree_names_its_tree() -> None:
    assert note_of(NESTED.nodes[1], NESTED) == "DriveSomewhere"


def test_long_texts_are_shortened_and_a_name_keeps_both_ends() -> None:
    long = node(1, "WouldThisVeryLongAndUnusualNameBeLegible", ports={"path": "x" * 80})
    written = create_captions(observed_tree(long), observed_tree(long), with_notes=True)[1]
    assert len(written.name) == MAX_NAME_CHARS
    assert written.name.startswith("WouldThisVery")
    assert written.name.endswith("Legible")
    assert len(written.note) == MAX_NOTE_CHARS
    assert written.note.endswith("…")


def test_a_tree_has_notes_unless_they_would_be_too_small_to_read() -> None:
    few = observed_tree(node(1, "Sleep", ports={"msec": "500"}))
    many = observed_tree(
        node(1, "Root", children=range(2, 62)),
        *(node(uid, "Sleep", 1, ports={"msec": "500"}) for uid in range(2, 62)),
    )
    assert TreeView(RowBuffer(rr.RecordingStream("test")), few, GROOT, ROOM).captions[1].note == "msec=500"
    assert TreeView(RowBuffer(rr.RecordingStream("test")), many, GROOT, ROOM).captions[2].note == ""


def test_every_node_is_in_branch_and_number_of_branches_is_limited(
    big_tree: Callable[..., Any],
) -> None:
    assert split_by_subtree(NESTED) == {"": [0, 1, 4], "Drive": [2, 3]}
    big = big_tree(1000)
    parts = split_by_subtree(big)
    assert len(parts) == MAX_BRANCHES
    assert sorted(at for part in parts.values() for at in part) == list(range(1000))
    assert split_by_subtree(big, most=1) == {"": list(range(1000))}


def test_subtrees_beyond_the_limit_belong_to_the_branch_around_them() -> None:
    inner = observed_tree(
        node(1, "A", children=(2,), id="SubTree", type="subtree", path="A"),
        node(2, "B", 1, (3,), id="SubTree", type="subtree", path="A/B", subtree="A"),
        node(3, "C", 2, path="A/B/C", subtree="A/B"),
    )
    assert split_by_subtree(inner, most=2) == {"": [0], "A": [1, 2]}


def test_entities_follow_subtrees_and_avoid_names_of_drawing_parts(
    big_tree: Callable[..., Any],
) -> None:
    entities, subtrees = node_entities(NESTED, "tree")
    assert entities == [
        "tree/Root.1",
        "tree/Drive",
        "tree/Drive/Steps.3",
        "tree/Drive/Go.4",
        "tree/pills.5",
    ]
    assert subtrees == {"": "tree", "Drive": "tree/Drive"}
    big = big_tree(1000)
    assert len(set(node_entities(big, "tree")[0])) == 1000
    odd = observed_tree(node(1, "Is it?", path="Is it?", children=(2,)), node(2, "Is it!", 1, path="Is it!"))
    assert node_entities(odd, "tree")[0] == ["tree/Is_it", "tree/Is_it.2"]


def test_all_parts_of_a_subtree_are_below_its_entity(recorded: Callable[..., Any], tmp_path: Path) -> None:
    recording = recorded([TreeEvent(NESTED, 0, 0, {})], tmp_path / "run.rrd")
    entities = {entity for entity, _ in recording.columns if entity.startswith("/tree/Drive/")}
    shown = {"frames", "edges", "running_edges", "rims", "pills", "badges", "ink", "raised"}
    assert shown | {"Steps.3", "Go.4"} == {entity.rsplit("/", 1)[1] for entity in entities}
    assert len(recording.at("/tree/Drive/pills", "LineStrips2D:colors", 0)) == 2
    assert len(recording.at("/tree/pills", "LineStrips2D:colors", 0)) == 3
    assert recording.of("/tree/Drive/pills", "LineStrips2D:labels")[0][1] == ["Steps", "Go"]
    assert shown <= set(PARTS)


def test_the_entity_of_a_node_describes_it_and_has_the_place_of_its_pill(
    recorded: Callable[..., Any], tmp_path: Path
) -> None:
    tree = observed_tree(node(1, "nap", id="Sleep", path="nap", ports={"msec": "500"}))
    recording = recorded([TreeEvent(tree, 0, 0, {})], tmp_path / "run.rrd")
    assert recording.of("/tree/nap", "node")[0][1] == ['Sleep  nap  msec="500"']
    pill = recording.of("/tree/rims", "LineStrips2D:strips")[0][1]
    assert recording.of("/tree/nap", "LineStrips2D:strips")[0][1] == pill


def test_nodes_of_a_big_tree_have_entities_that_draw_nothing(
    big_tree: Callable[..., Any], recorded: Callable[..., Any], tmp_path: Path
) -> None:
    recording = recorded([TreeEvent(big_tree(FOLD_ABOVE_NODES + 10), 0, 0, {})], tmp_path / "run.rrd")
    named = [entity for entity, component in recording.columns if component == "node"]
    assert len(named) == FOLD_ABOVE_NODES + 10
    assert not [entity for entity in named if recording.of(entity, "LineStrips2D:strips")]


def test_legend_is_below_tree_in_colours_of_palette(recorded: Callable[..., Any], tmp_path: Path) -> None:
    recording = recorded([TreeEvent(NESTED, 0, 0, {})], tmp_path / "run.rrd")
    colours = set(recording.of("/tree/legend", "LineStrips2D:colors")[0][1])
    assert {int(colour) for colour in GROOT.fill[:5]} | {GROOT.raised} <= colours
    assert GROOT.highlight not in colours
    points = np.concatenate(recording.of("/tree/legend", "LineStrips2D:strips")[0][1])
    pills = np.concatenate(recording.of("/tree/rims", "LineStrips2D:strips")[0][1])
    assert points[:, 1].min() > pills[:, 1].max() + 21  # below the lowest pill's rim


@pytest.mark.parametrize("count", [1, 5, 60, 400])
def test_view_contains_tree_and_does_not_magnify_small_tree(big_tree: Callable[..., Any], count: int) -> None:
    view = TreeView(RowBuffer(rr.RecordingStream("test")), big_tree(count), GROOT, ROOM)
    x0, y0, x1, y1 = view.bounds()
    width, height = view.layout.size
    assert (x1 - x0) / (y1 - y0) == pytest.approx(ROOM[0] / ROOM[1])
    assert x0 < 0 < width < x1
    assert y0 < 0 < height < y1
    assert x1 - x0 > ROOM[0] / 1.4


def test_lanes_of_nodes_with_the_same_name_differ_by_their_ports() -> None:
    drives = [
        node(1, "Move", ports={"goal": "{home}"}),
        node(2, "Move", ports={"goal": "{shop}"}),
        node(3, "Move", ports={"goal": "x" * 99}),
        node(4, "Turn", ports={"angle": "1"}),
    ]
    assert distinct_names(drives) == ["Move {home}", "Move {shop}", "Move", "Turn"]


def test_nodes_of_one_name_are_distinguished_by_their_subtrees_or_their_uids() -> None:
    places = ("Zone A/Order 1/Drive", "Zone A/Order 2/Drive", "Zone B/Order 2/Drive")
    nodes = [
        ObservedNode(uid, "Go", "Go", "action", f"{place}/Go", 1, (), {"t": "7"}, place)
        for uid, place in enumerate(places, start=2)
    ]
    assert distinct_names(nodes[:2]) == ["Go · Order 1/Drive", "Go · Order 2/Drive"]
    assert distinct_names(nodes)[2] == "Go · Zone B/Order 2/Drive"
    twins = [ObservedNode(uid, "Sequence", "Sequence", "control", f"Sequence{uid}") for uid in (3, 4)]
    assert distinct_names(twins) == ["Sequence #3", "Sequence #4"]


@pytest.mark.parametrize(
    ("message", "shortened"),
    [
        ("/a/b.xml:3: node 'A' <B> raised while ticking: ValueError: no\n  x", "ValueError: no"),
        ("tree.xml:3: something else", "something else"),
        ("division by zero", "division by zero"),
    ],
)
def test_an_error_is_shortened_to_its_message(message: str, shortened: str) -> None:
    assert shorten_message(message) == shortened
