"""`btcore prove`: answer questions about all possible runs of a tree."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import click
from rich.live import Live
from rich.text import Text

from btcore.cli import node_libraries, terminal
from btcore.cli.completion import complete_tree
from btcore.cli.exit_codes import ExitCode
from btcore.cli.tree_source import STDIN, TreeSource, confined_option, find_source, format_option, tree_option
from btcore.clock import Clock
from btcore.escaping import escape_controls
from btcore.proof.counterexample import Counterexample, RunTick
from btcore.proof.declarations import Declarations, declarations_beside, read_declarations
from btcore.proof.exploration import StateGraph
from btcore.proof.model_leaves import Choices, with_model_leaves
from btcore.proof.propositions import parse_question
from btcore.proof.prove import PROVED, REFUTED, Answer, Prover, Report
from btcore.status import Status
from btcore.tree.tree import Tree
from btcore.xml.build import TreeInstantiator

_MARKS: Final = {PROVED: ("✔", "green"), REFUTED: ("✘", "red")}
_COLOURS: Final = {Status.SUCCESS: "green", Status.FAILURE: "red", Status.RUNNING: "yellow"}
_INTERVAL_S: Final = 0.2


@click.command(short_help="Prove what holds in every run of a tree.")
@click.argument("source", metavar="TREE", shell_complete=complete_tree)
@tree_option
@format_option()
@confined_option
@node_libraries.plugin_option
@node_libraries.model_option
@click.option(
    "--never",
    "never",
    multiple=True,
    metavar="A",
    help="Ask whether A never holds, such as 'Forward & Turn'.",
)
@click.option(
    "--ask",
    "asked",
    multiple=True,
    metavar="QUESTION",
    help="Ask a question: 'never A', 'A leads to B', 'A leads to B within 5 ticks' or 'A before B'.",
)
@click.option(
    "--given",
    "given",
    multiple=True,
    metavar="KEY",
    help="Assume that the program sets the blackboard key KEY before the first tick. Repeatable.",
)
@click.option(
    "--declarations",
    "file",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Read models of leaves, domains of entries and questions from FILE instead of TREE.proof.toml.",
)
@click.option(
    "--ticks", type=click.IntRange(1), metavar="N", help="Search runs of at most N ticks. Default: no limit."
)
@click.option(
    "--memory",
    type=click.IntRange(100),
    default=4000,
    show_default=True,
    metavar="MB",
    help="End the search when the process has used this much memory.",
)
@click.option("--json", "as_json", is_flag=True, help="Print a JSON object.")
def prove(
    source: str,
    tree: str | None,
    format: int | None,
    confined: bool,
    plugins: Sequence[str],
    models: Sequence[Path],
    never: Sequence[str],
    asked: Sequence[str],
    given: Sequence[str],
    file: Path | None,
    ticks: int | None,
    memory: int,
    as_json: bool,
) -> int:
    """Search all possible runs of TREE, and answer questions about them.

    Leaves are replaced by models: a condition succeeds or fails, an action may also be RUNNING for any number
    of ticks. All other nodes, and all scripts, run as they are. The standard questions are always asked.

    TREE is an XML file, - for stdin, or the name of a tree that is bundled with btcore.

    \b
    Exit codes:
      0  everything is proved
      1  something is refuted; a run that shows it is printed
      2  an error in the tree or on the command line
      4  something is unknown, and nothing is refuted
    """
    path = find_source(source)
    libraries = node_libraries.load_libraries(plugins, models, confined)
    declared = _declarations(path, file)
    examined, nodes = TreeSource(path, tree, libraries, format, confined).read(
        lambda nodes: with_model_leaves(nodes, declared.leaves)
    )

    def make(choices: Choices, clock: Clock) -> Tree:
        return TreeInstantiator(examined, nodes, None, [choices], clock).instantiate()

    questions = [parse_question(f"never {text}") for text in never]
    questions += [parse_question(text) for text in [*asked, *declared.questions.values()]]
    keys = [*dict.fromkeys([*declared.given, *given])]
    prover = Prover(make, questions, declared.entries, keys)
    with _Progress() as progress:
        report = prover.answer(ticks, memory << 20, progress)
    if as_json:
        terminal.print_json({"questions": [_as_data(answer) for answer in report.answers]})
    else:
        _print(report)
    answers = {answer.answer for answer in report.answers}
    if REFUTED in answers:
        return ExitCode.FAILURE
    return ExitCode.SUCCESS if answers == {PROVED} else ExitCode.INCOMPLETE_OUTPUT


def _declarations(path: Path, file: Path | None) -> Declarations:
    if file is not None:
        return read_declarations(file)
    return Declarations() if path == STDIN else declarations_beside(path)


class _Progress:
    """A line on a terminal with the number of states that were found so far."""

    def __init__(self) -> None:
        console = terminal.stderr_console()
        self._live = (
            Live(console=console, auto_refresh=False, transient=True) if console.is_terminal else None
        )
        self._next = time.monotonic() + _INTERVAL_S

    def __enter__(self) -> "_Progress":
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()

    def __call__(self, graph: StateGraph) -> None:
        now = time.monotonic()
        if self._live is None or now < self._next:
            return
        self._next = now + _INTERVAL_S
        found, searched = len(graph.parents), len(graph.edges)
        text = f"{searched:,} of {found:,} states searched, {graph.transitions:,} ticks run"
        self._live.update(Text(text, style="dim"), refresh=True)


def _print(report: Report) -> None:
    """Print the answers, with the counterexamples."""
    console = terminal.stdout_console()
    for answer in report.answers:
        mark, colour = _MARKS.get(answer.answer, ("?", "yellow"))
        line = Text(f"{mark} ", style=f"bold {colour}").append(
            escape_controls(answer.question, one_line=True), style="bold"
        )
        word = f"{answer.answer}, vacuously" if answer.is_vacuous else answer.answer
        line.append(f"  {word}", style=colour)
        if answer.detail:
            line.append(f": {escape_controls(answer.detail)}")
        console.print(line, soft_wrap=True)
        if answer.counterexample is not None:
            for text in _lines_of(answer.counterexample):
                console.print(text, soft_wrap=True)
    states = report.answers[0].states
    console.print(
        Text(f"{terminal.counted(states, 'state')}, {report.transitions:,} ticks run", style="dim"),
        soft_wrap=True,
    )


def _lines_of(run: Counterexample) -> list[Text]:
    """Return a line for each tick of a counterexample."""
    lines: list[Text] = []
    for number, tick in enumerate(run.ticks):
        if number == run.cycle:
            lines.append(Text("    ↻ from here again and again:", style="dim"))
        lines.append(_line_of(number + 1, tick))
        if tick.error:
            lines += [
                Text(f"           {line}", style="red") for line in escape_controls(tick.error).splitlines()
            ]
    return lines


def _line_of(number: int, tick: RunTick) -> Text:
    line = Text(f"    {number:>3}  {tick.time:>6.1f} s  ", style="dim")
    for index, leaf in enumerate(tick.leaves):
        line.append(", " if index else "", style="dim")
        line.append(f"{escape_controls(leaf.path)} ", style="not dim")
        line.append(leaf.result.name, style=f"not dim {_COLOURS.get(leaf.result, 'dim')}")
        for port, value in leaf.written.items():
            line.append(f" {port}={escape_controls(value)}", style="dim")
    for path in tick.halted:
        line.append(f", {escape_controls(path)} halted")
    if tick.result is not None:
        line.append(f"  → {tick.result.name}", style="not dim")
    return line


def _as_data(answer: Answer) -> dict[str, object]:
    """Return *answer* as JSON data."""
    run = answer.counterexample
    return {
        "question": answer.question,
        "answer": answer.answer,
        "detail": answer.detail,
        "vacuous": answer.is_vacuous,
        "ticks": answer.ticks,
        "states": answer.states,
        "counterexample": [] if run is None else [_tick_as_data(tick) for tick in run.ticks],
        "cycle": None if run is None else run.cycle,
    }


def _tick_as_data(tick: RunTick) -> dict[str, object]:
    leaves = [
        {"node": leaf.path, "result": leaf.result.name, "written": leaf.written} for leaf in tick.leaves
    ]
    return {
        "time": tick.time,
        "leaves": leaves,
        "halted": tick.halted,
        "running": tick.running,
        "result": None if tick.result is None else tick.result.name,
        "error": tick.error,
    }
