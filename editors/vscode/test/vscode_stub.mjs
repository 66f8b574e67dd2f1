// A stand-in for VS Code's module `vscode`: it keeps what the extension registers, for the test to call.
import { spawn } from "node:child_process";
import { EventEmitter as Hub, once } from "node:events";
import { existsSync, readFileSync, writeFileSync } from "node:fs";
import path from "node:path";
import { createMessageConnection, StreamMessageReader, StreamMessageWriter } from "vscode-jsonrpc/node.js";

export const calls = { errors: [], infos: [], tasks: [], languages: [], written: new Map(), clients: [], panels: [] };
export const handlers = new Map();
const hub = new Hub();
hub.setMaxListeners(0);
const event = (name) => (listener) => {
  hub.on(name, listener);
  return { dispose: () => hub.off(name, listener) };
};
export const fire = (name, value) => hub.emit(name, value);
export const configuration = new Map();

export class Position {
  constructor(line, character) { Object.assign(this, { line, character }); }
}
export class Range {
  constructor(a, b, c, d) {
    [this.start, this.end] = a instanceof Position ? [a, b] : [new Position(a, b), new Position(c, d)];
  }
}
export class Selection extends Range {
  get active() { return this.end; }
}
export class Location {
  constructor(uri, place) { Object.assign(this, { uri, range: new Range(place, place) }); }
}
export class Uri {
  static file(fsPath) { return Object.assign(new Uri(), { scheme: "file", fsPath, path: fsPath }); }
  static parse(text) { return Uri.file(decodeURIComponent(text.replace("file://", ""))); }
  static joinPath(uri, ...parts) { return Uri.file(path.join(uri.fsPath, ...parts)); }
  toString() { return `file://${encodeURI(this.fsPath)}`; }
}
export class SourceBreakpoint {
  constructor(location, enabled = true) { Object.assign(this, { location, enabled }); }
}
export class Task {
  constructor(definition, scope, name, source, execution) { Object.assign(this, { definition, name, execution }); }
}
export class ProcessExecution {
  constructor(process, args, options) { Object.assign(this, { process, args, options }); }
}
export class EventEmitter {
  hub = new Hub();
  event = (listener) => {
    this.hub.on("event", listener);
    return { dispose: () => this.hub.off("event", listener) };
  };
  fire(value) { this.hub.emit("event", value); }
}
export class WorkspaceEdit {
  edits = [];
  replace(uri, range, text) { this.edits.push({ uri, range, text }); }
  createFile(uri, { contents }) { this.edits.push({ uri, contents }); }
}
export const TaskScope = { Workspace: 2 };
export const ViewColumn = { One: 1, Beside: -2 };
export const TextEditorRevealType = { InCenterIfOutsideViewport: 2 };

export class Document {
  constructor(fsPath, languageId = "xml") {
    Object.assign(this, { uri: Uri.file(fsPath), languageId, isDirty: false, version: 1 });
    this.text = readFileSync(fsPath, "utf8");
  }
  get lineStarts() { return [0, ...Array.from(this.text.matchAll(/\r\n|\r|\n/g), (found) => found.index + found[0].length)]; }
  get lineCount() { return this.lineStarts.length; }
  getText(range) { return range ? this.text.slice(this.offsetAt(range.start), this.offsetAt(range.end)) : this.text; }
  positionAt(offset) {
    const starts = this.lineStarts, line = starts.findLastIndex((start) => start <= offset);
    return new Position(line, Math.min(offset, this.text.length) - starts[line]);
  }
  offsetAt({ line, character }) {
    const starts = this.lineStarts;
    return line < starts.length ? Math.min(starts[line] + character, starts[line + 1] ?? Infinity, this.text.length) : this.text.length;
  }
  /** Replace the text by typing: one change, which is as short as possible. */
  type(text) {
    const before = this.text;
    let start = 0, end = 0;
    while (start < Math.min(before.length, text.length) && before[start] === text[start]) start += 1;
    while (end < Math.min(before.length, text.length) - start && before.at(-1 - end) === text.at(-1 - end)) end += 1;
    this.change([{ range: new Range(this.positionAt(start), this.positionAt(before.length - end)), text: text.slice(start, text.length - end) }]);
  }
  /** Apply changes whose ranges are of the present text. */
  change(changes) {
    const placed = changes.map((item, index) => ({ ...item, index, from: this.offsetAt(item.range.start), to: this.offsetAt(item.range.end) }));
    // As in VS Code, the last one comes first.
    placed.sort((a, b) => b.from - a.from || b.to - a.to || b.index - a.index);
    for (const { from, to, text } of placed) this.text = this.text.slice(0, from) + text + this.text.slice(to);
    Object.assign(this, { isDirty: true, version: this.version + 1 });
    fire("change", { document: this, contentChanges: placed.map(({ range, text }) => ({ range, text })) });
  }
  async save() { writeFileSync(this.uri.fsPath, this.text); this.isDirty = false; fire("save", this); return true; }
}

export const workspace = {
  isTrusted: true,
  textDocuments: [],
  workspaceFolders: undefined,
  getConfiguration: () => ({ get: (name) => configuration.get(name) }),
  getWorkspaceFolder: () => undefined,
  createFileSystemWatcher: () => ({ dispose() {} }),
  openTextDocument: async (uri) => {
    let document = workspace.textDocuments.find((item) => item.uri.fsPath === uri.fsPath);
    if (!document) {
      document = new Document(uri.fsPath);
      workspace.textDocuments.push(document);
      fire("open", document);
    }
    return document;
  },
  applyEdit: async ({ edits }) => {
    const documents = new Map();
    const created = edits.filter(({ contents }) => contents);
    if (created.some(({ uri }) => existsSync(uri.fsPath))) return false;
    created.forEach(({ uri, contents }) => writeFileSync(uri.fsPath, contents));
    if (created.length) return true;
    for (const edit of edits) {
      const document = await workspace.openTextDocument(edit.uri);
      documents.set(document, [...(documents.get(document) ?? []), edit]);
    }
    const step = [...documents.keys()].map((document) => ({ document, before: document.text }));
    for (const [document, changes] of documents) document.change(changes);
    steps.undo.push(step.map((part) => ({ ...part, after: part.document.text })));
    steps.redo = [];
    return true;
  },
  fs: { isWritableFileSystem: () => true, writeFile: async (uri, data) => { calls.written.set(uri.fsPath, String(data)); } },
  onDidOpenTextDocument: event("open"),
  onDidSaveTextDocument: event("save"),
  onDidChangeTextDocument: event("change"),
  onDidCloseTextDocument: event("close"),
  onDidChangeConfiguration: event("configuration"),
  onDidGrantWorkspaceTrust: event("trust"),
};
export const languages = {
  setTextDocumentLanguage: async (document, id) => {
    document.languageId = id;
    calls.languages.push(id);
    fire("language", document);
    return document;
  },
};

/** The steps that `undo` and `redo` can take. VS Code asks before it undoes a step of several files; here it does so. */
export const steps = { undo: [], redo: [] };
function step(from, to, side) {
  const active = calls.panels.find((panel) => panel.active)?.document ?? window.shown?.document;
  const index = steps[from].findLastIndex((parts) => parts.some(({ document }) => document === active));
  if (index < 0) return;
  const [parts] = steps[from].splice(index, 1);
  for (const part of parts) part.document.type(part[side]);
  steps[to].push(parts);
}
export const commands = {
  registerCommand: (name, action) => { handlers.set(name, action); return { dispose() {} }; },
  executeCommand: async (name, ...args) => {
    if (name === "undo") step("undo", "redo", "before");
    else if (name === "redo") step("redo", "undo", "after");
    else if (name === "vscode.openWith") await openWith(...args);
    else throw new Error(`command '${name}' not found`);
  },
};
export const tasks = { executeTask: async (task) => { calls.tasks.push(task); } };
export const debug = {
  breakpoints: [],
  onDidChangeBreakpoints: event("breakpoints"),
  addBreakpoints: (items) => { debug.breakpoints.push(...items); fire("breakpoints", {}); },
  removeBreakpoints: (items) => { debug.breakpoints = debug.breakpoints.filter((item) => !items.includes(item)); fire("breakpoints", {}); },
};
export const window = {
  activeTextEditor: undefined,
  visibleTextEditors: [],
  onDidChangeTextEditorSelection: event("selection"),
  showErrorMessage: async (text) => { calls.errors.push(text); },
  showInformationMessage: async (text) => { calls.infos.push(text); },
  showInputBox: async ({ value }) => value,
  showSaveDialog: async ({ defaultUri }) => defaultUri,
  showTextDocument: async (uri) => {
    const editor = { document: await workspace.openTextDocument(uri), revealRange() {} };
    calls.panels.forEach((panel) => (panel.active = false));
    window.shown = editor;
    return editor;
  },
  createOutputChannel: () => ({ text: "", append(text) { calls.output = (calls.output ?? "") + text; }, show() {}, dispose() {} }),
  registerCustomEditorProvider: (type, provider, options) => {
    Object.assign(editors, { type, provider, options });
    return { dispose() {} };
  },
};

/** The custom editor of the extension. */
export const editors = {};
export async function openWith(uri, type, { viewColumn = 1 } = {}) {
  if (type !== editors.type) throw new Error(`no editor ${type}`);
  const messages = new Hub(), ended = new Hub(), sent = [], replies = new Map();
  let last = 0;
  const panel = {
    sent, viewColumn, active: true,
    document: await workspace.openTextDocument(uri),
    webview: {
      cspSource: "https://files.example",
      asWebviewUri: ({ fsPath }) => `https://files.example${fsPath}`,
      set html(html) { panel.html = html; },
      onDidReceiveMessage: (listener) => { messages.on("message", listener); return { dispose() {} }; },
      postMessage: async (message) => {
        // As in VS Code, nothing but JSON arrives.
        message = JSON.parse(JSON.stringify(message));
        sent.push(message);
        replies.get(message.id)?.(message);
        hub.emit("sent");
        return true;
      },
    },
    onDidDispose: (listener) => { ended.on("end", listener); return { dispose() {} }; },
    // Without a column, VS Code would show it a second time, in the active one.
    reveal(column, preserveFocus = false) {
      if (column === undefined) throw new Error("reveal without a column");
      if (!preserveFocus) calls.panels.forEach((item) => (item.active = item === panel));
    },
    dispose: () => { calls.panels.splice(calls.panels.indexOf(panel), 1); ended.emit("end"); },
    notify: (method, params) => messages.emit("message", { jsonrpc: "2.0", method, params }),
    /** Send a request of the page. */
    request: async (method, params) => {
      const id = ++last;
      const reply = new Promise((resolve) => replies.set(id, resolve));
      messages.emit("message", { jsonrpc: "2.0", id, method, params });
      const { result, error } = await reply;
      replies.delete(id);
      if (error) throw Object.assign(new Error(error.message), { code: error.code });
      return result;
    },
  };
  calls.panels.push(panel);
  panel.reveal(viewColumn);
  await editors.provider.resolveCustomTextEditor(panel.document, panel);
}

/** Return the first message to the page that matches, also one that is sent later; fail after 30 s. */
export async function message(panel, matches, from = 0) {
  const deadline = AbortSignal.timeout(30_000);
  for (;;) {
    const found = panel.sent.slice(from).find(matches);
    if (found) return found;
    await new Promise((resolve, reject) => {
      deadline.addEventListener("abort", () => reject(new Error("the message did not arrive")));
      hub.once("sent", resolve);
    });
  }
}

export const State = { Stopped: 1, Running: 2 };

/** The client of the language server, whose process and messages are real. */
export class LanguageClient {
  sent = [];
  states = new EventEmitter();
  onDidChangeState = this.states.event;
  documents = new Set();
  constructor(id, name, server, client) { Object.assign(this, { server, client }); calls.clients.push(this); }

  async start() {
    this.process = spawn(this.server.command, this.server.args, { stdio: ["pipe", "pipe", "inherit"] });
    await once(this.process, "spawn");
    const streams = [new StreamMessageReader(this.process.stdout), new StreamMessageWriter(this.process.stdin)];
    this.connection = createMessageConnection(...streams, undefined, this.client.connectionOptions);
    this.connection.onRequest(() => null);
    this.connection.listen();
    const capabilities = { workspace: { semanticTokens: { refreshSupport: true } } };
    const { initializationOptions } = this.client;
    await this.connection.sendRequest("initialize", { processId: null, rootUri: null, capabilities, initializationOptions });
    this.started = true;
    this.connection.sendNotification("initialized", {});
    workspace.textDocuments.forEach((document) => this.open(document));
    const isSynchronized = ({ uri }) => this.documents.has(uri.toString());
    this.ends = [
      event("open")((document) => this.open(document)),
      event("language")((document) => this.open(document)),
      event("change")(({ document, contentChanges }) => {
        const textDocument = { uri: document.uri.toString(), version: document.version };
        if (isSynchronized(document)) this.connection.sendNotification("textDocument/didChange", { textDocument, contentChanges });
      }),
    ];
    this.states.fire({ newState: State.Running });
  }

  open({ uri, languageId, version, text }) {
    if (languageId !== "behaviortree" || this.documents.has(uri.toString())) return;
    this.documents.add(uri.toString());
    this.connection.sendNotification("textDocument/didOpen", { textDocument: { uri: uri.toString(), languageId, version, text } });
  }

  async stop() {
    if (!this.started) throw new Error("Client is not running and can't be stopped.");
    this.stopped = true;
    this.ends.forEach((end) => end.dispose());
    await this.connection.sendRequest("shutdown");
    await this.connection.sendNotification("exit");
    await once(this.process, "exit");
    this.connection.dispose();
  }

  sendRequest(method, params) { return this.connection.sendRequest(method, params); }

  async sendNotification(method, value) {
    this.sent.push([method, value]);
    await this.connection.sendNotification(method, value);
  }
}
