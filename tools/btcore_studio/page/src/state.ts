// What the parts of the page share. A part changes another only through these signals and functions.

import { computed, effect, signal } from "@preact/signals";
import type {
  Command, Diagnostic, Drawing, DrawnNode, EditResult, Live, Palette, Place, Position, Preview, SharedFile, Start, WorkspaceEdit,
} from "./protocol";

export const start = signal<Start | null>(null);
/** The document of the text pane and of the drawing. */
export const uri = signal("");
/** The chosen tree; null for the main tree. */
export const tree = signal<string | null>(null);
export const folded = signal<ReadonlySet<string>>(new Set());
export const drawing = signal<Drawing | null>(null);
export const palette = signal<Palette>({ items: [] });
export const live = signal<Live | null>(null);
/** The keys of the selected nodes; the last one has the form and the cursor. */
export const selection = signal<readonly string[]>([]);
/** The errors and warnings of each document, by its URI. */
export const diagnostics = signal<ReadonlyMap<string, readonly Diagnostic[]>>(new Map());
/** The files of the folder. */
export const files = signal<readonly SharedFile[]>([]);
/** The file of the shown document, if it is in the folder. */
export const shownFile = computed(() => files.value.find((file) => file.uri === uri.value));

let awaited = 0;
let drawnAt = 0;
const afterwards: (() => void)[] = [];

/** How long (ms) the picture has shown the present text; 0 while a drawing is awaited. */
export const msSinceDrawing = (): number => (awaited ? 0 : performance.now() - drawnAt);

/** Await a command or a drawing: *drawn* settles when the picture shows the present text. */
export async function awaitDrawing<T>(drawn: Promise<T>): Promise<T> {
  awaited += 1;
  try {
    return await drawn;
  } finally {
    awaited -= 1;
    drawnAt = performance.now();
    if (!awaited) for (const step of afterwards.splice(0)) step();
  }
}

/**
 * Call *step*, after the drawing if one is awaited. A change of the page would be painted first, and Chromium handles no
 * messages of the server between a key and the frame that it causes.
 */
export function afterDrawing(step: () => void): void {
  if (awaited) afterwards.push(step);
  else step();
}

const ANNOUNCED_MS = 5000;
/** What screen readers read, each item once. */
export const announcements = signal<readonly { id: number; text: string }[]>([]);
let announced = 0;

/** Let screen readers read a text, also if it is the same as the last. */
export function announce(text: string): void {
  if (!text) return;
  const item = { id: ++announced, text };
  announcements.value = [...announcements.peek(), item];
  setTimeout(() => { announcements.value = announcements.peek().filter((other) => other !== item); }, ANNOUNCED_MS);
}

const shownMessage = signal("");
/** A sentence for the user, in the status line. Screen readers read it each time that it is set. */
export const message = {
  get value(): string { return shownMessage.value; },
  set value(text: string) {
    shownMessage.value = text;
    announce(text);
  },
  add(text: string): void {
    shownMessage.value += ` ${text}`;
    announce(text);
  },
};
/** Show why something is not possible, until another node, tree or connection is chosen. */
export function refuse(reason: string): void {
  message.value = reason;
  refusal = reason;
}
let refusal = "";

/** The field of a node type's form to which the last refusal belongs, or "". */
export const refusedField = signal("");

export const reasonOf = (error: unknown): string => (error instanceof Error ? error.message : String(error));
export const showError = (error: unknown): void => { message.value = reasonOf(error); };

export const nodesByKey = computed(
  () => new Map((drawing.value?.nodes ?? []).map((node) => [node.key, node] as const)),
);
/** Return the name of a node; of a node that is not in the picture, the last part of its path, or its key. */
export const nameOf = (key: string, path = key): string =>
  nodesByKey.value.get(key)?.name ?? path.split("/").at(-1)!.replace(/::\d+$/, "");
export const selectedNodes = computed(() =>
  selection.value.flatMap((key) => {
    const node = nodesByKey.value.get(key);
    return node ? [node] : [];
  }),
);
export const selectedNode = computed<DrawnNode | null>(() => selectedNodes.value.at(-1) ?? null);

effect(() => {
  void [selection.value, uri.value, tree.value, live.value?.connection];
  if (refusal && shownMessage.peek() === refusal) shownMessage.value = "";
  refusal = "";
});

const isBefore = (a: Position, b: Position) => a.line < b.line || (a.line === b.line && a.character <= b.character);
const isWithin = ({ uri, position }: Place, { place, end }: DrawnNode) =>
  place.uri === uri && isBefore(place.position, position) && isBefore(position, end);

export const isSamePosition = (a: Position, b: Position): boolean => a.line === b.line && a.character === b.character;
export const isSamePlace = (a: Place | undefined, b: Place | undefined): boolean =>
  a !== undefined && b !== undefined && a.uri === b.uri && isSamePosition(a.position, b.position);

/** Return the drawn nodes of the innermost element around a place. A tree that is called several times is drawn several times. */
function nodesAround(place: Place): DrawnNode[] {
  const around = (drawing.value?.nodes ?? []).filter((node) => isWithin(place, node));
  // The innermost element is the last that begins before the place.
  let innermost = around[0];
  for (const node of around) if (!isBefore(node.place.position, innermost!.place.position)) innermost = node;
  return around.filter((node) => isSamePlace(node.place, innermost!.place));
}

/** The problems of each node, by its key. Problems of a child are not its parent's. */
export const problemsByKey = computed(() => {
  const found = new Map<string, Diagnostic[]>();
  for (const [uri, items] of diagnostics.value) {
    for (const item of items) {
      for (const { key } of nodesAround({ uri, position: item.range.start })) found.set(key, [...(found.get(key) ?? []), item]);
    }
  }
  return found;
});

let lastSeverities: ReadonlyMap<string, 1 | 2> = new Map();

/** The most severe problem of each node, by its key: 1 error, 2 warning. The same map as long as the content is the same. */
export const severities = computed(() => {
  const found = new Map<string, 1 | 2>();
  for (const [key, items] of problemsByKey.value) {
    const severity = ([1, 2] as const).find((wanted) => items.some((item) => item.severity === wanted));
    if (severity) found.set(key, severity);
  }
  const isSame = found.size === lastSeverities.size && [...found].every(([key, severity]) => lastSeverities.get(key) === severity);
  if (!isSame) lastSeverities = found;
  return lastSeverities;
});

/** Return the key of the innermost node of the drawing around a position of a text. */
export const keyAt = (uri: string, position: Position): string | null => nodesAround({ uri, position })[0]?.key ?? null;

/** What the page's home (browser or VS Code) and its documents offer to the parts; set by main.tsx. */
interface Actions {
  /** Send a request to the language server. Rejects with an Error whose message is for the user. */
  request<T>(method: string, params: unknown): Promise<T>;
  /** Compute an operation, apply its edit as one step of undo, and select its nodes. Shows a refusal itself. */
  edit(command: Command): Promise<EditResult | null>;
  /** Return the problems that an operation would add. Rejects with the reason if it cannot be applied. */
  preview(command: Command): Promise<Preview>;
  /** Apply a change of several files as one step of undo. Shows a refusal itself. */
  apply(edit: WorkspaceEdit): void;
  undo(): Promise<void>;
  redo(): Promise<void>;
  save(): Promise<void>;
  /** Show the place in the text pane (or in VS Code's editor). */
  reveal(place: Place): void;
}

export const actions: Actions = {} as Actions;
