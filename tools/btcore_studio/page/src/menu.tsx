// The context menu, and the list of keys.

import { useSignal } from "@preact/signals";
import { useEffect, useLayoutEffect, useRef } from "preact/hooks";
import { type Operation, operations } from "./operations";
import { levelOf, usePreview, warningOf } from "./preview";
import { help, menu } from "./quick_state";
import { start } from "./state";
import { treeTexts } from "./texts";
import { focusPicture } from "./view";

/** Reasons that many operations share. They are shown only at the item that has the focus or the pointer. */
const GENERAL: ReadonlySet<string> = new Set([treeTexts.refusal.readOnly, treeTexts.refusal.noSelection]);

export function Menu() {
  return menu.value ? <OpenMenu key={`${menu.value.x} ${menu.value.y}`} {...menu.value} /> : null;
}

function OpenMenu({ x, y }: { x: number; y: number }) {
  const list = useRef<HTMLDivElement>(null);
  useLayoutEffect(() => {
    const element = list.current!;
    const { width, height } = element.getBoundingClientRect();
    element.style.left = `${Math.max(8, Math.min(x, innerWidth - width - 8))}px`;
    element.style.top = `${Math.max(8, Math.min(y, innerHeight - height - 8))}px`;
    element.querySelector<HTMLElement>("[role=menuitem]")?.focus();
    const outside = (event: PointerEvent) => { if (!element.contains(event.target as Node)) menu.value = null; };
    addEventListener("pointerdown", outside, true);
    return () => removeEventListener("pointerdown", outside, true);
  }, []);
  const close = () => {
    menu.value = null;
    focusPicture();
  };
  const [preview, requestPreview] = usePreview();
  const previewed = useSignal("");
  const previewOperation = ({ id, refusal, command }: Operation) => {
    previewed.value = id;
    requestPreview(command && !refusal() ? command : null);
  };
  const choose = (operation: Operation) => {
    if (operation.refusal()) return;
    close();
    void operation.run();
  };
  const key = (event: KeyboardEvent) => {
    const items = [...list.current!.querySelectorAll<HTMLElement>("[role=menuitem]")];
    const at = items.indexOf(document.activeElement as HTMLElement);
    const next = { ArrowDown: at + 1, ArrowUp: at - 1, Home: 0, End: items.length - 1 }[event.key];
    const letter = event.key.length === 1 && !event.ctrlKey && !event.altKey ? event.key.toLowerCase() : "";
    if (next !== undefined) items[(next + items.length) % items.length]?.focus();
    else if (event.key === "Escape" || event.key === "Tab") close();
    else if (letter && letter !== " ") {
      const after = [...items.slice(at + 1), ...items.slice(0, at + 1)];
      after.find((item) => item.textContent?.toLowerCase().startsWith(letter))?.focus();
    } else return;
    event.preventDefault();
    event.stopPropagation();
  };
  const groups = Map.groupBy(operations, (operation) => operation.group);
  const warning = warningOf(preview);
  return (
    <>
      <div class="popup menu" role="menu" aria-label={treeTexts.menu} ref={list} onKeyDown={key} onContextMenu={(event) => event.preventDefault()}>
        {[...groups].map(([group, items]) => (
          <div key={group} role="group" aria-label={treeTexts.groups[group]}>
            {items.map((operation) => {
              const reason = operation.refusal();
              return (
                <button
                  key={operation.id} role="menuitem" tabIndex={-1} aria-disabled={reason !== ""} title={reason} onClick={() => choose(operation)}
                  onFocus={() => previewOperation(operation)} onPointerEnter={() => previewOperation(operation)}
                >
                  <span>{operation.label()}</span><kbd>{operation.keys}</kbd>
                  {reason && <small class={GENERAL.has(reason) ? "general" : ""}>{reason}</small>}
                  {warning && previewed.value === operation.id && <small class={`preview ${levelOf(preview)}`}>⚠ {warning}</small>}
                </button>
              );
            })}
          </div>
        ))}
      </div>
      <p class="unseen" role="status">{warning}</p>
    </>
  );
}

/** The list of keys. */
export function Help() {
  const dialog = useRef<HTMLDialogElement>(null);
  const isOpen = help.value;
  useEffect(() => {
    if (isOpen && !dialog.current?.open) dialog.current?.showModal();
  }, [isOpen]);
  if (!isOpen) return null;
  const rows = [
    ...operations.map((operation) => ({ group: operation.group, keys: operation.keys, text: treeTexts.operation[operation.id] })),
    ...treeTexts.pageKeys,
  ];
  // The browser gives the focus back to what had it.
  return (
    <dialog class="help" ref={dialog} aria-label={treeTexts.helpTitle} onClose={() => { help.value = false; }}>
      <form method="dialog"><h2>{treeTexts.helpTitle}</h2><button aria-label={treeTexts.close} title={treeTexts.close}>×</button></form>
      <div class="help-groups">
        {[...Map.groupBy(rows, (row) => row.group)].map(([group, items]) => (
          <section key={group}>
            <h3>{treeTexts.groups[group]}</h3>
            <dl>{items.map(({ keys, text }) => <div key={keys}><dt><kbd>{keys}</kbd></dt><dd>{text}</dd></div>)}</dl>
          </section>
        ))}
      </div>
      <p>{treeTexts.marks}</p>
      <p>{treeTexts.mouse}</p>
      {start.value?.guide && <p><a href={start.value.guide} target="_blank" rel="noreferrer">{treeTexts.guide}</a></p>}
    </dialog>
  );
}
