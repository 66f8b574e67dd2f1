// A stand-in for VS Code's module `vscode`: it keeps what the extension registers, for the test to call.
import { EventEmitter } from "node:events";
import { readFileSync, writeFileSync } from "node:fs";
import path from "node:path";

export const calls = { errors: [], infos: [], tasks: [], languages: [], edits: [], written: new Map(), clients: [], panels: [] };
export const handlers = new Map();
const hub = new EventEmitter();
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
export class WorkspaceEdit {
  replace(uri, range, text) { calls.edits.push({ uri, text }); }
}
export const TaskScope = { Workspace: 2 };
export const ViewColumn = { One: 1, Beside: -2 };
export const TextEditorRevealType = { InCenterIfOutsideViewport: 2 };
export const ColorThemeKind = { Light: 1, Dark: 2, HighContrast: 3 };

export class Document {
  constructor(fsPath, languageId = "xml") {
    Object.assign(this, { uri: Uri.file(fsPath), languageId, isDirty: false, version: 1 });
    this.text = readFileSync(fsPath, "utf8");
  }
  get lineCount() { return this.text.split("\n").length; }
  getText() { return this.text; }
  positionAt() { return new Position(this.lineCount, 0); }
  type(text) { Object.assign(this, { text, isDirty: true, version: this.version + 1 }); fire("change", { document: this }); }
  async save() { writeFileSync(this.uri.fsPath, this.text); this.isDirty = false; fire("save", this); return true; }
}

export const workspace = {
  isTrusted: true,
  textDocuments: [],
  workspaceFolders: undefined,
  getConfiguration: () => ({ get: (name) => configuration.get(name) }),
  getWorkspaceFolder: () => undefined,
  createFileSystemWatcher: () => ({ dispose() {} }),
  openTextDocument: async (uri) => workspace.textDocuments.find((item) => item.uri.fsPath === uri.fsPath),
  applyEdit: async () => true,
  fs: { writeFile: async (uri, data) => { calls.written.set(uri.fsPath, String(data)); } },
  onDidOpenTextDocument: event("open"),
  onDidSaveTextDocument: event("save"),
  onDidChangeTextDocument: event("change"),
  onDidChangeConfiguration: event("configuration"),
  onDidGrantWorkspaceTrust: event("trust"),
};
export const languages = {
  setTextDocumentLanguage: async (document, id) => { document.languageId = id; calls.languages.push(id); return document; },
};
export const commands = {
  registerCommand: (name, action) => { handlers.set(name, action); return { dispose() {} }; },
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
  activeColorTheme: { kind: ColorThemeKind.Dark },
  onDidChangeTextEditorSelection: event("selection"),
  onDidChangeActiveColorTheme: event("theme"),
  showErrorMessage: async (text) => { calls.errors.push(text); },
  showInformationMessage: async (text) => { calls.infos.push(text); },
  showInputBox: async ({ value }) => value,
  showSaveDialog: async ({ defaultUri }) => defaultUri,
  showTextDocument: async (uri) => {
    const editor = { document: { uri }, revealRange() {} };
    window.shown = editor;
    return editor;
  },
  createOutputChannel: () => ({ text: "", append(text) { calls.output = (calls.output ?? "") + text; }, show() {}, dispose() {} }),
  createWebviewPanel: (type, title) => {
    const messages = new EventEmitter(), ended = new EventEmitter(), sent = [];
    const panel = {
      type, title, sent,
      webview: {
        set html(html) { sent.push({ type: "page", html }); hub.emit("sent"); },
        onDidReceiveMessage: (listener) => { messages.on("message", listener); return { dispose() {} }; },
        postMessage: async (message) => { sent.push(message); hub.emit("sent"); return true; },
      },
      onDidDispose: (listener) => { ended.on("end", listener); return { dispose() {} }; },
      reveal() {},
      dispose: () => ended.emit("end"),
      receive: (message) => messages.emit("message", message),
    };
    calls.panels.push(panel);
    return panel;
  },
};

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

// The client of the language server needs the real VS Code: its settings are recorded only.
export class LanguageClient {
  constructor(id, name, server, client) { Object.assign(this, { server, client, sent: [] }); calls.clients.push(this); }
  async start() {
    await new Promise((resolve) => setTimeout(resolve, 5));
    this.started = true;
    if (this.server.command === "missing") throw new Error("ENOENT");
  }
  async stop() {
    if (!this.started) throw new Error("Client is not running and can't be stopped.");
    this.stopped = true;
  }
  async sendNotification(method, value) { this.sent.push([method, value]); }
}
