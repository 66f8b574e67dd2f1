"""JSON files of worlds and robots, read field by field, so that each mistake is told with its address."""

import json
from pathlib import Path
from typing import Any

from btcore_robot.field_reader import FieldReader, did_you_mean
from btcore_sim.errors import SimError


class JsonRecord(FieldReader):
    """One JSON object of a file; `reject_unknown_fields` refuses the fields that were not read."""

    def __init__(self, data: dict[str, Any], where: str) -> None:
        super().__init__(data)
        self.where = where
        """The file, and the way to this object in it: ``arena.json: objects[2]``."""

    def whole(self, key: str, default: int | None = None) -> int:
        """A whole number of at least 1."""
        value = self._field(key, default)
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            raise self._unexpected(key, value, "a whole number of at least 1")
        return value

    def points(self, key: str) -> dict[str, tuple[float, float]]:
        """An object of points [x, y] by name, empty if the field is missing."""
        value = self._field(key, {})
        if not isinstance(value, dict):
            raise self._unexpected(key, value, "an object of points [x, y]")
        inner = JsonRecord(value, self._inner(key))
        points = {name: inner.numbers(name, [2]) for name in value}
        return {name: (x, y) for name, (x, y) in points.items()}

    def texts(self, key: str) -> list[str]:
        """A list of texts, empty if the field is missing."""
        value = self._field(key, [])
        if not isinstance(value, list) or not all(isinstance(one, str) for one in value):
            raise self._unexpected(key, value, "a list of texts")
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
            what = f"is '{value}', and a colour like '#c8b090' or '#c8b090ff' is expected"
            raise self.mistake(key, what) from None
        return parts[0], parts[1], parts[2], parts[3]

    def record(self, key: str) -> "JsonRecord":
        """A nested object."""
        value = self._field(key, None)
        if not isinstance(value, dict):
            raise self._unexpected(key, value, "an object")
        return JsonRecord(value, self._inner(key))

    def records(self, key: str) -> list["JsonRecord"]:
        """A list of nested objects."""
        value = self._field(key, None)
        if not isinstance(value, list) or not all(isinstance(one, dict) for one in value):
            raise self.error(f"'{key}' is not a list of objects")
        return [JsonRecord(one, self._inner(f"{key}[{index}]")) for index, one in enumerate(value)]

    def reject_unknown_fields(self) -> None:
        """Refuse every field that nobody asked for."""
        for key in self._fields:
            if key not in self._requested:
                hint = did_you_mean(key, self._requested)
                raise self.mistake(
                    key, f"is unknown: {hint}known are {', '.join(dict.fromkeys(self._requested))}"
                )

    def mistake(self, key: str, what: str) -> SimError:
        """A mistake in the field *key*, with its address."""
        return self.error(f"'{key}' {what}")

    def shown(self, value: object) -> str:
        """Return *value* in JSON."""
        return json.dumps(value)

    def error(self, what: str) -> SimError:
        """A mistake in this object, with its address."""
        return SimError(f"{self.where}: {what}")

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
