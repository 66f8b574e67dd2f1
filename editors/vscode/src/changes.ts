import * as vscode from "vscode";

/** The structures of the language server's protocol. */
export interface Position {
  line: number;
  character: number;
}
export interface Place {
  uri: string;
  position: Position;
}
export interface TextEdit {
  range: { start: Position; end: Position };
  newText: string;
}
/** An edit of texts with *versions*; a document without a version was not open. */
export interface VersionedEdit {
  changes: Record<string, TextEdit[]>;
  versions?: Versions;
}
export type Versions = Record<string, number>;

const MAX_CHANGES = 500;

interface Change {
  /** The version of the text before the change. */
  before: number;
  start: Position;
  end: Position;
  newEnd: Position;
}

/** What changed in the documents: finds places of earlier versions in the present texts. */
export class Changes {
  private readonly byUri = new Map<string, Change[]>();
  private readonly seen = new Map<string, number>();

  /** Note a change. Its parts apply one after the other. */
  note({ document, contentChanges }: vscode.TextDocumentChangeEvent): void {
    const uri = document.uri.toString();
    const known = this.byUri.get(uri) ?? [];
    const before = this.seen.get(uri) ?? document.version - 1;
    this.seen.set(uri, document.version);
    for (const { range, text } of contentChanges) {
      const { start, end } = range;
      const lines = text.split(/\r\n|\r|\n/);
      const last = lines.at(-1)?.length ?? 0;
      const newEnd = { line: start.line + lines.length - 1, character: lines.length > 1 ? last : start.character + last };
      known.push({ before, start, end, newEnd });
    }
    this.byUri.set(uri, known.slice(-MAX_CHANGES));
  }

  forget(document: vscode.TextDocument): void {
    this.byUri.delete(document.uri.toString());
    this.seen.delete(document.uri.toString());
  }

  /** Return the versions of the open documents. */
  versions(): Versions {
    return Object.fromEntries(vscode.workspace.textDocuments.map(({ uri, version }) => [uri.toString(), version]));
  }

  /** Return where a character of an earlier text is now; null if it was deleted. */
  position(uri: string, position: Position, versions: Versions | undefined): Position | null {
    return this.moved(uri, position, versions, false);
  }

  /** Return the present range of an earlier one; null if a part of it has changed. */
  range(uri: string, { start, end }: TextEdit["range"], versions: Versions | undefined): TextEdit["range"] | null {
    const from = this.moved(uri, start, versions, false);
    const isEmpty = start.line === end.line && start.character === end.character;
    const to = isEmpty ? from : this.moved(uri, end, versions, true);
    if (!from || !to || isBefore(to, from)) return null;
    const isChanged = !isEmpty && this.since(uri, versions).some(({ start: changed }) => isBefore(from, changed) && isBefore(changed, to));
    return isChanged ? null : { start: from, end: to };
  }

  private since(uri: string, versions: Versions | undefined): Change[] {
    const version = versions?.[uri];
    return version === undefined ? [] : (this.byUri.get(uri) ?? []).filter(({ before }) => before >= version);
  }

  /** @param isEnd Whether a text that is inserted at the position comes after it. */
  private moved(uri: string, position: Position, versions: Versions | undefined, isEnd: boolean): Position | null {
    const version = versions?.[uri];
    const first = this.byUri.get(uri)?.[0];
    // The changes before the listed ones are forgotten.
    if (version !== undefined && first && first.before > version && this.byUri.get(uri)?.length === MAX_CHANGES) return null;
    let { line, character } = position;
    for (const { start, end, newEnd } of this.since(uri, versions)) {
      const now = { line, character };
      if (isBefore(now, start) || (isEnd && !isBefore(start, now))) continue;
      if (isBefore(now, end)) return null;
      if (line === end.line) character += newEnd.character - end.character;
      line += newEnd.line - end.line;
    }
    return { line, character };
  }
}

const isBefore = (a: Position, b: Position): boolean => a.line < b.line || (a.line === b.line && a.character < b.character);

/** Return JSON data with every place moved by *move*. */
export function movePlaces(value: unknown, move: (place: Place) => Place): unknown {
  if (Array.isArray(value)) return value.map((item) => movePlaces(item, move));
  if (typeof value !== "object" || value === null) return value;
  if ("uri" in value && "position" in value) return move(value as Place);
  return Object.fromEntries(Object.entries(value).map(([name, item]) => [name, movePlaces(item, move)]));
}
