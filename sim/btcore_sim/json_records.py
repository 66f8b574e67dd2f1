"""JSON files of worlds and robots, read field by field, so that each mistake is told with its address."""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from btcore_sim.errors import SimError, did_you_mean


class JsonRecord:
    """One JSON object of a file. Fields are read by name; `reject_unknown_fields` refuses all others."""

    def __init__(self, data: dict[str, Any], where: str) -> None:
        self._data = data
        self._asked: list[str] = []
        self.where = where
        """The file, and the way to this object in it: ``arena.json: objects[2]``."""

    def has(self, key: str) -> bool:
        """Whether the field is there."""
        self._asked.append(key)
        return key in self._data

    def number(self, key: str, default: float | None = None, *, over: float | None = None) -> float:
        """A finite number, greater than *over* if that is given."""
        value = self._field(key, default)
        if not _is_number(value):
            raise self.error(f"'{key}' is {json.dumps(value)}, and a number is expected")
        if over is not None and not value > over:
            raise self.error(f"'{key}' is {value}, and it has to be greater than {over:g}")
        return float(value)

    def whole(self, key: str, default: int | None = None) -> int:
        """A whole number of at least 1."""
        value = self._field(key, default)
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            raise self.error(f"'{key}' is {json.dumps(value)}, and a whole number of at least 1 is expected")
        return value

    def numbers(self, key: str, counts: Sequence[int], default: Sequence[float] | None = None) -> list[float]:
        """A list of numbers whose length is one of *counts*."""
        value = self._field(key, list(default) if default is not None else None)
        if not isinstance(value, list) or not all(map(_is_number, value)) or len(value) not in counts:
            wanted = " or ".join(str(count) for count in counts)
            raise self.error(f"'{key}' is {json.dumps(value)}, and a list of {wanted} numbers is expected")
        return [float(one) for one in value]

    def rows(self, key: str, length: int) -> list[list[float]]:
        """A list of lists of *length* numbers each, empty if the field is missing."""
        value = self._field(key, [])
        if not isinstance(value, list) or not all(_is_row(one, length) for one in value):
            raise self.error(f"'{key}' is {json.dumps(value)}, and a list of [{length} numbers] is expected")
        return [[float(part) for part in one] for one in value]

    def points(self, key: str) -> dict[str, tuple[float, float]]:
        """An object of points [x, y] by name, empty if the field is missing."""
        value = self._field(key, {})
        if not isinstance(value, dict):
            raise self.error(f"'{key}' is {json.dumps(value)}, and an object of points [x, y] is expected")
        inner = JsonRecord(value, self._inner(key))
        points = {name: inner.numbers(name, [2]) for name in value}
        return {name: (x, y) for name, (x, y) in points.items()}

    def text(self, key: str, default: str | None = None, *, among: Sequence[str] = ()) -> str:
        """A text, one of *among* if that is given."""
        value = self._field(key, default)
        if not isinstance(value, str):
            raise self.error(f"'{key}' is {json.dumps(value)}, and a text is expected")
        if among and value not in among:
            known = " or ".join(f"'{name}'" for name in among)
            raise self.error(f"'{key}' is '{value}': {did_you_mean(value, among)}it has to be {known}")
        return value

    def texts(self, key: str) -> list[str]:
        """A list of texts, empty if the field is missing."""
        value = self._field(key, [])
        if not isinstance(value, list) or not all(isinstance(one, str) for one in value):
            raise self.error(f"'{key}' is {json.dumps(value)}, and a list of texts is expected")
        return value

    def color(self, key: str, default: str) -> tuple[int, int, int, int]:
        """A colour written ``#rrggbb`` or ``#rrggbbaa``, as four numbers of 0–255."""
        value = self.text(key, default)
        digits = value.removeprefix("#")
        try:
            if not value.startswith("#") or len(digits) not in (6, 8):
                raise ValueError
            parts = bytes.fromhex(digits.ljust(8, "f"))
        except ValueError:
            raise self.error(
                f"'{key}' is '{value}', and a colour like '#c8b090' or '#c8b090ff' is expected"
            ) from None
        return parts[0], parts[1], parts[2], parts[3]

    def record(self, key: str) -> "JsonRecord":
        """A nested object."""
        value = self._field(key, None)
        if not isinstance(value, dict):
            raise self.error(f"'{key}' is {json.dumps(value)}, and an object is expected")
        return JsonRecord(value, self._inner(key))

    def records(self, key: str) -> list["JsonRecord"]:
        """A list of nested objects."""
        value = self._field(key, None)
        if not isinstance(value, list) or not all(isinstance(one, dict) for one in value):
            raise self.error(f"'{key}' is not a list of objects")
        return [JsonRecord(one, self._inner(f"{key}[{index}]")) for index, one in enumerate(value)]

    def reject_unknown_fields(self) -> None:
        """Refuse every field that nobody asked for."""
        for key in self._data:
            if key not in self._asked:
                hint = did_you_mean(key, self._asked)
                raise self.error(
                    f"'{key}' is unknown: {hint}known are {', '.join(dict.fromkeys(self._asked))}"
                )

    def error(self, what: str) -> SimError:
        """A mistake in this object, with its address."""
        return SimError(f"{self.where}: {what}")

    def _field(self, key: str, default: Any) -> Any:
        self._asked.append(key)
        if key in self._data:
            return self._data[key]
        if default is None:
            hint = did_you_mean(key, self._data)
            tail = f": {hint.strip()}" if hint else ""
            raise self.error(f"'{key}' is missing{tail}")
        return default

    def _inner(self, step: str) -> str:
        return f"{self.where}.{step}" if ": " in self.where else f"{self.where}: {step}"


def read_record(path: Path, what: str) -> JsonRecord:
    """The JSON object in the file at *path*, which is *what* (``a world``, ``a robot``) for the reader."""
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise SimError(f"{path}: there is no such file") from None
    except (OSError, UnicodeDecodeError) as fault:
        raise SimError(f"{path}: the file can't be read: {fault}") from None
    try:
        data = json.loads(text)
    except json.JSONDecodeError as fault:
        raise SimError(f"{path}:{fault.lineno}:{fault.colno}: this is not JSON: {fault.msg}") from None
    if not isinstance(data, dict):
        raise SimError(f"{path}: {what} is a JSON object {{…}}, and this is something else")
    return JsonRecord(data, str(path))


def _is_row(value: object, length: int) -> bool:
    return isinstance(value, list) and len(value) == length and all(map(_is_number, value))


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
