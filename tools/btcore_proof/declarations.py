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
from typing import Annotated, Any, Final

import msgspec
from msgspec import Meta

from btcore.input_files import read_error, read_file
from btcore.typed_data import Record, convert
from btcore_proof.leaf_models import ModelError

SUFFIX: Final = ".proof.toml"
MAX_VALUES: Final = 1000
"""The maximum number of values of an entry."""
_Values = Annotated[tuple[str | bool | int | float, ...], Meta(max_length=MAX_VALUES)]


class _DeclarationFile(Record):
    given: _Values = ()
    leaves: dict[str, dict[str, Any]] = msgspec.field(default_factory=dict)
    entries: dict[str, _Values] = msgspec.field(default_factory=dict)
    questions: dict[str, str] = msgspec.field(default_factory=dict)


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
        file = convert(tomllib.loads(read_file(path).decode()), _DeclarationFile)
    except (OSError, ValueError) as error:
        reason = read_error(error) if isinstance(error, OSError) else error
        raise ModelError(f"{path}: {reason}") from error
    except RecursionError:
        raise ModelError(f"{path}: it is nested too deeply") from None
    entries = {key: _texts(values) for key, values in file.entries.items()}
    return Declarations(file.leaves, entries, file.questions, _texts(file.given))


def _texts(values: _Values) -> tuple[str, ...]:
    return tuple(str(value).lower() if isinstance(value, bool) else str(value) for value in values)
