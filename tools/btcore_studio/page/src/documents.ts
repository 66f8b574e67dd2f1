// The texts of the open documents. Every page has its own copy of a text; an authority (the server) puts the edits of
// all pages in one order, as in @codemirror/collab: it accepts edits of its present version only. A page whose
// edits are refused receives the others' edits, rebases its own, and repeats.

import { ChangeSet, type ChangeSpec, MapMode, Text } from "@codemirror/state";
import type { Position, Pushed, Range, SharedText, TextEdit, WorkspaceEdit } from "./protocol";

type Origin = "typing" | "command" | "undo" | "remote";

export interface Change {
  uri: string;
  changes: ChangeSet;
  before: Text;
  origin: Origin;
  /** CodeMirror's name of the user's action, such as "input.type". */
  userEvent: string;
}

export type Reply = number | "behind" | "lost" | "refused";

/** The server's side of the texts. */
interface Authority {
  read(uri: string): Promise<SharedText>;
  /** Resolves to the new version; "behind" if the text has another version, "lost" without a connection. */
  push(pushed: Pushed): Promise<Reply>;
  /** Give the text to the language server. */
  opened(uri: string, text: string, version: number): void;
  changed(uri: string, edits: TextEdit[], version: number): void;
}

/** What a text became after a moment: changes of the text at that moment, by document. */
export class Mark {
  readonly changes = new Map<string, { before: Text; changes: ChangeSet }>();

  /** Note a change. */
  note({ uri, before, changes }: Change): void {
    const known = this.changes.get(uri);
    this.changes.set(uri, known ? { before: known.before, changes: known.changes.compose(changes) } : { before, changes });
  }
}

interface OpenDocument {
  text: Text;
  /** The text of the authority's *version*. */
  confirmed: Text;
  version: number;
  /** The edits that the authority has not answered yet. */
  pushing: ChangeSet | null;
  /** Later edits; or all, if the authority refused them. */
  local: ChangeSet | null;
  /** Edits of others that the page cannot apply before the reply to its own. */
  waiting: Pushed[];
  languageVersion: number;
  isPushing: boolean;
  waiters: { resolve: () => void; reject: (error: Error) => void }[];
}

export class Documents {
  private readonly open = new Map<string, OpenDocument>();
  private readonly opening = new Map<string, Promise<void>>();
  private readonly listeners: ((change: Change) => void)[] = [];
  private readonly marks = new Set<WeakRef<Mark>>();

  constructor(private readonly authority: Authority) {}

  /** Call *listener* after each change of a text. */
  listen(listener: (change: Change) => void): void {
    this.listeners.push(listener);
  }

  /** Begin to note what changes. */
  mark(): Mark {
    const mark = new Mark();
    this.marks.add(new WeakRef(mark));
    return mark;
  }

  text(uri: string): Text {
    return this.document(uri).text;
  }

  isOpen(uri: string): boolean {
    return this.open.has(uri);
  }

  /** Read a text, unless it is open. */
  load(uri: string): Promise<void> {
    if (this.open.has(uri)) return Promise.resolve();
    let loading = this.opening.get(uri);
    if (!loading) {
      loading = this.authority.read(uri).then(({ text, version }) => {
        const document = textOf(text);
        this.open.set(uri, {
          text: document, confirmed: document, version, pushing: null, local: null, waiting: [], languageVersion: 1,
          isPushing: false, waiters: [],
        });
        this.authority.opened(uri, text, 1);
      }).finally(() => this.opening.delete(uri));
      this.opening.set(uri, loading);
    }
    return loading;
  }

  /** Read every open text again, after a new connection. Own edits that the authority misses are pushed again. */
  async reload(): Promise<void> {
    for (const [uri, document] of this.open) {
      const shared = await this.authority.read(uri);
      document.languageVersion += 1;
      this.authority.opened(uri, document.text.toString(), document.languageVersion);
      this.resume(uri, document, shared);
    }
  }

  /** Change a text, and send the change to the language server and to the authority. */
  change(uri: string, changes: ChangeSet, origin: Origin, userEvent = ""): void {
    if (changes.empty) return;
    const document = this.document(uri);
    document.local = document.local ? document.local.compose(changes) : changes;
    this.apply(uri, document, changes, origin, userEvent);
    void this.push(uri, document);
  }

  /**
   * Return the changes of an edit.
   *
   * @param since The moment of the texts for which the edit was made.
   */
  async changesOf(edit: WorkspaceEdit, since: Mark): Promise<Map<string, ChangeSet>> {
    const found = new Map<string, ChangeSet>();
    for (const [uri, edits] of Object.entries(edit.changes)) {
      await this.load(uri);
      const later = since.changes.get(uri);
      const changes = changeSet(later ? later.before : this.text(uri), edits);
      found.set(uri, later ? changes.map(later.changes, true) : changes);
    }
    return found;
  }

  /** Return where a character of the texts at *since* is now; null if it was deleted. */
  position(uri: string, position: Position, since: Mark): Position | null {
    const later = since.changes.get(uri);
    if (!later) return position;
    const offset = later.changes.mapPos(offsetAt(later.before, position), 1, MapMode.TrackAfter);
    return offset === null ? null : positionAt(this.text(uri), offset);
  }

  /** Resolves when the authority has every edit. */
  pushed(uri: string): Promise<void> {
    const document = this.document(uri);
    return new Promise((resolve, reject) => {
      document.waiters.push({ resolve, reject });
      void this.push(uri, document);
    });
  }

  /** Apply the edits of another page, or of the disk. */
  receive(pushed: Pushed): void {
    const document = this.open.get(pushed.uri);
    if (!document || pushed.version < document.version) return;
    if (pushed.version > document.version) {
      // The reply to the page's own edits comes first; without such a request, something was lost.
      if (document.pushing) document.waiting.push(pushed);
      else void this.authority.read(pushed.uri).then((shared) => this.resume(pushed.uri, document, shared));
      return;
    }
    this.rebase(pushed.uri, document, changeSet(document.confirmed, pushed.edits), pushed.version + 1);
    void this.push(pushed.uri, document);
  }

  private document(uri: string): OpenDocument {
    const document = this.open.get(uri);
    if (!document) throw new Error(`the document ${uri} is not open`);
    return document;
  }

  private apply(uri: string, document: OpenDocument, changes: ChangeSet, origin: Origin, userEvent: string): void {
    const before = document.text;
    document.text = changes.apply(before);
    document.languageVersion += 1;
    this.authority.changed(uri, textEdits(before, changes), document.languageVersion);
    const change = { uri, changes, before, origin, userEvent };
    for (const reference of this.marks) {
      const mark = reference.deref();
      if (mark) mark.note(change);
      else this.marks.delete(reference);
    }
    for (const listener of this.listeners) listener(change);
  }

  private async push(uri: string, document: OpenDocument): Promise<void> {
    if (document.isPushing) return;
    document.isPushing = true;
    let reply: Reply | null = null;
    while (document.local && !document.pushing) {
      const { version, local, confirmed } = document;
      document.pushing = local;
      document.local = null;
      reply = await this.authority.push({ uri, version, edits: textEdits(confirmed, local) });
      // The edits of others may have moved the page's own meanwhile.
      const pushing: ChangeSet | null = document.pushing;
      if (typeof reply === "number" && pushing) {
        document.confirmed = pushing.apply(document.confirmed);
        document.version = reply;
        document.pushing = null;
        for (const pushed of document.waiting.splice(0)) this.receive(pushed);
      } else if (reply === "lost") {
        // `reload` finds out whether the authority has the edits.
        break;
      } else {
        this.unpush(document);
        // After "behind", the edits of others are either here already, or on their way.
        if (document.version === version) break;
      }
    }
    document.isPushing = false;
    if (reply === "behind" && document.local) return;
    const waiters = document.waiters.splice(0);
    if (!document.local && !document.pushing) for (const { resolve } of waiters) resolve();
    else for (const { reject } of waiters) reject(new Error("the edits were not accepted"));
  }

  private unpush(document: OpenDocument): void {
    const { pushing, local } = document;
    if (pushing) document.local = local ? pushing.compose(local) : pushing;
    document.pushing = null;
    document.waiting = [];
  }

  /** Continue from the authority's text, whatever was lost before. */
  private resume(uri: string, document: OpenDocument, shared: SharedText): void {
    const text = textOf(shared.text);
    const sent = document.pushing?.apply(document.confirmed);
    if (sent?.eq(text)) {
      document.confirmed = sent;
      document.pushing = null;
    }
    this.unpush(document);
    const changes = difference(document.confirmed, text);
    this.rebase(uri, document, changes, shared.version);
    void this.push(uri, document);
  }

  private rebase(uri: string, document: OpenDocument, remote: ChangeSet, version: number): void {
    document.confirmed = remote.apply(document.confirmed);
    document.version = version;
    for (const name of ["pushing", "local"] as const) {
      const own = document[name];
      if (!own) continue;
      document[name] = own.map(remote, true);
      remote = remote.map(own);
    }
    if (!remote.empty) this.apply(uri, document, remote, "remote", "");
  }
}

// --- texts and positions

/** Return a text that keeps every character: its lines end at LF, so that a CR before it belongs to the line. */
export const textOf = (text: string): Text => Text.of(text.split("\n"));

// Lines of the protocol also end at a CR without LF, which is rare. Then the starts of all lines are listed.
const listedStarts = new WeakMap<Text, number[] | null>();

function lineStarts(text: Text): number[] | null {
  let starts = listedStarts.get(text);
  if (starts === undefined) {
    const all = text.toString();
    starts = /\r(?!\n)/.test(all) ? [0, ...Array.from(all.matchAll(/\r\n?|\n/g), (found) => found.index + found[0].length)] : null;
    listedStarts.set(text, starts);
  }
  return starts;
}

/** Return the start and the end of a line without its line break. */
function lineSpan(text: Text, line: number): [number, number] {
  const starts = lineStarts(text);
  const start = starts ? starts[line]! : text.line(line + 1).from;
  let end = starts ? (starts[line + 1] ?? text.length + 1) - 1 : text.line(line + 1).to;
  if (starts && line + 1 === starts.length) end = text.length;
  if (end > start && text.sliceString(end - 1, end) === "\r" && end < text.length) end -= 1;
  return [start, end];
}

const lineCount = (text: Text): number => lineStarts(text)?.length ?? text.lines;

/** Return the offset of a position; after the end of a line, its end. */
export function offsetAt(text: Text, { line, character }: Position): number {
  if (line >= lineCount(text)) return text.length;
  const [start, end] = lineSpan(text, Math.max(0, line));
  return Math.min(start + Math.max(0, character), end);
}

export function positionAt(text: Text, offset: number): Position {
  const starts = lineStarts(text);
  let line: number;
  if (starts) {
    let [low, high] = [0, starts.length];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (starts[middle]! <= offset) low = middle;
      else high = middle;
    }
    line = low;
  } else line = text.lineAt(offset).number - 1;
  const [start, end] = lineSpan(text, line);
  return { line, character: Math.min(offset, end) - start };
}

export const rangeAt = (text: Text, from: number, to: number): Range => ({ start: positionAt(text, from), end: positionAt(text, to) });

/** Return the changes of edits that do not overlap. */
function changeSet(text: Text, edits: readonly TextEdit[]): ChangeSet {
  const specs: ChangeSpec[] = edits.map(({ range, newText }) => ({
    from: offsetAt(text, range.start), to: offsetAt(text, range.end), insert: textOf(newText),
  }));
  return ChangeSet.of(specs, text.length, "\n");
}

// A position of the protocol is neither inside CR LF nor inside a surrogate pair.
const isInside = (text: Text, offset: number): boolean =>
  offset > 0 && /^(\r\n|[\ud800-\udbff][\udc00-\udfff])$/.test(text.sliceString(offset - 1, Math.min(offset + 1, text.length)));

/** Return the edits of changes, all with positions in *before*, in the order of the text. */
export function textEdits(before: Text, changes: ChangeSet): TextEdit[] {
  const edits: { from: number; to: number; insert: string }[] = [];
  changes.iterChanges((from, to, _from, _to, inserted) => {
    let insert = inserted.toString();
    if (isInside(before, from)) insert = before.sliceString(--from, from + 1) + insert;
    if (isInside(before, to)) insert += before.sliceString(to, ++to);
    const last = edits.at(-1);
    if (last && from < last.to) {
      // Both were widened over the same two characters.
      last.insert += insert.slice(last.to - from);
      last.to = to;
    } else edits.push({ from, to, insert });
  });
  return edits.map(({ from, to, insert }) => ({ range: rangeAt(before, from, to), newText: insert }));
}

/** Return the smallest single change between two texts. */
function difference(before: Text, after: Text): ChangeSet {
  const [a, b] = [before.toString(), after.toString()];
  let start = 0;
  while (start < a.length && start < b.length && a[start] === b[start]) start += 1;
  let end = 0;
  while (end < a.length - start && end < b.length - start && a[a.length - 1 - end] === b[b.length - 1 - end]) end += 1;
  return ChangeSet.of({ from: start, to: a.length - end, insert: textOf(b.slice(start, b.length - end)) }, a.length, "\n");
}
