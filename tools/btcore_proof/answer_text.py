"""Answers as lines of text for people, with the ticks of counterexamples and a drawing of the tree."""

from typing import Final

from btcore.escaping import escape_controls
from btcore.status import Status
from btcore.suggestions import counted, join_names
from btcore.tree.drawing import Fragment
from btcore_proof.counterexample import Counterexample, RunTick
from btcore_proof.prover import PROVED, REFUTED, Answer

Line = list[Fragment]

_MARKS: Final = {PROVED: ("✔", "green"), REFUTED: ("✘", "red")}
_COLOURS: Final = {Status.SUCCESS: "green", Status.FAILURE: "red", Status.RUNNING: "yellow"}
MAX_TICKS: Final = 30
"""The number of ticks of a run from which on only the first and the last ticks are printed."""
_SHOWN: Final = 12
BIG_TREE: Final = 25
"""The number of nodes of a tree from which on nodes that were not ticked are not drawn."""


def lines_of_answer(answer: Answer) -> list[Line]:
    """Return the lines that show an answer, and its counterexample."""
    mark, colour = _MARKS.get(answer.answer, ("?", "yellow"))
    word = f"{answer.answer}, vacuously" if answer.is_vacuous else answer.answer
    first = [
        (f"{mark} ", f"bold {colour}"),
        (escape_controls(answer.question, one_line=True), "bold"),
        (f"  {word}", colour),
    ]
    if answer.detail:
        first.append((f": {escape_controls(answer.detail)}", ""))
    run = answer.counterexample
    return [first] if run is None else [first, *_lines_of_run(run)]


def _lines_of_run(run: Counterexample) -> list[Line]:
    lines: list[Line] = []
    if run.given:
        values = ", ".join(f"{{{key}}} = {value}" for key, value in run.given.items())
        lines.append([(f"    before the first tick  {escape_controls(values)}", "dim")])
    last = len(run.ticks) - 1
    for number, tick in enumerate(run.ticks):
        is_left_out = last >= MAX_TICKS and _SHOWN <= number <= last - _SHOWN
        if number == run.cycle:
            lines.append([("    ↻ the ticks from here repeat forever:", "dim")])
        if is_left_out:
            if number == _SHOWN or number == run.cycle:
                end = run.cycle if run.cycle is not None and number < run.cycle <= last - _SHOWN else None
                count = (last - _SHOWN + 1 if end is None else end) - number
                lines.append([(f"         … {counted(count, 'tick')} …", "dim")])
            continue
        lines += _lines_of_tick(number + 1, tick)
    if run.cycle is not None:
        lines.append([(f"    ↻ on to tick {run.cycle + 1}", "dim")])
    return lines + _drawing(run)


def _drawing(run: Counterexample) -> list[Line]:
    """Return the drawing of the tree; in a big tree without the nodes that were not ticked."""
    lines: list[Line] = []
    hidden = 0
    for line in run.drawing:
        was_ticked = len(run.drawing) <= BIG_TREE or not line[-1][0].endswith(Status.IDLE.name)
        hidden = 0 if was_ticked else hidden + 1
        if hidden > 1:
            lines.pop()
        shown = line if was_ticked else [(f"… {counted(hidden, 'node')} not ticked", "dim")]
        lines.append([("           ", ""), *shown])
    return lines


def _lines_of_tick(number: int, tick: RunTick) -> list[Line]:
    line: Line = [(f"    {number:>3}  {tick.time:>6.1f} s  ", "dim")]
    for index, leaf in enumerate(tick.events):
        line.append((", " if index else "", "dim"))
        line.append((f"{escape_controls(leaf.name, one_line=True)} ", ""))
        if leaf.result is Status.IDLE:
            line.append(("halted", ""))
            continue
        line.append((leaf.result.name, _COLOURS.get(leaf.result, "cyan")))
        for port, value in leaf.written.items():
            line.append((f" {port}={escape_controls(value, one_line=True)}", "dim"))
    if tick.result is not None:
        line.append((f"  → {tick.result.name}", ""))
    if tick.guesses:
        line.append((f"  (if {escape_controls(join_names(tick.guesses, 'and'), one_line=True)})", "yellow"))
    if len(tick.times) > 1:
        line.append((f"  (the tick takes {tick.times[-1] - tick.time:.3g} s)", "dim"))
    error = escape_controls(tick.error).splitlines()
    return [line, *([("           ", ""), (text, "red")] for text in error)]
