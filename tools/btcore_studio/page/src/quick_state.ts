// What the popups at the selected node show.

import { signal } from "@preact/signals";
import type { Command, PaletteItem } from "./protocol";

/** What the list of node types is for: to insert a node, to wrap the selected nodes, or to change the type of a node. */
export type QuickMode = "insert" | "wrap" | "type";
export const quick = signal<{ mode: QuickMode } | null>(null);

/** A field at the selected node: *command* returns what its text leads to, or null. */
export const prompt = signal<{
  label: string; value: string; command: (text: string) => Command | null;
  /** A text that was refused, and why. */
  refused?: { text: string; reason: string };
} | null>(null);

export const menu = signal<{ x: number; y: number } | null>(null);
export const help = signal(false);

/** The form of a node type, or of a new one. */
export const modelForm = signal<{ item: PaletteItem | null; id?: string } | null>(null);
