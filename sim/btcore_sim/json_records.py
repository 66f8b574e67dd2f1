"""A reader for JSON files of worlds and robots that reports each error with the place in the file."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from btcore_robot.field_reader import FieldReader, did_you_mean, read_json
from btcore_sim.errors import SimError

Value = TypeVar("Value")


class JsonRecord(FieldReader):
    """A JSON object of a file. `read_whole` raises an error for fields that were not read."""

    def __init__(self, data: dict[str, Any], where: str) -> None:
        super().__init__(data)
        self.where = where
        """The file, and the path of this object in it: `arena.json: objects[2]`."""

    def whole(self, key: str, default: int | None = None) -> int:
        """Return an integer of at least 1.

        Args:
            key: The field's name.
            default: The value for a missing field; None if the field is required.

        Raises:
            SimError: The field is missing or has another value.
        """
        value = self._field(key, default)
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            raise self._unexpected(key, value, "a whole number of at least 1")
        return value

    def truth(self, key: str, default: bool) -> bool:
        """Return `true` or `false`.

        Args:
            key: The field's name.
            default: The value for a missing field.

        Raises:
            SimError: The field has another value.
        """
        value = self._field(key, default)
        if not isinstance(value, bool):
            raise self._unexpected(key, value, "true or false")
        return value

    def points(self, key: str) -> dict[str, tuple[float, float]]:
        """Return the points [x, y] of an object, by name; empty if the field is missing.

        Raises:
            SimError: The field has another type.
        """
        value = self._field(key, {})
        if not isinstance(value, dict):
            raise self._unexpected(key, value, "an object of points [x, y]")
        inner = JsonRecord(value, self._inner(key))
        points = {name: inner.numbers(name, [2]) for name in value}
        return {name: (x, y) for name, (x, y) in points.items()}

    def texts(self, key: str) -> list[str]:
        """Return a list of strings, empty if the field is missing.

        Raises:
            SimError: The field has another type.
        """
        value = self._field(key, [])
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            raise self._unexpected(key, value, "a list of strings")
        return value

    def color(self, key: str, default: str) -> tuple[int, int, int, int]:
        """Return a colour as red, green, blue and alpha (0–255).

        Args:
            key: The field's name; its value is `#rrggbb` or `#rrggbbaa`.
            default: The value for a missing field.

        Raises:
            SimError: The field has another form.
        """
        value = self.text(key, default)
        digits = value.removeprefix("#")
        try:
            if not value.startswith("#") or len(digits) not in (6, 8):
                raise ValueError
            parts = bytes.fromhex(digits.ljust(8, "f"))
        except ValueError:
            problem = f"is '{value}', and a colour like '#c8b090' or '#c8b090ff' is expected"
            raise self.mistake(key, problem) from None
        return parts[0], parts[1], parts[2], parts[3]

    def nested(self, key: str, parse: Callable[["JsonRecord"], Value]) -> Value:
        """Return the result of *parse* for a nested object.

        Args:
            key: The field that contains the object.
            parse: Converts the record of the nested object to the result. It must read all fields.

        Raises:
            SimError: The field is missing or has another type, or *parse* does not read all of its fields.
        """
        value = self._field(key, None)
        if not isinstance(value, dict):
            raise self._unexpected(key, value, "an object")
        return JsonRecord(value, self._inner(key)).read_whole(parse)

    def nested_list(self, key: str, parse: Callable[["JsonRecord"], Value]) -> list[Value]:
        """Return the results of *parse* for a list of nested objects, in order.

        Args:
            key: The field that contains the list.
            parse: Converts the record of a nested object to a result. It must read all fields.

        Raises:
            SimError: The field is missing or has another type, or *parse* does not read all of its fields.
        """
        value = self._field(key, None)
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            raise self.error(f"'{key}' is not a list of objects")
        records = [JsonRecord(item, self._inner(f"{key}[{index}]")) for index, item in enumerate(value)]
        return [record.read_whole(parse) for record in records]

    def read_whole(self, parse: Callable[["JsonRecord"], Value]) -> Value:
        """Return the result of *parse*. Raise a `SimError` for a field that *parse* does not read."""
        result = parse(self)
        for key in self._fields:
            if key not in self._requested:
                hint = did_you_mean(key, self._requested)
                raise self.mistake(
                    key, f"is unknown: {hint}known are {', '.join(dict.fromkeys(self._requested))}"
                )
        return result

    def mistake(self, key: str, problem: str) -> SimError:
        """Return an exception for the field *key*; its message contains the place in the file."""
        return self.error(f"'{key}' {problem}")

    def shown(self, value: object) -> str:
        """Return *value* as JSON text, for messages."""
        return json.dumps(value)

    def error(self, problem: str) -> SimError:
        """Return an exception for this object; its message contains the place in the file."""
        return SimError(f"{self.where}: {problem}")

    def _inner(self, step: str) -> str:
        return f"{self.where}.{step}" if ": " in self.where else f"{self.where}: {step}"


def read_record(path: Path, content: str) -> JsonRecord:
    """Read the JSON object in a file.

    Args:
        path: The file.
        content: The content of the file, for messages: `a world` or `a robot`.

    Raises:
        SimError: The file does not exist, is unreadable, or does not contain a JSON object.
    """
    data = read_json(path, f"a JSON file of {content}", SimError)
    if not isinstance(data, dict):
        raise SimError(f"{path}: {content} is a JSON object {{…}}, but this file contains another type")
    return JsonRecord(data, str(path))
