"""A reader of data files, field by field, that reports each mistake with its place in the file."""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from btcore.input_files import read_file
from btcore.json_text import load_json


def did_you_mean(word: str, names: Iterable[str]) -> str:
    """Return `did you mean 'house'? ` if a name in *names* is similar to *word*, else an empty string."""
    matches = get_close_matches(word, list(names), n=1, cutoff=0.6)
    return f"did you mean '{matches[0]}'? " if matches else ""


def read_text(path: Path, expected: str, error_type: type[Exception]) -> str:
    """Return the text of a file in UTF-8.

    Args:
        path: The file.
        expected: The expected content, for messages: `a YAML file of a map`.
        error_type: The class of the exception for a file that cannot be read.
    """
    try:
        return read_file(path).decode()
    except FileNotFoundError:
        raise error_type(f"{path}: no such file") from None
    except OSError as error:
        raise error_type(f"{path}: cannot read the file: {error.strerror}") from None
    except UnicodeDecodeError:
        raise error_type(f"{path}: not a text file; expected {expected}") from None


def read_json(path: Path, expected: str, error_type: type[Exception]) -> Any:
    """Return the value in a JSON file.

    Args:
        path: The file.
        expected: The expected content, for messages: `a JSON file of a world`.
        error_type: The class of the exception for a file that cannot be read, or is not JSON.
    """
    try:
        return load_json(read_text(path, expected, error_type))
    except json.JSONDecodeError as error:
        raise error_type(f"{path}:{error.lineno}:{error.colno}: not valid JSON: {error.msg}") from None


class FieldReader:
    """Reads the fields of an object in a file by name. A field without a default is required.

    For a missing or invalid field every method raises the exception that `mistake` returns. Subclasses define
    `mistake`, and may override `shown` and `parse_number` for their file format.
    """

    def __init__(self, fields: Mapping[str, Any]) -> None:
        self._fields = fields
        self._requested: list[str] = []

    def mistake(self, key: str, problem: str) -> Exception:
        """Return the exception for a mistake in the field *key*, with its place in the file."""
        raise NotImplementedError

    def shown(self, value: object) -> str:
        """Return *value* as text for error messages."""
        return repr(value)

    def parse_number(self, value: object) -> float | None:
        """Return *value* as a float, or None if it is not a finite number."""
        numeric = isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
        return float(value) if numeric else None  # type: ignore[arg-type]

    def has(self, key: str) -> bool:
        """Return whether the field is present."""
        self._requested.append(key)
        return key in self._fields

    def number(self, key: str, default: float | None = None, *, over: float | None = None) -> float:
        """Return a finite number. If *over* is given, the number must be greater than *over*."""
        value = self._field(key, default)
        number = self.parse_number(value)
        if number is None:
            raise self._unexpected(key, value, "a number")
        if over is not None and not number > over:
            raise self.mistake(key, f"is {value}, and it has to be greater than {over:g}")
        return number

    def numbers(self, key: str, counts: Sequence[int], default: Sequence[float] | None = None) -> list[float]:
        """Return a list of finite numbers whose length is one of *counts*."""
        value = self._field(key, list(default) if default is not None else None)
        numbers = self._parse_numbers(value)
        if numbers is None or len(numbers) not in counts:
            expected = " or ".join(str(count) for count in counts)
            raise self._unexpected(key, value, f"a list of {expected} numbers")
        return numbers

    def rows(
        self, key: str, count: int, default: Sequence[Sequence[float]] | None = None
    ) -> list[list[float]]:
        """Return a list of lists of *count* finite numbers each."""
        value = self._field(key, default)
        parsed = [self._parse_numbers(row) for row in value] if isinstance(value, list) else [None]
        rows = [row for row in parsed if row is not None and len(row) == count]
        if len(rows) < len(parsed):
            raise self._unexpected(key, value, f"a list of lists of {count} numbers")
        return rows

    def text(self, key: str, default: str | None = None, *, among: Sequence[str] = ()) -> str:
        """Return a string. If *among* is given, the string must be in *among*."""
        value = self._field(key, default)
        if not isinstance(value, str):
            raise self._unexpected(key, value, "a text")
        if among and value not in among:
            known = " or ".join(f"'{name}'" for name in among)
            raise self.mistake(key, f"is '{value}': {did_you_mean(value, among)}it has to be {known}")
        return value

    def _field(self, key: str, default: Any) -> Any:
        self._requested.append(key)
        if key in self._fields:
            return self._fields[key]
        if default is None:
            hint = did_you_mean(key, self._fields).strip()
            raise self.mistake(key, f"is missing{f': {hint}' if hint else ''}")
        return default

    def _unexpected(self, key: str, value: object, expected: str) -> Exception:
        return self.mistake(key, f"is {self.shown(value)}, and {expected} is expected")

    def _parse_numbers(self, value: object) -> list[float] | None:
        if not isinstance(value, list):
            return None
        numbers = [self.parse_number(item) for item in value]
        return None if None in numbers else [number for number in numbers if number is not None]
