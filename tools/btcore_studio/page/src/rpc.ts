// JSON-RPC 2.0 over a transport: a WebSocket in the browser, messages of a web view in VS Code.

export interface Transport {
  send(message: object): void;
  /** Set by the connection. */
  receive: (message: Message) => void;
  /** Set by the connection: the transport has lost the other side. */
  lost: () => void;
}

interface Message {
  id?: number | string | null;
  method?: string;
  params?: unknown;
  result?: unknown;
  error?: { code: number; message: string; data?: unknown };
}

export const CONTENT_MODIFIED = -32801;
const METHOD_NOT_FOUND = -32601;
const CONNECTION_LOST = -32000;

/** An error reply. Its message is for the user. */
export class RpcError extends Error {
  constructor(readonly code: number, message: string, readonly data?: unknown) {
    super(message);
    this.name = "RpcError";
  }
}

type Reply = { resolve: (result: never) => void; reject: (error: RpcError) => void };

/** Requests and notifications in both directions. */
export class Connection {
  private readonly replies = new Map<number | string, Reply>();
  private readonly listeners = new Map<string, ((params: never) => void)[]>();
  private lastId = 0;

  /** @param lostText The message of requests without a reply. */
  constructor(private readonly transport: Transport, private readonly lostText: string) {
    transport.receive = (message) => this.receive(message);
    transport.lost = () => this.rejectAll();
  }

  request<T>(method: string, params: unknown): Promise<T> {
    const id = ++this.lastId;
    return new Promise<T>((resolve, reject) => {
      this.replies.set(id, { resolve, reject });
      try {
        this.transport.send({ jsonrpc: "2.0", id, method, params });
      } catch {
        this.replies.delete(id);
        reject(new RpcError(CONNECTION_LOST, this.lostText));
      }
    });
  }

  /** Send a notification; without a connection nothing is sent. */
  notify(method: string, params: unknown): void {
    try {
      this.transport.send({ jsonrpc: "2.0", method, params });
    } catch {
      // The home opens everything again with the next connection.
    }
  }

  /** Call *listener* with the parameters of each notification. */
  on<T>(method: string, listener: (params: T) => void): void {
    this.listeners.set(method, [...(this.listeners.get(method) ?? []), listener]);
  }

  private receive(message: Message): void {
    const { id, method } = message;
    if (method !== undefined) {
      for (const listener of this.listeners.get(method) ?? []) listener(message.params as never);
      if (id === undefined || id === null) return;
      // The page's capabilities offer the server no requests, except those whose answer is nothing.
      const isKnown = method.startsWith("workspace/") || method.startsWith("client/") || method.startsWith("window/");
      this.transport.send(
        isKnown ? { jsonrpc: "2.0", id, result: null }
          : { jsonrpc: "2.0", id, error: { code: METHOD_NOT_FOUND, message: `the page has no method ${method}` } });
      return;
    }
    const reply = id === undefined || id === null ? undefined : this.replies.get(id);
    if (!reply || id === undefined || id === null) return;
    this.replies.delete(id);
    if (message.error) reply.reject(new RpcError(message.error.code, message.error.message, message.error.data));
    else reply.resolve(message.result as never);
  }

  private rejectAll(): void {
    const replies = [...this.replies.values()];
    this.replies.clear();
    for (const { reject } of replies) reject(new RpcError(CONNECTION_LOST, this.lostText));
  }
}
