import { randomBytes } from "node:crypto";
import * as vscode from "vscode";
import { documentFor } from "./commands";
import { PreviewProcess } from "./process";
import { folderOf, libraryOptions, settings } from "./settings";

const TYPING_PAUSE_MS = 150;
const MAX_TEXT = 8 << 20;
/** The actions that the page may request. */
const ACTIONS = new Set(["drawing", "watch", "release"]);

interface PlacedNode {
  key: string;
  file: number;
  line: number;
  /** The last line of its start tag. */
  last: number;
}

interface Drawing {
  nodes?: PlacedNode[];
  files?: { name: string }[];
}

/** A message of the page. */
type Message =
  | { type: "ready" }
  | { type: "request"; id: number; name: string; body: Record<string, unknown> }
  | { type: "reveal" | "breakpoint"; file: string; line: number; column?: number }
  | { type: "export"; name: string; svg: string };

/** Return the page with its script and style sheet inside, which only a nonce permits. */
export function pageHtml(html: string, style: string, script: string, isDark: boolean): string {
  const nonce = randomBytes(16).toString("base64");
  const policy = `default-src 'none'; style-src 'nonce-${nonce}'; script-src 'nonce-${nonce}'`;
  // VS Code's theme decides, not the theme of the desktop.
  const themed = style.replaceAll("(prefers-color-scheme: dark)", isDark ? "all" : "not all");
  const scheme = themed.replace("color-scheme: light dark", `color-scheme: ${isDark ? "dark" : "light"}`);
  return html
    .replace("<head>", () => `<head><meta http-equiv="Content-Security-Policy" content="${policy}">`)
    .replace(/<link rel="preload"[^>]*>/, "")
    .replace(/<link rel="stylesheet"[^>]*>/, () => `<style nonce="${nonce}">${scheme}</style>`)
    .replace(/<script src="preview.js"[^>]*><\/script>/, "")
    .replace("</body>", () => `<script nonce="${nonce}">${script}</script></body>`);
}

function isDark(): boolean {
  const { kind } = vscode.window.activeColorTheme;
  return kind === vscode.ColorThemeKind.Dark || kind === vscode.ColorThemeKind.HighContrast;
}

/** The preview of one document beside its text. */
class Preview {
  private readonly process: PreviewProcess;
  private readonly disposables: vscode.Disposable[] = [];
  private typing: NodeJS.Timeout | undefined;
  private tree: string | undefined;

  constructor(
    private readonly document: vscode.TextDocument,
    readonly panel: vscode.WebviewPanel,
  ) {
    const args = [...libraryOptions(), "--", document.uri.fsPath];
    this.process = new PreviewProcess(settings().command, args, folderOf(document.uri), (reason) => {
      void vscode.window.showErrorMessage(`btcore preview ended: ${reason}`);
      this.panel.dispose();
    });
    const isThis = (other: vscode.TextDocument): boolean => other.uri.toString() === document.uri.toString();
    this.disposables.push(
      panel.onDidDispose(() => this.dispose()),
      panel.webview.onDidReceiveMessage((message: Message) => this.receive(message).catch(() => undefined)),
      vscode.workspace.onDidChangeTextDocument(({ document: other }) => isThis(other) && this.sendTextSoon()),
      vscode.workspace.onDidSaveTextDocument((other) => isThis(other) && this.sendTextSoon()),
      vscode.window.onDidChangeTextEditorSelection(({ textEditor, selections }) => {
        const line = selections[0]?.active.line;
        if (line !== undefined) this.post({ type: "cursor", file: textEditor.document.uri.fsPath, line: line + 1 });
      }),
      vscode.window.onDidChangeActiveColorTheme(() => void this.load().catch(() => undefined)),
      vscode.debug.onDidChangeBreakpoints(() => void this.sendBreakpoints().catch(() => undefined)),
    );
    void this.load().catch(() => undefined);
  }

  private async load(): Promise<void> {
    const [html, style, script] = await Promise.all(["", "preview.css", "preview.js"].map((name) => this.process.get(name)));
    this.panel.webview.html = pageHtml(html ?? "", style ?? "", script ?? "", isDark());
  }

  private post(message: unknown): void {
    void this.panel.webview.postMessage(message);
  }

  /** Show a tree of the document. */
  select(tree: string | undefined): void {
    this.tree = tree;
    if (tree !== undefined) this.post({ type: "tree", tree });
  }

  /** Watch the running tree at *address*. */
  async watch(address: string): Promise<void> {
    const reply = (await this.process.post("watch", { address })) as { error?: string };
    if (reply.error) void vscode.window.showErrorMessage(reply.error);
  }

  private async receive(message: Message): Promise<void> {
    if (message.type === "ready") {
      if (this.tree !== undefined) this.post({ type: "tree", tree: this.tree });
      this.post({ type: "address", address: settings().address });
      if (this.document.isDirty) this.sendTextSoon();
      await this.process.listen((name, value) => {
        this.post({ type: "event", name, value });
        // An edit moves nodes to other lines.
        if (name === "document") void this.sendBreakpoints().catch(() => undefined);
      });
    } else if (message.type === "request" && ACTIONS.has(message.name)) {
      const value = await this.process.post(message.name, message.body);
      this.post({ type: "reply", id: message.id, value });
    } else if (message.type === "reveal") {
      await this.reveal(message.file, message.line, message.column ?? 1);
    } else if (message.type === "breakpoint") {
      toggleBreakpoint(message.file, message.line);
    } else if (message.type === "export") {
      await this.save(message.name, message.svg);
    }
  }

  /** Move the cursor to a place, in the editor that shows the file already, if there is one. */
  private async reveal(file: string, line: number, column: number): Promise<void> {
    const visible = vscode.window.visibleTextEditors.find((editor) => editor.document.uri.fsPath === file);
    const place = new vscode.Position(Math.max(0, line - 1), Math.max(0, column - 1));
    const editor = await vscode.window.showTextDocument(vscode.Uri.file(file), {
      viewColumn: visible?.viewColumn ?? vscode.ViewColumn.One,
      preserveFocus: true,
    });
    editor.selection = new vscode.Selection(place, place);
    editor.revealRange(new vscode.Range(place, place), vscode.TextEditorRevealType.InCenterIfOutsideViewport);
  }

  private async save(name: string, svg: string): Promise<void> {
    const folder = vscode.Uri.joinPath(this.document.uri, "..");
    const target = await vscode.window.showSaveDialog({
      defaultUri: vscode.Uri.joinPath(folder, name.replace(/[^\w.-]+/g, "_")),
      filters: { SVG: ["svg"] },
    });
    if (target) await vscode.workspace.fs.writeFile(target, Buffer.from(svg));
  }

  private sendTextSoon(): void {
    clearTimeout(this.typing);
    this.typing = setTimeout(() => {
      const text = this.document.isDirty ? this.document.getText() : null;
      if (text === null || text.length <= MAX_TEXT) void this.process.post("text", { text }).catch(() => undefined);
    }, TYPING_PAUSE_MS);
  }

  /** Set breakpoints in the running tree before the nodes whose lines have one in the margin. */
  private async sendBreakpoints(): Promise<void> {
    const { nodes = [], files = [] } = (await this.process.post("drawing", {})) as Drawing;
    const lines = new Set(
      vscode.debug.breakpoints
        .filter((item): item is vscode.SourceBreakpoint => item instanceof vscode.SourceBreakpoint && item.enabled)
        .map(({ location }) => `${location.range.start.line + 1} ${location.uri.fsPath}`),
    );
    const chosen = nodes.filter(({ line, last, file }) =>
      Array.from({ length: last - line + 1 }, (_, index) => line + index).some((number) =>
        lines.has(`${number} ${files[file]?.name}`),
      ),
    );
    await this.process.post("breakpoints", { keys: chosen.map((node) => node.key) });
  }

  private dispose(): void {
    clearTimeout(this.typing);
    this.process.close();
    this.disposables.forEach((item) => void item.dispose());
  }
}

/** Set a breakpoint in the margin of a line, or remove it. */
function toggleBreakpoint(file: string, line: number): void {
  const present = vscode.debug.breakpoints.filter(
    (item) =>
      item instanceof vscode.SourceBreakpoint &&
      item.location.uri.fsPath === file &&
      item.location.range.start.line === line - 1,
  );
  if (present.length) {
    vscode.debug.removeBreakpoints(present);
    return;
  }
  const place = new vscode.Location(vscode.Uri.file(file), new vscode.Position(line - 1, 0));
  vscode.debug.addBreakpoints([new vscode.SourceBreakpoint(place)]);
}

/** The previews that are open, by the URI of their document. */
export class Previews {
  private readonly open = new Map<string, Preview>();

  /** Open the preview of a document beside its text, or show it if it is open. */
  async show(uri?: unknown, tree?: unknown): Promise<Preview | undefined> {
    const document = await documentFor(uri);
    if (!document) return undefined;
    const key = document.uri.toString();
    let preview = this.open.get(key);
    if (preview) {
      preview.panel.reveal(undefined, true);
    } else {
      const name = document.uri.path.split("/").pop() ?? "";
      const panel = vscode.window.createWebviewPanel(
        "btcore.preview",
        `Preview ${name}`,
        { viewColumn: vscode.ViewColumn.Beside, preserveFocus: true },
        { enableScripts: true, retainContextWhenHidden: true, localResourceRoots: [] },
      );
      preview = new Preview(document, panel);
      this.open.set(key, preview);
      panel.onDidDispose(() => this.open.delete(key));
    }
    preview.select(typeof tree === "string" ? tree : undefined);
    return preview;
  }

  /** Ask for the address of a running tree, and watch it in the preview of the active document. */
  async watch(): Promise<void> {
    const preview = await this.show();
    if (!preview) return;
    const address = await vscode.window.showInputBox({ prompt: "Address of the running tree", value: settings().address });
    if (address) await preview.watch(address);
  }

  dispose(): void {
    this.open.forEach((preview) => preview.panel.dispose());
  }
}
