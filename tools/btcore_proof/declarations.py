"""The declarations beside a tree: the models of its leaves, the domains of its entries, and its questions.

`patrol.proof.toml` belongs to `patrol.xml`:

    given = ["goal"]

    [leaves.Move]
    results = ["SUCCESS", "FAILURE"]
    uses = ["base"]

    [entries]
    battery = ["low", "ok"]

    [questions]
    recharges = "{battery} == 'low' leads to Recharge"
"""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from btcore.input_files import read_error, read_file
from btcore.suggestions import did_you_mean
from btcore_proof.leaf_models import ModelError

SUFFIX: Final = ".proof.toml"
MOST_VALUES: Final = 1000
"""The maximum number of values of an entry."""
_TABLES: Final = ("given", "leaves", "entries", "questions")


@dataclass(frozen=True)
class Declarations:
    """What is declared for proofs about a tree.

    Attributes:
        leaves: The declared models of leaves, by ID; see `LeafModel`.
        entries: The texts of the values that an entry may have, by key.
        questions: The questions, by name.
        given: The keys of the entries that the program sets before the first tick.
    """

    leaves: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    entries: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    questions: Mapping[str, str] = field(default_factory=dict)
    given: tuple[str, ...] = ()


def declarations_beside(tree: Path) -> Declarations:
    """Return the declarations in the file beside the file *tree*; empty if there is no such file.

    Raises:
        ModelError: The file cannot be read, or is invalid.
    """
    path = tree.with_suffix(SUFFIX)
    return read_declarations(path) if path.exists() else Declarations()


def read_declarations(path: Path) -> Declarations:
    """Return the declarations in a file.

    Raises:
        ModelError: The file cannot be read, or is invalid.
    """
    try:
        data = tomllib.loads(read_file(path).decode())
    except (OSError, ValueError) as error:
        reason = read_error(error) if isinstance(error, OSError) else error
        raise ModelError(f"{path}: {reason}") from error
    except RecursionError:
        raise ModelError(f"{path}: it is nested too deeply") from None
    try:
        return _declarations(data)
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from error


def _declarations(data: Mapping[str, Any]) -> Declarations:
    for key in data:
        if key not in _TABLES:
            raise ModelError(f"unknown key '{key}'{did_you_mean(key, _TABLES)}")
    leaves = _table(data, "leaves")
    for ID, declared in leaves.items():
        if not isinstance(declared, dict):
            raise ModelError(f"[leaves.{ID}] must be a table")
    questions = _table(data, "questions")
    for name, question in questions.items():
        if not isinstance(question, str):
            raise ModelError(f"[questions] {name} must be a text")
    entries = {key: _texts(f"[entries] {key}", values) for key, values in _table(data, "entries").items()}
    return Declarations(leaves, entries, questions, _texts("given", data.get("given", [])))


def _table(data: Mapping[str, Any], name: str) -> dict[str, Any]:
    table = data.get(name, {})
    if not isinstance(table, dict):
        raise ModelError(f"[{name}] must be a table")
    return table


def _texts(place: str, values: object) -> tuple[str, ...]:
    """Return the texts of a list of values."""
    if not isinstance(values, list) or len(values) > MOST_VALUES:
        raise ModelError(f"{place} must be a list of at most {MOST_VALUES} values")
    texts: list[str] = []
    for value in values:
        if not isinstance(value, (str, int, float)):
            raise ModelError(f"{place}: a value must be a text, a number or a boolean, not {value!r}")
        texts.append(str(value).lower() if isinstance(value, bool) else str(value))
    return tuple(texts)
