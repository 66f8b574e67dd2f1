"""Hostile calls to ``btcore mcp``: each is refused, or ends within its limits, and does no harm.

``python tests/acceptance/mcp_attacks.py`` serves a folder with links and includes that lead out of it, with
modules that Python must not import, and with files that are too large. It makes more than a hundred calls:
paths, sizes, endless trees, large numbers, control characters, options as values, and invalid messages. The
script exits with 1 if

- a call takes longer than its limit, or has a result that is too large,
- a call that must be refused is not refused, or a result contains a text from outside of the folder,
- a file outside of the folder or in it is changed, or a module of the folder is imported,
- the server ends, forgets a call in its log, or leaves a process behind.
"""

import argparse
import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from itertools import cycle
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, NamedTuple

import psutil
from checkout import environment

LIMIT = 15.0
"""The limit of a call (s)."""
MARGIN: Final = 10.0
"""What a call may take longer than its limit, on a busy computer (s)."""
SIZE: Final = 2_200_000
"""The largest answer (bytes): a tree as a resource."""
SECRET: Final = "Geheim4711"
GOOD: Final = '<root BTCPP_format="4"><BehaviorTree ID="Gut"><AlwaysSuccess/></BehaviorTree></root>'


class Attack(NamedTuple):
    """A request, and whether it must be refused; None if both are harmless."""

    name: str
    method: str
    parameters: Any
    refused: bool | None = True


def tree(body: str, before: str = "") -> str:
    """Return a document with a tree."""
    return f'{before}<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'


def with_models(body: str, models: str) -> str:
    """Return a document with a tree and with declarations of its leaves."""
    return tree(body).replace("</root>", f"<TreeNodesModel>{models}</TreeNodesModel></root>")


def prepare(folder: Path) -> Path:
    """Write the files of the attacks, and return the folder that is served."""
    served = folder / "served"
    (served / "sub").mkdir(parents=True)
    secret = folder / "secret.xml"
    secret.write_text(tree(f'<AlwaysSuccess name="{SECRET}"/>').replace("Main", SECRET), encoding="utf-8")
    (folder / "secret.btlog").write_text(SECRET, encoding="utf-8")
    (served / "good.xml").write_text(GOOD, encoding="utf-8")
    (served / "huge.xml").write_text(GOOD + " " * 2_000_000, encoding="utf-8")
    with (served / "huge.btlog").open("wb") as file:
        file.truncate(65_000_000)
    (served / "empty.btlog").touch()
    (served / "damaged.db3").write_bytes(b"SQLite format 3\0" + bytes(range(256)) * 20)
    (served / "link.xml").symlink_to(secret)
    (served / "link.btlog").symlink_to(folder / "secret.btlog")
    (served / "loop.xml").symlink_to("loop.xml")
    (served / "out").symlink_to(folder)
    os.mkfifo(served / "pipe.xml")
    include = '<root BTCPP_format="4"><include path="{}"/>' + GOOD[GOOD.index("<Behavior") :]
    (served / "sub" / "up.xml").write_text(include.format("../../secret.xml"), encoding="utf-8")
    (served / "sub" / "absolute.xml").write_text(include.format(secret), encoding="utf-8")
    (served / "sub" / "linked.xml").write_text(include.format("../link.xml"), encoding="utf-8")
    (served / "sub" / "self.xml").write_text(include.format("self.xml"), encoding="utf-8")
    for module in ("click", "json", "sitecustomize", "btcore", "evil"):
        code = f"import pathlib\npathlib.Path({str(folder / 'imported')!r}).write_text(__name__)\n"
        (served / f"{module}.py").write_text(code, encoding="utf-8")
    return served


def call(name: str, tool: str, refused: bool | None = True, **arguments: Any) -> Attack:
    """Return an attack on a tool."""
    return Attack(name, "tools/call", {"name": tool, "arguments": arguments}, refused)


def paths(secret: Path) -> list[Attack]:
    """Return attacks by names of files."""
    names = [
        "../secret.xml",
        "..\\secret.xml",
        str(secret),
        f"file://{secret}",
        "~/secret.xml",
        "C:\\secret.xml",
        "\\\\host\\share\\a.xml",
        "link.xml",
        "out/secret.xml",
        "sub/../../secret.xml",
        "loop.xml",
        "pipe.xml",
        "huge.xml",
        "sub",
        ".",
        "",
        "-",
        "--plugin=evil.py",
        "evil.py",
        "good.xml\0",
        "good.xml\n",
        "\x1b[31m.xml",
        "\u202egood.xml",
        "a" * 499,
        "a" * 100_000,
        "/dev/zero",
        "/proc/self/environ",
        "%2e%2e/x.xml",
        "good.xml/../good.xml",
        "sub/up.xml/x.xml",
        "CON",
        "bumpgo.xml",
    ]
    tools = ["validate", "show", "run", "prove"]
    attacks = [call(f"path {name[:30]!a}", tool, tree=name) for name, tool in zip(names, cycle(tools))]
    attacks.append(call("path in sweep", "sweep", tree="../secret.xml", seeds=1))
    attacks += [
        call(f"model {name!a}", "nodes", models=[name])
        for name in ("../secret.xml", "link.xml", "evil.py", "-")
    ]
    logs = (
        "../secret.btlog",
        "link.btlog",
        "huge.btlog",
        "empty.btlog",
        "damaged.db3",
        "damaged.db3#99999999999",
        "good.xml",
        "run-1",
        "run-99999999999999999999",
        "run-../../x",
        "damaged.db3#1;DROP",
        str(secret),
    )
    attacks += [
        call(f"log {log!a}", ("read_log", "explain_failure")[i % 2], log=log) for i, log in enumerate(logs)
    ]
    resources = (
        "btcore://trees/../secret.xml",
        "btcore://trees/..%2Fsecret.xml",
        f"btcore://trees/{secret}",
        "btcore://trees/link.xml",
        "btcore://trees/evil.py",
        "btcore://docs/../pyproject",
        "btcore://docs//etc/passwd",
        f"file://{secret}",
        "btcore://trees/%00",
        "btcore://trees/" + "%2e%2e%2f" * 1000,
        "x" * 1_000_000,
        "",
    )
    attacks += [Attack(f"resource {uri[:40]!a}", "resources/read", {"uri": uri}) for uri in resources]
    return attacks


def contents(folder: Path) -> list[Attack]:
    """Return attacks by the contents of trees."""
    secret, target = folder / "secret.xml", folder / "written.yaml"
    laughs = "".join(f'<!ENTITY a{i} "{f"&a{i - 1};" * 10}">' for i in range(1, 12))
    entity = f'<!DOCTYPE root [<!ENTITY x SYSTEM "file://{secret}">]>'
    pose = f'<NavigateToPose goal="1;0;0" behavior_tree="{secret}"/>'
    subtree = '<SubTree ID="Main"/>'
    double = '<Sequence><Script code=" s := \'abcdefgh\' "/><Repeat num_cycles="60">{}</Repeat></Sequence>'
    endless = '<Repeat num_cycles="-1"><AlwaysSuccess/></Repeat>'
    publish = '<RosTopicPublish topic_name="/cmd_vel" type="geometry_msgs/msg/Twist" message="{}"/>'
    deep = "<Inverter>" * 50_000 + "<AlwaysSuccess/>" + "</Inverter>" * 50_000
    nested = "<Inverter>" * 900 + "<AlwaysSuccess/>" + "</Inverter>" * 900
    wide = "<Sequence>" + "<AlwaysSuccess/>" * 60_000 + "</Sequence>"
    parallel = f'<ParallelAll max_failures="1">{endless * 20}</ParallelAll>'
    actions = "".join(f'<Action ID="A{i}"/>' for i in range(14))
    combined = "a" + "\u0301" * 5000
    names = '<AlwaysSuccess name="\x1b]0;title\x07\u202e\u2028&#10;name"/>'
    return [
        call("include ..", "run", tree="sub/up.xml"),
        call("include absolute", "prove", tree="sub/absolute.xml"),
        call("include by a link", "show", tree="sub/linked.xml"),
        call(
            "include in a text", "run", xml=GOOD.replace("<Behavior", f'<include path="{secret}"/><Behavior')
        ),
        call("include of itself", "validate", False, tree="sub/self.xml"),
        call("include of a model", "nodes", models=["sub/up.xml"]),
        call("external entity", "show", None, xml=tree('<AlwaysSuccess name="&x;"/>', entity)),
        call(
            "a billion laughs",
            "show",
            None,
            xml=tree("<AlwaysSuccess/>", f"<!DOCTYPE r [<!ENTITY a0 'x'>{laughs}]>"),
        ),
        call("tree of a navigation", "run", None, xml=tree(pose), duration=3.0),
        call("write a map outside", "run", None, xml=tree(f'<SaveMap file="{target}"/>'), duration=3.0),
        call(
            "write a map by ..",
            "run",
            None,
            xml=tree('<SaveMap file="../../../written.yaml"/>'),
            duration=3.0,
        ),
        call(
            "a map in a sweep", "sweep", None, xml=tree(f'<SaveMap file="{target}"/>'), seeds=1, duration=2.0
        ),
        call("write a map here", "run", None, xml=tree('<SaveMap file="written.yaml"/>'), duration=3.0),
        call("a ROS leaf", "run", xml=tree(publish)),
        call("a sweep with a ROS leaf", "sweep", None, xml=tree(publish), seeds=1),
        call("endless without a pause", "run", None, xml=tree(endless)),
        call("endless, in parallel", "run", None, xml=tree(parallel)),
        call("endless, in a proof", "prove", None, xml=tree(endless)),
        call("a tree that calls itself", "run", xml=tree(subtree)),
        call("50,000 levels", "validate", None, xml=tree(deep)),
        call("900 levels", "show", None, xml=tree(nested)),
        call("60,000 nodes", "show", None, xml=tree(wide)),
        call("60,000 nodes run", "run", None, xml=tree(wide)),
        call("a text that doubles", "run", None, xml=tree(double.format('<Script code=" s := s + s "/>'))),
        call("a long sleep", "run", None, xml=tree('<Sleep msec="18446744073709551615"/>')),
        call("a port with 1 MB", "validate", None, xml=tree(f'<Sleep msec="{"9" * 1_000_000}"/>')),
        call("a script with 1 MB", "validate", None, xml=tree(f'<Script code="{"(" * 1_000_000}"/>')),
        call("names that control a terminal", "show", None, xml=tree(names)),
        call("5,000 combining characters", "show", None, xml=tree(f'<AlwaysSuccess name="{combined}"/>')),
        call("2.1 MB of XML", "validate", xml=tree("<AlwaysSuccess/>") + " " * 2_100_000),
        call("no XML", "validate", False, xml="\0\ufffd<<<"),
        call("a timer in a proof", "prove", None, xml=tree('<Sleep msec="4000000000"/>')),
        call(
            "many states",
            "prove",
            None,
            xml=with_models(f"<ParallelAll>{actions}</ParallelAll>", actions),
            own_models=True,
        ),
    ]


def values(folder: Path) -> list[Attack]:
    """Return attacks by numbers, options and types."""
    outside = str(folder / "written")
    numbers: list[dict[str, Any]] = [
        {"duration": 1e308},
        {"duration": -1},
        {"duration": 601},
        {"duration": "NaN"},
        {"duration": float("inf")},
        {"rate": 0},
        {"rate": 1e9},
        {"seed": -1},
        {"seed": 2**70},
        {"people": 10**9},
        {"obstacles": 10**30},
        {"battery": -1},
        {"noise": 1e300},
        {"world": "/etc/passwd"},
        {"world": "../secret.json"},
        {"world": "arena --ros2 tiago"},
        {"world": "office:9999999999999"},
        {"until": "forever"},
        {"event": ["box:1"] * 1000},
        {"event": ["box:1" * 1000]},
        {"outcomes": {f"p{i}": "S" for i in range(1000)}},
        {"entries": [1, 2]},
        {"models": "good.xml"},
        {"models": ["good.xml"] * 1000},
        {"tree_id": "x" * 10_000},
        {"tree_id": 5},
        # What the command line has and the tool does not:
        {"ros2": "tiago"},
        {"publish": "groot2"},
        {"monitor": True},
        {"plugin": "evil.py"},
        {"plugins": ["evil.py"]},
        {"log": outside + ".btlog"},
        {"save_map": outside},
        {"gui": True},
        {"map": outside},
        {"bag": outside},
        {"nav2": True},
        {"save": outside},
        {"serve_web": True},
        {"substitute": outside},
        {"robot": outside},
    ]
    attacks = [call(f"run {str(item)[:50]}", "run", tree="good.xml", **item) for item in numbers]
    attacks += [
        call("an option as a tree ID", "run", tree="good.xml", tree_id="--ros2=tiago"),
        call("an option as a start", "run", None, tree="good.xml", start="--ros2=tiago", duration=1.0),
        call("an option as an event", "run", None, tree="good.xml", event=["--publish=groot2"], duration=1.0),
        call("an option as an ID", "nodes", ids=["--plugin=evil.py"]),
        call("an option as a key", "validate", False, tree="good.xml", given=["--plugin=evil.py"]),
        call(
            "an option as an entry",
            "run",
            None,
            tree="good.xml",
            entries={"--gui": 1, "a=b": "=", "ü\n": "\0"},
        ),
        call("an option as outcomes", "run", None, tree="good.xml", outcomes={"--log": outside}),
        call("an option as a question", "prove", None, tree="good.xml", ask=[f"--save={outside}"]),
        call("a question with 1 MB", "prove", tree="good.xml", ask=["x" * 1_000_000]),
        call("a question with 500 brackets", "prove", None, tree="good.xml", never=["(" * 500]),
        call("a large entry", "run", None, tree="good.xml", entries={"a": "x" * 100_000}),
        call("an entry with many digits", "run", None, tree="good.xml", entries={"a": 10**4000}),
        call("10**9 seeds", "sweep", tree="good.xml", seeds=10**9),
        call("a million episodes", "sweep", tree="good.xml", seeds=50, parameters={"noise": list(range(20))}),
        call("a forbidden parameter", "sweep", tree="good.xml", seeds=1, parameters={"ros2": ["tiago"]}),
        call("a parameter that writes", "sweep", tree="good.xml", seeds=1, parameters={"log": [outside]}),
        call(
            "a range as a value",
            "sweep",
            None,
            tree="good.xml",
            seeds=1,
            parameters={"bb.x": ["0..1000000:1"]},
        ),
        call(
            "a condition that is code", "sweep", None, tree="good.xml", seeds=1, success_if="__import__('os')"
        ),
        call("both sources", "run", tree="good.xml", xml=GOOD),
        call("no source", "prove"),
        call("an unknown tool", "shell", command="id"),
        call("a long tool", "x" * 1_000_000),
        call("100,000 IDs", "nodes", ids=["Sequence"] * 100_000),
        call("an ID with 1 MB", "nodes", ids=["x" * 1_000_000]),
        Attack("arguments that are a list", "tools/call", {"name": "run", "arguments": [1]}),
        Attack("no name", "tools/call", {"arguments": {}}),
        Attack("an unknown method", "tools/destroy", {}),
        Attack("a prompt", "prompts/get", {"name": "../x"}),
        Attack("an invalid cursor", "tools/list", {"cursor": "x" * 100_000}, None),
    ]
    return attacks


MESSAGES: Final = (
    b"\n",
    b"{\n",
    b"[]\n",
    b"null\n",
    b"\xff\xfe\0\n",
    b"[" * 100_000 + b"\n",
    b"x" * 9_000_000 + b"\n",
    b'{"jsonrpc":"2.0","id":1e400,"method":"ping"}\n',
    b'{"jsonrpc":"1.0","method":"tools/call"}\n',
    b'{"jsonrpc":"2.0","id":{"a":' * 1000 + b"\n",
    b'{"jsonrpc":"2.0","id":"n","method":"tools/call","params":7}\n',
    b'{"jsonrpc":"2.0","id":"s","method":"tools/call","params":{"name":"\\ud800"}}\n',
)
"""Messages that are not requests; the server ignores them or answers with an error."""


class Client:
    """A client that sends messages as they are.

    Args:
        served: The folder to serve.
        log: The file for the server's log.
    """

    def __init__(self, served: Path, log: Path) -> None:
        command = [
            sys.executable,
            "-m",
            "btcore",
            "mcp",
            f"--time-limit={LIMIT}",
            f"--log={log}",
            str(served),
        ]
        pipe = subprocess.PIPE
        # Not in the served folder: Python would import its modules.
        self.process = subprocess.Popen(
            command,
            stdin=pipe,
            stdout=pipe,
            stderr=subprocess.DEVNULL,
            # The home folders of its calls are temporary folders.
            env=environment() | {"TMPDIR": str(log.parent)},
            cwd=log.parent,
        )
        self._answers: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        self._number = 0
        greeting = {
            "protocolVersion": "2025-06-18",
            "capabilities": {},
            "clientInfo": {"name": "x", "version": "1"},
        }
        self.request("initialize", greeting)
        self.send(b'{"jsonrpc":"2.0","method":"notifications/initialized"}\n')

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._answers.put(line)

    def send(self, message: bytes) -> None:
        """Send the bytes of a message."""
        assert self.process.stdin is not None
        self.process.stdin.write(message)
        self.process.stdin.flush()

    def request(self, method: str, parameters: Any) -> tuple[dict[str, Any], int]:
        """Send a request, and return the answer and its size.

        Raises:
            queue.Empty: There is no answer in time.
        """
        self._number += 1
        request = {"jsonrpc": "2.0", "id": self._number, "method": method, "params": parameters}
        self.send(json.dumps(request).encode() + b"\n")
        end = time.monotonic() + LIMIT + MARGIN
        while True:
            line = self._answers.get(timeout=max(0.0, end - time.monotonic()))
            answer = json.loads(line)
            if answer.get("id") == self._number:
                return answer, len(line)

    def close(self) -> None:
        """Close stdin, and wait for the end of the server."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.close()
        try:
            self.process.wait(MARGIN)
        finally:
            self.process.kill()
            self._reader.join()
            self.process.stdout.close()
            self.process.wait()


def attempt(client: Client, attack: Attack) -> str:
    """Make a hostile call, and return what is wrong, or an empty text."""
    try:
        answer, size = client.request(attack.method, attack.parameters)
    except queue.Empty:
        return "no answer in time"
    text = json.dumps(answer, ensure_ascii=False)
    refused = "error" in answer or bool(answer["result"].get("isError"))
    if attack.refused is not None and refused is not attack.refused:
        return f"{'refused' if refused else 'not refused'}: {text[:500]}"
    if size > SIZE:
        return f"an answer of {size:,} bytes"
    if SECRET in text:
        return f"a text from outside: {text[:500]}"
    if "Traceback" in text or "internal error" in text:
        return f"an internal error: {text[:800]}"
    return ""


def state(folder: Path) -> dict[str, tuple[int, int]]:
    """Return the sizes and times of all files."""
    return {
        str(path.relative_to(folder)): (path.lstat().st_size, path.lstat().st_mtime_ns)
        for path in sorted(folder.rglob("*"))
        if not path.is_dir() and path.name != "mcp.log"
    }


def left_behind(served: Path) -> list[int]:
    """Return the processes of calls that still exist."""
    found = []
    for process in psutil.process_iter():
        try:
            if str(served.parent) in process.environ().get("HOME", ""):
                found.append(process.pid)
        except psutil.Error:
            continue
    return found


def end_during_a_call(served: Path, log: Path, end: Callable[[Client], object]) -> str:
    """End a server that runs a long call, and return what is wrong, or an empty text."""
    client = Client(served, log)
    endless = {"name": "run", "arguments": {"xml": tree('<Repeat num_cycles="-1"><AlwaysSuccess/></Repeat>')}}
    message = {"jsonrpc": "2.0", "id": "last", "method": "tools/call", "params": endless}
    client.send(json.dumps(message).encode() + b"\n")
    limit = time.monotonic() + MARGIN
    while not left_behind(served):
        if time.monotonic() > limit:
            return "the call does not start"
        time.sleep(0.1)
    end(client)
    try:
        client.process.wait(MARGIN)
    except subprocess.TimeoutExpired:
        return "the server does not end"
    finally:
        client.close()
    remaining = left_behind(served)
    return f"processes are left behind: {remaining}" if remaining else ""


def run(chosen: Sequence[str] = ()) -> tuple[int, list[str]]:
    """Make the attacks whose names contain one of *chosen*, or all. Return their number and all faults."""
    faults = []
    with TemporaryDirectory() as temporary:
        folder = Path(temporary).resolve()
        served, log = prepare(folder), folder / "mcp.log"
        attacks = [*paths(folder / "secret.xml"), *contents(folder), *values(folder)]
        if chosen:
            attacks = [attack for attack in attacks if any(part in attack.name for part in chosen)]
        before = state(folder)
        client = Client(served, log)
        for message in MESSAGES:
            client.send(message)
        for attack in attacks:
            began = time.monotonic()
            if fault := attempt(client, attack):
                faults.append(f"{attack.name}: {fault}")
            if client.process.poll() is not None:
                faults.append(f"{attack.name}: the server has ended")
                break
            if not chosen:
                print(f"{time.monotonic() - began:6.2f} s  {attack.name}", flush=True)
        if remaining := left_behind(served):
            faults.append(f"processes are left behind: {remaining}")
        client.close()
        ends: dict[str, Callable[[Client], object]] = {
            "stdin is closed": lambda client: client.process.stdin.close(),
            "SIGTERM": lambda client: client.process.terminate(),
            "Ctrl-C": lambda client: client.process.send_signal(signal.SIGINT),
        }
        for name, end in ends.items():
            if chosen and name not in chosen:
                continue
            if fault := end_during_a_call(served, log, end):
                faults.append(f"{name}: {fault}")
        if (after := state(folder)) != before:
            faults.append(f"changed files: {sorted(set(after.items()) ^ set(before.items()))}")
        lines = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
        if len(lines) < len(attacks):
            faults.append(f"{len(attacks)} calls, but {len(lines)} lines in the log")
    return len(attacks) + len(MESSAGES), faults


def main() -> int:
    """Make all attacks."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", action="append", default=[], metavar="PART", help="attacks with this name")
    count, faults = run(parser.parse_args().only)
    for fault in faults:
        print(f"✘ {fault}")
    print(f"{count} hostile calls and messages, {len(faults)} faults")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
