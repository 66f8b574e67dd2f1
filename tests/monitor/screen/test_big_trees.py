"""Trees too big for a window: folded subtrees, lanes of running leaves, and search by name."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from btcore_monitor.events import ExceptionEvent, ObservedNode, ObservedTree, TransitionEvent, TreeEvent
from btcore_monitor.screen.folding import MAX_FOLDED_NODES, fold
from btcore_monitor.screen.style import GROOT
from btcore_monitor.screen.subtree_drawing import node_entities, split_by_subtree
from btcore_monitor.screen.tree_view import match_nodes
from tests.monitor.screen.conftest import Recording

IDLE, RUNNING, SUCCESS, FAILURE = range(4)
SECOND = 10**9


def tree_events(tree: ObservedTree, *steps) -> list[TransitionEvent | TreeEvent]:
    """Return the events of *tree* and of *steps*, which are (time in s, uid, status)."""
    events = [TreeEvent(tree, 0, 0, {})]
    status: dict[int, int] = {}
    for number, (seconds, uid, new) in enumerate(steps, start=1):
        t = round(seconds * SECOND)
        events.append(TransitionEvent(number, t, t, number, uid, status.get(uid, IDLE), new))
        status[uid] = new
    return events


def named(tree: ObservedTree, name: str) -> ObservedNode:
    return next(node for node in tree.nodes if node.name == name)


def colours(recording: Recording, tree: ObservedTree, origin: str, t: int) -> dict[int, int]:
    """uid → colour of its pill at *t*, from the entities of all subtrees."""
    found = {}
    _, entities = node_entities(tree, origin)
    for path, indices in split_by_subtree(tree).items():
        row = recording.at(f"/{entities[path]}/pills", "LineStrips2D:colors", t)
        found.update(zip((tree.nodes[at].uid for at in indices), row, strict=True))
    return found


def folded(recording: Recording, t: int) -> tuple[int, dict[str, int]]:
    """Return the number of the folded drawing in the view at *t*, and its colours by the nodes' names."""
    inside = [
        entity
        for entity, component in recording.columns
        if entity.startswith("/folded/pills/")
        and component == "Transform3D:translation"
        and recording.at(entity, component, t)[0][0] > -10_000
    ]
    (entity,) = inside
    names = recording.of(entity, "LineStrips2D:labels")[0][1]
    return int(entity.rsplit("/", 1)[1]), dict(
        zip(names, recording.at(entity, "LineStrips2D:colors", t), strict=True)
    )


def drawn(recording: Recording, origin: str, part: str, component: str, t: int) -> list[list[list[float]]]:
    """Return the values that the entities of *part* in all subtrees have at *t*."""
    entities = {entity for entity, _ in recording.columns if entity.startswith(f"/{origin}/")}
    rows = [recording.at(entity, component, t) for entity in sorted(entities) if entity.endswith(f"/{part}")]
    return [cell for row in rows for cell in row]


def test_folding_keeps_main_tree_and_no_more_nodes_than_are_readable(
    big_tree: Callable[..., Any],
) -> None:
    tree = big_tree(400)
    small = fold(tree)
    assert len(small.nodes) <= MAX_FOLDED_NODES
    kept = {node.uid for node in small.nodes}
    assert {node.uid for node in tree.nodes if node.subtree == ""} <= kept
    assert all(set(node.children) <= kept for node in small.nodes)
    whole = [node.uid for node in tree.nodes]
    assert [whole.index(node.uid) for node in small.nodes] == sorted(whole.index(uid) for uid in kept)


def test_a_main_tree_of_too_many_nodes_is_not_cut(big_tree: Callable[..., Any]) -> None:
    tree = big_tree(1500)
    small = fold(tree)
    assert {node.subtree for node in small.nodes} == {""}
    assert len(small.nodes) == len([node for node in tree.nodes if node.subtree == ""])


def test_a_called_tree_that_is_too_large_for_any_drawing_is_unfolded_level_by_level(
    big_tree: Callable[..., Any],
) -> None:
    tree = big_tree(30)
    assert [node.name for node in fold(tree, most=5).nodes] == ["Day", "Task1", "Steps", "Task11", "Task21"]


def test_running_nodes_are_unfolded_with_siblings_and_others_as_long_as_there_is_room(
    big_tree: Callable[..., Any],
) -> None:
    tree = big_tree(400)
    last = tree.nodes[-1]
    steps = tree.by_uid[last.parent]
    small = fold(tree, {last.uid, *(node.uid for node in tree.ancestors(last.uid))})
    kept = {node.uid for node in small.nodes}
    assert len(small.nodes) <= MAX_FOLDED_NODES
    assert {last.uid, steps.uid, *steps.children} <= kept
    assert {node.uid for node in tree.nodes if node.subtree == ""} <= kept


def test_a_big_tree_without_subtrees_is_folded_except_for_its_running_part() -> None:
    rows, columns = 20, 15
    control = [ObservedNode(2 + at, f"C{at}", "Sequence", "control", f"C{at}", 1) for at in range(rows)]
    nodes = [ObservedNode(1, "Root", "Fallback", "control", "Root", 0, tuple(node.uid for node in control))]
    for at, node in enumerate(control):
        first = 2 + rows + at * columns
        nodes.append(replace(node, children=tuple(range(first, first + columns))))
        nodes += [
            ObservedNode(uid, f"L{uid}", "L", "action", f"L{uid}", node.uid) for uid in nodes[-1].children
        ]
    tree = ObservedTree("f" * 32, "Flat", tuple(nodes), {"": "Flat"})
    running = nodes[-1].uid
    small = fold(tree, {1, control[-1].uid, running})
    assert len(small.nodes) <= MAX_FOLDED_NODES
    assert {running, *(node.uid for node in control)} <= {node.uid for node in small.nodes}


def test_a_big_tree_unfolds_what_runs_and_returns_to_an_earlier_drawing(
    big_tree: Callable[..., Any], tmp_path: Path, recorded: Callable[..., Any]
) -> None:
    tree = big_tree(400)
    small = fold(tree)
    hidden = [tree.by_uid[node.uid] for node in small.nodes if node.type == "subtree" and not node.children]
    leaves = [tree.by_uid[tree.by_uid[task.children[0]].children[0]] for task in (hidden[0], hidden[-1])]
    paths = [[*(node.uid for node in tree.ancestors(leaf.uid)), leaf.uid] for leaf in leaves]
    steps = [
        (second + at / 100, uid, status)
        for second, path, status in (
            (1, 0, RUNNING),
            (2, 0, IDLE),
            (3, 1, RUNNING),
            (4, 1, IDLE),
            (5, 0, RUNNING),
        )
        for at, uid in enumerate(paths[path])
    ]
    recording = recorded(tree_events(tree, *steps), tmp_path / "run.rrd")
    begin, first, second, again = (folded(recording, round(t * SECOND)) for t in (0.5, 1.5, 3.5, 5.5))
    assert set(begin[1]) == {node.name for node in small.nodes}
    assert first[1][leaves[0].name] == GROOT.fill[RUNNING]
    assert second[1][leaves[1].name] == GROOT.fill[RUNNING]
    assert begin[0] != first[0] != second[0]
    assert again[0] == first[0]
    assert again[1][leaves[0].name] == GROOT.fill[RUNNING]
    assert len(colours(recording, tree, "tree", 2 * SECOND)) == 400
    assert len(drawn(recording, "tree", "running_edges", "LineStrips2D:strips", round(1.5 * SECOND))) == 3


def test_a_tree_that_fits_is_drawn_once(
    run: Callable[..., Any], tmp_path: Path, recorded: Callable[..., Any]
) -> None:
    recording = recorded(run(5), tmp_path / "run.rrd")
    assert not [entity for entity, _ in recording.columns if entity.startswith("/folded")]


def test_lanes_of_big_tree_name_subtree_and_running_leaves(
    big_tree: Callable[..., Any], tmp_path: Path, recorded: Callable[..., Any]
) -> None:
    tree = big_tree(400)
    first, second, third = (named(tree, name) for name in ("Leaf3", "Leaf4", "Leaf5"))
    task = named(tree, "Task1")
    steps = [
        (1.0, task.uid, RUNNING),
        (1.1, first.uid, RUNNING),
        (2.0, second.uid, RUNNING),
        (3.0, first.uid, SUCCESS),
        (4.0, third.uid, RUNNING),
        (5.0, task.uid, SUCCESS),
    ]
    recording = recorded(tree_events(tree, *steps), tmp_path / "run.rrd")

    def lane(name: str, seconds: float):
        return recording.at(f"/{name}", "StateChange:state", round(seconds * SECOND))[0]

    assert [lane("1_subtree", t) for t in (0.5, 1.5, 6)] == ["–", "Task1", "–"]
    assert [lane("2_leaf", t) for t in (0.5, 1.5, 2.5, 3.5, 4.5)] == ["–", "Leaf3", "Leaf3", "–", "Leaf5"]
    assert [lane("3_leaf_2", t) for t in (2.5, 3.5, 4.5)] == ["Leaf4", "Leaf4", "Leaf4"]
    assert ("/4_leaf_3", "StateChange:state") not in recording.columns


def test_nodes_are_found_by_a_part_of_their_name_and_by_patterns(run: Callable[..., Any]) -> None:
    tree = run(1)[1].tree
    names = {node.uid: node.name for node in tree.nodes}

    def found(pattern: str):
        return [names[uid] for uid in match_nodes(tree, pattern)]

    assert found("obst") == ["IsObstacle"]
    assert found("Is*") == ["IsObstacle"]
    assert found("b*") == ["bumpgo", "Back"]
    assert found("?ack") == ["Back"]
    assert found("inverter") == ["clear"]  # by its ID
    assert found("x") == []


def test_found_nodes_are_highlighted_and_have_the_lanes(
    run: Callable[..., Any], tmp_path: Path, recorded: Callable[..., Any]
) -> None:
    recording = recorded(run(70), tmp_path / "run.rrd", find_patterns=["escape", "Turn", "nowhere"])
    halos = recording.of("/tree/highlights", "LineStrips2D:strips")[0][1]
    pills = recording.of("/tree/pills", "LineStrips2D:strips") or recording.of(
        "/tree/rims", "LineStrips2D:strips"
    )
    assert halos == [pills[0][1][4], pills[0][1][6]]
    lanes = sorted({entity for entity, component in recording.columns if component == "StateChange:state"})
    assert lanes == ["/1_escape", "/2_Turn"]
    lines = [values[0] for _, values in recording.of("/log", "TextLog:text")]
    assert any("no node's name or path matches 'nowhere'" in line for line in lines)


def test_a_node_that_raised_is_marked_until_it_runs_again(
    run: Callable[..., Any], tmp_path: Path, recorded: Callable[..., Any]
) -> None:
    forward, path = 8, "Forward"
    events = run(50)  # Forward is reset at 4.1 s and idle since
    t = events[-2].stamp
    events[-1:] = [
        ExceptionEvent(t, t, path, "no laser"),
        TransitionEvent(10_000, t + SECOND, t, 60, forward, IDLE, RUNNING),
        TransitionEvent(10_001, t + 2 * SECOND, t, 70, forward, RUNNING, IDLE),
        TransitionEvent(10_002, t + 3 * SECOND, t, 80, forward, IDLE, RUNNING),
    ]
    recording = recorded(events, tmp_path / "run.rrd")
    pill = recording.of("/tree/rims", "LineStrips2D:strips")[0][1][7]
    assert recording.at("/tree/raised", "LineStrips2D:strips", t) == [pill]
    assert recording.of("/tree/raised", "LineStrips2D:strips")[-1][1] == []


def test_the_last_exception_stays_in_the_running_panel(
    run: Callable[..., Any], tmp_path: Path, recorded: Callable[..., Any]
) -> None:
    events = run(50)
    message = "/a/t.xml:7: node 'avoid' <Avoid> raised while ticking: Fault: no laser\n  bumpgo\n    avoid"
    events.append(ExceptionEvent(6 * SECOND, 0, "avoid|x", message))
    recording = recorded(events, tmp_path / "run.rrd")
    text = recording.of("/now", "TextDocument:text")[-1][1][0]
    assert text.startswith("**avoid¦x** raised at 6.00 s: Fault: no laser\n\n| runs |")


def test_an_exception_inside_a_folded_subtree_marks_the_subtree(
    big_tree: Callable[..., Any], tmp_path: Path, recorded: Callable[..., Any]
) -> None:
    tree = big_tree(400)
    small = fold(tree)
    leaf = tree.nodes[-1]
    assert leaf.uid not in {node.uid for node in small.nodes}
    events = [TreeEvent(tree, 0, 0, {}), ExceptionEvent(SECOND, SECOND, leaf.path, "no laser")]
    recording = recorded(events, tmp_path / "run.rrd")
    place = recording.of("/folded/lines/0/rims", "LineStrips2D:strips")[0][1][-1]  # the last of the main tree
    assert small.nodes[-1].subtree == ""
    assert recording.at("/folded/lines/0/raised", "LineStrips2D:strips", SECOND) == [place]
