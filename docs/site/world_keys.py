"""Print the tables of docs/guides/worlds.md: the keys of a world's file, from its JSON schema.

``python docs/site/world_keys.py`` prints the tables. Copy them into the page after a change of the keys.
"""

import json
from collections.abc import Iterator, Mapping
from typing import Any

from btcore.typed_data import json_schema
from btcore_sim.world_description import WorldFile

COMMON = ("name", "position", "yaw", "color", "material")


def tables() -> str:
    """Return the sections with the keys of the file, of all objects, and of each kind."""
    named = json_schema(WorldFile)["$defs"]
    world, start, box = named["WorldFile"], named["Start"], named["Box"]
    world["properties"]["start"] |= {"description": start["description"]}
    common = {key: box["properties"][key] for key in COMMON}
    parts = ["### The file", *_table(world), "### start", start["description"], *_table(start)]
    parts += [
        "### All objects",
        "These keys have the same meaning in every kind, unless its table has another.",
        *_table({"required": ["position"], "properties": common}),
    ]
    for kind, reference in world["properties"]["objects"]["items"]["discriminator"]["mapping"].items():
        entry = named[reference.rpartition("/")[2]]
        keys = entry["properties"].items()
        own = {key: value for key, value in keys if key != "kind" and value != common.get(key)}
        parts += [f"### {kind}", entry["description"], *_table({**entry, "properties": own})]
    return "\n\n".join(parts)


def _table(schema: Mapping[str, Any]) -> Iterator[str]:
    """Yield a table of the keys of *schema*."""
    rows = ["| key | default | meaning |", "|---|---|---|"]
    for key, value in schema["properties"].items():
        default = f"`{json.dumps(value['default'])}`" if "default" in value else ""
        if key in schema.get("required", ()):
            default = "required"
        words = (
            f" {' or '.join(f'`{json.dumps(word)}`' for word in value['enum'])}." if "enum" in value else ""
        )
        rows.append(f"| `{key}` | {default} | {value['description']}{words} |")
    yield "\n".join(rows)


if __name__ == "__main__":
    print(tables())
