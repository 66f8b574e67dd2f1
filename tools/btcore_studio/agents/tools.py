"""The tools of `btcore mcp`: each calls commands of btcore, and returns their results in bounded size."""

import base64
import json
import re
from collections import OrderedDict
from collections.abc import Awaitable, Callable, Sequence
from itertools import count
from pathlib import Path
from typing import Any, Final

from mcp_types import ContentBlock, ImageContent, TextContent

from btcore.errors import BtcoreError
from btcore.escaping import escape_controls
from btcore.exit_codes import ExitCode
from btcore_studio.agents.arguments import (
    MAX_EPISODES,
    SETTINGS,
    ExplainFailureArguments,
    LinkArguments,
    NodesArguments,
    ProveArguments,
    ReadLogArguments,
    RunArguments,
    ShowArguments,
    SweepArguments,
    TreeArguments,
    ValidateArguments,
    Value,
)
from btcore_studio.agents.command_process import CommandRunner, Finished
from btcore_studio.agents.result_size import shorten_text, to_bounded_json
from btcore_studio.agents.summaries import (
    answer_of,
    counts_of,
    ending_of,
    palette_by_type,
)
from btcore_studio.served_folder import (
    LOGS,
    MAX_LOG_SIZE,
    MAX_TREE_SIZE,
    TREES,
    RefusedError,
    ServedFolder,
)
from btcore_studio.site.links import link_to

KEPT_RUNS: Final = 20
"""The number of runs whose logs are kept."""

_TICK_LIMIT_S: Final = 5
_MESSAGES: Final = 4000
_OUTLINE: Final = 20_000
_PROOF_MEMORY_MB: Final = 1000


class Toolbox:
    """The tools for the trees in a folder.

    Args:
        runner: Runs the commands.
    """

    def __init__(self, folder: ServedFolder, runner: CommandRunner) -> None:
        self._folder = folder
        self._runner = runner
        self._numbers = count(1)
        self._runs: OrderedDict[str, dict[str, Any]] = OrderedDict()

    @property
    def tools(self) -> Sequence[Callable[..., Awaitable[Any]]]:
        """The tools. The docstring of a tool is its description for agents."""
        return (
            self.nodes,
            self.validate,
            self.show,
            self.run,
            self.sweep,
            self.prove,
            self.read_log,
            self.explain_failure,
            self.link,
        )

    async def nodes(self, call: NodesArguments) -> str:
        """List the nodes that trees can use.

        Without `ids`: by type, the ports of each node and a sentence. An input with `=` has a default; `=`
        alone stands for an empty default. `only_on_robots` names the nodes that `run`, `sweep` and `prove` do
        not have. With `ids`: everything about these nodes, such as the types of their ports.
        """
        words = [f"--format={call.format}", "--json", *self._models(call.models), "--", *call.ids]
        facts = await self._json("nodes", words, all_nodes=True)
        if call.ids:
            return to_bounded_json(facts)
        simulated = await self._json("nodes", words)
        return to_bounded_json(
            palette_by_type(facts) | {"only_on_robots": [node for node in facts if node not in simulated]}
        )

    async def validate(self, call: ValidateArguments) -> str:
        """Report all errors and warnings in a tree, each with line, column and a hint.

        A tree with errors cannot run. `prove` finds what depends on the order of ticks, such as an entry that
        is read before it is written.
        """
        words = [*_repeated_option("given", call.given), "--json"]
        checked = await self._of_tree("validate", call, words, all_nodes=True)
        checked["diagnostics"] = [
            {key: value for key, value in item.items() if key not in ("url", "width")}
            for item in checked["diagnostics"]
        ]
        return to_bounded_json(checked)

    async def show(self, call: ShowArguments) -> list[ContentBlock]:
        """Show a tree with its subtrees as an outline and as a picture, or its data flow."""
        if call.data_flow:
            flow = await self._of_tree("show", call, ["--data", "--json"], all_nodes=True)
            return [_text(to_bounded_json(flow))]
        with self._runner.temporary_folder() as output:
            words = self._words(call, output)
            command = ["show", *self._runner.plugins]
            outline = await self._runner.run([*command, *words], output, all_nodes=True)
            _require_success("show", outline)
            content: list[ContentBlock] = [_text(shorten_text(outline.stdout, _OUTLINE))]
            if call.picture:
                png = output / "tree.png"
                drawn = await self._runner.run([*command, f"--png={png}", *words], output, all_nodes=True)
                if drawn.code == ExitCode.SUCCESS:
                    data = base64.b64encode(png.read_bytes()).decode()
                    content.append(ImageContent(type="image", data=data, mime_type="image/png"))
                else:
                    content.append(_text(_message("show", drawn)))
        return content

    async def run(self, call: RunArguments) -> str:
        """Run a tree in simulated time, and return the results of all nodes.

        Leaves of a robot control a simulated robot in `world`. For each node the result counts the ticks and
        the results; zeros are omitted. `robot` has what the simulation knows of the robot (m, rad, s, %).
        The `log` can be given to explain_failure and read_log.
        """
        words = [
            *_repeated_option("outcomes", [f"{leaf}={letters}" for leaf, letters in call.outcomes.items()]),
            *_repeated_option("set", [f"{key}={_value(value)}" for key, value in call.entries.items()]),
            f"--duration={call.duration}",
            f"--until={call.until}",
            f"--tick-limit={_TICK_LIMIT_S}",
        ]
        for name, value in call.model_dump(include=set(SETTINGS), exclude_defaults=True).items():
            words += _repeated_option(name, value if isinstance(value, list) else [value])
        command = ["run", "--fast", "--json", *self._runner.plugins, *words]
        name = f"run-{next(self._numbers)}"
        with self._runner.temporary_folder() as output:
            log = output / f"{name}.btrec.txt"
            done = await self._runner.run([*command, f"--record={log}", *self._words(call, output)], output)
            report = _last_json("run", done)
            kept = log.replace(self._runner.scratch / log.name)
        # The summary on stderr repeats the result; what comes before it are messages of leaves.
        messages = [
            line for line in done.stderr.splitlines() if line.startswith(("warning", "error", "note"))
        ]
        extra = {"messages": [shorten_text(line, 500) for line in messages[:30]]} if messages else {}
        self._keep(name, {"file": kept, **{key: report[key] for key in ("error",) if key in report}, **extra})
        del report["real_time_factor"]
        report |= counts_of(report["nodes"])
        return to_bounded_json({"log": name, **ending_of(report, done.code, name), **report, **extra})

    async def sweep(self, call: SweepArguments) -> str:
        """Run a tree in simulated time with many seeds and parameter values, and return the success rates.

        `interval` is the confidence interval of a rate. `by` has the rates for each value. `figures` has the
        columns of the episodes. `failing` has the nodes that failed: how many episodes they ended, in how
        many they failed, and how often. `failed` has the first episodes without success: `run` with the same
        seed and parameters repeats an episode.
        """
        episodes = call.seeds * max(1, len(call.worlds))
        for values in call.parameters.values():
            episodes *= len(values)
        if episodes > MAX_EPISODES:
            raise RefusedError(f"the sweep has {episodes:,} episodes; at most {MAX_EPISODES} are permitted")
        words = [
            f"--seeds={call.seeds}",
            f"--duration={call.duration}",
            f"--tick-limit={_TICK_LIMIT_S}",
            "--workers=2",
            *_option("success-if", call.success_if),
            *_repeated_option(
                "param", [f"{key}={_values(values)}" for key, values in call.parameters.items()]
            ),
            *([f"--worlds={','.join(call.worlds)}"] if call.worlds else []),
        ]
        command = ["sweep", "--json", *self._runner.plugins, *words]
        with self._runner.temporary_folder() as output:
            files = [f"--output={output / 'sweep'}", *self._words(call, output)]
            done = await self._runner.run([*command, *files], output)
        report = _last_json("sweep", done)
        # Files that the agent cannot read, and command lines that it cannot use.
        for key in ("table", "report", "workers"):
            del report[key]
        for episode in report["failed"]:
            del episode["replay"]
        return to_bounded_json(report)

    async def prove(self, call: ProveArguments) -> str:
        """Prove what holds in every possible run of a tree, whatever its leaves return.

        The standard questions are always asked. A refuted question has a counterexample: the result of each
        leaf in each tick. With `cycle`, it repeats forever from the tick with this number; the first is 0.
        Such an answer is only possible if it depends on comparisons with values that are not known. An
        answer is unknown if the search was ended early, for example by the time limit: see its detail.

        Propositions A and B in `never` and `ask` are about a tick: 'Move' (it is RUNNING), 'Move is SUCCESS'
        (or FAILURE, SKIPPED, RUNNING, IDLE), 'Move ticked', 'Move halted', '{battery} < 20', '!A', 'A & B',
        'A | B', '(A)'. A node is its name or path, in quotes if it contains spaces.
        """
        words = [
            *_repeated_option("never", call.never),
            *_repeated_option("ask", call.ask),
            *_repeated_option("given", call.given),
            *_option("ticks", call.ticks),
            f"--memory={_PROOF_MEMORY_MB}",
            "--jobs=2",
            "--json",
        ]
        with self._runner.temporary_folder() as output:
            if call.declarations is not None:
                file = output / "declarations.toml"
                file.write_text(call.declarations, encoding="utf-8", errors="replace", newline="\n")
                words.append(f"--declarations={file}")
            command = ["prove", *self._runner.plugins, *words, *self._words(call, output)]
            report = _last_json("prove", await self._runner.run(command, output))
        report["questions"] = [answer_of(question) for question in report["questions"]]
        return to_bounded_json(report)

    async def read_log(self, call: ReadLogArguments) -> str:
        """Read a log: statistics of each node, gaps and damage, and the last changes of results.

        For each node: how often it succeeded, failed or was halted; `rate`, the share of successes; `runs`,
        how often it was RUNNING, and for how long in total, on average and at most (s). Zeros are omitted.
        `failure` is the path from the root to the node that made the tree fail, if it failed.
        """
        statistics = await self._json("stats", ["--json", "--", self._log(call.log)])
        changes = [
            f"{change['time_s']:g} s: {change['node']} {change['result'] or 'halted'}"
            for change in statistics.pop("changes")
        ]
        statistics |= {"changes": changes[-call.changes :]} if call.changes else {}
        return to_bounded_json(statistics | counts_of(statistics["nodes"]) | {"log": call.log})

    async def explain_failure(self, call: ExplainFailureArguments) -> str:
        """Explain what a node did in a recorded run; by default, why the tree failed.

        `chain` leads from the result to the leaf results and entries that it depends on. `answer` names a
        smallest set of them that changes the result, as was tried by running the recording again. `error` is
        the exception of a leaf, and `messages` are what leaves reported. A log that `run` did not write
        needs to be a recording (.btrec.txt, .mcap); for other logs use read_log.
        """
        moment = _option("at", call.at)
        words = [*moment, "--json", "--", self._log(call.log), *([call.node] if call.node else [])]
        explained = await self._json("why", words)
        kept = self._runs.get(call.log, {})
        return to_bounded_json(
            {"log": call.log, **explained, **{key: kept[key] for key in ("error", "messages") if key in kept}}
        )

    async def link(self, call: LinkArguments) -> str:
        """Return a link that opens a tree in the studio in the browser, for the user to see and edit it.

        With `log`, the link also contains a run, which the user can step through. Opening a link runs
        nothing. The link contains the file of the tree, but no files that it includes.
        """
        file, text = self._tree_text(call)
        recording = None
        if call.log is not None:
            log = Path(self._log(call.log))
            if not log.name.endswith(".btrec.txt"):
                raise RefusedError(f"'{call.log}' is refused: a link contains recordings, *.btrec.txt")
            recording = _read_text(log)
        try:
            return link_to({file: text}, tree=call.tree_id, recording=recording)
        except BtcoreError as error:
            raise RefusedError(str(error)) from None

    def _tree_text(self, call: TreeArguments) -> tuple[str, str]:
        """Return the name and the text of the tree of a call."""
        file = self._tree_file(call)
        return ("tree.xml", call.xml or "") if file is None else (file.name, _read_text(file))

    def _tree_file(self, call: TreeArguments) -> Path | None:
        """Return the file of the tree of a call, or None if the call has the text."""
        if (call.tree is None) == (call.xml is None):
            raise RefusedError("give either `tree`, a path, or `xml`, a text")
        return None if call.tree is None else self._folder.find_tree(call.tree)

    def _keep(self, name: str, run: dict[str, Any]) -> None:
        """Keep the log of a run, and forget the oldest run."""
        self._runs[name] = run
        if len(self._runs) > KEPT_RUNS:
            _, oldest = self._runs.popitem(last=False)
            oldest["file"].unlink(missing_ok=True)

    def _log(self, name: str) -> str:
        """Return the file of a log, as an argument of the command line."""
        if name in self._runs:
            return str(self._runs[name]["file"])
        if re.fullmatch(r"run-\d+", name):
            raise RefusedError(f"there is no log '{name}'; the logs of the last {KEPT_RUNS} runs are kept")
        file, mark, session = name.partition("#")
        if mark and not re.fullmatch(r"\d{1,6}", session):
            raise RefusedError(f"'{name}' is refused: after # comes the number of a session")
        return f"{self._folder.find(file, LOGS, MAX_LOG_SIZE)}{mark}{session}"

    def _words(self, call: TreeArguments, output: Path) -> list[str]:
        """Return the arguments of a command for a tree: a file in the folder, or the text in a new file."""
        file = self._tree_file(call)
        if file is None:
            assert call.xml is not None
            data = call.xml.encode(errors="replace")
            if len(data) > MAX_TREE_SIZE:
                raise RefusedError(f"`xml` is refused: it has more than {MAX_TREE_SIZE:,} bytes")
            file = output / "tree.xml"
            file.write_bytes(data)
        own = [f"--model={file}"] if call.own_models else []
        models = [*self._models(call.models), *own]
        return ["--confined", *models, *_option("tree", call.tree_id), "--", str(file)]

    def _models(self, models: Sequence[str]) -> list[str]:
        return [f"--model={self._folder.find(model, TREES, MAX_TREE_SIZE)}" for model in models]

    async def _of_tree(
        self, command: str, call: TreeArguments, words: Sequence[str], all_nodes: bool = False
    ) -> Any:
        """Return the JSON data that a command prints about a tree."""
        with self._runner.temporary_folder() as output:
            return await self._json(command, [*words, *self._words(call, output)], all_nodes)

    async def palette(self) -> str:
        """Return the available nodes as a TreeNodesModel.

        Raises:
            RefusedError: The nodes cannot be listed.
        """
        with self._runner.temporary_folder() as output:
            done = await self._runner.run(["nodes", *self._runner.plugins, "--xml"], output, all_nodes=True)
        _require_success("nodes", done)
        return done.stdout

    async def _json(self, command: str, words: Sequence[str], all_nodes: bool = False) -> Any:
        """Return the JSON data that a command prints."""
        plugins = [] if command in ("stats", "why") else self._runner.plugins
        with self._runner.temporary_folder() as output:
            done = await self._runner.run([command, *plugins, *words], output, all_nodes=all_nodes)
        try:
            return json.loads(done.stdout)
        except ValueError:
            raise RefusedError(_message(command, done)) from None


def _read_text(file: Path) -> str:
    try:
        return file.read_bytes().decode()
    except (OSError, UnicodeDecodeError):
        raise RefusedError(f"'{file.name}' is refused: it cannot be read as UTF-8") from None


def _option(name: str, value: object) -> list[str]:
    return [] if value is None else [f"--{name}={value}"]


def _repeated_option(name: str, values: Sequence[str]) -> list[str]:
    return [f"--{name}={value}" for value in values]


def _value(value: Value) -> str:
    """Return the text of a value on the command line."""
    return value if isinstance(value, str) else json.dumps(value)


def _values(values: Sequence[Value]) -> str:
    """Return the texts of `--param`. Quotes keep a comma or a range inside of a value."""
    return ",".join('"' + _value(value).replace('"', '""') + '"' for value in values)


def _last_json(command: str, done: Finished) -> dict[str, Any]:
    """Return the JSON object in the last line of stdout, and why it is incomplete if it is."""
    try:
        data = json.loads(done.stdout.rstrip().rpartition("\n")[2])
    except ValueError:
        data = None
    if not isinstance(data, dict):
        raise RefusedError(_message(command, done))
    return ({"incomplete": done.incomplete} if done.incomplete else {}) | data


def _require_success(command: str, done: Finished) -> None:
    if done.code != ExitCode.SUCCESS:
        raise RefusedError(_message(command, done))


def _message(command: str, done: Finished) -> str:
    """Return what a command printed instead of a result, without the hint at its `--help`."""
    if done.incomplete:
        return done.incomplete
    text = done.stderr.strip() or done.stdout.strip()
    text = re.sub(r"\s+Try 'btcore [a-z]+ --help' for help\.$", "", text).removeprefix("error: ")
    if not text:
        return f"'btcore {command}' ended with the exit code {done.code} and without a message"
    return shorten_text(escape_controls(text), _MESSAGES)


def _text(text: str) -> TextContent:
    return TextContent(type="text", text=text)
