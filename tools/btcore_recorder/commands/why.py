"""`btcore why`: explain a moment of a recorded run."""

import re

import click

from btcore.cli import terminal
from btcore.escaping import escape_controls
from btcore.exit_codes import ExitCode
from btcore.suggestions import join_names

_MOMENT = re.compile(r"(\d{1,15})|(\d{1,12}(?:\.\d{1,9})?)s")


@click.command()
@click.argument("file", metavar="FILE")
@click.argument("node", metavar="[NODE]", default="")
@click.option(
    "--at",
    "moment",
    metavar="TICK|TIME",
    help="The moment: the number of a tick, or the seconds since the recording began, such as 12.5s.  "
    "[default: the last failure of the tree, or its last tick]",
)
@click.option(
    "--compare", "other", metavar="FILE", help="Explain the first difference to another run instead."
)
@click.option("--json", "as_json", is_flag=True, help="Print a JSON object.")
def why(file: str, node: str, moment: str | None, other: str | None, as_json: bool) -> int:
    """Explain why a node of the recorded run FILE (.btrec.txt or .mcap) did what it did, from a replay.

    NODE is the path of a node: why did it have its result, why was it halted, or why was it not ticked?
    Without NODE it is the root: why did the tree fail? {KEY} in place of NODE asks who wrote this entry. The
    answer is a chain from the result to a smallest set of leaf results and entries that would change it,
    which is tried by running the recording again. The leaves themselves are not run.
    """
    from btcore_recorder.why import Explainer

    tick, time = _parse_moment(moment)
    explainer = Explainer(file)
    changed = explainer.changed_files()
    if changed:
        terminal.print_notes(
            [f"{join_names(changed)} changed since: the lines are those of the recorded text"]
        )
    if other is not None:
        if node or moment is not None:
            raise click.UsageError("--compare finds node and moment itself: leave out NODE and --at.")
        answer = explainer.differs_from(Explainer(other))
    elif node.startswith("{") and node.endswith("}"):
        answer = explainer.who_wrote(node[1:-1], tick, time)
    else:
        answer = explainer.why(node, tick, time)
    if as_json:
        terminal.print_json(answer.as_data())
    else:
        click.echo(escape_controls(str(answer)))
    return ExitCode.SUCCESS


def _parse_moment(text: str | None) -> tuple[int | None, float | None]:
    if text is None:
        return None, None
    match = _MOMENT.fullmatch(text)
    if match is None:
        raise click.UsageError(
            f"--at {text}: give the number of a tick, such as 12, or seconds, such as 1.5s."
        )
    tick, seconds = match.groups()
    return (int(tick), None) if tick else (None, float(seconds))
