"""The JSON schema of worlds: its keys, required keys and defaults are those of worlds' files."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from btcore_sim.errors import SimError
from btcore_sim.world_description import KINDS, SCHEMA, WORLD_FILES, world_names
from btcore_sim.worlds import load_world_description

WORLD: dict[str, Any] = json.loads(SCHEMA.read_text(encoding="utf-8"))
DEFS = WORLD["$defs"]
EXAMPLES = {kind: DEFS[kind]["examples"][0] for kind in KINDS}


def problems(schema: dict[str, Any], value: Any, where: str = "") -> list[str]:
    """Return the violations of *schema* by *value*: the keywords of JSON Schema that our schema uses."""
    if "$ref" in schema:
        return problems(DEFS[schema["$ref"].removeprefix("#/$defs/")], value, where)
    known = {"$schema", "title", "description", "default", "examples", "$defs"} | {
        *("type", "const", "enum", "pattern", "minimum", "exclusiveMinimum", "minItems", "maxItems"),
        *("items", "required", "properties", "additionalProperties", "oneOf"),
    }
    assert set(schema) <= known, f"{where}: extend this test by {set(schema) - known}"
    kinds = {"object": dict, "array": list, "string": str, "boolean": bool, "integer": int}
    kind = schema.get("type")
    numeric = isinstance(value, int | float) and not isinstance(value, bool)
    if kind and not (numeric if kind in ("number", "integer") else isinstance(value, kinds[kind])):
        return [f"{where}: {value!r} is not a {kind}"]
    found: list[str] = []
    if "const" in schema and value != schema["const"]:
        found.append(f"{where}: {value!r} is not {schema['const']!r}")
    if "enum" in schema and value not in schema["enum"]:
        found.append(f"{where}: {value!r} is not in {schema['enum']}")
    if "pattern" in schema and not re.search(schema["pattern"], value):
        found.append(f"{where}: {value!r} does not match {schema['pattern']}")
    if "minimum" in schema and value < schema["minimum"]:
        found.append(f"{where}: {value!r} is too small")
    if "exclusiveMinimum" in schema and value <= schema["exclusiveMinimum"]:
        found.append(f"{where}: {value!r} is too small")
    if isinstance(value, list):
        if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value)):
            found.append(f"{where}: {len(value)} items")
        for index, item in enumerate(value):
            found += problems(schema.get("items", {}), item, f"{where}[{index}]")
    if isinstance(value, dict):
        found += [f"{where}: {key} is missing" for key in schema.get("required", ()) if key not in value]
        others = schema.get("additionalProperties", {})
        for key, item in value.items():
            inner = schema.get("properties", {}).get(key, others)
            if inner is False:
                found.append(f"{where}: {key} is unknown")
            else:
                found += problems(inner, item, f"{where}.{key}")
    if "oneOf" in schema:
        tried = [problems(option, value, where) for option in schema["oneOf"]]
        if sum(not option for option in tried) != 1:
            found += min(tried, key=len) or [f"{where}: fits several kinds"]
    return found


def load(folder: Path, **world: Any) -> Any:
    path = folder / "mine.json"
    path.write_text(json.dumps({"start": {"pose": [0, 0, 0]}, "objects": [], **world}))
    return load_world_description(str(path))


def keys_read(folder: Path, **world: Any) -> set[str]:
    """Return the keys that the reader lists in its error about the unknown key `zzz`."""
    with pytest.raises(SimError, match="'zzz' is unknown") as caught:
        load(folder, **world)
    return set(str(caught.value).rpartition("known are ")[2].split(", "))


@pytest.mark.parametrize("name", world_names())
def test_every_world_of_the_package_fits_the_schema(name: str):
    assert problems(WORLD, json.loads((WORLD_FILES / f"{name}.json").read_text(encoding="utf-8"))) == []


def test_the_lobby_has_an_object_of_every_kind_and_glass():
    objects = json.loads((WORLD_FILES / "lobby.json").read_text(encoding="utf-8"))["objects"]
    assert {thing["kind"] for thing in objects} == set(KINDS)
    assert "glass" in {thing.get("material") for thing in objects}


def test_the_schema_refuses_what_the_reader_refuses(tmp_path: Path):
    crate = EXAMPLES["box"]
    for changes in (
        {"kind": "bx"},
        {"sice": 1},
        {"size": [1, 1]},
        {"size": [1, 0, 1]},
        {"color": "red"},
        {"mass": -1},
    ):
        world = {"start": {"pose": [0, 0, 0]}, "objects": [{**crate, **changes}]}
        assert problems(WORLD, world) != [], changes
        with pytest.raises(SimError):
            load(tmp_path, **world)


@pytest.mark.parametrize("kind", KINDS)
def test_the_schema_has_the_keys_the_requirements_and_the_defaults_of_the_reader(tmp_path: Path, kind: str):
    schema, example = DEFS[kind], EXAMPLES[kind]
    assert problems(schema, example) == []
    assert set(schema["properties"]) == keys_read(tmp_path, objects=[{**example, "zzz": 1}])
    needed = {key: example[key] for key in schema["required"]}
    (*found,) = load(tmp_path, objects=[needed]).objects
    for key in schema["required"]:
        with pytest.raises(SimError, match=f"'{key}' is missing"):
            load(tmp_path, objects=[{name: value for name, value in needed.items() if name != key}])
    properties = {
        key: DEFS[value["$ref"].rpartition("/")[2]] if "$ref" in value else value
        for key, value in schema["properties"].items()
    }
    defaults = {key: value["default"] for key, value in properties.items() if "default" in value}
    assert list(load(tmp_path, objects=[{**defaults, **needed}]).objects) == found


def test_the_schema_has_the_keys_of_the_whole_file_and_of_the_start(tmp_path: Path):
    assert {ref["$ref"] for ref in WORLD["properties"]["objects"]["items"]["oneOf"]} == {
        f"#/$defs/{kind}" for kind in KINDS
    }
    assert set(WORLD["properties"]) == keys_read(tmp_path, zzz=1)
    area = {"area": [-1, -1, 1, 1], "zzz": 1}
    assert set(WORLD["properties"]["start"]["properties"]) == keys_read(tmp_path, start=area)
    defaults = {key: value["default"] for key, value in WORLD["properties"].items() if "default" in value}
    assert load(tmp_path, **defaults) == load(tmp_path)
