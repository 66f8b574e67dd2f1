"""JSON from files and options is read up to a maximum depth."""

import json

import pytest

from btcore.errors import ConversionError
from btcore.json_text import load_json, too_deep_at
from btcore.values.numbers import read_json

DEEP = "nested more than 100 levels deep"
DEEP_TEXTS = ['{"a":' * 101 + "1" + "}" * 101, "[" * 100_000 + "]" * 100_000, "[" * 100_000]


@pytest.mark.parametrize("text", DEEP_TEXTS, ids=["objects", "arrays", "unclosed"])
def test_deeply_nested_json_is_refused_with_the_place(text: str) -> None:
    with pytest.raises(json.JSONDecodeError, match=DEEP) as caught:
        load_json(text)
    assert text[caught.value.pos] in "[{"
    assert too_deep_at(text) == caught.value.pos


def test_brackets_in_strings_and_beside_each_other_do_not_count() -> None:
    deepest = "[" * 100 + "]" * 100
    texts = [json.dumps(["[{" * 500, "\\", '"[' * 200]), json.dumps([[1]] * 300), deepest]
    assert [load_json(text) for text in texts] == [json.loads(text) for text in texts]


@pytest.mark.parametrize("text", DEEP_TEXTS, ids=["objects", "arrays", "unclosed"])
def test_json_of_a_port_has_a_maximum_depth(text: str) -> None:
    with pytest.raises(ConversionError, match=DEEP):
        read_json(text)
