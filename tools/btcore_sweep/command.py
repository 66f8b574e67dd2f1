"""The command `btcore sweep`."""

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import click

from btcore.cli import terminal
from btcore.cli.tree_source import complete_tree
from btcore.errors import ScriptError
from btcore.field_options import FiniteRange
from btcore.script.program import Program, compile_script
from btcore_sweep.definition import create_definition
from btcore_sweep.episode_runner import run_sweep
from btcore_sweep.options import SweepCommand
from btcore_sweep.parameters import parse_seeds
from btcore_sweep.results import write_results
from btcore_sweep.sweep_folder import SweepFolder


def _parse_script(ctx: click.Context, parameter: click.Parameter, text: str | None) -> Program | None:
    try:
        return None if text is None else compile_script(text, {})
    except ScriptError as error:
        raise click.UsageError(f"--success-if: {error}") from error


@click.command(cls=SweepCommand)
@click.argument("source", metavar="TREE", shell_complete=complete_tree)
@click.option(
    "--seeds",
    required=True,
    metavar="N|A..B|A,B",
    callback=lambda ctx, option, text: parse_seeds(text),
    help="The seeds: the first N seeds (0 to N-1), an inclusive range A..B, or a list.",
)
@click.option(
    "--param",
    "params",
    multiple=True,
    metavar="KEY=VALUES",
    help="Vary a parameter: an option of 'btcore run' without its dashes, or bb.NAME for a blackboard entry. "
    "VALUES are separated by commas; a range is written as 20..100:20. With several parameters, all "
    "combinations of their values are run. Repeatable.",
)
@click.option(
    "--duration",
    type=FiniteRange(0, min_open=True),
    default=600.0,
    show_default=True,
    metavar="S",
    help="End each episode after S seconds of the tree's clock.",
)
@click.option(
    "--success-if",
    callback=_parse_script,
    metavar="SCRIPT",
    help="The condition for a success, as a script over the columns of the table: "
    "\"status == 'SUCCESS' && robot_collisions == 0\".  [default: the run exits with 0]",
)
@click.option(
    "--output",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="DIR",
    help="The folder for the results. An interrupted sweep continues from it.  [default: TREE.sweep]",
)
@click.option(
    "--format",
    "table_format",
    type=click.Choice(["csv", "parquet"]),
    default="csv",
    show_default=True,
    help="The file format of the table. (For the XML format of the tree use --param format=3.)",
)
@click.option(
    "--workers",
    type=click.IntRange(1),
    metavar="N",
    help="Number of processes on this machine.  [default: one per core]",
)
@click.option("--scheduler", metavar="ADDRESS", help="Use the workers of this Dask scheduler instead.")
@click.option(
    "--attempts",
    type=click.IntRange(1),
    default=3,
    show_default=True,
    metavar="N",
    help="Run an episode up to N times if its worker dies; after that its status is KILLED.",
)
@click.option("--no-record", is_flag=True, help="Do not keep the recordings of the episodes without success.")
@click.option(
    "--json", "as_json", is_flag=True, help="Print the results as a JSON object on the last line of stdout."
)
@click.pass_context
def sweep(
    ctx: click.Context,
    /,
    source: str,
    seeds: tuple[int, ...],
    params: Sequence[str],
    success_if: Program | None,
    output: Path | None,
    table_format: str,
    workers: int | None,
    scheduler: str | None,
    attempts: int,
    no_record: bool,
    as_json: bool,
    duration: float,
    **run_options: Any,
) -> int:
    """Run TREE in simulated time with many seeds and parameter values, and report the success rates.

    Each episode is the same as a run of 'btcore run TREE --fast --seed S'; the report lists the command lines
    of the episodes that failed, whose recordings are kept for 'btcore replay'. Finished episodes are saved in
    the output folder: after an interruption, the same command continues with the remaining episodes.

    \b
    Exit codes:
      0    all episodes were successful
      1    an episode was not successful
      2    an error in the tree or on the command line
      3    a leaf raised an exception in an episode
      130  interrupted by Ctrl-C
      143  terminated by SIGTERM
    """
    if workers is not None and scheduler is not None:
        raise click.UsageError("--workers and --scheduler cannot be used together.")
    # Imported only here, since Dask takes long to import: `--help` must not wait for it.
    for module in ("distributed", "pyarrow") if table_format == "parquet" else ("distributed",):
        import_module(module)
    from btcore_sweep import cluster

    definition = create_definition(ctx, source, params, seeds, duration)
    path = output if output is not None else Path(f"{Path(source).stem}.sweep")
    with SweepFolder(path, definition) as folder:
        if scheduler is not None:
            pool = cluster.remote(scheduler, attempts)
        else:
            pool = cluster.local(workers, attempts, path)
        can_record = "record" in definition.choices.refused  # the recorder is installed
        summary = run_sweep(folder, success_if, pool, can_record and not no_record)
        results, code = write_results(folder, success_if, table_format, summary)
    if as_json:
        terminal.print_json(results)
    return code
