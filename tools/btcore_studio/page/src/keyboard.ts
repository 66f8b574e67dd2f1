// The keys of the picture. What a key means does not depend on the page; the operations decide what is possible.

import type { Structure } from "./tree";
import type { OperationId } from "./operations";

interface Key { key: string; ctrl: boolean; shift: boolean; alt: boolean }

export type Direction = "up" | "down" | "left" | "right" | "first" | "last";
export type PageAction = "all" | "none" | "search" | "larger" | "smaller" | "fit" | "help" | "menu" | "form" | "back" | "forth"
  | "play" | "why" | "into" | "over" | "outOf" | "succeed" | "fail" | "keepRunning";
/** Undo, redo and save are keys of the whole page, see main.tsx. */
export type Action = { operation: OperationId } | { select: Direction; isExtending: boolean } | { page: PageAction };

const OPERATIONS: Record<string, OperationId> = {
  "i": "insert", "Insert": "insert", "w": "wrap", "u": "unwrap", "t": "type", "F2": "rename", "e": "toggle",
  "Ctrl+d": "duplicate", "Delete": "remove", "Backspace": "remove", "Ctrl+c": "copy", "Ctrl+x": "cut",
  "Alt+ArrowLeft": "earlier", "Alt+ArrowRight": "later", "Alt+ArrowUp": "out", "Alt+ArrowDown": "in",
  "x": "extract", "Shift+X": "inline", "n": "model", "o": "open", "Ctrl+Enter": "text", " ": "fold", "b": "breakpoint", "c": "release",
};
const PAGE: Record<string, PageAction> = {
  "Ctrl+a": "all", "Escape": "none", "/": "search", "Ctrl+f": "search", "+": "larger", "=": "larger", "-": "smaller", "0": "fit", "?": "help", "F1": "help",
  "ContextMenu": "menu", "Shift+F10": "menu", "Enter": "form", ",": "back", ".": "forth",
  "r": "play", "s": "into", "v": "over", "Shift+V": "outOf", "y": "why", "1": "succeed", "2": "fail", "3": "keepRunning",
};
const SELECT: Record<string, Direction> = {
  ArrowUp: "up", ArrowDown: "down", ArrowLeft: "left", ArrowRight: "right", Home: "first", End: "last",
};

export const keyOf = ({ key, ctrlKey, metaKey, shiftKey: shift, altKey: alt }: KeyboardEvent): Key => ({ key, ctrl: ctrlKey || metaKey, shift, alt });

/** Return what a key does while the picture has the focus; null if it does nothing. */
export function actionOf({ key, ctrl, shift, alt }: Key): Action | null {
  if (key.length > 1 && key in SELECT && !ctrl && !alt) return { select: SELECT[key]!, isExtending: shift };
  // Shift is part of a character such as "?".
  const isSign = key.length === 1 && key.toLowerCase() === key.toUpperCase();
  const name = `${ctrl ? "Ctrl+" : ""}${alt ? "Alt+" : ""}${shift && !isSign ? "Shift+" : ""}${shift || key.length > 1 ? key : key.toLowerCase()}`;
  const operation = OPERATIONS[name];
  if (operation) return { operation };
  const page = PAGE[name];
  return page ? { page } : null;
}

/** Whether a key works in every part of the page except text fields and editors. */
export const isForPage = (action: Action): boolean =>
  "page" in action && ["search", "help"].includes(action.page);

/** Return the index that an arrow leads to, or -1. */
export function neighbour(structure: Structure, index: number, direction: Direction): number {
  if (!structure.nodes.length) return -1;
  if (index < 0 || direction === "first") return 0;
  if (direction === "last") return structure.nodes.length - 1;
  if (direction === "up") return structure.parent(index);
  if (direction === "down") return structure.nodes[index]!.hidden ? -1 : structure.children[index]![0] ?? -1;
  const siblings = structure.siblings(index);
  const position = structure.positions[index]! - 1 + (direction === "left" ? -1 : 1);
  return siblings[position] ?? cousin(structure, index, direction);
}

/** Return the nearest node of the same level in a direction, or -1. */
function cousin(structure: Structure, index: number, direction: "left" | "right"): number {
  const step = direction === "left" ? -1 : 1;
  for (let other = index + step; structure.nodes[other]; other += step) {
    if (structure.levels[other] === structure.levels[index]) return other;
  }
  return -1;
}
