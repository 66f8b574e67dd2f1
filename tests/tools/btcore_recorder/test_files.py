"""Recordings in files: what is written, what damage is found, and what cannot be recorded."""

import logging
import re
from contextlib import suppress
from io import BytesIO, FileIO
from pathlib import Path
from random import Random

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

import btcore
from btcore import SUCCESS, BtcoreError, In, NodeExecutionError, Registry, Tree
from btcore.logs import LogError
from btcore.testing import TestNodeConfig
from btcore_bags.log import BagLog, read_bag
from btcore_recorder import Explainer, Replay, record
from btcore_recorder.file_recorder import RingRecorder
from btcore_recorder.files import EXTENSIONS, read_recording
from btcore_recorder.inputs import RunRecording
from btcore_recorder.recorder import RecorderOptions
from btcore_recorder.replayed_log import read_as_log
from btcore_recorder.values import Decoder, Encoder, NotReplayable
from btcore_recorder.what_if import run_changed
from tests.tools.btcore_recorder.random_leaves import Colour, Spot, any_value, random_registry

GOLDEN = Path(__file__).parent / "golden"
NODES = random_registry()
XML = """<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>
    <Write name="pen" out="{o}" number="{n}" spot="{s}" colour="{c}"/>
    <Hold out="{h}"/><Script code="done := true"/>
</Sequence></BehaviorTree></root>
"""


SHORT_XML = """<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>
    <Script code="n := 3"/><Repeat num_cycles="9"><Sleep msec="1000000"/></Repeat>
</Sequence></BehaviorTree></root>
"""


def written_tree() -> Tree:
    return btcore.loads(XML, nodes=NODES, resources=[Random(3)], clock=btcore.SimClock())


def record_run(path: Path) -> Tree:
    tree = written_tree()
    with record(tree, path):
        for number in range(6):
            with suppress(NodeExecutionError):
                tree.tick_exactly_once()
            tree.blackboard["n"] = number
        with suppress(NodeExecutionError):
            tree.halt()
    return tree


@pytest.fixture(scope="module", params=EXTENSIONS)
def file(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording in each form."""
    path = tmp_path_factory.mktemp("recording") / f"run{request.param}"
    record_run(path)
    return path


@pytest.fixture(scope="module")
def text_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording in the text form."""
    path = tmp_path_factory.mktemp("recording") / "run.btrec.txt"
    record_run(path)
    return path


def test_a_recorded_file_is_replayed_without_the_nodes(file: Path) -> None:
    replay = Replay(file)
    assert replay.verify() is None
    assert [step.tick for step in replay.steps] == [1, 2, 3, 4, 5, 6, 0]
    assert replay.tree.ticks == 6


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_a_recording_of_the_first_version_is_read(extension: str) -> None:
    replay = Replay(GOLDEN / f"format_1{extension}")
    assert replay.verify() is None
    assert [step.tick for step in replay.steps] == [1, 2, 3, 4, 5, 6, 0]
    assert [segment.position for segment in replay.recording.segments] == [4]
    assert {type(event).__name__ for step in replay.steps for event in (*step.before, *step.inputs)} >= {
        *("Result", "ExternalHaltBegan", "ExternalHaltEnded", "ChildTicked", "StatusSet", "TimeRead"),
        *("Written", "ScriptRun", "Removed", "Replaced", "StatusForced", "Raised"),
    }


def test_a_recording_with_facts_and_transitions_is_read() -> None:
    replay = Replay(GOLDEN / "format_1_facts.btrec.txt")
    assert replay.verify() is None
    facts = replay.recording.head.facts
    assert (facts.code["Look"].place, facts.resources) == ("leaves.py:6", ("btcore.clock.Clock",))
    assert [step.woken_by for step in replay.steps] == [0, 0, 3, -1, -1, None]
    assert [len(step.transitions or ()) for step in replay.steps] == [3, 0, 9, 3, 0, 3]


def test_a_recording_and_a_bag_in_one_file_are_both_read(tmp_path: Path) -> None:
    tree = btcore.loads(
        '<root BTCPP_format="4"><BehaviorTree ID="Main"><AlwaysSuccess/></BehaviorTree></root>'
    )
    bag = BagLog(tree, tmp_path / "bag.mcap")
    with record(tree, tmp_path / "run.mcap"):
        tree.tick_once()
    bag.finish()
    bag.release()
    both = tmp_path / "both.mcap"
    with both.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        for part in ("bag.mcap", "run.mcap"):
            channels: dict[int, int] = {}
            for schema, channel, message in make_reader(
                BytesIO((tmp_path / part).read_bytes())
            ).iter_messages():
                if channel.id not in channels:
                    known = writer.register_schema(schema.name, schema.encoding, schema.data)
                    channels[channel.id] = writer.register_channel(
                        channel.topic, channel.message_encoding, known
                    )
                number = channels[channel.id]
                writer.add_message(number, message.log_time, message.data, 0, message.sequence)
        writer.finish()
    assert read_recording(both) == read_recording(tmp_path / "run.mcap")
    assert read_bag(both).transitions == read_bag(tmp_path / "bag.mcap").transitions


def test_the_tree_is_not_changed_by_a_recording_that_has_ended(tmp_path: Path) -> None:
    tree = record_run(tmp_path / "run.btrec.txt")
    assert tree.context.journal is None
    assert tree.blackboard.recorder is None
    assert all(node._wrapper is None or node._wrapper.journal is None for node in tree)


def test_a_file_that_is_cut_off_anywhere_holds_only_complete_steps(file: Path, tmp_path: Path) -> None:
    data, whole = file.read_bytes(), read_recording(file)
    cut = tmp_path / f"cut{file.suffix}"
    for size in range(0, len(data), 3):
        cut.write_bytes(data[:size])
        check_beginning(cut, whole)


def test_a_changed_bit_is_found(file: Path, tmp_path: Path) -> None:
    data, whole = file.read_bytes(), read_recording(file)
    source, flipped = Random(1), tmp_path / "flipped"
    for _ in range(300):
        damaged = bytearray(data)
        damaged[source.randrange(len(data))] ^= 1 << source.randrange(8)
        flipped.write_bytes(damaged)
        check_beginning(flipped, whole)


def check_beginning(path: Path, whole: RunRecording) -> None:
    """Check that *path* is refused, or holds the beginning of *whole* and says so unless it is complete."""
    try:
        recording = read_recording(path)
    except LogError:
        return
    assert recording.head._replace(types={}) == whole.head._replace(types={})
    assert recording.steps == whole.steps[: len(recording.steps)]
    is_cut_between_steps = path.stem == "cut" and not recording.damage
    assert recording.damage or recording.steps == whole.steps or is_cut_between_steps


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("hello", "it does not begin with 'btrec'"),
        ("btrec [2]\n", "this recording has format 2; btcore supports format 1"),
        ("btrec [1]\n", "line 1: the head of this recording is damaged: the head does not end"),
        (
            "btrec [1]\ntree [4]\n",
            "line 2: the head of this recording is damaged: 'tree' does not belong here",
        ),
        (
            "btrec [1]\nhead [7]\n",
            "line 2: the head of this recording is damaged: the lines before it were changed",
        ),
        ("btrec [1]\nhead [null]\n", "the tree, its documents or its scope are missing"),
        ("btrec [1]\n" + "tree " + "[" * 5000 + "\n", "line 2: the head of this recording is damaged"),
    ],
)
def test_what_is_not_a_recording_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "run.btrec.txt"
    path.write_text(text)
    with pytest.raises(LogError) as raised:
        Replay(path)
    assert str(path) in str(raised.value)
    assert message in str(raised.value)


@pytest.mark.parametrize("line", ['result [9, "SUCCESS"]', "child_ticked [0]", 'written [7, "a", 1, null]'])
def test_nodes_and_scopes_that_do_not_exist_are_refused(text_file: Path, tmp_path: Path, line: str) -> None:
    head, _, _ = text_file.read_text().partition("\ntick ")
    path = tmp_path / "run.btrec.txt"
    path.write_text(f'{head}\ntick [1, -1]\n{line}\nend ["SUCCESS", 0, null]\n')
    with pytest.raises(LogError, match="names a node or scope that does not exist"):
        Replay(path)


VALUES = ("-1", "65536", "9" * 20, "1.5", "null", "true", "[]", "{}", '"x"', '"IDLE"', '{"__deque":[1]}')
VALUES = (
    *VALUES,
    '{"__enum":"Colour","name":"RED"}',
    '{"__type":"Spot","x":1}',
    '{"__float":"x"}',
    '{"__entry":9}',
)


@pytest.mark.parametrize("seed", range(60))
def test_a_changed_recording_is_replayed_or_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    monkeypatch.setattr("btcore_recorder.recorded_tree.MAX_REPETITIONS", 1000)
    name = "format_1_facts.btrec.txt" if seed % 3 == 0 else "format_1.btrec.txt"
    text, path, source = (GOLDEN / name).read_text(), tmp_path / "run.btrec.txt", Random(seed)
    lines = re.sub(r"^((head|end|state_end) .*?)\d+\]$", r"\1null]", text, flags=re.MULTILINE).splitlines()
    for _ in range(source.randrange(1, 4)):
        number, other = source.randrange(len(lines)), source.randrange(len(lines))
        tokens = list(re.finditer(r'-?\d+|"[^"]*"|true|false|null', lines[number]))
        match source.randrange(4):
            case 0:
                del lines[number]
            case 1:
                lines.insert(number, lines[other])
            case 2:
                lines[number], lines[other] = lines[other], lines[number]
            case 3 if tokens:
                token, line = source.choice(tokens), lines[number]
                lines[number] = line[: token.start()] + source.choice(VALUES) + line[token.end() :]
    path.write_text("\n".join(lines) + "\n")
    with suppress(BtcoreError):
        Replay(path).verify()
    with suppress(BtcoreError):
        run_changed(read_recording(path))
    with suppress(BtcoreError):
        read_as_log(path)
    with suppress(BtcoreError):
        Explainer(path).why()


def test_a_recorded_tree_that_repeats_without_end_is_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("btcore_recorder.recorded_tree.MAX_REPETITIONS", 1000)
    path = tmp_path / "run.btrec.txt"
    repeat = '<Repeat num_cycles="3"><AlwaysSuccess/></Repeat>'
    tree = btcore.loads(f'<root><BehaviorTree ID="Main">{repeat}</BehaviorTree></root>')
    with record(tree, path):
        tree.tick_once()
    text = path.read_text().replace('num_cycles="3"', 'num_cycles="-1"')
    path.write_text(re.sub(r"^(head \[)\d+", r"\1null", text, flags=re.MULTILINE))
    difference = Replay(path).verify()
    assert difference is not None
    assert difference.now == "the result is IDLE: more than 1,000 repetitions in a tick"


def test_only_documents_are_recorded(tmp_path: Path) -> None:
    tree = written_tree()
    tree.documents = ()
    with pytest.raises(BtcoreError, match="is not from a document"):
        record(tree, tmp_path / "run.btrec.txt")


def test_nodes_that_rules_replaced_are_recorded(tmp_path: Path) -> None:
    nodes, path = NODES.copy(), tmp_path / "run.btrec.txt"
    nodes.substitute("pen", "AlwaysSuccess")
    nodes.substitute("Hold", TestNodeConfig(success_script="held := 1", async_delay=100))
    clock = btcore.SimClock()
    tree = btcore.loads(XML, nodes=nodes, resources=[Random(3)], clock=clock)
    with record(tree, path):
        tree.tick_while_running(period=0.05)
    replay = Replay(path)
    assert replay.verify() is None
    names = [type(node).__name__ for node in replay.tree]
    assert names == ["Sequence", "AlwaysSuccess", "TestNode", "Script"]
    assert (replay.tree.ticks, replay.tree.blackboard["held"]) == (3, 1)
    nodes.substitute("pen", "AlwaysFailure")
    with pytest.raises(BtcoreError, match="the substitution rule of 'pen' has changed"):
        record(tree, path)


def test_a_value_that_is_not_replayable_keeps_the_type_of_its_entry(tmp_path: Path) -> None:
    clock, path = btcore.SimClock(), tmp_path / "run.btrec.txt"
    tree = btcore.loads(SHORT_XML, clock=clock)
    with record(tree, path):
        for number in range(4):
            tree.tick_exactly_once()
            tree.blackboard["range"] = range(number)
            clock.advance(50.0)  # with a new segment, whose entries are compared
    replay = Replay(path)
    assert replay.verify() is None
    assert len(replay.recording.segments) == 1
    assert replay.tree.blackboard["range"] == NotReplayable("range(0, 2)")


class Place:
    """A user's type with a text form of its own."""

    def __init__(self, name: str) -> None:
        self.name = name


@btcore.condition
def at(place: In[Place]) -> bool:
    """Return whether the place has a name."""
    return bool(place.name)


def test_a_literal_of_a_users_type_needs_no_converter(tmp_path: Path) -> None:
    nodes = Registry.standard()
    nodes.add_type(Place, from_text=Place)
    nodes.add(at)
    xml = '<root BTCPP_format="4"><BehaviorTree ID="Main"><At place="kitchen"/></BehaviorTree></root>'
    tree = btcore.loads(xml, nodes=nodes)
    with record(tree, tmp_path / "run.btrec.txt"):
        assert tree.tick_once() is SUCCESS
    assert Replay(tmp_path / "run.btrec.txt").verify() is None


def test_entries_can_be_excluded(text_file: Path, tmp_path: Path) -> None:
    xml = """<root BTCPP_format="4" main_tree_to_execute="Main">
      <BehaviorTree ID="Main"><Sequence>
        <SubTree ID="Login" pin="{secret}"/><Script code="public := 1"/>
      </Sequence></BehaviorTree>
      <BehaviorTree ID="Login"><Write number="{pin}"/></BehaviorTree>
    </root>"""
    board = btcore.Blackboard()
    board["secret"] = 4711
    tree = btcore.loads(xml, nodes=NODES, resources=[Random(5)], blackboard=board)
    path = tmp_path / "run.btrec.txt"
    with record(tree, path, exclude=["secr*"]):
        tree.tick_once()
        board["secret"] = 4712
        tree.tick_once()
    assert "471" not in "".join(re.findall("^(?:entry|written).*$", path.read_text(), re.MULTILINE))
    assert path.read_text().count('{"__text":"excluded"}') >= 2
    replay = Replay(path)
    assert replay.verify() is None
    assert replay.tree.blackboard["public"] == 1


def test_a_tree_is_recorded_once(tmp_path: Path) -> None:
    tree = written_tree()
    with record(tree, tmp_path / "run.btrec.txt"), pytest.raises(BtcoreError, match="being recorded already"):
        record(tree, tmp_path / "other.btrec.txt")


def test_the_name_of_the_file_is_checked(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"must end in \.btrec\.txt or \.mcap; did you mean run\.btrec\.txt"):
        record(written_tree(), tmp_path / "run.btlog")
    tree = written_tree()
    with pytest.raises(LogError, match="does not exist"):
        record(tree, tmp_path / "missing/run.btrec.txt")
    assert tree.context.journal is None


def test_after_a_full_disk_the_recording_continues_with_a_gap(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("btcore_recorder.file_recorder.WRITE_INTERVAL_S", 3600.0)
    path = tmp_path / "run.btrec.txt"
    tree = written_tree()

    def tick() -> None:
        with suppress(NodeExecutionError):
            tree.tick_exactly_once()

    with caplog.at_level(logging.WARNING, "btcore"), record(tree, path) as recorder:
        tick()
        recorder._write_queued()
        file = recorder._file
        with FileIO("/dev/full", "wb") as full:
            recorder._file = full
            tick()
            recorder._write_queued()
        recorder._file = file  # there is room again
        tick()
        recorder._write_queued()
        tick()  # from its end on, the run is recorded
        tick()
    assert recorder.is_incomplete
    assert "is incomplete: writing failed: No space left on device" in caplog.text
    replay = Replay(path)
    assert replay.verify() is None
    assert [step.tick for step in replay.steps] == [1, 2, 5]
    assert [(segment.position, segment.gap) for segment in replay.recording.segments] == [
        (2, "writing failed: No space left on device")
    ]
    assert replay.tree.blackboard.get("n") == tree.blackboard.get("n")


def test_steps_are_lost_if_the_queue_is_full(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("btcore_recorder.file_recorder.WRITE_INTERVAL_S", 3600.0)
    monkeypatch.setattr("btcore_recorder.file_recorder.MAX_QUEUED_VALUES", 100)
    tree = btcore.loads(SHORT_XML)
    with caplog.at_level(logging.WARNING, "btcore"), record(tree, tmp_path / "run.btrec.txt") as recorder:
        for _ in range(100):
            tree.tick_exactly_once()
        recorder._write_queued()
        for _ in range(3):
            tree.tick_exactly_once()
    assert "is incomplete: the disk is too slow" in caplog.text
    replay = Replay(recorder.path)
    assert replay.verify() is None
    numbers = [step.tick for step in replay.steps]
    assert numbers[-2:] == [102, 103]
    assert len(numbers) < 60


@pytest.mark.parametrize("change", ["entry", "node"])
def test_the_state_at_the_start_of_a_segment_is_compared(tmp_path: Path, change: str) -> None:
    path = tmp_path / "run.btrec.txt"
    clock = btcore.SimClock()
    tree = btcore.loads(SHORT_XML, clock=clock)
    with record(tree, path):
        for _ in range(4):
            tree.tick_exactly_once()
            clock.advance(50.0)
    replay = Replay(path)
    assert replay.verify() is None
    assert [segment.position for segment in replay.recording.segments] == [3]
    text = path.read_text()
    old, new = ("entry [3,", "entry [2,") if change == "entry" else ('{"_count":0}', '{"_count":1}')
    head, found, segment = text.partition("segment ")
    assert old in segment
    path.write_text(head + found + re.sub(r"(state_end \[)\d+", r"\1null", segment.replace(old, new)))
    difference = Replay(path).verify()
    assert difference is not None
    assert ("'n'" if change == "entry" else "node 3") in difference.recorded


@pytest.mark.parametrize("limit", ["time", "size"])
def test_a_ring_keeps_the_end_of_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: str) -> None:
    if limit == "size":
        monkeypatch.setattr("btcore_recorder.file_recorder.RING_BYTES", 20_000)
    clock, path = btcore.SimClock(), tmp_path / "run.btrec.txt"
    tree = written_tree()
    tree.context.clock = clock
    ring = RingRecorder(tree, path, RecorderOptions())
    assert not path.exists()
    for _ in range(1000):
        with suppress(NodeExecutionError):
            tree.tick_exactly_once()
        clock.advance(2.0 if limit == "time" else 0.01)
    ring.save()
    replay = Replay(path)
    assert replay.verify() is None
    assert replay.tree.ticks == 1000
    first = replay.recording.head.state.ticks
    assert 600 < first < 710 if limit == "time" else 0 < first < 990
    assert tree.context.journal is None


# --- values


@pytest.mark.parametrize("limits", [{"max_duration_s": 1.0}, {"max_bytes": 10_000.0}])
def test_a_recording_continues_in_further_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limits: dict[str, float]
) -> None:
    monkeypatch.setattr("btcore_recorder.file_recorder.WRITE_INTERVAL_S", 0.001)
    tree, count = written_tree(), 0
    with record(tree, tmp_path / "run.btrec.txt", **limits) as recorder:
        while not (tmp_path / "run.3.btrec.txt").exists() and count < 10_000:
            with suppress(NodeExecutionError):
                tree.tick_exactly_once()
            tree.clock.advance(0.3)  # type: ignore[attr-defined]
            tree.blackboard["n"] = count
            count += 1
            while recorder._queue.qsize() > 20:
                pass  # the thread catches up
    assert not recorder.is_incomplete
    count_of_files = len(list(tmp_path.iterdir()))
    assert count_of_files >= 3
    numbers = ["", *[f".{number}" for number in range(2, count_of_files + 1)]]
    replays = [Replay(tmp_path / f"run{number}.btrec.txt") for number in numbers]
    assert not any(replay.verify() for replay in replays)
    assert [step.tick for replay in replays for step in replay.steps] == list(range(1, count + 1))


@pytest.mark.parametrize("seed", range(30))
def test_values_are_recorded_exactly(seed: int) -> None:
    value = any_value(Random(seed))
    types: dict[str, object] = {}
    encoded = Encoder(types.__setitem__).encode(value)
    decoded = Decoder(types).decode(encoded)
    if isinstance(value, (Spot, Colour)):
        assert type(decoded) is not type(value)
        assert repr(decoded) == repr(value)
    else:
        assert (type(decoded), decoded) == (type(value), value)


def test_other_values_are_recorded_as_text() -> None:
    endless: list[object] = []
    endless.append(endless)
    encoder = Encoder(lambda name, description: None)
    for value, text in [
        (range(3), "range(0, 3)"),
        ("x" * 200_000, "str of 200,000 items"),
        (endless, "a list that cannot be recorded"),
    ]:
        assert Decoder({}).decode(encoder.encode(value)) == NotReplayable(text)


def test_types_of_one_name_are_distinguished() -> None:
    types: dict[str, object] = {}
    encoder = Encoder(types.__setitem__)
    other = type("Spot", (), {})
    other.__qualname__ = "Spot"
    assert encoder.name(Spot) == "Spot"
    assert encoder.name(other) == "Spot#2"
    assert types == {"Spot": {"fields": ["x", "y"]}, "Spot#2": {}}
