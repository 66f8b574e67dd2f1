"""The generated pages of the reference, of nodes and commands, which docs/site/build_site.py writes."""

import contextlib
import inspect
import itertools
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from btcore import NodeExecutionError, NodeType, Registry, Status
from btcore.testing import Harness

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "docs" / "site"))

for module in ("numpy", "cv2", "yaml", "zmq", "msgpack", "pybullet"):
    pytest.importorskip(module, reason="the pages describe the nodes and commands of all packages")

import node_examples  # noqa: E402
import node_pages  # noqa: E402
from command_pages import SHORT_HELP, main, write_command_pages  # noqa: E402

NODES = node_examples.all_nodes()
CASES = [(id, format) for format in (4, 3) for id in sorted(node_examples.EXAMPLES) if NODES.get(id, format)]


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The generated pages, in their folders."""
    folder = tmp_path_factory.mktemp("reference")
    node_pages.write_node_pages(folder / "nodes")
    write_command_pages(folder / "commands")
    return folder


def linked(page: Path) -> list[str]:
    return re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text(encoding="utf-8"))


def test_every_node_has_a_page_and_is_in_the_index_and_the_navigation_once(pages: Path) -> None:
    ids = {*NODES.manifests_of(3), *NODES.manifests_of(4)}
    assert len(ids) > 120
    listed = sorted([*(f"{id}.md" for id in ids), "index.md"])
    assert sorted(page.name for page in (pages / "nodes").glob("*.md")) == listed
    assert sorted(linked(pages / "nodes" / "navigation")) == listed
    for id in ids:
        assert linked(pages / "nodes" / "index.md").count(f"{id}.md") == 1


def test_the_class_of_a_node_says_what_the_node_is_or_does() -> None:
    """The description of a class begins with an article, a status or a verb in the third person."""
    manifests = [*NODES.manifests_of(3).values(), *NODES.manifests_of(4).values()]
    descriptions = {item.id: item.description for item in manifests if item.function is None}
    described = re.compile(r"(An?|The|SUCCESS|FAILURE|RUNNING|SKIPPED|[A-Z][a-z]*s)\b")
    assert [id for id, text in descriptions.items() if not described.match(text)] == []


def test_every_command_has_a_page_and_is_in_the_index_and_the_navigation_once(pages: Path) -> None:
    def files(group: click.Group, prefix: str) -> Iterator[str]:
        context = click.Context(group)
        for name in SHORT_HELP if group is main else group.list_commands(context):
            yield f"{prefix}{name}.md"
            command = group.get_command(context, name)
            if isinstance(command, click.Group):
                yield from files(command, f"{prefix}{name}-")

    listed = sorted([*files(main, ""), "index.md"])
    assert {"run", "hook-break", "book-hello"} <= {Path(name).stem for name in listed}
    assert sorted(page.name for page in (pages / "commands").glob("*.md")) == listed
    assert sorted(linked(pages / "commands" / "navigation")) == listed
    assert sorted(linked(pages / "commands" / "index.md")) == sorted(set(listed) - {"index.md"})


def test_the_names_of_pages_differ_in_more_than_capital_letters(pages: Path) -> None:
    for folder in pages.iterdir():
        names = [page.name.lower() for page in folder.iterdir()]
        assert len(names) == len(set(names))


def test_files_that_the_pages_link_to_exist(pages: Path) -> None:
    dead = []
    for page in pages.rglob("*.md"):
        for link in linked(page):
            written = Path(os.path.normpath(ROOT / "docs" / "reference" / page.parent.name / link))
            # docs/site/build_site.py checks the links to pages of the API, which the tests do not generate.
            generated = (page.parent / link).exists() or link.startswith("../api/")
            if "://" not in link and not generated and not written.exists():
                dead.append(f"{page.name}: {link}")
    assert dead == []


def test_every_option_of_a_command_is_on_its_page(pages: Path) -> None:
    run, index = (
        (pages / "commands" / f"{name}.md").read_text(encoding="utf-8") for name in ("run", "index")
    )
    assert "<code>--until [done&#124;success&#124;failure&#124;never]</code>" in run
    assert "## Options of btcore_sim" in run
    assert "Default: `10.0`. Range: `0<x<=10000`." in run
    assert "| 3 | a leaf raised an exception" in run
    assert "$ btcore run fetch.xml" in run
    assert "Environment variable: `BTCORE_MAX_FILE_SIZE`." in index


def test_the_value_of_an_option_has_a_name(pages: Path) -> None:
    unnamed = re.compile(r"<code>-[^<]* (INTEGER|FLOAT|TEXT|PATH|FILENAME)[ <]")
    found = [
        page.name for page in (pages / "commands").glob("*.md") if unnamed.search(page.read_text("utf-8"))
    ]
    assert found == []


def test_every_built_in_node_has_an_example() -> None:
    built_in = {(id, format) for format in (3, 4) for id in Registry.standard().manifests_of(format)}
    assert built_in - set(CASES) == set()
    assert [id for id in node_examples.EXAMPLES if not NODES.get(id, 3) and not NODES.get(id, 4)] == []


def test_differences_between_the_formats_are_on_the_page(pages: Path) -> None:
    expected = {
        "Switch6": ': case_1="1" is compared as a number too',
        "Repeat": "#c201--one-cycle-per-tick): a child of `<Repeat>` that succeeds immediately",
        "SequenceStar": "replaces it by [`SequenceWithMemory`](",
        "SequenceWithMemory": "Its counterparts there: [`SequenceStar`](",
        "Delay": "The node is the same.",
    }
    for id, text in expected.items():
        assert text in (pages / "nodes" / f"{id}.md").read_text(encoding="utf-8")


def test_a_table_of_ticks_shows_results_halts_entries_and_the_time() -> None:
    assert node_examples.example("Switch2", 4, NODES).table() == [
        "| tick | 1 | 2 | 3 | 4 |",
        "|---|:-:|:-:|:-:|:-:|",
        f"| `Switch2` | {label('RUNNING')} | {label('RUNNING')} | {label('SUCCESS')} | {label('FAILURE')} |",
        f"| &nbsp;&nbsp;&nbsp;`Patrol` | {label('RUNNING')} | {label('halted')} | – | – |",
        f"| &nbsp;&nbsp;&nbsp;`Clean` | – | {label('RUNNING')} | {label('SUCCESS')} | – |",
        f"| &nbsp;&nbsp;&nbsp;`Wait` | – | – | – | {label('FAILURE')} |",
        "| `{floor}` | `1` | `2` |  | `3` |",
    ]
    timeout = node_examples.example("Timeout", 4, NODES).table()
    assert timeout[2] == "| time | 0 ms | 100 ms | 200 ms | 300 ms | 400 ms | 500 ms |"
    assert timeout[3].split(" | ")[3:5] == [label("RUNNING"), label("FAILURE")]
    repeat = node_examples.example("Repeat", 3, NODES).table()
    assert repeat[3].count('<span class="status success">SUCCESS ×3</span>') == 3


def label(status: str) -> str:
    return f'<span class="status {status.lower()}">{status}</span>'


@pytest.mark.parametrize(("id", "format"), CASES)
def test_a_node_returns_exactly_the_results_on_its_page(id: str, format: int) -> None:
    """The leaves of the example return all combinations of results, and ports with a status all statuses."""
    manifest = NODES.get(id, format)
    assert manifest is not None
    example = node_examples.example(id, format, NODES)
    seen: set[Status] = set()
    for harness in harnesses(example, format):
        # Some nodes reject a skipped child.
        with contextlib.suppress(NodeExecutionError):
            example.tick(harness, max(6, example.fields["ticks"]))
        for node in harness.tree:
            if node.id == id:
                path = next(path for path, it in harness.tree.nodes_by_path().items() if it is node)
                seen.update(harness.trace.results(path))
    assert seen == set(node_pages.possible_statuses(manifest, format))


def harnesses(example: node_examples.NodeExample, format: int) -> Iterator[Harness]:
    """Yield harnesses for the tree of *example*, with varied results of leaves and varied ports."""
    yield example.harness()
    manifest = example.nodes.get(example.id, format)
    assert manifest is not None
    conditions = example.fields.get("conditions", {})
    leaves = [*example.fields.get("actions", {}), *conditions]
    at_once = ["S", "F", *(["K"] if format == 4 else [])]
    results = [
        at_once if leaf in conditions else [*at_once, *(f"R{end}" for end in at_once)] for leaf in leaves
    ]
    for letters in itertools.product(*results[:2]):
        yield example.harness(**dict(zip(leaves, letters, strict=False)))
    for letter in at_once:
        yield example.harness(**dict.fromkeys(leaves, letter))
    for port in manifest.ports.values():
        if port.type.name.endswith("NodeStatus"):
            for status in ("FAILURE", "SKIPPED") if format == 4 else ("FAILURE", "SUCCESS"):
                without = re.sub(rf' {port.name}="\w+"', "", re.sub(r"</?root[^>]*>", "", example.xml))
                xml = without.replace(f"<{example.id}", f'<{example.id} {port.name}="{status}"')
                fields = {**example.fields, "xml" if format == 4 else "xml3": xml}
                other = node_examples.NodeExample(example.id, format, NODES, fields)
                yield other.harness(**dict.fromkeys(leaves, "S"))


def test_no_leaf_of_the_robot_returns_skipped() -> None:
    """node_pages.possible_statuses() leaves SKIPPED out for these leaves, whose classes do not declare it."""
    for manifest in NODES.manifests.values():
        if manifest.library != "btcore" and manifest.type in (NodeType.ACTION, NodeType.CONDITION):
            source = inspect.getsource(manifest.function or manifest.cls)
            assert re.search(r"(?<!WaypointState\.)\bSKIPPED\b", source) is None, manifest.id
            assert Status.SKIPPED not in node_pages.possible_statuses(manifest, 4)
