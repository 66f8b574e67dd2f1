// Where the page lives: in a browser, or in a web view of VS Code. site/home.ts has the third home.

import type { Text } from "@codemirror/state";
import { effect, signal } from "@preact/signals";
import { type Change, Documents, Mark, type Reply, textOf } from "./documents";
import { type Done, History } from "./history";
import type { Place, Pushed, SharedText, Start, WorkspaceEdit } from "./protocol";
import { Connection, CONTENT_MODIFIED, RpcError, type Transport } from "./rpc";
import { afterDrawing, keyAt, message, reasonOf, selectedNode, selection, tree } from "./state";
import { texts } from "./texts";

const FIRST_WAIT_MS = 250;
const LAST_WAIT_MS = 4000;

/** What the page needs from its surroundings, besides the requests of the language server. */
export interface Home {
  readonly connection: Connection;
  /** The texts of the page; null if an editor has them. */
  readonly documents: Documents | null;
  begin(): Promise<Start>;
  read(uri: string): Promise<Text>;
  /** Begin to note changes, so that an edit for the present texts can be applied to later ones. */
  mark(): Mark;
  /** Apply an edit as one step of undo. */
  apply(edit: WorkspaceEdit, since: Mark): Promise<void>;
  /** Resolves to null if there is nothing to undo, or if the editor shows what it has undone. */
  undo(): Promise<Done | null>;
  redo(): Promise<Done | null>;
  /** Resolves to whether something was written. */
  save(uri: string): Promise<boolean>;
  /** Offer a file to the user. */
  export(name: string, content: Blob): Promise<void>;
  /** Show a place in the editor; the browser's page shows it itself. */
  reveal(place: Place): void;
  /** Call *listener* after each change of a text. */
  onChange(listener: (uri: string, origin: Change["origin"]) => void): void;
}

/** Whether the process of the page answers. */
export const isConnected = signal(true);
export const canUndo = signal(false);
export const canRedo = signal(false);

class SocketTransport implements Transport {
  receive: Transport["receive"] = () => {};
  lost: Transport["lost"] = () => {};
  private socket: WebSocket | null = null;
  private wait = FIRST_WAIT_MS;

  /** @param opened Called after each connection. */
  constructor(private readonly opened: () => void) {}

  connect(): void {
    const address = new URL("socket", location.href);
    address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
    address.search = address.hash = "";
    const socket = new WebSocket(address);
    socket.onopen = () => {
      this.socket = socket;
      this.wait = FIRST_WAIT_MS;
      this.opened();
    };
    socket.onmessage = ({ data }) => {
      this.receive(JSON.parse(String(data)));
    };
    socket.onclose = () => {
      this.socket = null;
      isConnected.value = false;
      this.lost();
      setTimeout(() => this.connect(), this.wait);
      this.wait = Math.min(LAST_WAIT_MS, 2 * this.wait);
    };
  }

  send(message: object): void {
    if (!this.socket) throw new Error("not connected");
    this.socket.send(JSON.stringify(message));
  }
}

const CAPABILITIES = {
  general: { positionEncodings: ["utf-16"] },
  textDocument: {
    completion: { completionItem: { snippetSupport: true, documentationFormat: ["markdown"] } },
    hover: { contentFormat: ["markdown"] },
    codeAction: { codeActionLiteralSupport: { codeActionKind: { valueSet: ["quickfix", "refactor"] } } },
    rename: { prepareSupport: true },
    semanticTokens: { requests: { full: true }, tokenTypes: [], tokenModifiers: [], formats: ["relative"] },
  },
  workspace: { semanticTokens: { refreshSupport: true } },
};

/** A home in which the page has the texts. */
export abstract class PageHome implements Home {
  readonly connection: Connection;
  readonly documents: Documents;
  readonly history: History;
  /** The documents that the present language server knows. */
  private known = new Set<string>();

  constructor(transport: Transport, lostText: string) {
    this.connection = new Connection(transport, lostText);
    this.documents = new Documents({
      read: (uri) => this.readShared(uri),
      push: (pushed) => this.push(pushed),
      opened: (uri, text, version) => {
        this.known.add(uri);
        this.connection.notify("textDocument/didOpen", { textDocument: { uri, languageId: "behaviortree", version, text } });
      },
      changed: (uri, contentChanges, version) => {
        if (!this.known.has(uri)) return;
        // The server applies one change after the other. From the last to the first, no change moves another.
        const changes = contentChanges.toReversed().map(({ range, newText }) => ({ range, text: newText }));
        this.connection.notify("textDocument/didChange", { textDocument: { uri, version }, contentChanges: changes });
      },
    });
    this.history = new History(
      this.documents,
      () => afterDrawing(() => {
        canUndo.value = this.history.canUndo;
        canRedo.value = this.history.canRedo;
      }),
      () => selection.value,
    );
  }

  abstract begin(): Promise<Start>;
  abstract save(uri: string): Promise<boolean>;
  protected abstract readShared(uri: string): Promise<SharedText>;
  protected abstract push(pushed: Pushed): Promise<Reply>;

  async read(uri: string): Promise<Text> {
    await this.documents.load(uri);
    return this.documents.text(uri);
  }

  mark(): Mark {
    return this.documents.mark();
  }

  async apply(edit: WorkspaceEdit, since: Mark): Promise<void> {
    this.history.apply(await this.documents.changesOf(edit, since));
  }

  undo(): Promise<Done | null> {
    return Promise.resolve(this.history.undo());
  }

  redo(): Promise<Done | null> {
    return Promise.resolve(this.history.redo());
  }

  export(name: string, content: Blob): Promise<void> {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(content);
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    return Promise.resolve();
  }

  reveal(): void {}

  onChange(listener: (uri: string, origin: Change["origin"]) => void): void {
    this.documents.listen(({ uri, origin }) => listener(uri, origin));
  }

  /** Begin a new connection, whose language server knows no document. */
  protected forget(): void {
    this.known = new Set();
  }

  /** Initialize the language server. Resolves when it has replied. */
  protected async initialize(workspaceFolders: { uri: string; name: string }[] | null): Promise<void> {
    await this.connection.request("initialize", {
      processId: null, rootUri: null, workspaceFolders, capabilities: CAPABILITIES, clientInfo: { name: "btcore studio" },
    });
    this.connection.notify("initialized", {});
  }
}

/** The page of `btcore studio`: the texts are shared by all pages of its process. */
export class BrowserHome extends PageHome {
  private readonly transport: SocketTransport;
  private isFirst = true;
  private started!: (start: Start) => void;
  private failed!: (error: unknown) => void;
  private readonly start = new Promise<Start>((resolve, reject) => {
    this.started = resolve;
    this.failed = reject;
  });

  constructor() {
    const transport = new SocketTransport(() => void this.opened());
    super(transport, texts.lost);
    this.transport = transport;
    this.connection.on<Pushed>("btcore/pushed", (pushed) => this.documents.receive(pushed));
  }

  begin(): Promise<Start> {
    this.transport.connect();
    return this.start;
  }

  async save(uri: string): Promise<boolean> {
    await this.documents.load(uri);
    await this.documents.pushed(uri);
    const isWritten = await this.connection.request<boolean>("btcore/save", { uri });
    this.connection.notify("textDocument/didSave", { textDocument: { uri } });
    return isWritten;
  }

  protected readShared(uri: string): Promise<SharedText> {
    return this.connection.request("btcore/read", { uri });
  }

  protected async push(pushed: Pushed): Promise<Reply> {
    try {
      return (await this.connection.request<{ version: number }>("btcore/push", pushed)).version;
    } catch (error) {
      if (!isConnected.value) return "lost";
      if (error instanceof RpcError && error.code === CONTENT_MODIFIED) return "behind";
      message.value = texts.editRefused(reasonOf(error));
      return "refused";
    }
  }

  private async opened(): Promise<void> {
    this.forget();
    try {
      const start = await this.connection.request<Start>("btcore/start", {});
      // The studio's process chooses the folder and the settings.
      await this.initialize(null);
      isConnected.value = true;
      if (this.isFirst) this.started(start);
      else await this.documents.reload();
      this.isFirst = false;
    } catch (error) {
      if (isConnected.value) this.failed(error);
    }
  }
}

/** Follow the colours of VS Code, not those of the desktop. */
function followTheme(): void {
  const follow = () => {
    const isLight = /vscode-(high-contrast-)?light/.test(document.body.className);
    document.documentElement.dataset.theme = isLight ? "light" : "dark";
  };
  new MutationObserver(follow).observe(document.body, { attributeFilter: ["class"] });
  follow();
}

export interface EditorApi { postMessage(message: unknown): void }

/** The page in VS Code, which has the texts, their undo and the language client. */
export class EditorHome implements Home {
  readonly connection: Connection;
  readonly documents = null;
  private keyOfCursor: string | null = null;

  constructor(api: EditorApi) {
    const transport: Transport = { send: (message) => api.postMessage(message), receive: () => {}, lost: () => {} };
    this.connection = new Connection(transport, texts.lost);
    window.addEventListener("message", ({ data }) => transport.receive(data));
    canUndo.value = canRedo.value = true;
    followTheme();
    this.connection.on<{ tree: string }>("studio/tree", (params) => { tree.value = params.tree; });
    this.connection.on<Place>("studio/cursor", ({ uri, position }) => {
      const key = keyAt(uri, position);
      if (!key || selection.value.includes(key)) return;
      this.keyOfCursor = key;
      selection.value = [key];
    });
    // A selected node moves the cursor of the text beside it, unless the cursor has selected it.
    let last: string | null = null;
    effect(() => {
      const node = selectedNode.value;
      if (node && node.key !== last && node.key !== this.keyOfCursor) this.connection.notify("studio/select", node.place);
      last = node?.key ?? null;
      this.keyOfCursor = null;
    });
  }

  begin(): Promise<Start> {
    return this.connection.request("studio/start", {});
  }

  async read(uri: string): Promise<Text> {
    return textOf(await this.connection.request<string>("studio/read", { uri }));
  }

  mark(): Mark {
    return new Mark();
  }

  async apply(edit: WorkspaceEdit): Promise<void> {
    await this.connection.request("studio/apply", { edit });
  }

  async undo(): Promise<null> {
    await this.connection.request("studio/undo", {});
    return null;
  }

  async redo(): Promise<null> {
    await this.connection.request("studio/redo", {});
    return null;
  }

  async save(uri: string): Promise<boolean> {
    await this.connection.request("studio/save", { uri });
    return true;
  }

  async export(name: string, content: Blob): Promise<void> {
    const bytes = new Uint8Array(await content.arrayBuffer());
    await this.connection.request("studio/export", { name, base64: btoa(Array.from(bytes, (byte) => String.fromCharCode(byte)).join("")) });
  }

  reveal(place: Place): void {
    this.connection.notify("studio/reveal", place);
  }

  onChange(listener: (uri: string, origin: Change["origin"]) => void): void {
    this.connection.on<{ uri: string }>("studio/changed", ({ uri }) => listener(uri, "remote"));
  }
}
