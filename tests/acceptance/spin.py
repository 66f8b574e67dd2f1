"""The model checker spin answers the same questions about small trees as `btcore prove`.

``python tests/acceptance/spin.py`` translates the trees of spin_trees.toml to Promela (promela.py). It asks
spin and `btcore prove` the standard questions and the questions listed with each tree, and exits with 1 if
an answer differs. It needs spin (Debian package `spin`) and gcc; without them nothing is compared.
"""

import argparse
import json
import shutil
import sys
import tomllib
from collections import Counter
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from subprocess import PIPE, STDOUT, run
from tempfile import TemporaryDirectory
from typing import Any

from checkout import environment
from promela import promela
from promela_questions import Translation

TREES = Path(__file__).with_name("spin_trees.toml")
PATIENCE = 300.0
"""How long a program may take (s)."""
DEPTH = 300_000
"""The number of steps of a run that spin searches at most; a longer run is reported as an error."""

Comparison = tuple[str, str, str]
"""A question, and the answers of btcore and of spin."""


def execute(folder: Path, *command: str, codes: tuple[int, ...] = (0,)) -> str:
    """Return what a program prints."""
    done = run(
        command, cwd=folder, env=environment(), stdout=PIPE, stderr=STDOUT, text=True, timeout=PATIENCE
    )
    if done.returncode not in codes:
        raise RuntimeError(f"{' '.join(command)}: {done.stdout[-2000:]}")
    return done.stdout


def answers_of_spin(folder: Path, translation: Translation) -> dict[str, str]:
    """Return the answer to each question."""
    (folder / "tree.pml").write_text(translation.program)
    execute(folder, "spin", "-a", "tree.pml")
    execute(folder, "gcc", "-O0", "-w", "-DNOREDUCE", "-DVECTORSZ=4096", "-o", "pan", "pan.c")

    def holds(formula: str) -> bool:
        printed = execute(folder, "./pan", "-a", f"-m{DEPTH}", "-w18", "-N", formula)
        if "max search depth too small" in printed or "errors: " not in printed:
            raise RuntimeError(printed)
        return "errors: 0" in printed

    answers = {question: all(map(holds, names)) for question, names in translation.proofs.items()}
    for question, names in translation.witnesses.items():
        answers[question] = not any(map(holds, names))
    if translation.runs_forever is not None and holds(translation.runs_forever):
        answers["the tree ends"] = True
    return {question: "proved" if holds else "refuted" for question, holds in answers.items()}


def answers_of_btcore(folder: Path, xml: str, models: str, declarations: str) -> dict[str, str]:
    """Return the answer to each question, except for those that are unknown because a node raises."""
    (folder / "tree.xml").write_text(xml)
    (folder / "models.xml").write_text(models)
    (folder / "tree.proof.toml").write_text(declarations)
    command = (
        sys.executable,
        "-m",
        "btcore",
        "prove",
        "tree.xml",
        "--model",
        "models.xml",
        "--instant-leaves",
        "--json",
    )
    printed = json.loads(execute(folder, *command, codes=(0, 1, 4)))
    return {
        answer["question"]: answer["answer"]
        for answer in printed["questions"]
        if not answer["detail"].startswith("not searched beyond this error")
    }


def xml_of(tree: Mapping[str, Any]) -> str:
    """Return the XML text of a tree and its subtrees."""
    trees = {"Main": tree["tree"], **tree.get("subtrees", {})}
    parts = [f'<BehaviorTree ID="{ID}">{text}</BehaviorTree>' for ID, text in trees.items()]
    return f'<root BTCPP_format="4" main_tree_to_execute="Main">{"".join(parts)}</root>'


def declarations_of(tree: Mapping[str, Any], leaves: Mapping[str, Any]) -> str:
    """Return the declarations of a tree as TOML."""

    def line(key: str, value: object) -> str:
        return f"{key} = {json.dumps(value)}"

    lines: list[str] = []
    for ID, declared in leaves.items():
        lines += [f"[leaves.{ID}]", *(line(key, value) for key, value in declared.items())]
    lines += ["[entries]", *(line(key, value) for key, value in tree.get("entries", {}).items())]
    questions = enumerate(tree.get("questions", []))
    lines += ["[questions]", *(line(f"q{number}", question) for number, question in questions)]
    return "\n".join(lines)


def compared(
    tree: Mapping[str, Any], translation: Translation, models: str, leaves: Mapping[str, Any]
) -> list[Comparison]:
    """Return the answers to all questions about a tree."""
    with TemporaryDirectory() as name:
        spin = answers_of_spin(Path(name), translation)
        btcore = answers_of_btcore(Path(name), xml_of(tree), models, declarations_of(tree, leaves))
    return [(each, answer, spin.get(each, "missing")) for each, answer in btcore.items()]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--trees", type=int, help="the number of trees, from the first; default: all")
    parser.add_argument("--jobs", type=int, default=1, help="the number of trees at the same time")
    parser.add_argument("--verbose", action="store_true", help="print every answer")
    parser.add_argument("--promela", metavar="NAME", help="only print the translation of the tree NAME")
    arguments = parser.parse_args()
    data = tomllib.loads(TREES.read_text())
    trees = data["trees"][: arguments.trees]
    translated = {
        tree["name"]: promela(
            xml_of(tree), data["models"], data["leaves"], tree.get("entries", {}), tree.get("questions", [])
        )
        for tree in trees
    }
    if arguments.promela:
        print(translated[arguments.promela].program)
        return 0
    missing = [program for program in ("spin", "gcc") if shutil.which(program) is None]
    if missing:
        print(
            f"note: without {' and '.join(missing)}, proofs are not compared with spin's; "
            "`apt-get install spin gcc` installs them"
        )
        return 0

    def compare(tree: Mapping[str, Any]) -> list[Comparison]:
        return compared(tree, translated[tree["name"]], data["models"], data["leaves"])

    answers: Counter[str] = Counter()
    wrong = 0
    with ThreadPoolExecutor(arguments.jobs) as pool:
        for tree, rows in zip(trees, pool.map(compare, trees), strict=True):
            for question, btcore, spin in rows:
                answers[spin] += 1
                wrong += btcore != spin
                if arguments.verbose or btcore != spin:
                    print(f"{tree['name']}: {question}: btcore {btcore}, spin {spin}")
    print(
        f"{len(trees)} trees, {answers.total()} questions: spin proved {answers['proved']} and refuted "
        f"{answers['refuted']}; btcore answered {wrong} differently"
    )
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
