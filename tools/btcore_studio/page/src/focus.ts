// The focus: it never falls to the page itself, and F6 moves it between the panes.

import { focusPicture } from "./view";

const FOCUSABLE = "button:not(:disabled, [tabindex='-1']), input:not(:disabled), select:not(:disabled), textarea, [tabindex='0'], a[href]";
/** In the order in which F6 reaches them. */
const PANES = [".canvas", ".right .form", ".text", ".problems", "header", ".files", ".palette"];

const isShown = (element: HTMLElement) => element.checkVisibility() && !element.closest("[hidden], details:not([open]) > :not(summary)");

/** Return the element in a pane that gets the focus: its current item, or the first. */
function entry(pane: Element): HTMLElement | null {
  if (pane.matches(".canvas")) return pane as HTMLElement;
  const text = pane.querySelector(".editor")?.shadowRoot?.querySelector<HTMLElement>(".cm-content");
  if (text) return text;
  const found = [...pane.querySelectorAll<HTMLElement>(FOCUSABLE)].filter(isShown);
  return found.find((element) => element.hasAttribute("aria-current")) ?? found[0] ?? null;
}

/** Move the focus to the next pane (1), or to the one before (-1). */
export function movePane(step: 1 | -1): void {
  const panes = PANES.flatMap((selector) => document.querySelector<HTMLElement>(selector) ?? []).filter(isShown);
  const at = panes.findIndex((pane) => pane.contains(document.activeElement));
  for (let count = 1; count <= panes.length; count++) {
    const next = panes[(Math.max(at, step < 0 ? 0 : -1) + step * count + count * panes.length) % panes.length]!;
    const element = entry(next);
    if (!element) continue;
    element.focus();
    if (next.contains(document.activeElement)) return;
  }
}

/** The elements around the last element with the focus, from the inside. */
let path: Element[] = [];

/** Give the focus to what is near the element that had it, if that element is gone. */
function recover(): void {
  const last = path[0];
  if (!last || document.activeElement !== document.body || (last.isConnected && !last.matches(":disabled"))) return;
  for (const outer of path.slice(1)) {
    if (!outer.isConnected || outer === document.body || outer.matches("main, .panes")) continue;
    const element = outer.contains(last) ? null : entry(outer);
    if (element) { element.focus({ preventScroll: true }); return; }
  }
  focusPicture();
}

/** Keep the focus on the page while its parts change. */
export function keepFocus(): void {
  addEventListener("focusin", (event) => { path = event.composedPath().filter((item): item is Element => item instanceof Element && item.isConnected); });
  // A click beside all elements takes the focus away on purpose.
  addEventListener("pointerdown", () => { path = []; }, true);
  // An element that is removed or disabled loses the focus without an event. The picture has too many elements to be observed.
  const observer = new MutationObserver(recover);
  for (const outer of document.querySelectorAll("body, main, .canvas-pane")) observer.observe(outer, { childList: true });
  for (const pane of document.querySelectorAll("header, .left, .right, footer")) {
    observer.observe(pane, { childList: true, subtree: true, attributeFilter: ["disabled"] });
  }
}
