"""The server of `btcore mcp`: tools and resources over the Model Context Protocol."""

import inspect
import json
import signal
import sys
import time
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import Any, BinaryIO, Final, NoReturn, TextIO, cast, get_type_hints
from urllib.parse import quote, unquote

import anyio
import anyio.to_thread
import mcp_types as types
from mcp import MCPError
from mcp.server.context import CallNext, HandlerResult, ServerRequestContext
from mcp.server.lowlevel import Server
from mcp.server.mcpserver.utilities.func_metadata import FuncMetadata
from mcp.server.stdio import stdio_server
from pydantic import ValidationError

import btcore
from btcore.documentation_site import FIRST_PAGE
from btcore.escaping import escape_controls
from btcore.input_files import data_folder
from btcore.suggestions import did_you_mean
from btcore_studio.agents.arguments import Arguments
from btcore_studio.agents.command_process import CommandRunner
from btcore_studio.agents.result_size import shorten_text
from btcore_studio.agents.tools import Toolbox
from btcore_studio.served_folder import TREES, RefusedError, ServedFolder

MAX_MESSAGE: Final = 8_000_000
"""The maximum size of a message of the client (bytes)."""
PALETTE: Final = "btcore://palette"
"""The resource with the available nodes."""
DOCUMENTATION: Final = "btcore://docs/"
"""The beginning of the names of resources that are pages of the documentation."""
TREE: Final = "btcore://trees/"
"""The beginning of the names of resources that are trees in the served folder."""

_INSTRUCTIONS: Final = """\
Behavior trees in the XML of BehaviorTree.CPP 4: write, check, simulate and prove them.
Work in a loop: `nodes` lists what trees can use; `validate` reports errors with hints; `prove` finds runs in
which a tree does something wrong, whatever its leaves return; `run` simulates it; `explain_failure` explains
why it failed. Paths are relative to the served folder. Runs are simulated: there is no way to a real robot.
A tree: <root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main"><Sequence name="go there">
<Move goal="{goal}"/></Sequence></BehaviorTree></root>. {goal} is an entry of the blackboard. A leaf without
code is declared in the root by <TreeNodesModel><Action ID="OpenDoor"/></TreeNodesModel>, with `own_models`.
The resource btcore://docs/reference/errors explains the codes of diagnostics.
"""
_READ_ONLY: Final = types.ToolAnnotations(read_only_hint=True, destructive_hint=False, open_world_hint=False)
_LONGEST: Final = 4000

_Context = ServerRequestContext[Any, Any]
_Parameters = types.PaginatedRequestParams | None
_LOGGED: Final = 1000


def create_server(folder: ServedFolder, runner: CommandRunner, log: TextIO) -> Server[Any]:
    """Return the server of a folder.

    Args:
        runner: Runs the commands.
        log: The file for the log of all requests.
    """
    toolbox = Toolbox(folder, runner)
    tools = {function.__name__: _Tool(function) for function in toolbox.tools}

    async def list_tools(ctx: _Context, params: _Parameters) -> types.ListToolsResult:
        return types.ListToolsResult(tools=[tool.description() for tool in tools.values()])

    async def call_tool(ctx: _Context, params: types.CallToolRequestParams) -> types.CallToolResult:
        try:
            if params.name not in tools:
                _refuse(
                    f"there is no tool '{shorten_text(params.name, 100)}'; the tools are {', '.join(tools)}"
                )
            content = await tools[params.name](params.arguments or {})
        except RefusedError as error:
            message = shorten_text(escape_controls(str(error)), _LONGEST)
            return types.CallToolResult(content=[_text(message)], is_error=True)
        return types.CallToolResult(content=[_text(content)] if isinstance(content, str) else content)

    async def list_resources(ctx: _Context, params: _Parameters) -> types.ListResourcesResult:
        trees = await anyio.to_thread.run_sync(folder.files, TREES)
        return types.ListResourcesResult(
            resources=[
                types.Resource(uri=PALETTE, name="palette", description=_PALETTE, mime_type=_XML),
                *(
                    _resource(DOCUMENTATION, name, _MARKDOWN, _heading_of(file))
                    for name, file in documentation_pages().items()
                ),
                *(_resource(TREE, tree, _XML) for tree in trees),
            ]
        )

    async def list_templates(ctx: _Context, params: _Parameters) -> types.ListResourceTemplatesResult:
        path = types.ResourceTemplate(
            uri_template=TREE + "{+path}", name="tree", description=_TREE, mime_type=_XML
        )
        return types.ListResourceTemplatesResult(resource_templates=[path])

    async def read_resource(
        ctx: _Context, params: types.ReadResourceRequestParams
    ) -> types.ReadResourceResult:
        uri = str(params.uri)
        try:
            if uri == PALETTE:
                text, mime = await toolbox.palette(), _XML
            elif uri.startswith(DOCUMENTATION):
                text, mime = _page(unquote(uri.removeprefix(DOCUMENTATION))), _MARKDOWN
            elif uri.startswith(TREE):
                name = unquote(uri.removeprefix(TREE))
                text, mime = await anyio.to_thread.run_sync(folder.read_tree, name), _XML
            else:
                _refuse(f"there is no resource '{shorten_text(uri, 200)}'")
        except RefusedError as error:
            raise MCPError(types.INVALID_PARAMS, escape_controls(str(error))) from None
        contents = types.TextResourceContents(uri=params.uri, text=text, mime_type=mime)
        return types.ReadResourceResult(contents=[contents])

    server: Server[Any] = Server(
        "btcore",
        version=btcore.__version__,
        instructions=_INSTRUCTIONS,
        on_list_tools=list_tools,
        on_call_tool=call_tool,
        on_list_resources=list_resources,
        on_list_resource_templates=list_templates,
        on_read_resource=read_resource,
    )
    server.middleware.append(CallLog(log))
    return server


async def serve_stdio(folder: ServedFolder, runner: CommandRunner, log: TextIO) -> int:
    """Serve a client over stdin and stdout until it closes stdin, or until SIGTERM or Ctrl-C.

    Args:
        runner: Runs the commands.
        log: The file for the log of all requests.

    Returns:
        The signal that ended the server, or 0. After a signal, a thread that waits for stdin may remain.
    """
    server = create_server(folder, runner, log)
    lines = cast("anyio.AsyncFile[str]", _Lines(sys.stdin.buffer))
    received: list[int] = []
    async with anyio.create_task_group() as group:
        if sys.platform != "win32":
            # Without the receiver, the signal would leave the processes of calls behind.
            group.start_soon(_cancel_at_signal, group.cancel_scope, received)
        async with stdio_server(lines) as (read, write):
            await server.run(read, write, server.create_initialization_options())
        group.cancel_scope.cancel()
    return received[0] if received else 0


async def _cancel_at_signal(scope: anyio.CancelScope, received: list[int]) -> None:
    with anyio.open_signal_receiver(signal.SIGTERM, signal.SIGINT) as signals:
        async for number in signals:
            received.append(number)
            scope.cancel()


def documentation_pages() -> dict[str, Path]:
    """Return the files of the pages of the documentation, by name."""
    folder = data_folder("docs")
    pages = sorted(folder.rglob("*.md"))
    return {page.relative_to(folder).with_suffix("").as_posix(): page for page in pages}


_XML: Final = "application/xml"
_MARKDOWN: Final = "text/markdown"
_PALETTE: Final = "The available nodes as a TreeNodesModel, which Groot can import."
_TREE: Final = "An XML file in the served folder."


class _Tool:
    """A tool with its arguments, which are the model in the annotation of its parameter `call`."""

    def __init__(self, function: Callable[..., Awaitable[str | list[types.ContentBlock]]]) -> None:
        self.function = function
        self.model: type[Arguments] = get_type_hints(function)["call"]

    def description(self) -> types.Tool:
        """Return the description for agents."""
        return types.Tool(
            name=self.function.__name__,
            description=inspect.getdoc(self.function),
            input_schema=self.model.model_json_schema(),
            annotations=_READ_ONLY,
        )

    async def __call__(self, arguments: dict[str, Any]) -> str | list[types.ContentBlock]:
        """Return the result of a call.

        Raises:
            RefusedError: An argument is invalid, or the tool refuses the call.
        """
        known = list(self.model.model_fields)
        for name in arguments:
            if name not in known:
                hint = did_you_mean(name[:100], known) or f"; the arguments are {', '.join(known)}"
                _refuse(f"'{self.function.__name__}' has no argument '{shorten_text(name, 100)}'{hint}")
        # Some clients send lists and objects as texts of JSON.
        parsed = FuncMetadata(arg_model=self.model).pre_parse_json(arguments)
        try:
            call = self.model.model_validate(parsed)
        except ValidationError as error:
            places = {
                ".".join(str(part)[:100] for part in item["loc"]): item["msg"] for item in error.errors()
            }
            _refuse("; ".join(f"{place}: {message}" for place, message in list(places.items())[:5]))
        return await self.function(call)


def _refuse(message: str) -> NoReturn:
    raise RefusedError(message)


def _page(name: str) -> str:
    pages = documentation_pages()
    if name not in pages:
        hint = did_you_mean(name[:200], pages) or f"; all pages are at {FIRST_PAGE}"
        _refuse(f"there is no page '{shorten_text(name, 200)}'{hint}")
    return pages[name].read_text(encoding="utf-8")


def _heading_of(page: Path) -> str | None:
    with page.open(encoding="utf-8") as file:
        line = file.readline()
    return line.removeprefix("# ").strip() if line.startswith("# ") else None


def _resource(prefix: str, name: str, mime_type: str, title: str | None = None) -> types.Resource:
    return types.Resource(uri=prefix + quote(name), name=name, title=title, mime_type=mime_type)


def _text(text: str) -> types.TextContent:
    return types.TextContent(type="text", text=text)


class CallLog:
    """A middleware that writes a line of JSON for each request: its parameters, duration and outcome."""

    def __init__(self, file: TextIO) -> None:
        self._file = file

    async def __call__(self, ctx: ServerRequestContext[Any, Any], call_next: CallNext) -> HandlerResult:
        """Let the rest of the server handle a request, and write the line."""
        if ctx.request_id is None:
            return await call_next(ctx)  # a notification
        began = time.monotonic()
        outcome: dict[str, object] = {"outcome": "cancelled"}
        try:
            result = await call_next(ctx)
            outcome = _outcome_of(result)
            return result
        except Exception as error:
            outcome = {"outcome": "error", "message": shorten_text(str(error), _LOGGED)}
            raise
        finally:
            line = {
                "time": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
                "method": shorten_text(ctx.method, _LOGGED),
                "parameters": _bounded(ctx.params or {}),
                "seconds": round(time.monotonic() - began, 3),
                **outcome,
            }
            self._file.write(json.dumps(line) + "\n")
            self._file.flush()


def _outcome_of(result: HandlerResult) -> dict[str, object]:
    """Return whether a request was refused, and the size of the result (characters)."""
    if result is None or isinstance(result, dict):
        data = result or {}
    else:
        data = result.model_dump(mode="json", by_alias=True, exclude_none=True)
    size = {"size": len(json.dumps(data))}
    if not data.get("isError"):
        return {"outcome": "ok", **size}
    return {"outcome": "refused", "message": shorten_text(data["content"][0]["text"], _LOGGED), **size}


def _bounded(parameters: Mapping[str, Any]) -> object:
    """Return parameters for the log: as JSON data, or as the beginning of their text if they are long."""
    named = {key: value for key, value in parameters.items() if key != "_meta"}
    text = json.dumps(named, default=str)
    return named if len(text) <= _LOGGED else shorten_text(text, _LOGGED)


class _Lines:
    """The messages of the client, one in each line. A line that is too long becomes an invalid message."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream

    def __aiter__(self) -> "_Lines":
        return self

    async def __anext__(self) -> str:
        line = await anyio.to_thread.run_sync(self._read, abandon_on_cancel=True)
        if line is None:
            raise StopAsyncIteration
        return line

    def _read(self) -> str | None:
        line = self._stream.readline(MAX_MESSAGE + 1)
        if not line:
            return None
        if len(line) <= MAX_MESSAGE:
            return line.decode(errors="replace")
        while line and not line.endswith(b"\n"):
            line = self._stream.readline(MAX_MESSAGE)
        return f"a message of more than {MAX_MESSAGE:,} bytes"
