// All nodes that can be inserted.

import { useSignal } from "@preact/signals";
import { pressItem } from "./drag";
import { search } from "./fuzzy";
import { lastUsed, noteUse } from "./last_used";
import { commandOf, run, applyType } from "./operations";
import { usePreview, Warning } from "./preview";
import { plain } from "./markdown";
import type { PaletteItem } from "./protocol";
import { modelForm } from "./quick_state";
import { palette, start } from "./state";
import { treeTexts } from "./texts";
import { focusPicture } from "./view";

export const SIGNS = { in: "→", out: "←", inout: "↔", "": "" };
const KINDS: readonly PaletteItem["kind"][] = ["control", "decorator", "condition", "action", "subtree", "undefined"];

/** The badge of a node type. */
export function Symbol({ item }: { item: Pick<PaletteItem, "kind" | "symbol"> }) {
  return (
    <svg class={`symbol kind-${item.kind}`} viewBox="-11 -11 22 22" aria-hidden="true">
      <circle r="11" /><path d={item.symbol ?? ""} />
    </svg>
  );
}

/** A text with its matching letters in bold. */
export function Highlighted({ text, at }: { text: string; at: readonly number[] }) {
  if (!at.length) return <b>{text}</b>;
  const letters = new Set(at);
  return <b>{[...text].map((letter, index) => letters.has(index) ? <mark key={index}>{letter}</mark> : letter)}</b>;
}

/** Whether a group has nodes of the project, which have models or are trees. */
const isOwn = (group: readonly { item: PaletteItem }[]): boolean => group.some(({ item }) => item.isEditable || item.kind === "subtree");

/** What an item is for, and its ports. */
const textOf = ({ about, ports }: PaletteItem): string => [
  ...(about ? [plain(about)] : []),
  ...ports.map(({ name, direction, type, default: text, about }) =>
    `${SIGNS[direction]} ${name}${type && `: ${type}`}${text && ` = ${text}`}${about && `, ${about}`}`),
].join("\n");

/** Insert a node at the cursor, in the first place that is possible. */
function insert(item: PaletteItem): void {
  noteUse(item.id);
  applyType("insert", item);
}

/** The palette: drag an item into the picture, or insert it at the selected node by a click or Enter. */
export function Palette() {
  const words = useSignal("");
  const about = useSignal("");
  const [preview, requestPreview] = usePreview();
  const describe = (item: PaletteItem) => {
    about.value = textOf(item);
    requestPreview(() => commandOf("insert", item));
  };
  const current = useSignal("");
  const items = palette.value.items.toSorted((a, b) => KINDS.indexOf(a.kind) - KINDS.indexOf(b.kind) || a.id.localeCompare(b.id));
  const byId = new Map(items.map((item) => [item.id, item]));
  const matches = search(words.value, items, (item) => item.id);
  const recent = words.value ? [] : lastUsed.value.flatMap((id) => byId.get(id) ?? []);
  const groups: [string, { item: PaletteItem; at: number[] }[]][] = words.value
    ? [[treeTexts.results(matches.length), matches]]
    : [...Map.groupBy(matches, ({ item }) => item.group)].toSorted((a, b) => Number(isOwn(b[1])) - Number(isOwn(a[1])));
  const itemAt = (event: Event) => byId.get((event.target as Element).closest<HTMLElement>("[data-id]")?.dataset.id ?? "");
  const press = (event: PointerEvent) => {
    const item = itemAt(event);
    // The picture gets the keys.
    if (item) pressItem(item.id, event, () => { focusPicture(); insert(item); });
  };
  // A press with the mouse is handled by its pointer; Enter and screen readers click without a pointer.
  const click = (event: MouseEvent) => {
    const item = itemAt(event);
    if (item && event.detail === 0) insert(item);
  };
  const arrows = (event: KeyboardEvent) => {
    const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (!step) return;
    const stops = [...(event.currentTarget as Element).querySelectorAll<HTMLElement>("input, [data-id]")].filter((stop) => stop.offsetParent);
    const at = stops.indexOf(document.activeElement as HTMLElement);
    stops[at + step]?.focus();
    event.preventDefault();
  };
  // Tab reaches one of the items, and arrows the others.
  const shownIds = [...recent, ...groups.flatMap(([, found]) => found.map(({ item }) => item))].map(({ id }) => id);
  const stop = shownIds.includes(current.value) ? current.value : shownIds[0];
  const isReadOnly = start.value?.readOnly ?? false;
  const button = (item: PaletteItem, at: readonly number[]) => item.isEditable && !isReadOnly ? (
    <div class="palette-row" key={item.id}>
      {insertButton(item, at)}
      <button
        class="small" tabIndex={item.id === stop ? 0 : -1} aria-label={`${treeTexts.editModel} ${item.id}`} title={treeTexts.editModel}
        onClick={() => { modelForm.value = { item }; }}
      >✎</button>
    </div>
  ) : insertButton(item, at);
  const insertButton = (item: PaletteItem, at: readonly number[]) => (
    <button
      key={item.id} class="palette-item" data-id={item.id} title={textOf(item)} aria-describedby="palette-about"
      tabIndex={item.id === stop ? 0 : -1} onFocus={() => { describe(item); current.value = item.id; }} onPointerEnter={() => describe(item)} onPointerLeave={() => requestPreview(null)} onBlur={() => requestPreview(null)}
    >
      <Symbol item={item} /><Highlighted text={item.id} at={at} />
    </button>
  );
  return (
    <section class="palette" aria-label={treeTexts.palette} onKeyDown={arrows}>
      <div class="palette-search">
        <input
          type="search" placeholder={treeTexts.searchPalette} aria-label={treeTexts.searchPalette} value={words.value} spellcheck={false}
          onInput={(event) => { words.value = event.currentTarget.value; }}
          onKeyDown={(event) => { if (event.key === "Enter" && matches[0]) insert(matches[0].item); }}
        />
        {!isReadOnly && <button aria-label={treeTexts.newModel} title={`${treeTexts.newModel} (N)`} onClick={() => run("model")}>+</button>}
      </div>
      <div class="palette-items" onPointerDown={press} onClick={click} onDragStart={(event) => event.preventDefault()}>
        {recent.length > 0 && (
          <details open><summary>{treeTexts.lastUsed}</summary>{recent.map((item) => button(item, []))}</details>
        )}
        {groups.map(([group, found]) => (
          <details key={group} open><summary>{group}</summary>{found.map(({ item, at }) => button(item, at))}</details>
        ))}
      </div>
      <div class="about">
        <Warning preview={preview} />
        <p id="palette-about">{about.value || treeTexts.paletteHint}</p>
      </div>
    </section>
  );
}
