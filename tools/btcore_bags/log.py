"""Writing and reading bags of ROS 2 with the messages that Nav2 publishes on `behavior_tree_log`.

A bag is an MCAP file (https://mcap.dev/spec) with messages nav2_msgs/msg/BehaviorTreeLog in the encoding CDR.
A message contains the changes of a tick: time, name and UID of the node, and both statuses, but nothing about
the tree. Bags of btcore contain the tree's XML in a std_msgs/msg/String on `TREE_TOPIC`. For others, such as
those of Nav2, it is read from the file beside the bag: `run.xml` for `run.mcap`. It can be the XML from which
the tree was loaded, because BehaviorTree.CPP numbers the nodes in the order in which it creates them.

Writing needs no package. A file that was not completed, because its process was killed, lacks the end that
readers require. Reading needs the package rosbags.
"""

import os
import struct
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from lxml import etree

from btcore.clock import NS_PER_S, NS_PER_US
from btcore.input_files import ENLARGE, format_size, max_size
from btcore.loading.tree_xml import tree_to_xml
from btcore.logs.files import LogError, create, expect_extension, read_bytes, write_whole
from btcore.logs.log import Log
from btcore.logs.recording import Gap, LoggedTransition, RecordedNode, Recording, parse_nodes
from btcore.status import NodeType, Status, Transition
from btcore.tree.tree import Tree
from btcore.xml.read.tags import MODEL_TAGS
from btcore_bags.reader import BagReader

EXTENSION: Final = ".mcap"
LOG_TOPIC: Final = "/behavior_tree_log"
TREE_TOPIC: Final = "/behavior_tree_xml"
GAP_TOPIC: Final = "/behavior_tree_gaps"
"""The topic of the reasons for which transitions are missing, as std_msgs/msg/String."""

_LOG_TYPE: Final = "nav2_msgs/msg/BehaviorTreeLog"
_TEXT_TYPE: Final = "std_msgs/msg/String"
_LINE: Final = "=" * 80
_DEFINITIONS: Final = {
    _LOG_TYPE: f"""builtin_interfaces/Time timestamp
BehaviorTreeStatusChange[] event_log
{_LINE}
MSG: nav2_msgs/BehaviorTreeStatusChange
builtin_interfaces/Time timestamp
string node_name
uint16 uid
string previous_status
string current_status
{_LINE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
""",
    _TEXT_TYPE: "string data\n",
}
_CHANNELS: Final = ((LOG_TOPIC, _LOG_TYPE), (TREE_TOPIC, _TEXT_TYPE), (GAP_TOPIC, _TEXT_TYPE))
"""The topics and their types. The number of a channel is its position, from 1."""

_MAGIC: Final = b"\x89MCAP0\r\n"
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _DATA_END = 0x01, 0x02, 0x03, 0x04, 0x05, 0x0F
_CDR: Final = b"\x00\x01\x00\x00"
"""The beginning of a message: CDR, little-endian."""


class BagWriter:
    """A writer of a bag; an existing file is overwritten.

    Args:
        xml: The XML of the tree, in UTF-8.
        names: The name of each node, by UID.
        start: The first time stamp (µs since 1970).

    Raises:
        LogError: The extension is not `.mcap`, or the file cannot be written.
    """

    def __init__(self, path: Path, xml: bytes, names: Mapping[int, str], start: int) -> None:
        expect_extension(path, EXTENSION)
        self._names = names
        self._start = self._last = start * NS_PER_US
        head = [_MAGIC, _record(_HEADER, _text("ros2") + _text("btcore"))]
        schemas = {name: number for number, name in enumerate(_DEFINITIONS, 1)}
        for name, number in schemas.items():
            definition = _text(name) + _text("ros2msg") + _text(_DEFINITIONS[name])
            head.append(_record(_SCHEMA, struct.pack("<H", number) + definition))
        profiles = _text("offered_qos_profiles") + _text("")
        for number, (topic, name) in enumerate(_CHANNELS, 1):
            numbers = struct.pack("<HH", number, schemas[name])
            metadata = struct.pack("<I", len(profiles)) + profiles
            head.append(_record(_CHANNEL, numbers + _text(topic) + _text("cdr") + metadata))
        self._file = create(path, b"".join([*head, self._message(TREE_TOPIC, _CDR + _string(xml))]))

    def append(self, records: Iterable[tuple[int, int, Status, Status]]) -> None:
        """Append a message with transitions, given as (time since the start in µs, UID, previous, status).

        Raises:
            OSError: The file cannot be written.
        """
        changes = bytearray()
        count = 0
        for since, uid, previous, status in records:
            self._last = self._start + since * NS_PER_US
            changes += _pad(changes, 4) + _time(self._last) + _string(self._names.get(uid, "").encode())
            changes += _pad(changes, 2) + struct.pack("<H", uid & 0xFFFF)
            changes += _pad(changes, 4) + _string(previous.name.encode())
            changes += _pad(changes, 4) + _string(status.name.encode())
            count += 1
        # The changes begin at a multiple of 4.
        message = _CDR + _time(self._last) + struct.pack("<I", count) + bytes(changes)
        write_whole(self._file, self._message(LOG_TOPIC, message))

    def gap(self, reason: str) -> None:
        """Mark that transitions are missing before the next transition, for *reason*."""
        write_whole(self._file, self._message(GAP_TOPIC, _CDR + _string(reason.encode())))

    def finish(self) -> None:
        """Write the end of the file, which readers require."""
        end = _record(_DATA_END, bytes(4)) + _record(_FOOTER, bytes(20))
        write_whole(self._file, end + _MAGIC)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _message(self, topic: str, data: bytes) -> bytes:
        number = [name for name, _ in _CHANNELS].index(topic) + 1
        return _record(_MESSAGE, struct.pack("<HIQQ", number, 0, self._last, self._last) + data)


def _record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def _text(text: str) -> bytes:
    """Return a text as in MCAP's records."""
    data = text.encode()
    return struct.pack("<I", len(data)) + data


def _string(data: bytes) -> bytes:
    """Return a text as in messages."""
    return struct.pack("<I", len(data) + 1) + data + b"\0"


def _time(stamp: int) -> bytes:
    return struct.pack("<iI", *divmod(stamp, NS_PER_S))


def _pad(data: bytearray, size: int) -> bytes:
    """Return the bytes that align the end of *data* to *size*."""
    return bytes(-len(data) % size)


class BagLog(Log):
    """A log of a tree as a bag of ROS 2: the messages that Nav2 publishes, one for each tick with changes.

    Args:
        tree: The tree to log.
        path: The file; an existing file is overwritten.

    Raises:
        LogError: The extension is not `.mcap`, or the file cannot be written.
    """

    def __init__(self, tree: Tree, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        super().__init__(tree, str(self.path))
        names = {node.config.uid: node.name for node in tree.nodes}
        xml = tree_to_xml(tree).encode("utf-8", "replace")
        self._file = BagWriter(self.path, xml, names, self.epoch // NS_PER_US)
        self.attach()

    def write(self, changes: list[Transition]) -> None:
        """Write a message with *changes*."""
        self._file.append(
            ((stamp - self.start) // NS_PER_US, uid, previous, status)
            for _, stamp, _, uid, previous, status in changes
        )

    def finish(self) -> None:
        """Write the end of the file."""
        self._file.finish()

    def release(self) -> None:
        """Close the file."""
        self._file.close()


def read_bag(path: str | os.PathLike[str]) -> Recording:
    """Read the transitions in the messages nav2_msgs/msg/BehaviorTreeLog of a bag.

    Args:
        path: The MCAP file. If it does not contain the tree's XML, the XML file of the same name beside it is
            read. Without that, the nodes have names only, and no parents.

    Raises:
        LogError: The file cannot be read, contains no such messages, or the XML is that of another tree; or
            the package rosbags is not installed.
    """
    path = Path(path)
    xml, start = "", None
    rows: list[tuple[LoggedTransition, str]] = []
    gaps: list[Gap] = []
    for source, stamp, message in _messages(path):
        if source == _LOG_TYPE:
            rows += [_transition(path, event) for event in message.event_log]
        elif source == TREE_TOPIC:
            xml, start = message.data, stamp
        else:
            gaps.append(Gap(len(rows), message.data))
    names: dict[int, str] = {}
    for transition, name in rows:
        names.setdefault(transition.uid, name)
    beside = path.with_suffix(".xml")
    if not xml and beside.exists():
        xml = read_bytes(beside).decode("utf-8", "replace")
        nodes = parse_nodes(xml, str(beside)) if "_uid=" in xml else _numbered_nodes(xml, beside)
        _check_names(nodes, names, path, beside)
    elif xml:
        nodes = parse_nodes(xml, str(path))
    else:
        nodes = {
            uid: RecordedNode(uid, name, name, NodeType.UNDEFINED, name, ()) for uid, name in names.items()
        }
    unknown = sorted(names.keys() - nodes.keys())
    if unknown:
        raise LogError(f"{path}: the tree has no node with the UID {unknown[0]}, '{names[unknown[0]]}'")
    transitions = [transition for transition, _ in rows]
    if start is None:
        start = transitions[0].stamp if transitions else 0
    return Recording(path, xml, start, nodes, transitions, gaps=tuple(gaps))


"""The format of the extension `EXTENSION`, an entry point of the group `btcore.logs`."""


def _messages(path: Path) -> Iterator[tuple[str, int, Any]]:
    """Yield the messages of a log in their order: type or topic, stamp (ns since 1970), and message."""
    with BagReader(path, _DEFINITIONS) as reader:
        logs = [topic for topic, message_type in reader.topics.items() if message_type == _LOG_TYPE]
        if not logs:
            raise LogError(f"{path}: this bag contains no messages {_LOG_TYPE}")
        if len(logs) > 1:
            topics = ", ".join(sorted(logs))
            raise LogError(f"{path}: this bag contains the logs of several trees: {topics}")
        size = 0
        texts = [topic for topic in (TREE_TOPIC, GAP_TOPIC) if reader.topics.get(topic) == _TEXT_TYPE]
        for topic, stamp, data in reader.messages((*logs, *texts)):
            size += len(data)
            if size > max_size():
                limit = format_size(max_size())
                raise LogError(
                    f"{path}: cannot read this log: its messages are larger than {limit}; {ENLARGE}"
                )
            yield _LOG_TYPE if topic in logs else topic, stamp, reader.decode(topic, data)


def _transition(path: Path, event: Any) -> tuple[LoggedTransition, str]:
    """Return the transition of an event, and the name of the node."""
    if not hasattr(event, "uid"):
        raise LogError(f"{path}: the messages are from Nav2 in Humble or older and do not contain UIDs")
    try:
        statuses = Status[event.previous_status], Status[event.current_status]
        stamp = event.timestamp.sec * NS_PER_S + event.timestamp.nanosec
        return LoggedTransition(stamp, int(event.uid), *statuses), event.node_name
    except KeyError as unknown:
        raise LogError(f"{path}: {unknown} is not a status") from None


def _check_names(nodes: Mapping[int, RecordedNode], names: Mapping[int, str], path: Path, xml: Path) -> None:
    for uid, name in names.items():
        if uid in nodes and nodes[uid].name != name:
            raise LogError(
                f"{path}: node {uid} is '{name}', but in {xml} it is '{nodes[uid].name}'; "
                "that file is not the XML of this log's tree"
            )


def _numbered_nodes(xml: str, file: Path) -> dict[int, RecordedNode]:
    """Return the nodes of a tree by UID, from the XML from which BehaviorTree.CPP loads it."""
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=True)
    try:
        root = etree.fromstring(xml.encode(), parser)
    except etree.XMLSyntaxError as error:
        raise LogError(f"{file}: not valid XML: {error.msg}") from None
    trees = {str(tree.get("ID", "")): tree for tree in root.iterchildren("BehaviorTree")}
    main = root.get("main_tree_to_execute") or next(iter(trees), "")
    if main not in trees or not list(trees[main].iterchildren(etree.Element)):
        raise LogError(f"{file}: no tree '{main}' with nodes")
    nodes: dict[int, RecordedNode] = {}
    children: dict[int, list[int]] = {}
    roots = list(trees[main].iterchildren(etree.Element))
    waiting: list[tuple[etree._Element, int, str, tuple[str, ...]]] = [(roots[0], 0, "", (main,))]
    while waiting:
        element, parent, prefix, inside = waiting.pop()
        uid = len(nodes) + 1
        children.setdefault(parent, []).append(uid)
        children[uid] = []
        tag = str(element.tag)
        node_type = MODEL_TAGS.get(tag, NodeType.UNDEFINED)
        registered = str(element.get("ID", tag)) if node_type is not NodeType.UNDEFINED else tag
        name = str(element.get("name", registered))
        path = f"{prefix}{name}::{uid}" if name == registered else prefix + name
        ports = {str(key): str(value) for key, value in element.attrib.items() if key not in ("ID", "name")}
        nodes[uid] = RecordedNode(uid, name, registered, node_type, path, (), ports)
        below = list(element.iterchildren(etree.Element))
        if node_type is NodeType.SUBTREE and registered in trees:
            if registered in inside:
                raise LogError(f"{file}: the tree '{registered}' contains itself")
            prefix, inside = f"{path}/", (*inside, registered)
            below = list(trees[registered].iterchildren(etree.Element))
        waiting += [(child, uid, prefix, inside) for child in reversed(below)]
    return {
        uid: RecordedNode(uid, node.name, node.id, node.type, node.path, tuple(children[uid]), node.ports)
        for uid, node in nodes.items()
    }
