import { randomBytes } from "node:crypto";
import * as path from "node:path";
import * as vscode from "vscode";
import { addBreakpoints, type DrawnNode, hasBreakpoints, keysOfBreakpoints, removeBreakpoints } from "./breakpoints";
import { Changes, movePlaces, type Place, type VersionedEdit, type Versions } from "./changes";
import { documentFor } from "./commands";
import { LANGUAGE, REFRESH, type Server, type ServerMessage } from "./language";
import { createFile } from "./new_files";
import { folderOf, settings } from "./settings";

export const VIEW_TYPE = "btcore.studio";

/** The requests of the page that the language server answers. */
const FOR_SERVER = new Set([
  "btcore/drawing",
  "btcore/palette",
  "btcore/node",
  "btcore/edit",
  "btcore/leaf",
  "btcore/preview",
  "btcore/copy",
  "btcore/watch",
  "btcore/release",
  "btcore/setEntry",
  "btcore/reload",
  "btcore/run",
  "btcore/runStep",
  "btcore/runAnswer",
  "btcore/runMoment",
  "btcore/runLeaf",
  "btcore/runFiles",
  "btcore/endRun",
  "btcore/why",
  "btcore/prove",
  "btcore/stopProof",
  "btcore/counterexample",
  "btcore/moment",
  "btcore/whatIf",
  "textDocument/prepareRename",
  "textDocument/rename",
]);
const EDITABLE = /\.(xml|btproj)$/i;
const TYPING_PAUSE_MS = 150;
const MAX_EDIT_TRIALS = 3;
const REQUEST_FAILED = -32803;
const METHOD_NOT_FOUND = -32601;

/** A message of the page. */
interface PageMessage {
  id?: number;
  method: string;
  params: Record<string, unknown>;
}

interface Live {
  address: string;
  wanted: string[];
  keys?: string[];
  calls?: unknown[];
}

interface Drawing {
  tree: string;
  nodes: DrawnNode[];
  trees: { id: string; isMain: boolean }[];
  versions?: Versions;
}

/** Return the page, whose script only a nonce permits. */
function pageHtml(webview: vscode.Webview, folder: vscode.Uri): string {
  const nonce = randomBytes(16).toString("base64");
  const address = (name: string): string => webview.asWebviewUri(vscode.Uri.joinPath(folder, name)).toString();
  // The picture becomes a PNG file by way of an image with its SVG.
  const policy = `default-src 'none'; img-src blob:; style-src ${webview.cspSource}; script-src 'nonce-${nonce}'`;
  return `<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="${policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>btcore studio</title>
<link rel="stylesheet" href="${address("studio.css")}">
<script nonce="${nonce}" src="${address("studio.js")}" defer></script>
</head>
<body></body>
</html>`;
}

/** The page of one document, in a web view. */
class Studio {
  private readonly disposables: vscode.Disposable[] = [];
  /** The last drawing of the page. */
  private drawing: Drawing = { tree: "", nodes: [], trees: [] };
  tree: string | null = null;
  /** The documents of each command that can be undone or redone, since the last other change. */
  private steps: { undo: string[][]; redo: string[][] } = { undo: [], redo: [] };
  private isOwnChange = false;

  constructor(
    readonly document: vscode.TextDocument,
    readonly panel: vscode.WebviewPanel,
    private readonly studios: Studios,
  ) {
    this.disposables.push(
      panel.webview.onDidReceiveMessage((message: PageMessage) => void this.receive(message)),
      vscode.window.onDidChangeTextEditorSelection(({ textEditor, selections }) => {
        const uri = textEditor.document.uri.toString();
        const position = selections[0]?.active;
        if (position && !this.studios.isRevealed(uri, position)) this.notify("studio/cursor", { uri, position });
      }),
    );
  }

  notify(method: string, params: unknown): void {
    void this.panel.webview.postMessage({ jsonrpc: "2.0", method, params });
  }

  /** Show a tree of the document. */
  show(tree: string): void {
    this.tree = tree;
    this.notify("studio/tree", { tree });
  }

  dispose(): void {
    this.disposables.forEach((item) => void item.dispose());
  }

  private async receive({ id, method, params }: PageMessage): Promise<void> {
    let reply: object;
    try {
      reply = { result: (await this.answer(method, params)) ?? null };
    } catch (error) {
      const { code = REQUEST_FAILED, message = String(error) } = error as { code?: number; message?: string };
      reply = { error: { code: typeof code === "number" ? code : REQUEST_FAILED, message } };
    }
    if (id !== undefined) void this.panel.webview.postMessage({ jsonrpc: "2.0", id, ...reply });
  }

  private async answer(method: string, params: Record<string, unknown>): Promise<unknown> {
    if (FOR_SERVER.has(method)) return this.request(method, params);
    switch (method) {
      case "studio/start":
        return this.start();
      case "studio/read":
        return (await vscode.workspace.openTextDocument(editable(String(params.uri)))).getText();
      case "studio/apply":
        return this.apply(params.edit as VersionedEdit);
      case "studio/undo":
        return this.step("undo");
      case "studio/redo":
        return this.step("redo");
      case "studio/save":
        return this.save(String(params.uri));
      case "studio/export":
        return this.export(String(params.name), String(params.base64));
      case "studio/reveal":
        return this.studios.reveal(params as unknown as Place, this.panel.viewColumn);
      case "studio/select":
        return this.studios.select(params as unknown as Place);
      case "btcore/files":
        return this.files();
      case "btcore/create":
        return this.create(String(params.name), String(params.text));
      case "btcore/breakpoints":
        return this.setBreakpoints(params.keys as string[]);
      default:
        throw Object.assign(new Error(`The extension has no method ${method}.`), { code: METHOD_NOT_FOUND });
    }
  }

  /** Send a request to the language server. Its texts are the documents, with the present versions. */
  private async request(method: string, { versions: since, ...params }: Record<string, unknown>): Promise<unknown> {
    const { changes } = this.studios;
    const place = (earlier: Place): Place => {
      const position = changes.position(earlier.uri, earlier.position, since as Versions | undefined);
      if (!position) throw new Error("This node is not in the text any more.");
      return { uri: earlier.uri, position };
    };
    const moved = since ? movePlaces(params, place) : params;
    const versions = changes.versions();
    const result = await this.studios.server.request(method, moved);
    if (method === "btcore/drawing") {
      this.tree = (params as { tree: string | null }).tree;
      this.drawing = { ...(result as Drawing), versions };
      this.studios.sendBreakpoints();
      return this.drawing;
    }
    return withVersions(result, versions);
  }

  private start(): object {
    this.studios.sendState(this);
    return {
      folder: folderOf(this.document.uri).fsPath,
      uri: this.document.uri.toString(),
      tree: this.tree,
      readOnly: this.isReadOnly,
      live: true,
      address: settings().address,
      recording: null,
    };
  }

  private get isReadOnly(): boolean {
    return vscode.workspace.fs.isWritableFileSystem(this.document.uri.scheme) === false;
  }

  /** Return the only file of the page, with its name relative to the folder. */
  private files(): object[] {
    const { uri } = this.document;
    return [{ uri: uri.toString(), name: path.posix.relative(folderOf(uri).path, uri.path), unsaved: false }];
  }

  private async create(name: string, text: string): Promise<object> {
    if (this.isReadOnly) throw new Error("the studio is read-only: nothing is changed");
    return { uri: await createFile(folderOf(this.document.uri), name, text) };
  }

  private async apply(edit: VersionedEdit): Promise<void> {
    const uris = Object.keys(edit.changes).filter((uri) => edit.changes[uri]?.length);
    // A command that changes nothing is no step of undo.
    if (!uris.length) return;
    this.isOwnChange = true;
    await this.studios.apply(edit).finally(() => (this.isOwnChange = false));
    this.steps.undo.push(uris);
    this.steps.redo = [];
  }

  /** Note a change: one that is not the page's own is the last one of its document. */
  changed(): void {
    if (!this.isOwnChange) this.steps = { undo: [], redo: [] };
  }

  /**
   * Undo or redo the last change. VS Code does so in the document of the active editor, and asks whether it should do so
   * in the other documents of a step, too. A command that has changed only an included document is undone in its editor.
   */
  private async step(command: "undo" | "redo"): Promise<void> {
    const own = this.document.uri.toString();
    const uris = this.steps[command].at(-1) ?? [own];
    const versions = (): string => uris.map((uri) => this.studios.changes.versions()[uri]).join(" ");
    const before = versions();
    this.isOwnChange = true;
    try {
      const [other] = uris;
      if (other !== undefined && !uris.includes(own)) await this.studios.showText(other, this.panel.viewColumn);
      else if (!this.panel.active) this.panel.reveal(this.panel.viewColumn, false);
      await vscode.commands.executeCommand(command);
    } finally {
      this.isOwnChange = false;
    }
    // The user may have answered no.
    if (versions() !== before) {
      this.steps[command].pop();
      this.steps[command === "undo" ? "redo" : "undo"].push(uris);
    }
    this.panel.reveal(this.panel.viewColumn, false);
  }

  private async save(uri: string): Promise<void> {
    const document = vscode.workspace.textDocuments.find((item) => item.uri.toString() === uri);
    if (document?.isDirty && !(await document.save())) throw new Error("VS Code did not save the file.");
  }

  private async export(name: string, base64: string): Promise<void> {
    const folder = vscode.Uri.joinPath(this.document.uri, "..");
    const file = name.replace(/[^\p{L}\p{N}_.-]+/gu, "_");
    const extension = file.split(".").pop() ?? "svg";
    const target = await vscode.window.showSaveDialog({
      defaultUri: vscode.Uri.joinPath(folder, file),
      filters: { [extension.toUpperCase()]: [extension] },
    });
    if (target) await vscode.workspace.fs.writeFile(target, Buffer.from(base64, "base64"));
  }

  /** Set and remove breakpoints in the margin, so that *keys* have one. */
  private async setBreakpoints(keys: string[]): Promise<void> {
    const present = new Set(this.studios.live?.wanted);
    const wanted = new Set(keys);
    const { nodes, versions } = this.drawing;
    const changed = nodes.flatMap(({ key, place: { uri, position: earlier } }) => {
      if (wanted.has(key) === present.has(key)) return [];
      const position = this.studios.changes.position(uri, earlier, versions);
      return position ? [{ key, place: { uri, position } }] : [];
    });
    await removeBreakpoints(changed.filter(({ key }) => present.has(key)));
    addBreakpoints(changed.filter(({ key }) => wanted.has(key)));
  }

  /** Return the nodes that a running tree may have: of the shown tree, and of the main tree. */
  async nodes(): Promise<DrawnNode[]> {
    const { nodes, tree, trees } = this.drawing;
    if (this.tree === null || trees.some(({ id, isMain }) => isMain && id === tree)) return nodes;
    const params = { textDocument: { uri: this.document.uri.toString() }, tree: null, folded: [] };
    return [...nodes, ...(await this.studios.server.request<Drawing>("btcore/drawing", params)).nodes];
  }
}

/** Return the URI of a document that the page may read and change. */
function editable(address: string): vscode.Uri {
  const uri = vscode.Uri.parse(address, true);
  if (uri.scheme !== "file" || !EDITABLE.test(uri.path)) throw new Error(`The studio does not change ${address}.`);
  return uri;
}

/** Open a document, and give it the language of the language server. */
async function openTree(uri: vscode.Uri): Promise<void> {
  const document = await vscode.workspace.openTextDocument(uri);
  if (document.languageId !== LANGUAGE) await vscode.languages.setTextDocumentLanguage(document, LANGUAGE);
}

/** Return a result whose edits have the versions of the texts for which they were made. */
function withVersions(result: unknown, versions: Versions): unknown {
  if (Array.isArray(result)) return result.map((item) => withVersions(item, versions));
  if (typeof result !== "object" || result === null) return result;
  if ("changes" in result) return { ...result, versions };
  return "edit" in result ? { ...result, edit: withVersions(result.edit, versions) } : result;
}

/** The custom editor "btcore studio". */
export class Studios implements vscode.CustomTextEditorProvider {
  readonly changes = new Changes();
  live: Live | undefined;
  private readonly open = new Set<Studio>();
  private readonly diagnostics = new Map<string, unknown>();
  /** The trees to show in studios that are being opened, by document. */
  private readonly wantedTrees = new Map<string, string>();
  private readonly disposables: vscode.Disposable[];
  private revealed: Place | undefined;
  private typing: NodeJS.Timeout | undefined;
  private sentKeys = "";

  constructor(
    readonly server: Server,
    private readonly extensionUri: vscode.Uri,
  ) {
    this.disposables = [
      server.onMessage((message) => this.receive(message)),
      server.onStart(() => this.restarted()),
      vscode.workspace.onDidChangeTextDocument((event) => this.changed(event)),
      vscode.workspace.onDidCloseTextDocument((document) => this.changes.forget(document)),
      vscode.debug.onDidChangeBreakpoints(() => this.sendBreakpoints()),
      vscode.window.registerCustomEditorProvider(VIEW_TYPE, this, {
        supportsMultipleEditorsPerDocument: true,
        webviewOptions: { retainContextWhenHidden: true },
      }),
    ];
  }

  /** Fill the editor that VS Code opens for a document. */
  async resolveCustomTextEditor(document: vscode.TextDocument, panel: vscode.WebviewPanel): Promise<void> {
    // A document without a tree gets its first tree in the studio.
    await openTree(document.uri);
    const studio = new Studio(document, panel, this);
    const uri = document.uri.toString();
    studio.tree = this.wantedTrees.get(uri) ?? null;
    this.wantedTrees.delete(uri);
    this.open.add(studio);
    panel.onDidDispose(() => this.closed(studio));
    const page = vscode.Uri.joinPath(this.extensionUri, "out", "page");
    panel.webview.options = { enableScripts: true, localResourceRoots: [page] };
    panel.webview.html = pageHtml(panel.webview, page);
    this.sendBreakpoints();
  }

  /** The document of the studio in the active tab. */
  get activeDocument(): vscode.TextDocument | undefined {
    return [...this.open].find(({ panel }) => panel.active)?.document;
  }

  /** Open the studio of a document beside its text, or show it if it is open. */
  async show(uri?: unknown, tree?: unknown): Promise<boolean> {
    const document = await documentFor(uri, this.activeDocument);
    if (!document) return false;
    const studio = [...this.open].find((item) => item.document === document);
    if (studio) {
      studio.panel.reveal(studio.panel.viewColumn, true);
      if (typeof tree === "string") studio.show(tree);
      return true;
    }
    if (typeof tree === "string") this.wantedTrees.set(document.uri.toString(), tree);
    const options = { viewColumn: vscode.ViewColumn.Beside, preserveFocus: true };
    await vscode.commands.executeCommand("vscode.openWith", document.uri, VIEW_TYPE, options);
    return true;
  }

  /** Ask for the address of a running tree, and watch it in the studio of the active document. */
  async watch(): Promise<void> {
    if (!(await this.show())) return;
    const address = await vscode.window.showInputBox({ prompt: "Address of the running tree", value: settings().address });
    if (!address) return;
    try {
      await this.server.request("btcore/watch", { address });
    } catch (error) {
      void vscode.window.showErrorMessage((error as Error).message);
    }
  }

  /** Send what a page that begins has missed. */
  sendState(studio: Studio): void {
    for (const params of this.diagnostics.values()) studio.notify("textDocument/publishDiagnostics", params);
    if (this.live) studio.notify("btcore/live", this.live);
  }

  /** Apply an edit of several documents as one step of undo. */
  async apply({ changes, versions }: VersionedEdit): Promise<void> {
    // The language server learns of a change only if the document has its language.
    await Promise.all(Object.keys(changes).map((address) => openTree(editable(address))));
    for (let trial = 0; trial < MAX_EDIT_TRIALS; trial++) {
      const edit = new vscode.WorkspaceEdit();
      for (const [address, edits] of Object.entries(changes)) {
        const uri = editable(address);
        for (const { range, newText } of edits) {
          const place = this.changes.range(address, range, versions);
          if (!place) throw new Error("The text was changed in the meantime. Please repeat the command.");
          const { start, end } = place;
          edit.replace(uri, new vscode.Range(start.line, start.character, end.line, end.character), newText);
        }
      }
      // VS Code refuses an edit if the text changes before it arrives.
      if (await vscode.workspace.applyEdit(edit)) return;
    }
    throw new Error("VS Code did not apply the edit.");
  }

  /** Show a place in the editor of its text, beside the studio in *column*. */
  async reveal({ uri, position }: Place, column: vscode.ViewColumn | undefined): Promise<void> {
    this.moveCursor(await this.showText(uri, column), position);
  }

  /** Show the editor of a text, beside the studio in *column*. */
  showText(uri: string, column: vscode.ViewColumn | undefined): Thenable<vscode.TextEditor> {
    const visible = vscode.window.visibleTextEditors.find(({ document }) => document.uri.toString() === uri);
    const other = column === vscode.ViewColumn.One ? vscode.ViewColumn.Beside : vscode.ViewColumn.One;
    return vscode.window.showTextDocument(vscode.Uri.parse(uri), { viewColumn: visible?.viewColumn ?? other });
  }

  /** Move the cursor of the visible editors of a text to the selected node. */
  select({ uri, position }: Place): void {
    for (const editor of vscode.window.visibleTextEditors) {
      if (editor.document.uri.toString() === uri) this.moveCursor(editor, position);
    }
  }

  private moveCursor(editor: vscode.TextEditor, { line, character }: Place["position"]): void {
    const place = new vscode.Position(line, character);
    this.revealed = { uri: editor.document.uri.toString(), position: place };
    editor.selection = new vscode.Selection(place, place);
    editor.revealRange(new vscode.Range(place, place), vscode.TextEditorRevealType.InCenterIfOutsideViewport);
  }

  /** Whether the studio has moved the cursor to a position. */
  isRevealed(uri: string, { line, character }: Place["position"]): boolean {
    const { position } = this.revealed ?? {};
    return this.revealed?.uri === uri && position?.line === line && position.character === character;
  }

  dispose(): void {
    clearTimeout(this.typing);
    this.open.forEach(({ panel }) => panel.dispose());
    this.disposables.forEach((item) => void item.dispose());
  }

  private notify(method: string, params: unknown): void {
    this.open.forEach((studio) => studio.notify(method, params));
  }

  private receive({ method, params }: ServerMessage): void {
    if (method === "textDocument/publishDiagnostics") this.diagnostics.set((params as { uri: string }).uri, params);
    else if (method === "btcore/live") this.live = { keys: this.live?.keys, calls: this.live?.calls, ...(params as Live) };
    this.notify(method, params);
  }

  private restarted(): void {
    this.diagnostics.forEach((_, uri) => this.notify("textDocument/publishDiagnostics", { uri, diagnostics: [] }));
    this.diagnostics.clear();
    this.live = undefined;
    this.sentKeys = "";
    this.notify(REFRESH, null);
    this.sendBreakpoints();
  }

  private changed(event: vscode.TextDocumentChangeEvent): void {
    if (event.document.languageId !== LANGUAGE || !event.contentChanges.length) return;
    this.changes.note(event);
    this.open.forEach((studio) => studio.changed());
    this.notify("studio/changed", { uri: event.document.uri.toString() });
  }

  /** Set breakpoints in the running tree before the nodes whose lines have one in the margin, after a pause. */
  sendBreakpoints(): void {
    clearTimeout(this.typing);
    this.typing = setTimeout(() => void this.sendKeys().catch(() => undefined), TYPING_PAUSE_MS);
  }

  private async sendKeys(): Promise<void> {
    const nodes = hasBreakpoints() ? (await Promise.all([...this.open].map((studio) => studio.nodes()))).flat() : [];
    const keys = [...new Set(await keysOfBreakpoints(nodes))].sort();
    const text = keys.join(" ");
    if (text === this.sentKeys) return;
    this.sentKeys = text;
    await this.server.request("btcore/breakpoints", { keys });
  }

  private closed(studio: Studio): void {
    studio.dispose();
    this.open.delete(studio);
    // Without a studio, a tree that waits at a breakpoint could not be continued.
    if (!this.open.size && this.live?.address) void this.server.request("btcore/watch", { address: "" }).catch(() => undefined);
    this.sendBreakpoints();
  }
}
