"""Write the reference of the command line: a page for each command, from click's objects, and an index."""

import ast
import html
import re
import shlex
import tempfile
import tomllib
from collections.abc import Iterator
from contextlib import chdir
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import click
from click.testing import CliRunner
from mentions import PAGES, links_to_mentions

from btcore import exit_codes
from btcore.cli.main import SHORT_HELP, main
from btcore.field_options import FieldOption

ROOT: Final = Path(__file__).parents[2]
EXAMPLES: Final[dict[str, Any]] = tomllib.loads(
    Path(__file__).with_name("command_examples.toml").read_text(encoding="utf-8")
)
ENVIRONMENT: Final = {"NO_COLOR": "1", "COLUMNS": "96", "PYTHONUTF8": "1"}


def write_command_pages(folder: Path) -> None:
    """Write the pages, their index and their navigation into *folder*."""
    folder.mkdir(parents=True)
    root = click.Context(main, info_name="btcore", **main.context_settings)
    index = ["# Command line", "", *_description(main)[0], "## Commands", ""]
    index += ["| command | |", "|---|---|"]
    navigation = ["- [Command line](index.md)"]
    for page in commands(root):
        (folder / page.file).write_text(page.text(), encoding="utf-8")
        index.append(f"| [`{page.name}`]({page.file}) | {_escaped(page.summary())} |")
        indent = "    " * (page.name.count(" ") - 1)
        group = isinstance(page.command, click.Group)
        entry = page.name.removeprefix("btcore ") if group or not indent else page.name.split()[-1]
        if group:
            navigation += [f"{indent}- {entry}", f"{indent}    - [overview]({page.file})"]
        else:
            navigation.append(f"{indent}- [{entry}]({page.file})")
    (folder / "index.md").write_text(
        "\n".join([*index, "", *_options(main, root), *_exit_codes()]), encoding="utf-8"
    )
    (folder / "navigation").write_text("\n".join([*navigation, ""]), encoding="utf-8")


def commands(context: click.Context) -> "Iterator[CommandPage]":
    """Yield the pages of the commands of a group, and of their subcommands."""
    group = context.command
    assert isinstance(group, click.Group)
    # Without the commands of other distributions that are installed here.
    for name in SHORT_HELP if group is main else group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        inner = click.Context(command, info_name=name, parent=context)
        yield CommandPage(command, inner)
        if isinstance(command, click.Group):
            yield from commands(inner)


class CommandPage:
    """The page of a command.

    Args:
        command: The command.
        context: A context of the command, with the names of the groups to which the command belongs.
    """

    def __init__(self, command: click.Command, context: click.Context) -> None:
        self.command = command
        self.context = context
        self.name = " ".join(_names(context))
        self.file = f"{'-'.join(self.name.split()[1:])}.md"

    def summary(self) -> str:
        """Return the command's line in the help of its group, or the first paragraph of the description."""
        paragraph = " ".join((self.command.help or "").split("\n\n")[0].split())
        line = SHORT_HELP.get(self.name.removeprefix("btcore ")) or self.command.short_help
        return (line or paragraph).removesuffix(".")

    def text(self) -> str:
        """Return the page in Markdown."""
        usage = " ".join([self.name, *self.command.collect_usage_pieces(self.context)])
        lines = [f"---\ntitle: {self.name}\n---\n", f"# {self.name}", "", "```text", usage, "```", ""]
        description, codes = _description(self.command)
        lines += description
        if isinstance(self.command, click.Group):
            lines += ["## Commands", "", "| command | |", "|---|---|"]
            for page in commands(self.context):
                lines.append(f"| [`{page.name}`]({page.file}) | {_escaped(page.summary())} |")
            lines.append("")
        lines += [*self._examples(), *_options(self.command, self.context), *codes]
        return "\n".join([*lines, *self._links()])

    def _examples(self) -> list[str]:
        """Return the examples with their recorded output."""
        example = EXAMPLES.get(self.name.removeprefix("btcore "))
        if example is None:
            return []
        lines = ["## Examples", ""]
        shown = " ".join(example["run"])
        for file, text in EXAMPLES["files"].items():
            if file in shown:
                lines += [f'```xml title="{file}"', text.strip(), "```", ""]
        with tempfile.TemporaryDirectory() as folder, chdir(folder):
            for file, text in EXAMPLES["files"].items():
                Path(file).write_text(text.lstrip(), encoding="utf-8")
            for line in example.get("before", ()):
                _record(line, 0)
            codes = example.get("codes", [0] * len(example["run"]))
            for line, code in zip(example["run"], codes, strict=True):
                lines += ["```console", f"$ btcore {line}", *_record(line, code).splitlines(), "```", ""]
        return lines

    def _links(self) -> list[str]:
        """Return links to the pages that mention the command."""
        pattern = re.compile(rf"{re.escape(self.name)}(?![\w-])")
        links = links_to_mentions({page: len(pattern.findall(text)) for page, text in PAGES.items()})
        return ["## See also", "", *links, ""] if links else []


def _names(context: click.Context) -> Iterator[str]:
    if context.parent is not None:
        yield from _names(context.parent)
    yield str(context.info_name)


def _record(line: str, code: int) -> str:
    """Run a command, and return its output. Raise RuntimeError if it does not exit with *code*."""
    result = CliRunner().invoke(main, shlex.split(line), env=ENVIRONMENT, prog_name="btcore")
    if result.exit_code != code:
        raise RuntimeError(f"btcore {line} exits with {result.exit_code}:\n{result.output}")
    return re.sub(r"[ \t]+$", "", result.output, flags=re.MULTILINE).strip("\n")


def _description(command: click.Command) -> tuple[list[str], list[str]]:
    """Return the paragraphs of the help text, and a table of its exit codes."""
    lines: list[str] = []
    codes: list[str] = []
    for paragraph in (command.help or "").split("\n\n"):
        if not paragraph.strip().startswith("\b"):
            lines += [_escaped(" ".join(paragraph.split())), ""]
            continue
        title, *rows = paragraph.strip().lstrip("\b\n ").splitlines()
        codes += [f"## {title.strip().removesuffix(':')}", "", "| code | |", "|---|---|"]
        for row in rows:
            number, _, meaning = row.strip().partition(" ")
            codes.append(f"| {number} | {_escaped(meaning.strip())} |")
        codes.append("")
    return lines, codes


def _options(command: click.Command, context: click.Context) -> list[str]:
    """Return tables of the options: those of the command, and those of each package that adds options."""
    tables: dict[str, list[str]] = {}
    for option in command.get_params(context):
        if isinstance(option, click.Option) and not option.hidden:
            record = option.get_help_record(context)
            assert record is not None
            is_added = isinstance(option, FieldOption) and option not in command.params
            package = option.options_class.__module__.partition(".")[0] if is_added else "btcore"
            title = "Options" if package == "btcore" else f"Options of {package}"
            # As HTML, because a table in Markdown would show the escape before a | in code.
            name = html.escape(record[0]).replace("|", "&#124;")
            tables.setdefault(title, []).append(f"| <code>{name}</code> | {_about(option, context)} |")
    lines = []
    for title, rows in sorted(tables.items()):
        lines += [f"## {title}", "", "| option | |", "|---|---|", *rows, ""]
    return lines


def _about(option: click.Option, context: click.Context) -> str:
    """Return the description of an option, its default, its range and its environment variable."""
    extra = option.get_help_extra(context)
    # Some help texts explain a default that depends on other options.
    described, _, default = (option.help or "").partition("  [")
    parts = [_escaped(described)]
    if default:
        name, _, value = default.removesuffix("]").partition(": ")
        parts.append(f"{name.capitalize()}: {_escaped(value)}.")
    elif "default" in extra:
        parts.append(f"Default: `{extra['default']}`.")
    if "range" in extra:
        parts.append(f"Range: `{extra['range']}`.")
    if option.envvar and str(option.envvar) not in (option.help or ""):
        parts.append(f"Environment variable: `{option.envvar}`.")
    if option.multiple and not re.search("epeatable|several times|twice", option.help or ""):
        parts.append("Repeatable.")
    if option.required:
        parts.append("Required.")
    return " ".join(parts)


def _escaped(text: str) -> str:
    """Return a text of click as Markdown: options and commands become code."""
    parts = re.split(r"(`[^`]*`)", re.sub(r"'(btcore [^']*)'", r"`\1`", text))
    for index in range(0, len(parts), 2):
        escaped = re.sub(r"([*_<\[\]])", r"\\\1", parts[index])
        parts[index] = re.sub(r"(?<![\w-])(--?[a-z][\w-]*)", r"`\1`", escaped)
    return "".join(parts).replace("|", "\\|")


def _exit_codes() -> list[str]:
    """Return a table of the exit codes, with the descriptions in the source."""
    source = ast.parse(Path(exit_codes.__file__).read_text(encoding="utf-8"))
    (body,) = [node.body for node in source.body if isinstance(node, ast.ClassDef)]
    about = {"SUCCESS": "Success."}
    for member, docstring in pairwise(body):
        if isinstance(member, ast.Assign) and isinstance(docstring, ast.Expr):
            (target,) = member.targets
            about[ast.unparse(target)] = " ".join(ast.literal_eval(docstring.value).split())
    lines = ["## Exit codes", "", "| code | |", "|---|---|"]
    lines += [f"| {int(code)} | {_escaped(about[code.name])} |" for code in exit_codes.ExitCode]
    return [*lines, ""]
