// What screen readers read of the whole page, in one live region: messages, problems, opened trees and the running tree.

import { effect, signal, untracked } from "@preact/signals";
import { checked, messageOf } from "./problems";
import type { Diagnostic } from "./protocol";
import { actions, announce, announcements, diagnostics, drawing, live, message, nameOf, showError, uri } from "./state";
import { texts, treeTexts } from "./texts";
import { fileName } from "./toolbar";

/** While the user types, a text has passing errors. */
const PAUSE_MS = 1200;
const RELEASE_MS = 500;

export function Announcer() {
  return <div class="unseen" aria-live="polite">{announcements.value.map(({ id, text }) => <p key={id}>{text}</p>)}</div>;
}

// --- problems

/** Why the picture does not show the present text, or "". */
export const notice = signal("");
let timer = 0;
let isWaiting = false;
/** How many problems of each code each checked file had in the last report. */
const before = new Map<string, Map<string, number>>();
let spokenSummary = "";
let spokenNotice = false;

/** Wait until the user does not type any more, and report which problems are new. */
function reportLater(): void {
  isWaiting = true;
  clearTimeout(timer);
  timer = window.setTimeout(report, PAUSE_MS);
}

/** Let the report of problems wait while the text changes. */
export function postponeReport(): void {
  if (isWaiting) reportLater();
}

const codeOf = (item: Diagnostic) => String(item.code ?? item.message);

function countsOf(items: readonly Diagnostic[]): Map<string, number> {
  const counts = new Map<string, number>();
  for (const item of items) counts.set(codeOf(item), (counts.get(codeOf(item)) ?? 0) + 1);
  return counts;
}

function report(): void {
  isWaiting = false;
  let first: Diagnostic | undefined;
  for (const address of before.keys()) {
    const items = diagnostics.peek().get(address) ?? [];
    const counts = countsOf(items);
    first ??= items.find((item) => counts.get(codeOf(item))! > (before.get(address)!.get(codeOf(item)) ?? 0));
    before.set(address, counts);
  }
  const items = [...diagnostics.peek().values()].flat();
  const errors = items.filter(({ severity }) => severity === 1).length;
  const summary = texts.problemSummary(errors, items.length - errors);
  const parts = first ? [texts.newProblem(first.severity === 1, messageOf(first))] : [];
  // The error of a broken text changes with each character.
  if (notice.peek() && !spokenNotice && !first) parts.push(notice.peek());
  spokenNotice = notice.peek() !== "";
  if (summary !== spokenSummary && (items.length || spokenSummary)) parts.push(summary);
  spokenSummary = summary;
  announce(parts.join(" "));
}

// --- the shown tree

let shown = "";

function reportTree(): void {
  const tree = drawing.value;
  const place = tree && `${uri.peek()}\n${tree.tree}`;
  if (!tree || !place || place === shown) return;
  const isFirst = !shown;
  const isOther = !shown.startsWith(`${uri.peek()}\n`);
  shown = place;
  if (!isFirst) message.value = texts.opened(isOther ? fileName(uri.peek()) : "", tree.tree, tree.nodes.length);
}

// --- the running tree

let connection = "";
let stopped = "";

function reportLive(): void {
  // Recordings and runs have no address, and reports of their own.
  const state = live.value?.address ? live.value : null;
  const [now, at] = [state?.connection ?? "", state?.stopped ?? ""];
  untracked(() => {
    if (now !== connection && now === "connected") message.value = treeTexts.connected(state!.address);
    else if (now !== connection && !now) message.value = treeTexts.disconnected;
    if (at && at !== stopped) message.value = treeTexts.stoppedAt(nameOf(at));
    else if (!at && stopped && now) message.value = treeTexts.continued;
  });
  [connection, stopped] = [now, at];
}

/** Continue a tree that waits at a breakpoint. With *status*, the node returns it without being ticked. The tree may wait there again in the next tick. */
export async function release(status: "" | "SUCCESS" | "FAILURE" = ""): Promise<void> {
  stopped = "";
  message.value = status ? treeTexts.forced(status) : treeTexts.continued;
  await actions.request("btcore/release", { status }).catch(showError);
  setTimeout(reportLive, RELEASE_MS);
}

/** Announce what changes on the page. */
export function followPage(): void {
  effect(() => {
    for (const address of checked.value) {
      if (!before.has(address)) before.set(address, countsOf(diagnostics.value.get(address) ?? []));
    }
    void [diagnostics.value, notice.value];
    reportLater();
  });
  effect(reportTree);
  effect(reportLive);
}
