"""Fuzzing: mutated trees, scripts and port texts give results or clean errors, soon and in bounded memory.

``python tests/acceptance/fuzz.py --inputs 100000`` uses all cores. Every input follows from its number and
the seed, so that a reported input can be run again alone: ``--only trees:1234``. It prints a table,
and exits with 1 when anything but a BtcoreError was raised, or when an input took over 1 s.
"""

import argparse
import gzip
import json
import os
import random
import resource
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from pathlib import Path

from btcore import Blackboard, BtcoreError, SimClock, loads
from btcore.lint.validate import validate_document
from btcore.script.program import compile_script
from btcore.values import DOUBLE, INT, INT64, NODE_STATUS, UINT, UINT64, VECTOR_DOUBLE, VECTOR_INT
from btcore.xml.read.read import parse_text
from tests.conformance.recorded_cases import CallLog, conformance_registry

DATA = Path(__file__).parents[1] / "conformance" / "data"
LIMIT = 1.0
"""The limit of the processor time for an input (s)."""
CHUNK = 500
PIECES = [
    "<", ">", "&", "&#0;", "&amp;", "'", '"', "/", "{", "}", "{=}", "{@a}", "{ a }", "=", "]]>", "<!--",
    "<?x", "<!DOCTYPE a>", "\x00", "\ufffe", "é", "𝄞", "\r\n", "\t", " ", ";", ":=", "==", "..", "+=", "?",
    ":", "&&", "||", "!", "~", "^", "0x", "1e999", "-1", "99999999999999999999", "3.7", "nan", "inf",
    "json:[", "true", "ID", "name", "_skipIf", "_while", "_autoremap", "Sequence", "SubTree", "Repeat",
    "Switch2", "num_cycles", "BehaviorTree", "root", "(" * 50, "-" * 300, "a" * 500,
]  # fmt: skip


@cache
def corpus(*names: str) -> list[dict[str, object]]:
    """The recorded cases in the files *names*."""
    cases = []
    for name in names:
        with gzip.open(DATA / f"{name}.jsonl.gz", "rt", encoding="utf-8") as lines:
            cases += [json.loads(line) for line in lines]
    return cases


def mutate(text: str, rng: random.Random) -> str:
    """*text* with one to six changes: pieces put in, cut out, doubled, moved, characters replaced."""
    for _ in range(rng.randint(1, 6)):
        at = rng.randint(0, len(text))
        end = min(len(text), at + int(rng.expovariate(0.08)))
        kind = rng.randrange(5)
        if kind == 0:
            text = text[:at] + rng.choice(PIECES) + text[at:]
        elif kind == 1:
            text = text[:at] + text[end:]
        elif kind == 2:
            text = text[:end] + text[at:]
        elif kind == 3:
            text = text[:at] + rng.choice(PIECES) + text[end:]
        else:
            text = (
                text[:at] + chr(rng.choice((rng.randrange(32, 127), rng.randrange(0x2FF)))) + text[at + 1 :]
            )
    return text


def check_tree(rng: random.Random) -> None:
    """Check a mutated tree, load it, and tick it three times in format 4."""
    case = rng.choice(corpus("v4_full", "v4_scopes", "v3_full"))
    text = mutate(str(case["xml"]), rng)
    format = rng.choice((None, 3, 4))
    nodes = conformance_registry()
    try:
        validate_document(parse_text(text), nodes=nodes, format=format)
        tree = loads(text, nodes=nodes, resources=[CallLog()], format=format, clock=SimClock())
        # A Repeat of format 3 does all its cycles in one tick, and a mutation may demand any number.
        for _ in range(3 if tree.format == 4 else 0):
            tree.tick_once()
    except BtcoreError as fault:
        str(fault)


def check_script(rng: random.Random) -> None:
    """Compile a mutated script, and run it three times."""
    case = rng.choice(corpus("scripts"))
    board = Blackboard()
    for key, value in dict(case["bb"]).items():  # type: ignore[call-overload]
        board.set(key, value)
    try:
        program = compile_script(mutate(str(case["script"]), rng), {"RED": 1})
        for _ in range(3):
            program.run(board)
    except BtcoreError as fault:
        str(fault)


def check_port(rng: random.Random) -> None:
    """Convert a mutated text to every type of port."""
    text = mutate(str(rng.choice(corpus("convert"))["text"]), rng)
    for kind in (INT, INT64, UINT, UINT64, DOUBLE, NODE_STATUS, VECTOR_INT, VECTOR_DOUBLE):
        for format in (3, 4):
            try:
                kind.from_text(text, format)
            except BtcoreError as fault:
                str(fault)


KINDS: dict[str, tuple[Callable[[random.Random], None], float]] = {
    "trees": (check_tree, 0.4),
    "scripts": (check_script, 0.3),
    "ports": (check_port, 0.3),
}


def run(kind: str, seed: int, numbers: range) -> tuple[str, list[str], float, float]:
    """Run the inputs *numbers*; return the kind, failures, longest time (s) and peak memory (MB)."""
    wrong, slowest = [], 0.0
    for number in numbers:
        began = time.process_time()
        try:
            KINDS[kind][0](random.Random(f"{seed}:{kind}:{number}"))
        except BaseException as fault:
            wrong.append(f"{kind}:{number}: {type(fault).__name__}: {fault}")
        took = time.process_time() - began
        slowest = max(slowest, took)
        if took > LIMIT:
            wrong.append(f"{kind}:{number}: took {took:.1f} s")
    return kind, wrong, slowest, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main(arguments: list[str]) -> int:
    """Run the command line *arguments*, and return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--inputs", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--only", metavar="KIND:NUMBER", help="run one input again, and let it raise")
    chosen = parser.parse_args(arguments)
    if chosen.only:
        kind, number = chosen.only.split(":")
        KINDS[kind][0](random.Random(f"{chosen.seed}:{kind}:{number}"))
        return 0
    failed = False
    print(f"{'kind':<10}{'inputs':>9}{'wrong':>8}{'slowest s':>12}{'peak MB':>10}")
    for kind, (_, share) in KINDS.items():
        count = round(chosen.inputs * share)
        chunks = [range(start, min(start + CHUNK, count)) for start in range(0, count, CHUNK)]
        with ProcessPoolExecutor(chosen.jobs) as pool:
            done = list(pool.map(run, [kind] * len(chunks), [chosen.seed] * len(chunks), chunks))
        wrong = [line for result in done for line in result[1]]
        failed = failed or bool(wrong)
        print(
            f"{kind:<10}{count:>9}{len(wrong):>8}"
            f"{max(result[2] for result in done):>12.2f}{max(result[3] for result in done):>10.0f}"
        )
        for line in wrong[:10]:
            print("   ", line[:300])
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
