"""Print the tables of docs/guides/worlds.md: the keys of a world's file, from its JSON schema.

``python docs/site/world_keys.py`` prints the tables. Copy them into the page after a change of the schema.
"""

import json
from collections.abc import Iterator, Mapping
from typing import Any

from btcore_sim.world_description import KINDS, SCHEMA

COMMON = ("name", "position", "yaw", "color", "material")


def tables() -> str:
    """Return the sections with the keys of the file, of all objects, and of each kind."""
    schema = json.loads(SCHEMA.read_text(encoding="utf-8"))
    named = schema["$defs"]
    parts = ["### The file", *_table(schema, named)]
    parts += [
        "### start",
        schema["properties"]["start"]["description"],
        *_table(schema["properties"]["start"], named),
    ]
    parts += [
        "### All objects",
        "These keys have the same meaning in every kind, unless its table has another.",
    ]
    parts += _table({"required": ["position"], "properties": {key: named[key] for key in COMMON}}, named)
    for kind in KINDS:
        parts += [
            f"### {kind}",
            named[kind]["description"],
            *_table(named[kind], named, but=("kind", *COMMON)),
        ]
    return "\n\n".join(parts)


def _table(schema: Mapping[str, Any], named: Mapping[str, Any], but: tuple[str, ...] = ()) -> Iterator[str]:
    """Yield a table of the keys of *schema*. Keys in *but* are left out if they refer to *named*."""
    rows = ["| key | default | meaning |", "|---|---|---|"]
    for key, value in schema["properties"].items():
        inner = {**named.get(value.get("$ref", "").rpartition("/")[2], {}), **value}
        if key in but and ("$ref" in value or "const" in value):
            continue
        default = f"`{json.dumps(inner['default'])}`" if "default" in inner else ""
        if key in schema.get("required", ()):
            default = "required"
        words = (
            f" {' or '.join(f'`{json.dumps(word)}`' for word in inner['enum'])}." if "enum" in inner else ""
        )
        rows.append(f"| `{key}` | {default} | {inner['description']}{words} |")
    yield "\n".join(rows)


if __name__ == "__main__":
    print(tables())
