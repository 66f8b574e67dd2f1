"""Values of entries that a user writes as text, on the command line or in the studio."""

from btcore.errors import ConversionError
from btcore.json_text import too_deep_at
from btcore.values import ValueType
from btcore.values.numbers import read_json


def value_from_text(text: str, declared: ValueType | None, format: int) -> object:
    """Return the value of a text: as in an attribute of a port, or of an entry without a type.

    Args:
        text: The text. For an entry without a type, it may be JSON; any other text is the value.
        declared: The type of the entry, or None.
        format: The XML format of the tree, 3 or 4.

    Raises:
        ConversionError: The text is not a value of the type, or JSON that is nested too deeply.
    """
    if declared is not None:
        return declared.from_text(text, format)
    try:
        value = read_json(text)
    except ConversionError:
        if text.lstrip().startswith(("[", "{")) and too_deep_at(text) is not None:
            raise
        return text
    return text if value is None else value
