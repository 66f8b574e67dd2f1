// The popups at the selected node: a list of node types, searched by a few letters, and a field for a name.

import { useSignal } from "@preact/signals";
import { useEffect, useLayoutEffect, useRef } from "preact/hooks";
import { search } from "./fuzzy";
import { lastUsed, noteUse } from "./last_used";
import { commandOf, edit, inTurn, applyType, type Where, wheres } from "./operations";
import { Highlighted, Symbol } from "./palette";
import { usePreview, Warning } from "./preview";
import { plain } from "./markdown";
import type { NodeForm, PaletteItem } from "./protocol";
import { modelForm, prompt, quick, type QuickMode } from "./quick_state";
import { actions, message, palette, selectedNode } from "./state";
import { canWrap } from "./tree";
import { treeTexts } from "./texts";
import { focusPicture, view } from "./view";

const MAX_SHOWN = 60;

export function Quick() {
  const mode = quick.value?.mode;
  if (prompt.value) return <Prompt key={prompt.value.refused} />;
  return mode ? <Chooser key={mode} mode={mode} /> : null;
}

/** Return the place below the cursor's card, within the window. */
function usePlace(): { ref: { current: HTMLDivElement | null } } {
  const ref = useRef<HTMLDivElement>(null);
  useLayoutEffect(() => {
    const element = ref.current;
    const shown = view.value;
    if (!element || !shown) return;
    const box = shown.boxes[shown.structure.at(selectedNode.value?.key ?? "")];
    const frame = shown.frame.getBoundingClientRect();
    const card = box ? shown.screen(box) : new DOMRect(frame.left + frame.width / 2 - 150, frame.top + frame.height / 4, 300, 0);
    const { width, height } = element.getBoundingClientRect();
    const below = card.bottom + 8 + height <= innerHeight - 8;
    const left = Math.max(8, Math.min(card.left, innerWidth - width - 8));
    const top = below ? card.bottom + 8 : Math.max(8, Math.min(card.top - 8 - height, innerHeight - height - 8));
    element.style.left = `${left}px`;
    element.style.top = `${top}px`;
  }, []);
  return { ref };
}

function close(): void {
  quick.value = null;
  prompt.value = null;
  focusPicture();
}

function Chooser({ mode }: { mode: QuickMode }) {
  const { ref } = usePlace();
  const words = useSignal("");
  const at = useSignal(0);
  const where = useSignal<Where | null>(null);
  const types = useSignal<ReadonlySet<string> | null>(null);
  useLayoutEffect(() => ref.current?.querySelector("input")?.focus(), []);
  useEffect(() => {
    const place = selectedNode.value?.place;
    if (mode !== "type" || !place) return;
    actions.request<NodeForm>("btcore/node", place).then((form) => { types.value = new Set(form.types); }, () => {});
  }, []);
  const isPossible = (item: PaletteItem) => mode === "wrap" ? canWrap(item.kind)
    : mode === "type" ? (types.value?.has(item.id) ?? false) : true;
  const isRecent = (item: PaletteItem) => lastUsed.value.includes(item.id);
  const items = palette.value.items.filter(isPossible);
  const sorted = words.value ? items : [...items.filter(isRecent), ...items.filter((item) => !isRecent(item))];
  const matches = search(words.value, sorted, (item) => item.id, (item) => isRecent(item) ? 2 : 0).slice(0, MAX_SHOWN);
  const chosenItem = matches[Math.min(at.value, matches.length - 1)]?.item;
  const places = mode === "insert" ? wheres(chosenItem?.kind) : [];
  const wanted = where.value && places.includes(where.value) ? where.value : null;
  const place = wanted ?? places[0];
  const accept = (item: PaletteItem | undefined) => {
    if (!item) return;
    noteUse(item.id);
    close();
    applyType(mode, item, wanted);
  };
  const createType = () => {
    const id = words.value.trim();
    close();
    modelForm.value = { item: null, id };
  };
  const [preview, requestPreview] = usePreview();
  useEffect(() => requestPreview(chosenItem ? () => commandOf(mode, chosenItem, place) : null), [chosenItem, place]);
  const key = (event: KeyboardEvent) => {
    const step = { ArrowDown: 1, ArrowUp: -1, PageDown: 8, PageUp: -8 }[event.key];
    const isAtPlaces = (event.target as Element).closest(".wheres") !== null;
    const chosenPlace = event.altKey
      ? ({ ArrowDown: "child", ArrowUp: "around", ArrowLeft: "before", ArrowRight: "after" } as const)[event.key as "ArrowUp"] : undefined;
    if (chosenPlace) { if (places.includes(chosenPlace)) where.value = chosenPlace; }
    else if (step) at.value = Math.max(0, Math.min(matches.length - 1, at.value + step));
    else if (event.key === "Tab") {
      // Tab goes to the choice of the place and back; it does not lose what was typed.
      const stops = [...ref.current!.querySelectorAll<HTMLElement>("input, .quick > button, [aria-checked=true]")];
      stops[(stops.indexOf(document.activeElement as HTMLElement) + 1) % stops.length]?.focus();
    } else if (isAtPlaces && (event.key === "ArrowLeft" || event.key === "ArrowRight")) {
      const next = places.indexOf(place!) + (event.key === "ArrowLeft" ? -1 : 1);
      where.value = places[(next + places.length) % places.length]!;
    } else if (event.key === "Enter" && !(event.target as Element).matches(".quick > button")) accept(chosenItem);
    else if (event.key === "Escape") close();
    else return;
    event.preventDefault();
    event.stopPropagation();
  };
  useLayoutEffect(() => {
    if (document.activeElement?.closest(".wheres")) ref.current?.querySelector<HTMLElement>("[aria-checked=true]")?.focus();
  }, [place]);
  useEffect(() => {
    ref.current?.querySelector("[aria-selected=true]")?.scrollIntoView({ block: "nearest" });
  }, [at.value, words.value]);
  const leave = (event: FocusEvent) => {
    if (!ref.current?.contains(event.relatedTarget as Node | null)) quick.value = null;
  };
  return (
    <div class="popup quick" ref={ref} role="dialog" aria-label={treeTexts.quick[mode]} onKeyDown={key} onFocusOut={leave}>
      <input
        role="combobox" aria-expanded="true" aria-controls="quick-list" aria-autocomplete="list" autocomplete="off" spellcheck={false}
        aria-activedescendant={chosenItem ? `quick-${at.value}` : undefined} aria-label={treeTexts.quick[mode]} placeholder={treeTexts.quick[mode]}
        value={words.value} onInput={(event) => { words.value = event.currentTarget.value; at.value = 0; }}
      />
      <ul id="quick-list" role="listbox" aria-label={treeTexts.nodeTypes}>
        {matches.map(({ item, at: letters }, index) => (
          <li
            key={item.id} id={`quick-${index}`} role="option" aria-selected={item === chosenItem}
            onPointerDown={(event) => event.preventDefault()} onClick={() => accept(item)} onPointerMove={() => { at.value = index; }}
          >
            <Symbol item={item} /><Highlighted text={item.id} at={letters} /><small>{item.group}</small>
          </li>
        ))}
        {!matches.length && <li class="none">{treeTexts.noneFound}</li>}
      </ul>
      {!matches.length && words.value.trim() && <button type="button" onClick={createType}>{treeTexts.newModelOf(words.value.trim())}</button>}
      <Warning preview={preview} />
      {chosenItem?.about && <p class="about">{firstSentence(plain(chosenItem.about))}</p>}
      {places.length > 1 && (
        <div class="wheres" role="radiogroup" aria-label={treeTexts.where}>
          {places.map((name) => (
            <button
              key={name} type="button" role="radio" aria-checked={name === place} tabIndex={name === place ? 0 : -1}
              onPointerDown={(event) => event.preventDefault()} onClick={() => { where.value = name; }}
            >{treeTexts.wheres[name]}<kbd>{treeTexts.whereKeys[name]}</kbd></button>
          ))}
        </div>
      )}
    </div>
  );
}

const firstSentence = (text: string) => /^[^]*?[.!?](?=\s|$)/.exec(text)?.[0] ?? text;

function Prompt() {
  const { ref } = usePlace();
  const asked = prompt.value!;
  const { label, value, command, refused } = asked;
  const [preview, requestPreview] = usePreview();
  // Keys that follow at once are for the field.
  useLayoutEffect(() => { ref.current?.querySelector("input")?.select(); }, []);
  const key = (event: KeyboardEvent) => {
    if (event.key === "Enter") {
      const text = (event.target as HTMLInputElement).value.trim();
      close();
      const wanted = text === value ? null : command(text);
      if (wanted) {
        inTurn(async () => {
          if (!await edit(wanted)) prompt.value = { ...asked, refused: { text, reason: message.value } };
        });
      }
    } else if (event.key === "Escape") close();
    else return;
    event.preventDefault();
    event.stopPropagation();
  };
  return (
    <div class="popup prompt" ref={ref} role="dialog" aria-label={label}>
      <label>{label}<input
        defaultValue={refused?.text ?? value} spellcheck={false} aria-describedby={refused && "refusal"} aria-invalid={Boolean(refused)} onKeyDown={key} onBlur={() => { prompt.value = null; }}
        onInput={(event) => { const text = event.currentTarget.value.trim(); requestPreview(text === value ? null : () => command(text)); }}
      /></label>
      {refused && <p class="error" id="refusal" role="alert">{refused.reason}</p>}
      <Warning preview={preview} />
    </div>
  );
}
