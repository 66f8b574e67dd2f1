"""A .fbl of BehaviorTree.CPP 3 is read, up to the point of truncation."""

import random
from pathlib import Path

import pytest

from btcore import NodeType, Status
from btcore.logs import LogError
from btcore_monitor.logs import read_fbl

# The transitions of the recorded session: (seconds, µs, uid, previous, status).
LISTED = [
    (1795223035, 621691, 1, 0, 1),
    (1795223035, 621823, 2, 0, 2),
    (1795223035, 621824, 3, 0, 1),
    (1795223035, 621825, 4, 0, 3),
    (1795223035, 621850, 5, 0, 1),
    (1795223035, 927032, 5, 1, 2),
    (1795223035, 927150, 4, 3, 0),
    (1795223035, 927150, 5, 2, 0),
    (1795223035, 927151, 3, 1, 2),
    (1795223035, 927152, 6, 0, 1),
    (1795223035, 927153, 7, 0, 1),
    (1795223035, 927157, 8, 0, 1),
    (1795223036, 77939, 8, 1, 2),
    (1795223036, 78006, 8, 2, 0),
    (1795223036, 78007, 7, 1, 2),
    (1795223036, 78009, 7, 2, 0),
    (1795223036, 78010, 6, 1, 2),
    (1795223036, 78011, 9, 0, 1),
    (1795223036, 78012, 10, 0, 1),
    (1795223036, 78017, 11, 0, 1),
]


def test_transitions_match_the_recorded_session(captures: Path) -> None:
    recording = read_fbl(captures / "v3_sample.fbl")
    assert recording.transitions == [
        (seconds * 10**9 + micros * 1000, uid, previous, status)
        for seconds, micros, uid, previous, status in LISTED
    ]
    assert recording.damage == ""
    assert recording.start == recording.transitions[0].stamp
    assert recording.statuses()[11] is Status.RUNNING


def test_tree_matches_the_recorded_session(captures: Path) -> None:
    nodes = read_fbl(captures / "v3_sample.fbl").nodes
    assert [(node.uid, node.name, node.id, list(node.children)) for node in nodes.values()] == [
        (1, "root_seq", "Sequence", [2, 3, 6, 9]),
        (2, "SetBlackboard", "SetBlackboard", []),
        (3, "Fallback", "Fallback", [4, 5]),
        (4, "AlwaysFailure", "AlwaysFailure", []),
        (5, "cnt", "Count", []),
        (6, "Sub", "SubTree", [7]),
        (7, "Sequence", "Sequence", [8]),
        (8, "Count", "Count", []),
        (9, "Sub", "SubTreePlus", [10]),
        (10, "Sequence", "Sequence", [11]),
        (11, "Count", "Count", []),
    ]
    assert {node.id: node.type for node in nodes.values()} == {
        "Sequence": NodeType.CONTROL,
        "SetBlackboard": NodeType.ACTION,
        "Fallback": NodeType.CONTROL,
        "AlwaysFailure": NodeType.ACTION,
        "Count": NodeType.ACTION,
        "SubTree": NodeType.SUBTREE,
        "SubTreePlus": NodeType.SUBTREE,
    }
    assert [nodes[uid].path for uid in (1, 2, 5, 6, 8, 11)] == [
        "root_seq",
        "SetBlackboard::2",
        "cnt",
        "Sub::6",
        "Sub::6/Count::8",
        "Sub::9/Count::11",
    ]


def test_truncated_file_is_read_up_to_the_cut_with_a_warning(captures: Path, tmp_path: Path) -> None:
    data = (captures / "v3_sample.fbl").read_bytes()
    whole = read_fbl(captures / "v3_sample.fbl").transitions
    first = 4 + 5824
    path = tmp_path / "cut.fbl"
    for cut in range(first, len(data)):
        path.write_bytes(data[:cut])
        recording = read_fbl(path)
        count, rest = divmod(cut - first, 12)
        assert recording.transitions == whole[:count]
        assert bool(recording.damage) == bool(rest)


@pytest.mark.parametrize("cut", [0, 3, 4, 100, 5827])
def test_file_truncated_in_its_tree_raises(captures: Path, tmp_path: Path, cut: int) -> None:
    path = tmp_path / "cut.fbl"
    path.write_bytes((captures / "v3_sample.fbl").read_bytes()[:cut])
    with pytest.raises(LogError, match=r"this is not a \.fbl file, or it ends within the tree"):
        read_fbl(path)


def test_damaged_file_gives_a_recording_or_a_log_error(captures: Path, tmp_path: Path) -> None:
    data = (captures / "v3_sample.fbl").read_bytes()
    rng = random.Random(3)
    path = tmp_path / "bent.fbl"
    faults: list[str] = []
    for _ in range(1000):
        bent = bytearray(data)
        for _ in range(3):
            bent[rng.randrange(len(data))] = rng.randrange(256)
        path.write_bytes(bent)
        try:
            read_fbl(path)
        except LogError as fault:
            faults.append(str(fault))
    assert 0 < len(faults) < 1000
    assert all(message.startswith(f"{path}: this is not a .fbl file") for message in faults)


def test_transition_with_an_invalid_status_ends_the_reading(captures: Path, tmp_path: Path) -> None:
    data = bytearray((captures / "v3_sample.fbl").read_bytes())
    third = 4 + 5824 + 2 * 12
    data[third + 11] = 7
    path = tmp_path / "bent.fbl"
    path.write_bytes(data)
    recording = read_fbl(path)
    assert len(recording.transitions) == 2
    assert recording.damage == f"the file is damaged from byte {third} on: unknown status 0 or 7"
