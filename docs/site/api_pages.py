"""Write the pages of the API reference: one for each name of btcore, and one for each other public module."""

import re
from pathlib import Path

import griffe

ROOT = Path(__file__).parents[2]
PARENTS = [ROOT, ROOT / "monitor", ROOT / "robot_nodes", ROOT / "sim"]

# The names of btcore, in the order of the index.
GROUPS = {
    "Loading and ticking trees": (
        "load", "loads", "make", "Tree", "Subtree", "TreeState", "required_resources",
    ),
    "Registering nodes": ("Registry", "condition", "action"),
    "Base classes of nodes": (
        "Condition", "SyncAction", "StatefulAction", "ThreadedAction", "ControlNode", "DecoratorNode",
        "LoopNode", "TreeNode",
    ),
    "Coroutines": ("running", "sleep"),
    "Ports and blackboard": (
        "In", "Out", "InOut", "Put", "Port", "Direction", "Blackboard", "Entry", "values",
    ),
    "Statuses and observers": ("Status", "NodeType", "Transition", "Transitions", "Observer"),
    "Time": ("Clock", "SystemClock", "SimClock"),
    "Trees in code, scripts": ("Builder", "blackboard_key", "compile_script"),
    "Errors": (
        "BtcoreError", "TreeError", "XmlSyntaxError", "UnknownNodeError", "PortError", "ScriptError",
        "ConversionError", "RegistrationError", "NodeError", "NodeExecutionError", "BlackboardError",
        "Diagnostic",
    ),
    "Builds": ("builds",),
}  # fmt: skip


def public_modules() -> list[str]:
    """Return the public modules of docs/reference/public_api.md, in its order."""
    page = (ROOT / "docs/reference/public_api.md").read_text(encoding="utf-8")
    cells = re.findall(r"^\| (`btcore.*?) \|", page, re.MULTILINE)
    return [name for cell in cells for name in re.findall(r"`([\w.]+)`", cell)]


def public_names(module: griffe.Module) -> list[str]:
    """Return the public names of *module*: `__all__`, or the names that the module itself defines."""
    if module.exports is not None:
        return [str(name) for name in module.exports]
    members = module.members.items()
    return [name for name, it in members if not (name.startswith("_") or it.is_alias or it.is_module)]


def summary(described: griffe.Object | griffe.Alias) -> str:
    """Return the first sentence of a docstring, without its last full stop."""
    docstring = described.docstring
    assert docstring is not None, f"{described.path} has no docstring"
    return docstring.value.split("\n\n")[0].replace("\n", " ").replace("|", "\\|").removesuffix(".")


def load_packages() -> griffe.ModulesCollection:
    """Read the source of all packages."""
    loader = griffe.GriffeLoader(search_paths=PARENTS)
    for package in ("btcore", "btcore_monitor", "btcore_robot", "btcore_scene", "btcore_sim"):
        loader.load(package)
    loader.resolve_aliases(implicit=True)
    return loader.modules_collection


def write_api_pages(folder: Path) -> None:
    """Write the pages, their index and their navigation into *folder*."""
    source = load_packages()
    index = ["# Python API", "", "Every public name, with its parameters, units and errors.", ""]
    navigation = ["- [Python API](index.md)", "- btcore"]

    def add(name: str, level: int) -> None:
        title = name.removeprefix("btcore.") if level else name
        # Some file systems do not distinguish the pages of Condition and condition.
        suffix = "_function" if title.islower() and title.title() in grouped else ""
        page = f"{title}{suffix}.md"
        (folder / page).write_text(f"---\ntitle: {title}\n---\n\n::: {name}\n", encoding="utf-8")
        index.append(f"| [`{title}`]({page}) | {summary(source[name])} |")
        navigation.append(f"{'    ' * level}- [{title}]({page})")

    grouped = {name for names in GROUPS.values() for name in names}
    folder.mkdir(parents=True)
    for group, names in GROUPS.items():
        index += [f"## {group}", "", "| name | |", "|---|---|"]
        for name in names:
            add(f"btcore.{name}", 1)
        index.append("")
    index += ["## Other modules", "", "| module | |", "|---|---|"]
    for name in public_modules():
        if name != "btcore" and name.removeprefix("btcore.") not in grouped:
            add(name, 0)
    (folder / "index.md").write_text("\n".join([*index, ""]), encoding="utf-8")
    (folder / "navigation").write_text("\n".join([*navigation, ""]), encoding="utf-8")
