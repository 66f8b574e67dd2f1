"""A client replaces the tree of `btcore run` between two ticks."""

import threading
from collections.abc import Callable
from pathlib import Path

import pytest

import btcore
from btcore.cli.commands.run import parse_run
from btcore_monitor.breakpoints import BreakpointClient
from btcore_monitor.serve import serve
from btcore_monitor.watch.address import parse_address
from btcore_monitor.watch.change_client import ChangeClient, ChangeError

TREE = '<root BTCPP_format="4"><BehaviorTree ID="Main">{}</BehaviorTree></root>'
FIRST = TREE.format(
    '<Sequence><Script code="laps := 3"/>'
    '<Repeat num_cycles="-1"><Sleep name="nap" msec="1"/></Repeat></Sequence>'
)
SECOND = TREE.format(
    '<Sequence><Script code="laps := laps + 1"/><SubTree ID="Last" _autoremap="true"/></Sequence>'
)


@pytest.fixture
def port() -> int:

    with serve(btcore.loads(FIRST), groot2_port=0) as publisher:
        return publisher.port


def test_a_client_reloads_the_tree_which_keeps_its_blackboard(
    tmp_path: Path, port: int, until: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "tree.xml"
    file.write_text(FIRST)
    (tmp_path / "last.xml").write_text(TREE.replace("Main", "Last").format('<Script code="done := laps"/>'))
    (tmp_path.parent / "outside.xml").write_text(TREE.format("<AlwaysSuccess/>"))
    errors: list[str] = []
    options = [
        "--publish",
        "groot2",
        "--port",
        str(port),
        "--allow-control",
        "--allow-changes",
        "--duration",
        "60",
    ]

    def refused(client: ChangeClient, xml: str) -> str:
        with pytest.raises(ChangeError) as refusal:
            client.replace_tree(xml)
        return str(refusal.value)

    def reload() -> None:
        address = f"tcp://127.0.0.1:{port}"
        try:
            with BreakpointClient(address, 60) as robot:
                robot.break_at("nap")
                robot.wait(60)
                with ChangeClient(parse_address(address)) as client:
                    until(lambda: (client.read_refusals() or {}).get("reload") == "", "the run takes trees")
                    assert "waits at a breakpoint" in refused(client, FIRST)
                robot.clear("nap")
            with ChangeClient(parse_address(address)) as client:
                until(client.read_refusals, "the reply")
                assert "unknown node" in refused(client, TREE.format("<Dirve/>"))
                assert "E002" in refused(client, "<root")
                outside = FIRST.replace("<BehaviorTree", '<include path="../outside.xml"/><BehaviorTree', 1)
                assert "outside" in refused(client, outside)
                client.replace_tree(SECOND.replace("<Beh", '<include path="last.xml"/><Beh', 1))
        except BaseException as error:
            errors.append(repr(error))

    with parse_run([str(file), *options]) as session:
        client = threading.Thread(target=reload)
        client.start()
        session.run_to_end()
        client.join(60)
        assert errors == []
        assert session.run.report["reloads"] == 1
        assert session.run.end_reason == "done"
        assert session.run.tree.blackboard["laps"] == 4
    assert "reloaded" in capsys.readouterr().err
