import * as vscode from "vscode";
import { LanguageClient, State } from "vscode-languageclient/node";
import { settings } from "./settings";

export const LANGUAGE = "behaviortree";
/** The nodes that documents can use have changed. */
export const REFRESH = "workspace/semanticTokens/refresh";

const TREES = /<\s*(?:BehaviorTree|TreeNodesModel)\b|<\s*root\b[^>]*\bBTCPP_format\b/;
const SEARCHED = 20_000;

/** Whether an XML document contains behavior trees or models of nodes. */
export function containsTrees(document: vscode.TextDocument): boolean {
  const end = document.positionAt(SEARCHED);
  return TREES.test(document.getText(new vscode.Range(0, 0, end.line, end.character)));
}

/** Change the language of XML documents with behavior trees, now and whenever a document is opened. */
export function associate(context: vscode.ExtensionContext): void {
  const check = (document: vscode.TextDocument): void => {
    if (document.languageId === "xml" && containsTrees(document)) {
      void vscode.languages.setTextDocumentLanguage(document, LANGUAGE);
    }
  };
  vscode.workspace.textDocuments.forEach(check);
  context.subscriptions.push(
    vscode.workspace.onDidOpenTextDocument(check),
    vscode.workspace.onDidSaveTextDocument(check),
  );
}

/** What the server sends to its client. */
export interface ServerMessage {
  method: string;
  params?: unknown;
}

/** The messages of the server that pages need, too. */
const FORWARDED = new Set(["textDocument/publishDiagnostics", "btcore/live", "btcore/proofProgress", REFRESH]);

/** The language server: `btcore lsp`. */
export class Server {
  private client: LanguageClient | undefined;
  private last: Promise<void> = Promise.resolve();
  private readonly messages = new vscode.EventEmitter<ServerMessage>();
  private readonly starts = new vscode.EventEmitter<void>();
  readonly onMessage = this.messages.event;
  /** The server was started, also again. */
  readonly onStart = this.starts.event;

  /** Start the server, or start it again. */
  start(): Promise<void> {
    return this.next(() => this.startClient());
  }

  stop(): Promise<void> {
    return this.next(() => this.stopClient());
  }

  /** Send a request to the server that is running, or starting. */
  async request<T>(method: string, params: unknown): Promise<T> {
    await this.last;
    if (!this.client) throw new Error("The language server does not run.");
    return this.client.sendRequest<T>(method, params);
  }

  /** Run an action after all earlier actions: a client that is starting cannot be stopped. */
  private next(action: () => Promise<void>): Promise<void> {
    this.last = this.last.then(action);
    return this.last;
  }

  private async startClient(): Promise<void> {
    await this.stopClient();
    const { command } = settings();
    const client = new LanguageClient(
      "btcore",
      "btcore",
      { command, args: ["lsp"] },
      {
        documentSelector: [{ language: LANGUAGE }],
        initializationOptions: serverSettings(),
        synchronize: {
          fileEvents: vscode.workspace.createFileSystemWatcher("**/*.{xml,btproj,py}"),
        },
        connectionOptions: {
          messageStrategy: {
            handleMessage: (message, next) => {
              next(message);
              const { method, params } = message as Partial<ServerMessage>;
              if (method !== undefined && FORWARDED.has(method)) this.messages.fire({ method, params });
            },
          },
        },
      },
    );
    this.client = client;
    client.onDidChangeState(({ newState }) => {
      if (newState === State.Running && this.client === client) this.starts.fire();
    });
    try {
      await client.start();
    } catch (error) {
      this.client = undefined;
      void vscode.window.showErrorMessage(
        `The command '${command} lsp' does not start: ${String(error)}. Install it with: ` +
          "pip install 'btcore[lsp]', or set its path in the setting btcore.command.",
      );
    }
  }

  /** Send the settings to the server again. */
  async configure(): Promise<void> {
    await this.client?.sendNotification("workspace/didChangeConfiguration", { settings: serverSettings() });
  }

  private async stopClient(): Promise<void> {
    const client = this.client;
    this.client = undefined;
    // A server that has crashed cannot be stopped.
    await client?.stop().catch(() => undefined);
  }
}

function serverSettings(): { btcore: object } {
  const { trusted, plugins, models, given } = settings();
  return { btcore: { trusted, plugins, models, given } };
}
