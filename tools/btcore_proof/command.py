"""`btcore prove`: answer questions about all possible runs of a tree."""

import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import click
from rich.live import Live
from rich.text import Text

from btcore.cli import files, terminal
from btcore.cli.node_libraries import NodeLibraries
from btcore.cli.tree_source import (
    STDIN,
    TreeOptions,
    TreeReader,
    complete_tree,
    find_source,
    given_keys,
)
from btcore.escaping import escape_controls
from btcore.exit_codes import ExitCode
from btcore.field_options import pass_options
from btcore.registry.mock_leaves import MockAction
from btcore.registry.registry import Registry
from btcore.suggestions import counted
from btcore.tree.tree import Tree
from btcore.xml.plan.plan import Plans
from btcore_proof.answer_text import lines_of_answer
from btcore_proof.counterexample import RunTick
from btcore_proof.declarations import SUFFIX, Declarations
from btcore_proof.declarations_template import template_of
from btcore_proof.model_leaves import with_model_leaves
from btcore_proof.prover import PROVED, REFUTED, Answer, Report
from btcore_proof.saved_counterexamples import RECORDING, TreeReference, file_name, source_of_test
from btcore_proof.search import SearchLimits
from btcore_proof.state_graph import StateGraph
from btcore_proof.state_graph_pictures import MAX_STATES, draw_graph, graph_to_dot
from btcore_proof.tree_files import declarations_of, prover_of, record_counterexample

_INTERVAL_S: Final = 0.2


@click.command()
@click.argument("source", metavar="TREE", shell_complete=complete_tree)
@pass_options(TreeOptions, "options")
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
@given_keys
@click.option(
    "--declarations",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Read models of leaves, domains of entries and questions from FILE instead of TREE.proof.toml.",
)
@click.option(
    "--instant-leaves",
    is_flag=True,
    help="Assume that leaves take no time. By default, any time may pass within a tick, so that timers of a "
    "tick may start at different times.",
)
@pass_options(SearchLimits, "limits")
@click.option(
    "--save",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="FOLDER",
    help="Write each counterexample to FOLDER: a recording for `btcore replay`, and a test for pytest that "
    "fails until the tree is mended.",
)
@click.option(
    "--dot",
    type=files.OUTPUT_FILE,
    metavar="FILE",
    help=f"Write the state graph, with at most {MAX_STATES} states, for Graphviz.",
)
@click.option("--strict", is_flag=True, help="Exit with 1 also for 'proved: unless …' and 'proved: if …'.")
@click.option(
    "--init",
    is_flag=True,
    help="Write a commented TREE.proof.toml with all that can be declared for TREE, and end.",
)
@click.option("--json", "as_json", is_flag=True, help="Print a JSON object.")
def prove(
    source: str,
    options: TreeOptions,
    never: Sequence[str],
    asked: Sequence[str],
    given: Sequence[str],
    declarations: Path | None,
    instant_leaves: bool,
    limits: SearchLimits,
    save: Path | None,
    dot: Path | None,
    strict: bool,
    init: bool,
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
      2  an error in the tree, on the command line or in a question
      4  something is unknown or possible, and nothing is refuted
    """
    path = find_source(source)
    if save is not None and path == STDIN:
        raise click.UsageError("--save needs a tree in a file, because tests name the file.")
    libraries = NodeLibraries(options.plugins, options.models, options.confined)
    declared = (
        Declarations() if path == STDIN and declarations is None else declarations_of(path, declarations)
    )
    plans = TreeReader(
        path, options, libraries, lambda nodes: with_model_leaves(nodes, declared.leaves)
    ).read_plans()
    questions = [*(f"never {text}" for text in never), *asked]
    prover = prover_of(plans, questions, declared, given, instant_leaves)
    if init:
        return _write_template(path, prover.tree)
    limits.jobs = limits.jobs or _default_jobs()
    with _Progress() as progress:
        report = prover.answer(limits, progress)
    if save is not None:
        has_libraries = _has_libraries(prover.tree, libraries.nodes, options.plugins)
        used = TreeReference(
            path, options.tree, options.format, options.models, options.plugins, has_libraries, declarations
        )
        for number, answer in enumerate(report.answers, 1):
            if answer.answer == REFUTED and answer.counterexample is not None:
                _save(save, file_name(number, answer.question), answer, used, plans, declared)
    if as_json:
        terminal.print_json({"questions": [_as_data(answer) for answer in report.answers]})
    else:
        _print(report)
    if dot is not None:
        files.write(dot, graph_to_dot(*draw_graph(prover)).encode())
    for error in prover.errors:
        terminal.print_error(error)
    return ExitCode.USER_ERROR if prover.errors else _exit_code(report, strict)


def _exit_code(report: Report, strict: bool) -> ExitCode:
    answers = {answer.answer for answer in report.answers}
    has_conditions = any(
        answer.answer == PROVED and answer.detail and not answer.is_vacuous for answer in report.answers
    )
    if REFUTED in answers or (strict and has_conditions):
        return ExitCode.FAILURE
    return ExitCode.SUCCESS if answers == {PROVED} else ExitCode.INCOMPLETE_OUTPUT


def _write_template(path: Path, tree: Tree) -> int:
    """Write a file with commented declarations beside the file of a tree."""
    if path == STDIN:
        raise click.UsageError("--init needs a tree in a file: it writes the declarations beside it.")
    target = path.with_suffix(SUFFIX)
    if target.exists():
        raise click.UsageError(f"{target} exists already; --init does not overwrite it.")
    files.write(target, template_of(tree).encode())
    click.echo(f"wrote {escape_controls(str(target))}")
    return ExitCode.SUCCESS


def _default_jobs() -> int:
    """Return the number of cores, but 1 for two: exchanging states would then take more than it saves."""
    cores = os.cpu_count() or 1
    return cores if cores > 2 else 1


def _has_libraries(tree: Tree, nodes: Registry, plugins: Sequence[str]) -> bool:
    """Return whether a tree has nodes of installed libraries."""
    own = {"btcore", *(Path(plugin).stem if plugin.endswith(".py") else plugin for plugin in plugins)}
    manifests = [nodes.get(node.config.id, node.config.format) for node in tree.nodes]
    return any(
        manifest.library not in own and not issubclass(manifest.cls, MockAction)
        for manifest in manifests
        if manifest is not None
    )


def _save(
    folder: Path,
    name: str,
    answer: Answer,
    used: TreeReference,
    plans: Plans,
    declared: Declarations,
) -> None:
    """Write the counterexample of *answer* as a recording and as a test."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise click.ClickException(f"cannot create '{folder}': {error.strerror}") from error
    if not record_counterexample(plans, answer, declared, folder / f"{name}{RECORDING}"):
        # Nodes that are no leaves, such as a ManualSelector, have no outcomes.
        terminal.print_warning(
            f"'{answer.question}': no test was saved, because the leaves' outcomes do not repeat the run"
        )
        return
    target = folder / f"test_{name.replace('-', '_')}.py"
    files.write(target, source_of_test(name, answer, used, folder).encode())


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
        text = f"{graph.expanded:,} of {graph.states:,} states searched, {graph.transitions:,} ticks run"
        self._live.update(Text(text, style="dim"), refresh=True)


def _print(report: Report) -> None:
    """Print the answers, with the counterexamples."""
    console = terminal.stdout_console()
    for answer in report.answers:
        for line in lines_of_answer(answer):
            console.print(Text.assemble(*line), soft_wrap=True)
    states = report.answers[0].states
    console.print(
        Text(f"{counted(states, 'state')}, {counted(report.transitions, 'tick')} run", style="dim"),
        soft_wrap=True,
    )


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
        "until": tick.times[-1],
        "leaves": leaves,
        "halted": tick.halted,
        "running": tick.running,
        "result": None if tick.result is None else tick.result.name,
        "error": tick.error,
        "assumed": list(tick.guesses),
    }
