"""Bags of ROS 2: rosbags reads those of btcore, and btcore reads those that rosbags writes, as from Nav2."""

import random
import struct
import sys
import tracemalloc
from collections.abc import Sequence
from pathlib import Path

import pytest
from click.testing import CliRunner

pytest.importorskip("rosbags")

from lz4.frame import LZ4FrameCompressor
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.rosbag2.storage_mcap import zstd
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

import btcore
from btcore.cli.main import main
from btcore.clock import NS_PER_S
from btcore.logs import LogError, open_log, read_log
from btcore_bags import reader
from btcore_bags.log import BagWriter

STATUS_CHANGE = """builtin_interfaces/Time timestamp
string node_name
uint16 uid
string previous_status
string current_status
"""
XML = """
<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Recover"><Wait wait_duration="5"/></BehaviorTree>
  <BehaviorTree ID="Main">
    <RecoveryNode number_of_retries="6" name="Navigate">
      <Action ID="FollowPath"/>
      <SubTree ID="Recover" name="Again"/>
      <SubTree ID="Recover"/>
    </RecoveryNode>
  </BehaviorTree>
</root>
"""
EVENTS = [
    (1, "Navigate", "IDLE", "RUNNING"),
    (2, "FollowPath", "IDLE", "FAILURE"),
    (4, "Wait", "IDLE", "SUCCESS"),
]


def write_nav2_bag(
    path: Path, events: Sequence[tuple[int, str, str, str]], change: str = STATUS_CHANGE, topics: int = 1
) -> Path:
    """Write a bag as `ros2 bag record` with a compression does, and move its file to *path*."""
    store = get_typestore(Stores.ROS2_KILTED)
    name = "nav2_msgs/msg/BehaviorTree"
    log = "builtin_interfaces/Time timestamp\nBehaviorTreeStatusChange[] event_log\n"
    store.register(
        {**get_types_from_msg(change, f"{name}StatusChange"), **get_types_from_msg(log, f"{name}Log")}
    )
    time = store.types["builtin_interfaces/msg/Time"]
    folder = path.with_name(f"{path.stem}_bag")
    writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        for topic in range(topics):
            connection = writer.add_connection(f"/log{topic}", f"{name}Log", typestore=store)
            for second, (uid, node, previous, status) in enumerate(events, 100):
                fields = {"node_name": node, "previous_status": previous, "current_status": status}
                if "uid" in change:
                    fields |= {"uid": uid}  # type: ignore[dict-item]
                event = store.types[f"{name}StatusChange"](timestamp=time(sec=second, nanosec=5), **fields)
                message = store.types[f"{name}Log"](timestamp=time(sec=second, nanosec=0), event_log=[event])
                writer.write(connection, second * NS_PER_S, store.serialize_cdr(message, f"{name}Log"))
    next(folder.glob("*.mcap")).rename(path)
    return path


def test_a_bag_contains_the_same_as_a_btlog(tmp_path: Path) -> None:
    b = btcore.Builder()
    tree = b.build(b.Sequence(b.AlwaysSuccess(name="dør"), b.Inverter(b.AlwaysFailure()), name="all"))
    with open_log(tree, tmp_path / "run.mcap"), open_log(tree, tmp_path / "run.btlog"):
        tree.tick_while_running()
        tree.tick_while_running()
    bag, log = read_log(tmp_path / "run.mcap"), read_log(tmp_path / "run.btlog")
    assert bag.nodes == log.nodes
    assert bag.xml == log.xml
    assert [change[1:] for change in bag.transitions] == [change[1:] for change in log.transitions]
    assert len(bag.transitions) == 20
    assert not bag.warnings
    for ours, other in zip(bag.transitions, log.transitions, strict=True):
        assert abs((ours.stamp - bag.start) - (other.stamp - log.start)) < NS_PER_S


def test_gaps_are_read_where_they_were_written(tmp_path: Path) -> None:
    b = btcore.Builder()
    tree = b.build(b.AlwaysSuccess())
    with open_log(tree, tmp_path / "run.mcap"):
        tree.tick_while_running()
    recording = read_log(tmp_path / "run.mcap")
    writer = BagWriter(tmp_path / "gap.mcap", recording.xml.encode(), {1: "AlwaysSuccess"}, 7)
    writer.append([(1, 1, btcore.Status.IDLE, btcore.Status.RUNNING)])
    writer.gap("the robot was away")
    writer.append([(2, 1, btcore.Status.RUNNING, btcore.Status.SUCCESS)])
    writer.finish()
    writer.close()
    recording = read_log(tmp_path / "gap.mcap")
    assert recording.gaps == ((1, "the robot was away"),)
    assert [change.stamp for change in recording.transitions] == [8_000, 9_000]
    assert recording.start == 7_000


def test_a_bag_of_nav2_with_the_xml_beside_it(tmp_path: Path) -> None:
    path = write_nav2_bag(tmp_path / "nav.mcap", EVENTS)
    (tmp_path / "nav.xml").write_text(XML)
    recording = read_log(path)
    assert {uid: (node.path, node.children) for uid, node in recording.nodes.items()} == {
        1: ("Navigate", (2, 3, 5)),
        2: ("FollowPath::2", ()),
        3: ("Again", (4,)),
        4: ("Again/Wait::4", ()),
        5: ("Recover::5", (6,)),
        6: ("Recover::5/Wait::6", ()),
    }
    assert recording.transitions[2] == (102 * NS_PER_S + 5, 4, btcore.Status.IDLE, btcore.Status.SUCCESS)
    assert recording.start == 100 * NS_PER_S + 5


def test_without_xml_the_nodes_have_names_only(tmp_path: Path) -> None:
    recording = read_log(write_nav2_bag(tmp_path / "nav.mcap", EVENTS))
    assert {uid: node.path for uid, node in recording.nodes.items()} == {
        1: "Navigate",
        2: "FollowPath",
        4: "Wait",
    }


def test_the_xml_of_another_tree_is_an_error(tmp_path: Path) -> None:
    path = write_nav2_bag(tmp_path / "nav.mcap", EVENTS)
    (tmp_path / "nav.xml").write_text(XML.replace("FollowPath", "Spin"))
    with pytest.raises(LogError, match=r"node 2 is 'FollowPath', but in .*nav.xml it is 'Spin'"):
        read_log(path)
    (tmp_path / "nav.xml").write_text(
        '<root><BehaviorTree ID="A"><RecoveryNode name="Navigate"/></BehaviorTree></root>'
    )
    with pytest.raises(LogError, match="no node with the UID 2, 'FollowPath'"):
        read_log(path)


@pytest.mark.parametrize(
    ("change", "topics", "events", "message"),
    [
        (STATUS_CHANGE.replace("uint16 uid\n", ""), 1, EVENTS, "Humble"),
        (STATUS_CHANGE, 2, EVENTS, "the logs of several trees: /log0, /log1"),
        (STATUS_CHANGE, 0, EVENTS, "contains no messages nav2_msgs/msg/BehaviorTreeLog"),
        (STATUS_CHANGE, 1, [(1, "A", "IDLE", "BUSY")], "'BUSY' is not a status"),
        (STATUS_CHANGE.replace("uint16", "uint32"), 1, EVENTS, "the field 'uid' of .* is defined otherwise"),
    ],
)
def test_bags_that_cannot_be_read_are_explained(
    tmp_path: Path, change: str, topics: int, events: Sequence[tuple[int, str, str, str]], message: str
) -> None:
    with pytest.raises(LogError, match=message):
        read_log(write_nav2_bag(tmp_path / "nav.mcap", events, change, topics))


def test_a_truncated_bag_is_an_error(tmp_path: Path) -> None:
    path = write_nav2_bag(tmp_path / "nav.mcap", EVENTS)
    content = path.read_bytes()
    for length in (0, 5, 40, len(content) // 2, len(content) - 1):
        path.write_bytes(content[:length])
        with pytest.raises(LogError, match="not a complete bag"):
            read_log(path)


def test_random_damage_is_an_error_of_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reader, "is_limited", lambda: True, raising=False)  # 50 processes would take long
    path = write_nav2_bag(tmp_path / "nav.mcap", EVENTS)
    content, random_numbers = path.read_bytes(), random.Random(5)
    errors: list[str] = []
    for _ in range(50):
        damaged = bytearray(content)
        for _ in range(random_numbers.choice((1, 2, 4))):
            damaged[random_numbers.randrange(len(damaged))] = random_numbers.choice((0, 1, 128, 255))
        path.write_bytes(damaged)
        try:
            read_log(path)
        except LogError as error:
            errors.append(str(error))
    assert len(errors) > 15
    assert not any("\n" in error for error in errors)


@pytest.mark.parametrize("declared", [100, 1 << 32, 1 << 40])
@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_a_chunk_that_grows_when_it_is_decompressed_needs_no_memory(
    tmp_path: Path, compression: str, declared: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        reader, "is_limited", lambda: True, raising=False
    )  # so that the memory can be measured
    compressor = zstd.ZstdCompressor() if compression == "zstd" else LZ4FrameCompressor()
    head = compressor.begin() if compression == "lz4" else b""
    data = b"".join([head, *(compressor.compress(bytes(1 << 20)) for _ in range(200)), compressor.flush()])
    name = compression.encode()
    fields = struct.pack("<QQQI", 0, 1, declared, 0) + struct.pack("<I", len(name)) + name
    chunk = fields + struct.pack("<Q", len(data)) + data
    writer = BagWriter(tmp_path / "run.mcap", b"<root/>", {}, 0)
    writer.close()
    with (tmp_path / "run.mcap").open("ab") as file:
        file.write(struct.pack("<BQ", 0x06, len(chunk)) + chunk)
        file.write(struct.pack("<BQI", 0x0F, 4, 0) + struct.pack("<BQ", 0x02, 20) + bytes(20))
        file.write(b"\x89MCAP0\r\n")
    tracemalloc.start()
    try:
        with pytest.raises(LogError, match="not a complete bag"):
            read_log(tmp_path / "run.mcap")
        assert tracemalloc.get_traced_memory()[1] < 50 << 20
    finally:
        tracemalloc.stop()


def record(kind: int, *fields: bytes | int) -> bytes:
    """A record of MCAP; a number has 16 bits, and a text has its length before it."""
    texts = (
        struct.pack("<H", field) if isinstance(field, int) else struct.pack("<I", len(field)) + field
        for field in fields
    )
    content = b"".join(texts)
    return struct.pack("<BQ", kind, len(content)) + content


@pytest.mark.parametrize(
    ("constant", "message"),
    [
        ("1 << 16000000000", "too much memory"),
        ("(1 << 60000000) / ((1 << 30000000) + 1)", "more than 1 s of processor time"),
    ],
)
def test_a_definition_whose_constants_are_hostile_is_an_error(
    tmp_path: Path, constant: str, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reader, "MAX_CPU_S", 1, raising=False)
    definition = f"module a {{ module msg {{ module B_Constants {{ const int32 C = {constant}; }}; "
    definition += "struct B { int32 x; }; }; };"
    path = tmp_path / "run.mcap"
    magic = b"\x89MCAP0\r\n"
    schema = record(0x03, 1, b"a/msg/B", b"ros2idl", definition.encode())
    channel = record(0x04, 1, 1, b"/b", b"cdr", b"")
    end = record(0x0F, 0, 0) + struct.pack("<BQ", 0x02, 20) + bytes(20)
    path.write_bytes(magic + record(0x01, b"ros2", b"") + schema + channel + end + magic)
    code, output = run_command("stats", path)
    assert code == 2
    assert message in output, output


def test_the_messages_of_a_log_are_limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_nav2_bag(tmp_path / "nav.mcap", EVENTS * 500)  # compressed to a fraction
    monkeypatch.setenv("BTCORE_MAX_FILE_SIZE", f"{path.stat().st_size}")
    with pytest.raises(LogError, match=r"its messages are larger than .* kB; to read it, use"):
        read_log(path)


def run_command(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(main, [str(argument) for argument in arguments], prog_name="btcore")
    assert "Traceback" not in result.output
    return result.exit_code, result.output


def test_replay_stats_and_diff_read_a_bag_with_the_xml_beside_it(tmp_path: Path) -> None:
    paths = [
        write_nav2_bag(tmp_path / f"{name}.mcap", EVENTS[:count]) for name, count in (("a", 3), ("b", 2))
    ]
    for path in paths:
        path.with_suffix(".xml").write_text(XML)
    code, output = run_command("stats", "--json", paths[0])
    assert code == 0, output
    assert '"Again/Wait::4"' in output
    code, output = run_command("diff", *paths)
    assert code == 1, output
    assert "the runs differ after 2 common transitions" in output
    assert run_command("diff", paths[0], paths[0]) == (0, "no difference: 3 transitions\n")
    pytest.importorskip("btcore_monitor")
    code, output = run_command("replay", "--text", paths[0])
    assert code == 0, output
    assert output.splitlines()[2].split() == ["2.000000", "Again/Wait::4", "IDLE", "→", "SUCCESS"]


@pytest.mark.parametrize("command", [["stats"], ["replay", "--text"]])
@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not a complete bag of ROS 2"),
        (b"no bag", "not a complete bag of ROS 2: File magic is invalid."),
        (None, "pip install 'btcore[bags]'"),
    ],
)
def test_commands_explain_what_is_wrong_with_a_bag(
    command: list[str], content: bytes | None, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if content is None:
        monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    path = tmp_path / "run.mcap"
    path.write_bytes(content or b"\x89MCAP0\r\n")
    code, output = run_command(*command, path)
    assert code == 2
    assert message in output
    assert len(output.splitlines()) == 1
