// What the parts of the page share. A part changes another only through these signals and functions.

import { computed, signal } from "@preact/signals";
import type {
  Command, Diagnostic, Drawing, DrawnNode, EditResult, Live, Palette, Position, SharedFile, Start,
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
/** A sentence for the user, in the status line. */
export const message = signal("");

export const nodesByKey = computed(
  () => new Map((drawing.value?.nodes ?? []).map((node) => [node.key, node] as const)),
);
export const selectedNodes = computed(() =>
  selection.value.flatMap((key) => {
    const node = nodesByKey.value.get(key);
    return node ? [node] : [];
  }),
);
export const selectedNode = computed<DrawnNode | null>(() => selectedNodes.value.at(-1) ?? null);

export const isBefore = (a: Position, b: Position) => a.line < b.line || (a.line === b.line && a.character <= b.character);

/** The most severe problem of each node, by its key: 1 error, 2 warning. Problems of a child are not its parent's. */
export const severities = computed(() => {
  const found = new Map<string, 1 | 2>();
  const nodes = drawing.value?.nodes ?? [];
  for (const [uri, items] of diagnostics.value) {
    for (const { range, severity } of items) {
      if (severity !== 1 && severity !== 2) continue;
      const around = nodes.filter(
        ({ place, end }) => place.uri === uri && isBefore(place.position, range.start) && isBefore(range.start, end),
      );
      // The innermost element is the last that begins before the problem. Its tree may be drawn several times.
      let innermost: Position | null = null;
      for (const { place } of around) {
        if (!innermost || isBefore(innermost, place.position)) innermost = place.position;
      }
      for (const { key, place } of around) {
        if (innermost && isBefore(innermost, place.position)) found.set(key, severity === 1 ? 1 : (found.get(key) ?? 2));
      }
    }
  }
  return found;
});

/** Return the key of the innermost node of the drawing around a position of a text. */
export function keyAt(uri: string, position: Position): string | null {
  let best: DrawnNode | null = null;
  for (const node of drawing.value?.nodes ?? []) {
    const { place, end } = node;
    if (place.uri !== uri || !isBefore(place.position, position) || !isBefore(position, end)) continue;
    // A tree that is called several times is drawn several times.
    if (!best || !isBefore(place.position, best.place.position)) best = node;
  }
  return best?.key ?? null;
}

/** What the page's home (browser or VS Code) and its documents offer to the parts; set by main.tsx. */
export interface Actions {
  /** Send a request to the language server. Rejects with an Error whose message is for the user. */
  request<T>(method: string, params: unknown): Promise<T>;
  /** Compute an operation, apply its edit as one step of undo, and select its nodes. Shows a refusal itself. */
  edit(command: Command): Promise<EditResult | null>;
  undo(): Promise<void>;
  redo(): Promise<void>;
  save(): Promise<void>;
  /** Request the drawing again, with the present tree and folded nodes. */
  redraw(): Promise<void>;
  /** Show the place in the text pane (or in VS Code's editor). */
  reveal(place: { uri: string; position: { line: number; character: number } }): void;
}

export const actions: Actions = {} as Actions;
