// What the parts of the page share. A part changes another only through these signals and functions.

import { computed, signal } from "@preact/signals";
import type { Command, Drawing, DrawnNode, EditResult, Live, Palette, Start } from "./protocol";

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
