// What can be done with the selected nodes: the same list for keys, the menu and the help.

import type { MakeCommand } from "./preview";
import type { Command, DrawnNode, EditResult, PaletteItem, Place } from "./protocol";
import { release } from "./announcer";
import { chooseCall, toggleBreakpoints } from "./live";
import { actions, drawing, live, message, reasonOf, refuse, selection, start, tree as shownTree } from "./state";
import { createQueue } from "./queue";
import { modelForm, prompt, quick, type QuickMode } from "./quick_state";
import { canWrap, placeOfTree, type Structure } from "./tree";
import { treeTexts } from "./texts";
import { view } from "./view";

export type OperationId =
  | "insert" | "wrap" | "unwrap" | "type" | "rename" | "toggle" | "duplicate" | "copy" | "cut" | "paste" | "remove"
  | "earlier" | "later" | "out" | "in" | "extract" | "inline" | "model" | "open" | "text" | "fold" | "breakpoint" | "release";

export interface Operation {
  id: OperationId;
  label: () => string;
  /** The keys as they are shown. */
  keys: string;
  group: "edit" | "clipboard" | "move" | "tree" | "view";
  /** Return why the operation is not possible, or "". */
  refusal: () => string;
  /** Return what `run` does, or why it is not possible; absent if `run` opens a popup, or changes no text. */
  command?: MakeCommand;
  run: () => unknown;
}

// --- the selection

const structure = (): Structure | undefined => view.value?.structure;

/** The selected nodes without those below others, in the order of the tree. */
export function chosen(): number[] {
  const found = structure();
  return found ? found.roots(selection.value.map((key) => found.at(key)).filter((index) => index >= 0)) : [];
}

const node = (index: number): DrawnNode => structure()!.nodes[index]!;
const places = (indices: readonly number[]): Place[] => indices.map((index) => node(index).place);
export const edit = (command: Command): Promise<EditResult | null> => actions.edit(command);

/** Do what a command says, or show why it is not possible. */
function perform(command: Command | string): unknown {
  if (typeof command !== "string") return edit(command);
  refuse(command);
  return undefined;
}

/** The part of an operation that does a command at once. */
const doing = (command: () => Command | string) => ({ command, run: () => perform(command()) });

const refusals = {
  readOnly: () => start.value?.readOnly ? treeTexts.refusal.readOnly : "",
  some: () => refusals.readOnly() || (chosen().length ? "" : treeTexts.refusal.noSelection),
  single: () => refusals.some() || (chosen().length > 1 ? treeTexts.refusal.several : ""),
  format: () => drawing.value?.format === 3 ? treeTexts.refusal.format3 : "",
};

/** Return why the nodes cannot be a row of siblings, or "". */
function notConsecutive(nodes: readonly number[]): string {
  const found = structure()!;
  const parent = found.parent(nodes[0]!);
  const isRow = nodes.every((index, position) =>
    found.parent(index) === parent && found.positions[index] === found.positions[nodes[0]!]! + position);
  return isRow ? "" : treeTexts.refusal.notConsecutive;
}

/** Return why the parents of the nodes cannot have *count* more children each, or "". */
function isFull(nodes: readonly number[]): string {
  const found = structure()!;
  for (const index of nodes) {
    if (found.isRoot(index)) return treeTexts.refusal.oneRoot;
    const parent = found.parent(index);
    const more = nodes.filter((other) => found.parent(other) === parent).length;
    if (!found.canTake(parent, more)) return treeTexts.refusal.full(node(parent));
  }
  return "";
}

// --- places for new nodes

export type Where = "child" | "after" | "before" | "around";

/** Return where a new node can be in relation to the cursor, the best place first. */
export function wheres(kind?: DrawnNode["kind"]): Where[] {
  const found = structure();
  const index = cursor();
  if (!found || index < 0) return ["child"];
  const result: Where[] = [];
  if (found.canTake(index, 1)) result.push("child");
  if (!found.isRoot(index) && found.canTake(found.parent(index), 1)) result.push("after", "before");
  if (kind === undefined || canWrap(kind)) result.push("around");
  return result;
}

export function cursor(): number {
  const found = structure();
  return found?.at(selection.value.at(-1) ?? "") ?? -1;
}

/** Return the command that does something with a node type at the cursor, or why it is not possible. */
export function commandOf(mode: QuickMode, { id, kind }: PaletteItem, wanted: Where | null = null): Command | string {
  if (start.value?.readOnly) return treeTexts.refusal.readOnly;
  if (mode === "type") return { kind: "change_type", node: node(cursor()).place, id };
  const where = mode === "wrap" ? "around" : wanted ?? wheres(kind)[0];
  const at = where && target(where);
  if (!at) return treeTexts.refusal.noPlace;
  return where === "around" && cursor() >= 0 ? { kind: "wrap", nodes: places(chosen()), id } : { kind: "add", ...at, id };
}

/** Do something with a node type at the cursor: by default in the best place. */
export function applyType(mode: QuickMode, item: PaletteItem, wanted: Where | null = null): void {
  inTurn(() => perform(commandOf(mode, item, wanted)));
}

const last = (parent: number) => ({ parent: node(parent).place, index: structure()!.children[parent]!.length });

/** Return the parent and the index of a new node at the cursor. */
function target(where: Where): { parent: Place; index: number } | null {
  const found = structure();
  const index = cursor();
  if (!drawing.value || !found) return null;
  if (index < 0) {
    if (!found.nodes.length) {
      const parent = placeOfTree(drawing.value);
      return parent && { parent, index: 0 };
    }
    return last(0);
  }
  if (where === "child") return last(index);
  const parent = found.parent(index);
  if (parent < 0) return last(index);
  return { parent: node(parent).place, index: found.positions[index]! - (where === "before" ? 1 : 0) };
}

// --- the clipboard

let copied = "";

/** Return the XML of nodes. */
export async function xmlOf(nodes: readonly Place[]): Promise<string> {
  const { xml } = await actions.request<{ xml: string }>("btcore/copy", { nodes });
  return xml;
}

export async function copy(): Promise<void> {
  try {
    copied = await xmlOf(places(chosen()));
    await navigator.clipboard.writeText(copied);
    message.value = treeTexts.copied(chosen().length);
  } catch (error) {
    message.value = copied ? treeTexts.clipboardRefused : reasonOf(error);
  }
}

const removing = (): Command => ({ kind: "remove", nodes: places(chosen()) });

async function cut(): Promise<void> {
  const removal = removing();
  await copy();
  await edit(removal);
}

/** Return the command that pastes XML at the cursor, or why it is not possible. */
function pasting(xml: string): Command | string {
  const where = wheres("action")[0];
  const at = where && target(where);
  if (!xml.trim()) return treeTexts.nothingToPaste;
  return at ? { kind: "paste", ...at, xml: xml.trim() } : treeTexts.refusal.noPlace;
}

/** Paste XML at the cursor; by default the text of the clipboard. */
export async function paste(xml?: string): Promise<void> {
  await perform(pasting(xml ?? await navigator.clipboard.readText().catch(() => copied)));
}

/** Return the command that pastes the clipboard; null if the browser would ask the user for the permission to read it. */
async function pastingClipboard(): Promise<Command | string | null> {
  const name = "clipboard-read" as PermissionName; // Chromium's
  const permission = await navigator.permissions.query({ name }).catch(() => null);
  return permission?.state === "granted" ? pasting(await navigator.clipboard.readText()) : null;
}

// --- movement

type Movement = "earlier" | "later" | "out" | "in";

/** Return where a movement of the nodes leads, or the reason why it is not possible. */
function movement(direction: Movement): { parent: number; index: number } | string {
  const found = structure()!;
  const nodes = chosen();
  const first = nodes[0]!;
  const reason = notConsecutive(nodes);
  if (reason) return reason;
  if (found.isRoot(first)) return treeTexts.refusal.root;
  const parent = found.parent(first);
  const siblings = found.siblings(first);
  const [before, after] = [siblings[found.positions[first]! - 2], siblings[found.positions[nodes.at(-1)!]!]];
  if (direction === "earlier") {
    return before === undefined ? treeTexts.refusal.first : { parent, index: found.positions[before]! - 1 };
  }
  if (direction === "later") return after === undefined ? treeTexts.refusal.last : { parent, index: found.positions[after]! };
  if (direction === "out") {
    if (found.isRoot(parent)) return treeTexts.refusal.top;
    const outer = found.parent(parent);
    if (!found.canTake(outer, nodes.length)) return treeTexts.refusal.full(node(outer));
    return { parent: outer, index: found.positions[parent]! };
  }
  // Into the sibling before, as its last child, or into the sibling after, as its first child.
  if (before !== undefined && found.canTake(before, nodes.length)) {
    return { parent: before, index: found.children[before]!.length };
  }
  if (after !== undefined && found.canTake(after, nodes.length)) return { parent: after, index: 0 };
  return treeTexts.refusal.noParent;
}

function moveTo(direction: Movement): Command | string {
  const place = movement(direction);
  if (typeof place === "string") return place;
  return { kind: "move", nodes: places(chosen()), parent: node(place.parent).place, index: place.index };
}

function moving(id: Movement, keys: string): Operation {
  return {
    id, keys, group: "move", label: () => treeTexts.operation[id],
    refusal: () => {
      const reason = refusals.some();
      if (reason) return reason;
      const place = movement(id);
      return typeof place === "string" ? place : "";
    },
    ...doing(() => moveTo(id)),
  };
}

// --- the list

const allDisabled = () => chosen().length > 0 && chosen().every((index) => node(index).disabled);

export const operations: readonly Operation[] = [
  {
    id: "insert", keys: "I", group: "edit", label: () => treeTexts.operation.insert,
    refusal: () => refusals.readOnly() || (wheres().length ? "" : treeTexts.refusal.noPlace),
    run: () => { quick.value = { mode: "insert" }; },
  },
  {
    id: "wrap", keys: "W", group: "edit", label: () => treeTexts.operation.wrap,
    refusal: () => refusals.some() || notConsecutive(chosen()),
    run: () => { quick.value = { mode: "wrap" }; },
  },
  {
    id: "unwrap", keys: "U", group: "edit", label: () => treeTexts.operation.unwrap,
    refusal: () => {
      const reason = refusals.single();
      if (reason) return reason;
      const found = structure()!;
      const index = chosen()[0]!;
      if (node(index).calls) return treeTexts.refusal.callUnwrap;
      if (node(index).leaf) return treeTexts.refusal.leafUnwrap;
      const count = found.children[index]!.length;
      if (found.isRoot(index)) return count > 1 ? treeTexts.refusal.oneRoot : "";
      const parent = found.parent(index);
      return found.canTake(parent, count, [index]) ? "" : treeTexts.refusal.full(node(parent));
    },
    ...doing(() => ({ kind: "unwrap", node: node(chosen()[0]!).place })),
  },
  {
    id: "type", keys: "T", group: "edit", label: () => treeTexts.operation.type,
    refusal: refusals.single,
    run: () => { quick.value = { mode: "type" }; },
  },
  {
    id: "rename", keys: "F2", group: "edit", label: () => treeTexts.operation.rename,
    refusal: refusals.single,
    run: () => {
      const { name, id } = node(chosen()[0]!);
      prompt.value = {
        label: treeTexts.nodeName, value: name === id ? "" : name,
        command: (text) => ({ kind: "set", node: node(cursor()).place, name: "name", text: text || null }),
      };
    },
  },
  {
    id: "toggle", keys: "E", group: "edit", label: () => allDisabled() ? treeTexts.operation.enable : treeTexts.operation.disable,
    refusal: () => refusals.some() || refusals.format(),
    ...doing(() => {
      const isEnabling = allDisabled();
      const nodes = chosen().filter((index) => node(index).disabled === isEnabling);
      return { kind: isEnabling ? "enable" : "disable", nodes: places(nodes) };
    }),
  },
  {
    id: "duplicate", keys: "Ctrl+D", group: "edit", label: () => treeTexts.operation.duplicate,
    refusal: () => refusals.some() || isFull(chosen()),
    ...doing(() => ({ kind: "duplicate", nodes: places(chosen()) })),
  },
  {
    id: "remove", keys: "Delete", group: "edit", label: () => treeTexts.operation.remove,
    refusal: refusals.some, ...doing(removing),
  },
  {
    id: "cut", keys: "Ctrl+X", group: "clipboard", label: () => treeTexts.operation.cut,
    refusal: refusals.some, command: removing, run: cut,
  },
  {
    id: "copy", keys: "Ctrl+C", group: "clipboard", label: () => treeTexts.operation.copy,
    refusal: () => chosen().length ? "" : treeTexts.refusal.noSelection, run: copy,
  },
  {
    id: "paste", keys: "Ctrl+V", group: "clipboard", label: () => treeTexts.operation.paste,
    refusal: () => refusals.readOnly() || (wheres("action").length ? "" : treeTexts.refusal.noPlace),
    command: pastingClipboard, run: () => paste(),
  },
  moving("earlier", "Alt+←"),
  moving("later", "Alt+→"),
  moving("out", "Alt+↑"),
  moving("in", "Alt+↓"),
  {
    id: "extract", keys: "X", group: "tree", label: () => treeTexts.operation.extract,
    refusal: () => refusals.some() || (chosen().length > 1 ? treeTexts.refusal.extractSeveral : ""),
    run: () => {
      prompt.value = {
        label: treeTexts.treeId, value: "",
        command: (text) => text ? { kind: "extract", node: node(cursor()).place, id: text } : null,
      };
    },
  },
  {
    id: "inline", keys: "Shift+X", group: "tree", label: () => treeTexts.operation.inline,
    refusal: () => refusals.single() || (node(chosen()[0]!).calls ? "" : treeTexts.refusal.noCall),
    ...doing(() => ({ kind: "inline", node: node(chosen()[0]!).place })),
  },
  {
    id: "model", keys: "N", group: "tree", label: () => treeTexts.operation.model,
    refusal: refusals.readOnly,
    run: () => { modelForm.value = { item: null }; },
  },
  {
    id: "open", keys: "O", group: "tree", label: () => treeTexts.operation.open,
    refusal: () => cursor() >= 0 && node(cursor()).calls ? "" : treeTexts.refusal.noCall,
    run: () => openTree(node(cursor())),
  },
  {
    id: "text", keys: "Ctrl+Enter", group: "view", label: () => treeTexts.operation.text,
    refusal: () => cursor() >= 0 ? "" : treeTexts.refusal.noSelection,
    run: () => actions.reveal(node(cursor()).place),
  },
  {
    id: "fold", keys: "Space", group: "view",
    label: () => cursor() >= 0 && node(cursor()).hidden ? treeTexts.operation.unfold : treeTexts.operation.fold,
    refusal: () => cursor() >= 0 && !node(cursor()).leaf ? "" : treeTexts.refusal.noChildren,
    run: () => view.value?.toggleFold(cursor()),
  },
  {
    id: "breakpoint", keys: "B", group: "view",
    label: () => cursor() >= 0 && live.value?.wanted.includes(node(cursor()).key)
      ? treeTexts.operation.noBreakpoint : treeTexts.operation.breakpoint,
    refusal: () => !start.value?.live ? treeTexts.refusal.notLive : cursor() >= 0 ? "" : treeTexts.refusal.noSelection,
    run: () => toggleBreakpoints([node(cursor()).key]),
  },
  {
    id: "release", keys: "C", group: "view", label: () => treeTexts.continue,
    refusal: () => live.value?.stopped ? "" : treeTexts.refusal.notStopped,
    run: release,
  },
];

const byId = new Map(operations.map((operation) => [operation.id, operation]));

/** Show the tree that a node calls alone. */
export function openTree({ calls, key }: DrawnNode): void {
  chooseCall(key);
  shownTree.value = calls;
  selection.value = [];
}

// --- order: each step needs the picture after the last, however fast the keys are pressed

const steps = createQueue();
export const inTurn = (step: () => unknown): void => void steps(async () => { await step(); });

/** The operations that open a popup, which gets the next keys. What is accepted there waits for its turn. */
const POPUPS: ReadonlySet<OperationId> = new Set(["insert", "wrap", "type", "rename", "extract", "model"]);

/** Run an operation, or show why it is not possible. */
export function run(id: OperationId): void {
  const step = () => {
    const operation = byId.get(id)!;
    const reason = operation.refusal();
    if (reason) refuse(reason);
    return reason ? undefined : operation.run();
  };
  if (POPUPS.has(id)) step();
  else inTurn(step);
}
