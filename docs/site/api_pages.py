"""Write the pages of the API reference: one for each name of btcore, and one for each other public module."""

import re
from pathlib import Path

import griffe

ROOT = Path(__file__).parents[2]
PARENTS = [ROOT, ROOT / "monitor", ROOT / "robot_nodes", ROOT / "ros2", ROOT / "sim", ROOT / "tools"]

# The names of btcore, in the order of the index.
GROUPS = {
    "Loading and ticking trees": ("load", "loads", "make", "Tree", "Subtree", "TreeResource"),
    "Runs and providers": (
        "Run", "RunSettings", "provider", "Settings", "option", "Report", "Resources",
    ),
    "Registering nodes": ("Registry", "condition", "action"),
    "Base classes of nodes": (
        "Condition", "SyncAction", "StatefulAction", "ThreadedAction", "ControlNode", "DecoratorNode",
        "LoopNode", "TreeNode", "NodeSpec",
    ),
    "Coroutines": ("running", "sleep"),
    "Ports and blackboard": (
        "In", "Out", "InOut", "Put", "Port", "Direction", "Blackboard", "Entry", "values",
    ),
    "Statuses and observers": (
        "Status", "SUCCESS", "FAILURE", "RUNNING", "SKIPPED", "IDLE", "NodeType", "Transition", "Transitions",
        "Observer",
    ),
    "Time": ("Clock", "SystemClock", "SimClock"),
    "Trees in code, scripts": ("Builder", "blackboard_key", "compile_script"),
    "Errors": (
        "BtcoreError", "TreeError", "XmlSyntaxError", "UnknownNodeError", "PortError", "ScriptError",
        "ConversionError", "RegistrationError", "NodeError", "NodeExecutionError", "BlackboardError",
        "SettingsError", "ProviderError", "OutputError", "Diagnostic", "LiteralProblem",
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
    return [
        name for name, member in members if not (name.startswith("_") or member.is_alias or member.is_module)
    ]


def summary(described: griffe.Object | griffe.Alias) -> str:
    """Return the first paragraph of a docstring, without its last full stop."""
    docstring = described.docstring
    assert docstring is not None, f"{described.path} has no docstring"
    return docstring.value.split("\n\n")[0].replace("\n", " ").removesuffix(".")


def load_packages() -> griffe.ModulesCollection:
    """Read the source of all packages."""
    loader = griffe.GriffeLoader(search_paths=PARENTS)
    for folder in PARENTS:
        for package in folder.glob("btcore*/__init__.py"):
            loader.load(package.parent.name)
    loader.resolve_aliases(implicit=True)
    return loader.modules_collection


def constants(described: griffe.Object, title: str) -> list[str]:
    """Return a section with a table of the constants that have no docstrings: mkdocstrings hides them."""
    assert described.docstring is not None
    public = public_names(described) if described.is_module else list(described.members)
    listed = re.findall(r"^ {4}(\w+):", described.docstring.value, re.MULTILINE)
    constants = [described.members[name] for name in public if name.isupper() and name not in listed]
    rows = [f"| `{member.name}` | `{member.value}` |" for member in constants if member.docstring is None]
    return ["", f"## {title}", "", "| name | value |", "|---|---|", *rows] if rows else []


def inherited(cls: griffe.Class, public: dict[str, str]) -> list[str]:
    """Return sections with the members that *cls* inherits; *public* are the public classes by path."""
    lines: list[str] = []
    seen = set(cls.members)
    for base in cls.mro():
        members = {
            name: member
            for name, member in base.members.items()
            if not name.startswith("_")
            and not member.is_alias
            and member.docstring is not None
            and name not in seen
        }
        seen |= set(base.members)
        if members and base.path in public:
            target = public[base.path]
            lines += ["", f"## Inherited from {base.name}", ""]
            lines += [
                f"- [`{name}`][{target}.{name}] – {summary(member)}" for name, member in members.items()
            ]
    return lines


def write_api_pages(folder: Path) -> None:
    """Write the pages, their index and their navigation into *folder*."""
    source = load_packages()
    index = ["# Python API", "", "Every public name, with its parameters, units and errors.", ""]
    navigation = ["- [Python API](index.md)"]
    grouped = {name for names in GROUPS.values() for name in names}
    classes = {source[f"btcore.{name}"].canonical_path: f"btcore.{name}" for name in grouped}

    def add(name: str, package: str) -> None:
        title = name.removeprefix(f"{package}.")
        described = source[name].final_target if source[name].is_alias else source[name]
        # Some file systems do not distinguish the pages of Condition and condition.
        suffix = "_function" if title.islower() and title.title() in grouped else ""
        page = f"{title if title in grouped else name}{suffix}.md"
        text = ["---", f"title: {title}", "---", "", f"::: {name}"]
        if described.is_module:
            text += constants(described, "Constants")
            for part in map(described.members.get, public_names(described)):
                if part is not None and part.is_class and any("Enum" in str(base) for base in part.bases):
                    text += constants(part, f"Members of {part.name}")
        elif described.is_class:
            text += inherited(described, classes)
        elif described.is_attribute:
            text += ["    options:", "      show_attribute_values: false"]
        (folder / page).write_text("\n".join([*text, ""]), encoding="utf-8")
        index.append(f"- [`{title}`]({page}) – {summary(described)}")
        navigation.append(f"    - [{title}]({page})")

    folder.mkdir(parents=True)
    navigation.append("- btcore")
    for group, names in GROUPS.items():
        index += [f"## {group}", ""]
        for name in names:
            add(f"btcore.{name}", "btcore")
        index.append("")
    modules = [name for name in public_modules() if name.removeprefix("btcore.") not in grouped | {"btcore"}]
    for package in dict.fromkeys(name.partition(".")[0] for name in modules):
        heading = "Other modules of btcore" if package == "btcore" else package
        index += [f"## {heading}", ""]
        navigation.append(f"- {heading}")
        for name in modules:
            if name.partition(".")[0] == package:
                add(name, package)
        index.append("")
    (folder / "index.md").write_text("\n".join([*index, ""]), encoding="utf-8")
    (folder / "navigation").write_text("\n".join([*navigation, ""]), encoding="utf-8")
