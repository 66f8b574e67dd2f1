"""`btcore mcp`: an agent mends, proves and simulates a tree; hostile calls are refused."""

import importlib.util
import io
import json
import os
import subprocess
import sys
from collections.abc import Callable, Coroutine, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

pytest.importorskip("mcp", reason="the extra mcp is not installed")

import anyio
from mcp import Client, StdioServerParameters
from mcp.client.stdio import stdio_client

from btcore_studio.agents import limited_command
from btcore_studio.agents.command_process import CommandRunner
from btcore_studio.agents.server import create_server
from btcore_studio.served_folder import ServedFolder

FAULTY = """<root BTCPP_format="4" main_tree_to_execute="Ausweichen">
  <BehaviorTree ID="Ausweichen">
    <ReactiveSequence name="Tür 🚪">
      <Fallback>
        <Inverter><IsObstacel distance="1.0"/></Inverter>
        <Sequence><Back/><Turn/></Sequence>
      </Fallback>
      <Forward/>
    </ReactiveSequence>
  </BehaviorTree>
</root>
"""
FAILING = """<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main"><Sequence>
  <Sleep name="kurz" msec="100"/>
  <SubTree ID="Hinein"/>
</Sequence></BehaviorTree>
<BehaviorTree ID="Hinein"><Fallback><AlwaysFailure name="zu"/><OpenDoor name="Tür"/></Fallback></BehaviorTree>
<TreeNodesModel><Action ID="OpenDoor"/></TreeNodesModel></root>
"""

LEAVES = """import btcore

@btcore.action
def grip() -> bool:
    raise OSError("no gripper")
"""


class Agent:
    """A client that returns results as JSON data."""

    def __init__(self, client: Client) -> None:
        self.client = client

    async def __call__(self, tool: str, **arguments: Any) -> Any:
        """Call a tool, which must not refuse the call."""
        result = await self.client.call_tool(tool, arguments)
        assert not result.is_error, result.content
        [content] = result.content
        return json.loads(content.text)

    async def refusal(self, tool: str, **arguments: Any) -> str:
        """Call a tool, which must refuse the call, and return the message."""
        result = await self.client.call_tool(tool, arguments)
        assert result.is_error
        return str(result.content[0].text)


def serve(
    folder: Path, log: Path, work: Callable[[Agent], Coroutine[Any, Any, None]], *options: str
) -> list[dict[str, Any]]:
    """Run *work* with a server process, and return the lines of its log."""

    async def connect() -> None:
        environment = {name: os.environ[name] for name in ("PATH", "PYTHONPATH") if name in os.environ}
        server = StdioServerParameters(
            command=sys.executable,
            args=["-m", "btcore", "mcp", "--log", str(log), *options, str(folder)],
            env=environment,
        )
        async with Client(stdio_client(server)) as client:
            await work(Agent(client))

    anyio.run(connect)
    return [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]


def serve_here(
    folder: Path,
    work: Callable[[Agent], Coroutine[Any, Any, None]],
    time_limit: float = 60.0,
    plugins: Sequence[str] = (),
) -> None:
    """Run *work* with a server in this process."""

    async def connect() -> None:
        served = ServedFolder(folder)
        runner = CommandRunner(served, time_limit, plugins)
        try:
            async with Client(create_server(served, runner, io.StringIO())) as client:
                await work(Agent(client))
        finally:
            runner.close()

    anyio.run(connect)


def test_an_agent_mends_proves_and_simulates_a_tree(tmp_path: Path) -> None:
    folder = tmp_path / "Bäume"
    folder.mkdir()
    file = folder / "Ausweichen 🤖.xml"
    file.write_text(FAULTY, encoding="utf-8")

    async def work(agent: Agent) -> None:
        tools = {tool.name for tool in (await agent.client.list_tools()).tools}
        assert tools == {
            "nodes", "validate", "show", "run", "sweep", "prove", "read_log", "explain_failure"
        }  # fmt: skip
        checked = await agent("validate", tree=file.name)
        assert not checked["ok"]
        [diagnostic] = checked["diagnostics"]
        assert (diagnostic["code"], diagnostic["file"], diagnostic["line"]) == ("E101", file.name, 5)
        assert "IsObstacle" in diagnostic["hint"]
        mended = FAULTY.replace("IsObstacel", "IsObstacle")
        file.write_text(mended, encoding="utf-8")
        assert (await agent("validate", tree=file.name))["ok"]
        proved = await agent("prove", tree=file.name, never=["Forward & Turn"])
        answers = {question["question"]: question["answer"] for question in proved["questions"]}
        assert answers["never Forward & Turn"] == "proved"
        result = await agent("run", tree=file.name, world="arena_boxes", duration=3)
        assert (result["log"], result["status"], result["ticks"]) == ("run-1", "RUNNING", 30)
        assert result["robot"]["distance_m"] > 0.3
        resource = await agent.client.read_resource(f"btcore://trees/{file.name}")
        assert resource.contents[0].text == mended
        names = {resource.name for resource in (await agent.client.list_resources()).resources}
        assert {file.name, "palette", "guides/agents"} <= names
        page = await agent.client.read_resource("btcore://docs/reference/errors")
        assert "E101" in page.contents[0].text

    lines = serve(folder, tmp_path / "mcp.log", work)
    calls = [line["parameters"]["name"] for line in lines if line["method"] == "tools/call"]
    assert calls == ["validate", "validate", "prove", "run"]
    assert {line["outcome"] for line in lines} == {"ok"}


def test_an_agent_learns_why_a_tree_failed(tmp_path: Path) -> None:
    async def work(agent: Agent) -> None:
        outcomes = {"OpenDoor": "RF"}
        result = await agent("run", xml=FAILING, own_models=True, outcomes=outcomes)
        assert result["ended"] == "the tree ended in FAILURE"
        explained = await agent("explain_failure", log=result["log"])
        assert explained["question"] == "why did 'Sequence::1' return FAILURE in tick 3 (0.2 s)?"
        assert explained["chain"][2]["because"] == "its child 'Hinein::3/Tür' returned FAILURE"
        assert explained["answer"].startswith("'Hinein::3/Tür' returned FAILURE. If ")
        running = await agent("explain_failure", log=result["log"], node="Hinein::3/Tür", at="2")
        assert running["question"] == "why is 'Hinein::3/Tür' RUNNING in tick 2 (0.1 s)?"
        assert result["next"] == "explain_failure with the log run-1 explains why"
        read = await agent("read_log", log=result["log"])
        assert read["nodes"]["kurz"]["success"] == 1
        assert read["changes"][1:3] == ["0 s: kurz RUNNING", "0.1 s: kurz SUCCESS"]
        shown = await agent.client.call_tool("show", {"xml": FAILING, "own_models": True})
        assert "Tür  OpenDoor" in shown.content[0].text
        can_draw = importlib.util.find_spec("resvg_py") is not None
        assert shown.content[1].type == ("image" if can_draw else "text")
        assert "did you mean 'duration'?" in await agent.refusal("run", xml=FAILING, durations=3)
        assert "less than or equal to 600" in await agent.refusal("run", xml=FAILING, duration=1e9)

        async def why(leaf: str) -> str:
            tree = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{leaf}</BehaviorTree></root>'
            result = await agent("run", xml=tree)
            explained = await agent("explain_failure", log=result["log"])
            return "\n".join([explained["chain"][-1]["because"], *explained.get("messages", [])])

        assert (await why("<Grip/>")).startswith("raised OSError: no gripper\n")
        if importlib.util.find_spec("pybullet"):
            reason = await why('<Move goal="50;50"/>')
            assert "can't go to (50.00, 50.00): GOAL_OUTSIDE_MAP" in reason

    plugin = tmp_path / "leaves.py"
    plugin.write_text(LEAVES, encoding="utf-8")
    serve_here(tmp_path, work, plugins=[str(plugin)])


@pytest.mark.skipif(sys.platform == "win32", reason="needs symbolic links and named pipes")
def test_a_sample_of_the_hostile_calls_does_no_harm(acceptance_script: Callable[[str], ModuleType]) -> None:
    attacks = acceptance_script("mcp_attacks")
    attacks.LIMIT = 90.0  # s; the machine may be slow
    count, faults = attacks.run(["path", "resource", "a map here", "a ROS leaf", "run {", "SIGTERM"])
    assert faults == []
    assert count > 90


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such limits")
def test_a_command_has_the_limits_of_its_call(tmp_path: Path) -> None:
    plugin, outside, work = tmp_path / "leaves.py", tmp_path / "outside", tmp_path / "work"
    code = f"""import pathlib, resource
kinds = (resource.RLIMIT_DATA, resource.RLIMIT_FSIZE, resource.RLIMIT_CPU, resource.RLIMIT_CORE)
pathlib.Path("limits").write_text(str([resource.getrlimit(kind) for kind in kinds]))
pathlib.Path({str(outside)!r}).write_text("")
"""
    plugin.write_text(code, encoding="utf-8")
    work.mkdir()
    program = [sys.executable, "-m", limited_command.__name__, "1000000000", "9000", "60"]
    command = [*program, "nodes", "--plugin", plugin]
    done = subprocess.run(command, capture_output=True, text=True, cwd=work, check=False)
    limits = [(1_000_000_000,) * 2, (9000,) * 2, (60,) * 2, (0,) * 2]
    assert (work / "limits").read_text(encoding="utf-8") == str(limits)
    if limited_command.landlock_version():
        assert "Permission denied" in done.stderr
        assert not outside.exists()


@pytest.mark.skipif(not limited_command.landlock_version(), reason="needs Landlock")
def test_a_command_that_cannot_be_limited_does_not_run(tmp_path: Path) -> None:
    # The kernel refuses the 17th limit of a process.
    code = f"""from {limited_command.__name__} import _write_only_in
for number in range(17):
    _write_only_in(".")
    print(number, flush=True)
"""
    program = [sys.executable, "-c", code]
    done = subprocess.run(program, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.returncode == 1
    assert done.stdout.split()[-1] == "15"
    assert "cannot limit where the command writes" in done.stderr


BIG = """<root BTCPP_format="4"><BehaviorTree ID="Main"><Parallel>{}</Parallel></BehaviorTree>
<TreeNodesModel><Action ID="Work"/></TreeNodesModel></root>""".format(
    '<Delay delay_msec="10"><Work/></Delay>' * 9
)
ENDLESS = """<root BTCPP_format="4"><BehaviorTree ID="Main">
  <KeepRunningUntilFailure><Sleep msec="1"/></KeepRunningUntilFailure>
</BehaviorTree></root>"""


def test_calls_return_what_they_have_when_their_time_ends(tmp_path: Path) -> None:
    async def work(agent: Agent) -> None:
        async def prove() -> None:
            entries = "[leaves.Work]\nat_once = false\n[questions]\nq = 'never Parallel is SKIPPED'"
            found = await agent("prove", xml=BIG, own_models=True, declarations=entries)
            assert found["questions"][-1]["question"] == "never Parallel is SKIPPED"
            assert found["questions"][-1]["detail"] == "the search was interrupted"
            assert found["incomplete"].startswith("'btcore prove' did not complete within 8 s")

        async def run() -> None:
            ended = await agent("run", xml=ENDLESS, duration=600, rate=1000)
            assert ended["ended"] == "the time limit of a call ended the run"
            assert ended["ticks"] > 10
            assert "a higher --time-limit" in ended["incomplete"]

        async with anyio.create_task_group() as both:
            both.start_soon(prove)
            both.start_soon(run)

    # Long enough for the start of a process on a slow machine.
    serve_here(tmp_path, work, time_limit=8)


def test_a_call_without_a_result_explains_what_to_do_when_its_time_ends(tmp_path: Path) -> None:
    async def work(agent: Agent) -> None:
        refusal = await agent.refusal("validate", xml=FAILING)
        assert refusal.startswith(
            "'btcore validate' did not complete within 1 s, the time limit of a call; use"
        )

    plugin = tmp_path / "leaves.py"
    plugin.write_text("import threading\nthreading.Event().wait()\n", encoding="utf-8")
    serve(tmp_path, tmp_path / "calls.jsonl", work, f"--plugin={plugin}", "--time-limit=1")
