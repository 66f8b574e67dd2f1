"""Read the nodes that Python source defines, without running the source.

The result is a guess: ports that code computes, such as in `provided_ports`, are found only where they are
written as `Port("name", …)`.
"""

import ast
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from btcore.engine.functions import camel_case
from btcore.errors import ConversionError
from btcore.input_files import read_file, real_path
from btcore.names import is_port_name
from btcore.status import NodeType
from btcore.values import (
    ANY,
    BOOL,
    DOUBLE,
    INT,
    STRING,
    VECTOR_BOOL,
    VECTOR_DOUBLE,
    VECTOR_INT,
    VECTOR_STRING,
    ValueType,
    to_text,
)
from btcore_studio.language.node_models import NodeModel, PortModel

MAX_SOURCE: Final = 2_000_000
"""Maximum size of a Python file that is read (bytes)."""
MAX_IMPORTS: Final = 50
"""Maximum number of files that are read for the nodes of one file."""
_BASES: Final = {
    "SyncAction": NodeType.ACTION,
    "StatefulAction": NodeType.ACTION,
    "ThreadedAction": NodeType.ACTION,
    "CoroutineAction": NodeType.ACTION,
    "LeafNode": NodeType.ACTION,
    "Condition": NodeType.CONDITION,
    "ControlNode": NodeType.CONTROL,
    "DecoratorNode": NodeType.DECORATOR,
    "LoopNode": NodeType.DECORATOR,
}
_MARKS: Final = {"In": "input", "Out": "output", "InOut": "inout", "Put": "output"}
_DECORATORS: Final = {"action": NodeType.ACTION, "condition": NodeType.CONDITION}
_TYPES: Final[dict[str, ValueType]] = {"int": INT, "float": DOUBLE, "str": STRING, "bool": BOOL}
_LISTS: Final = {"int": VECTOR_INT, "float": VECTOR_DOUBLE, "str": VECTOR_STRING, "bool": VECTOR_BOOL}

_Function = ast.FunctionDef | ast.AsyncFunctionDef


def module_file(plugin: str, folders: Sequence[Path]) -> Path | None:
    """Return the file of a node library in *folders*, or None.

    Args:
        plugin: A module, `module:function`, or the path of a Python file.
        folders: The folders that paths and modules are relative to.
    """
    if plugin.endswith(".py"):
        candidates = [plugin]
    else:
        parts = plugin.partition(":")[0].replace(".", "/")
        candidates = [f"{parts}.py", f"{parts}/__init__.py"]
    for folder in [*folders, *([] if folders else [Path()])]:
        for candidate in candidates:
            if (folder / candidate).is_file():
                return real_path(folder / candidate)
    return None


def read_nodes(path: Path, folders: Sequence[Path] = ()) -> tuple[list[NodeModel], set[Path]]:
    """Return the nodes that a Python file defines, and the files that were read.

    Args:
        path: The file.
        folders: The folders in which imported modules with base classes are searched.

    Raises:
        OSError: The file cannot be read.
        SyntaxError: The file is not valid Python, or is too large or too deep.
    """
    module = _parse(path)
    files = {path}
    try:
        return _Reader(module, path, _classes_in(module, path, folders, files)).nodes(), files
    except RecursionError:
        raise SyntaxError("the file is nested too deep") from None


def _parse(path: Path) -> ast.Module:
    """Parse a Python file. Raises OSError or SyntaxError."""
    data = read_file(path, MAX_SOURCE + 1)
    if len(data) > MAX_SOURCE:
        raise SyntaxError(f"the file has more than {MAX_SOURCE:,} bytes")
    try:
        return ast.parse(data, str(path))
    except (RecursionError, MemoryError, ValueError) as error:
        raise SyntaxError(f"the file cannot be read: {error}") from None


def _classes_in(
    module: ast.Module, path: Path, folders: Sequence[Path], files: set[Path]
) -> dict[str, ast.ClassDef]:
    """Return the classes of a module, and those of the modules in *folders* that it imports from."""
    classes: dict[str, ast.ClassDef] = {}
    for item in module.body:
        if isinstance(item, ast.ImportFrom) and len(files) < MAX_IMPORTS:
            start = [path.parents[item.level - 1]] if 0 < item.level <= len(path.parents) else folders
            file = module_file(item.module, start) if item.module and start else None
            if file is not None and file not in files:
                files.add(file)
                with suppress(OSError, SyntaxError):
                    classes |= _classes_in(_parse(file), file, folders, files)
    return classes | {item.name: item for item in module.body if isinstance(item, ast.ClassDef)}


class _Reader:
    def __init__(self, module: ast.Module, path: Path, classes: Mapping[str, ast.ClassDef]) -> None:
        self._path = path
        self._module = module
        self._classes = classes
        # The arguments of calls such as nodes.add(leaf, ID="Leaf"): the given ID by the leaf's name.
        self._added: dict[str, str | None] = {}
        for call in ast.walk(module):
            if isinstance(call, ast.Call) and _name_of(call.func) == "add":
                for argument in call.args:
                    if isinstance(argument, ast.Name):
                        self._added[argument.id] = _keyword_text(call, "ID")

    def nodes(self) -> list[NodeModel]:
        """Return the nodes in the order of the source."""
        found: list[NodeModel] = []
        for item in self._module.body:
            model: NodeModel | None = None
            if isinstance(item, ast.ClassDef):
                model = self._class(item)
            elif isinstance(item, _Function):
                model = self._function(item)
            if model is not None:
                found.append(model)
        return found

    def _class(self, item: ast.ClassDef) -> NodeModel | None:
        parents = self._parents(item)
        names = [_name_of(base) for parent in parents for base in parent.bases]
        kind = next((_BASES[name] for name in names if name in _BASES), None)
        if kind is None or item.name.startswith("_"):
            return None
        ports: dict[str, PortModel] = {}
        for parent in reversed(parents):
            for port in _ports_of_class(parent):
                ports[port.name] = port
        return self._model(item, self._added.get(item.name) or item.name, kind, ports)

    def _parents(self, item: ast.ClassDef) -> list[ast.ClassDef]:
        """Return the class and its known base classes, in the order of their lookup."""
        found: dict[str, ast.ClassDef] = {}
        pending = [item]
        while pending:
            current = pending.pop(0)
            if current.name not in found:
                found[current.name] = current
                names = map(_name_of, current.bases)
                pending += [self._classes[name] for name in names if name in self._classes]
        return list(found.values())

    def _function(self, item: _Function) -> NodeModel | None:
        kind, id = None, None
        for decorator in item.decorator_list:
            call = decorator.func if isinstance(decorator, ast.Call) else decorator
            if _name_of(call) in _DECORATORS:
                kind = _DECORATORS[_name_of(call)]
                id = _keyword_text(decorator, "ID") if isinstance(decorator, ast.Call) else None
        if kind is None and item.name in self._added:
            kind = NodeType.ACTION
        if kind is None:
            return None
        id = self._added.get(item.name) or id or camel_case(item.name)
        return self._model(item, id, kind, {port.name: port for port in _ports_of_function(item)})

    def _model(
        self, item: ast.ClassDef | _Function, id: str, kind: NodeType, ports: Mapping[str, PortModel]
    ) -> NodeModel:
        line = min([item.lineno, *(decorator.lineno for decorator in item.decorator_list)])
        described = ast.get_docstring(item) or ""
        return NodeModel(
            id, kind.name, tuple(ports.values()), described, self._path.stem, str(self._path), line
        )


def _name_of(expression: ast.expr) -> str:
    """Return the last name of `name`, `module.name` or `name[…]`; "" for anything else."""
    if isinstance(expression, ast.Subscript):
        expression = expression.value
    if isinstance(expression, ast.Attribute):
        return expression.attr
    return expression.id if isinstance(expression, ast.Name) else ""


def _keyword_text(call: ast.Call, name: str) -> str | None:
    value = next((keyword.value for keyword in call.keywords if keyword.arg == name), None)
    return _text_of(value)


def _text_of(expression: ast.expr | None) -> str | None:
    """Return the text that is written as *expression*, or None."""
    if isinstance(expression, ast.Constant) and isinstance(expression.value, str):
        return expression.value
    return None


def _unquoted(annotation: ast.expr) -> ast.expr:
    """Return the expression in an annotation that is written as a text."""
    text = _text_of(annotation)
    if text is not None:
        with suppress(SyntaxError, ValueError):
            return ast.parse(text, mode="eval").body
    return annotation


def _ports_of_class(item: ast.ClassDef) -> Iterator[PortModel]:
    for statement in item.body:
        if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
            port = _annotated_port(statement.target.id, statement.annotation, statement.value)
            if port is not None:
                yield port
        elif isinstance(statement, ast.FunctionDef) and statement.name == "provided_ports":
            for call in ast.walk(statement):
                if isinstance(call, ast.Call) and _name_of(call.func) == "Port":
                    yield from _written_port(call)


def _ports_of_function(item: _Function) -> Iterator[PortModel]:
    arguments = item.args
    positional = [*arguments.posonlyargs, *arguments.args]
    missing: list[ast.expr | None] = [None] * (len(positional) - len(arguments.defaults))
    defaults = [*missing, *arguments.defaults, *arguments.kw_defaults]
    for argument, default in zip([*positional, *arguments.kwonlyargs], defaults, strict=True):
        if argument.annotation is not None:
            port = _annotated_port(argument.arg, argument.annotation, default)
            if port is not None:
                yield port


def _annotated_port(name: str, annotation: ast.expr, default: ast.expr | None) -> PortModel | None:
    annotation = _unquoted(annotation)
    description = ""
    if _name_of(annotation) == "Annotated" and isinstance(annotation, ast.Subscript):
        parts = annotation.slice.elts if isinstance(annotation.slice, ast.Tuple) else [annotation.slice]
        description = next((text for part in parts if (text := _text_of(part)) is not None), "")
        annotation = parts[0]
    direction = _MARKS.get(_name_of(annotation))
    if direction is None or not is_port_name(name):
        return None
    inner = annotation.slice if isinstance(annotation, ast.Subscript) else None
    return PortModel(name, direction, _type_name(inner), _default_text(default), description)


def _written_port(call: ast.Call) -> Iterator[PortModel]:
    given = {keyword.arg: keyword.value for keyword in call.keywords}
    given |= dict(zip(("name", "direction", "type", "default", "description"), call.args, strict=False))
    name, direction = _text_of(given.get("name")), given.get("direction")
    if name is not None:
        written = _name_of(direction).lower() if direction is not None else "in"
        yield PortModel(
            name,
            {"in": "input", "out": "output"}.get(written, "inout"),
            default=_default_text(given.get("default")),
            description=_text_of(given.get("description")) or "",
            # The node may check whether a listed output is connected.
            optional="optional" in given or written == "out",
        )


def _type_name(expression: ast.expr | None) -> str:
    """Return the name of the type in `In[…]`; the name of a type that only the program knows is kept."""
    expression = _unquoted(expression) if expression is not None else None
    if isinstance(expression, ast.BinOp):  # T | None
        sides = [side for side in (expression.left, expression.right) if not isinstance(side, ast.Constant)]
        return _type_name(sides[0]) if len(sides) == 1 else ANY.name
    name = _name_of(expression) if expression is not None else ""
    if isinstance(expression, ast.Subscript):
        return _LISTS.get(_name_of(expression.slice), ANY).name if name == "list" else ANY.name
    if name in _TYPES:
        return _TYPES[name].name
    return ANY.name if name in ("", "Any", "object") else name


def _default_text(default: ast.expr | None) -> str | None:
    if default is None:
        return None
    try:
        value = ast.literal_eval(default)
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        return default.attr if isinstance(default, ast.Attribute) else ""
    try:
        return "" if value is None else to_text(value)
    except ConversionError:
        return ""
