"""``btcore sweep``: many episodes of a tree, over all cores or a cluster, and what they come to."""

import json
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import click

from btcore.cli.run import FiniteRange
from btcore.script.program import Program
from btcore.sweep import (
    episode_runner,
    options,
    success,
)
from btcore.sweep import seeds as seed_texts
from btcore.sweep.definition import create_definition
from btcore.sweep.journal import Journal
from btcore.sweep.results import write_results


def _have(modules: Sequence[str]) -> None:
    """Raise ModuleNotFoundError, which the command line explains, before hours are spent in vain."""
    for module in modules:
        import_module(module)


@click.command(cls=options.SweepCommand, short_help="Run a tree many times over all cores, and count.")
@click.argument("source", metavar="TREE")
@click.option(
    "--seeds",
    required=True,
    metavar="N|A..B|A,B",
    callback=lambda ctx, option, text: seed_texts.parse_seeds(text),
    help="How many seeds, from 0 on; or which: a range, both ends belong to it, or a list.",
)
@click.option(
    "--param",
    "params",
    multiple=True,
    metavar="KEY=VALUES",
    help="What to vary: an option of 'btcore run' without its dashes, or bb.NAME, an entry of the "
    "blackboard. VALUES stand apart by commas, or are ranges: 20..100:20. Several make a grid; each setting "
    "is run with each seed.",
)
@click.option(
    "--duration",
    type=FiniteRange(0, min_open=True),
    default=600.0,
    show_default=True,
    metavar="S",
    help="End an episode after so many seconds of the tree's clock.",
)
@click.option(
    "--success-if",
    "script",
    callback=success.parse_script,
    metavar="SCRIPT",
    help="What counts as a success, as a tree's scripts are written, over the table's columns: "
    "\"status == 'SUCCESS' && robot_collisions == 0\". Without it, a run that exits with 0.",
)
@click.option(
    "--output",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="DIR",
    help="Where the results go, and from where a sweep that was broken off goes on.  [default: TREE.sweep]",
)
@click.option(
    "--format",
    "suffix",
    type=click.Choice(["csv", "parquet"]),
    default="csv",
    show_default=True,
    help="The form of the table. (--param format=3 has trees read as format 3.)",
)
@click.option(
    "--workers", type=click.IntRange(1), metavar="N", help="Processes on this machine.  [default: one a core]"
)
@click.option("--scheduler", metavar="ADDRESS", help="Play on the workers of this Dask scheduler instead.")
@click.option(
    "--attempts",
    type=click.IntRange(1),
    default=3,
    show_default=True,
    metavar="N",
    help="How often an episode may take its worker with it before it counts as KILLED.",
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object as the last line of stdout.")
@click.pass_context
def sweep(
    ctx: click.Context,
    /,
    source: str,
    seeds: tuple[int, ...],
    params: Sequence[str],
    script: Program | None,
    output: Path | None,
    suffix: str,
    workers: int | None,
    scheduler: str | None,
    attempts: int,
    as_json: bool,
    **settings: Any,
) -> int:
    """Run TREE with many seeds and settings in simulated time, and tell how often it succeeds.

    Each episode is what 'btcore run TREE --fast --seed S' does, and the report has that command line for
    those that failed. What is done is kept in the output folder: the same command goes on after whatever
    ended it.

    Exits with 0 when every episode is a success, 1 when one isn't, 2 for a mistake in the tree or on the
    command line, 3 when a leaf raised in one, 130 when interrupted.
    """
    if workers is not None and scheduler is not None:
        raise click.UsageError("--workers counts processes on this machine, and --scheduler has its own.")
    _have(["distributed", *(["pyarrow"] if suffix == "parquet" else [])])
    definition = create_definition(ctx, source, params, seeds, settings["duration"])
    folder = output if output is not None else Path(f"{Path(source).stem}.sweep")
    with Journal(folder, definition) as journal:
        done = episode_runner.run_sweep(
            journal, script, episode_runner.WorkerOptions(workers, scheduler, attempts)
        )
        results = write_results(journal, script, suffix, done)
    if as_json:
        click.echo(json.dumps(results.json_object, ensure_ascii=False))
    return results.code
