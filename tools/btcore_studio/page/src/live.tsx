// The running tree: its address, its blackboard, its breakpoints, and durations.

import { computed, effect, signal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { release } from "./announcer";
import { ChangeControls, EntryValue } from "./live_changes";
import type { Live, RunningCall } from "./protocol";
import { actions, drawing, live, message, nodesByKey, showError, shownFile, start, tree, uri } from "./state";
import { treeTexts } from "./texts";
import { fileName } from "./toolbar";

const MAX_ENTRIES = 500;
const DEFAULT_ADDRESS = "tcp://127.0.0.1:1667";

const isOver = (state: Live | null) => state?.connection === "ended" || state?.connection === "lost";
/** Whether the text has changed since the run ended. Its statuses are then those of another tree. */
const isOutdated = signal(false);
effect(() => {
  if (!isOver(live.value)) isOutdated.value = false;
});

/** Note that a text has changed. */
export function noteChange(): void {
  if (isOver(live.peek())) isOutdated.value = true;
}

/** The running tree, or the last state of a run whose text is still the same. */
const shownRun = computed(() => live.value?.connection && !isOutdated.value ? live.value : null);
const NONE: readonly never[] = [];
const keys = computed<readonly string[]>(() => shownRun.value?.keys ?? NONE);
const calls = computed<readonly RunningCall[]>(() => shownRun.value?.calls ?? NONE);
/** The index of each node of the running tree in the digits of its state, by key. */
export const liveIndex = computed(() => new Map(keys.value.map((key, index) => [key, index] as const)));

/** The running calls of the shown tree. */
const ownCalls = computed(() => calls.value.filter((item) => item.tree === (tree.value ?? drawing.value?.tree)));
const chosenCall = signal("");
/** The call whose nodes are shown, if the shown tree is called in the running tree. */
export const call = computed(() => ownCalls.value.find(({ key }) => key === chosenCall.value) ?? ownCalls.value[0] ?? null);
/** The key of the call in the present drawing. */
export const drawnCall = signal("");

/** Show the nodes of a call, when its tree is shown. */
export const chooseCall = (key: string): void => { chosenCall.value = key; };

/** Return the status of a node and its last result, or null if it is not in the running tree. */
export function statusOf(key: string, state: Live | null): { status: number; result: number } | null {
  const index = liveIndex.value.get(key);
  return index === undefined || !state?.connection ? null : { status: Number(state.statuses[index]), result: Number(state.results[index]) };
}

// --- durations: since when each node is running, as this page has seen it

const runningSince = new Map<string, number>();
const lastDurations = new Map<string, number>();
let before = "";
let knownKeys: readonly string[] = [];
effect(() => {
  const state = live.value;
  const now = performance.now();
  if (!state?.connection || keys.value !== knownKeys) {
    runningSince.clear();
    lastDurations.clear();
    before = "";
    knownKeys = keys.value;
  }
  if (!state?.connection) return;
  for (const [key, index] of liveIndex.peek()) {
    const [old, status] = [before[index] ?? "0", state.statuses[index]];
    if (old === status) continue;
    if (status === "1") runningSince.set(key, now);
    else if (old === "1") {
      lastDurations.set(key, now - (runningSince.get(key) ?? now));
      runningSince.delete(key);
    }
  }
  before = state.statuses;
});

/** Return for how long a node runs, or ran last, in s; null if it did not run since the page was connected. */
export function durationOf(key: string): { seconds: number; isRunning: boolean } | null {
  const since = runningSince.get(key);
  if (since !== undefined) return { seconds: (performance.now() - since) / 1000, isRunning: true };
  const last = lastDurations.get(key);
  return last === undefined ? null : { seconds: last / 1000, isRunning: false };
}

// --- breakpoints

/** Remove the breakpoints of nodes. If they have none, set one at each. */
export async function toggleBreakpoints(nodes: readonly string[]): Promise<void> {
  const wanted = live.value?.wanted ?? [];
  const others = wanted.filter((key) => !nodes.includes(key));
  await send("btcore/breakpoints", { keys: others.length < wanted.length ? others : [...wanted, ...nodes] });
}

const send = (method: string, params: unknown) => actions.request(method, params).catch(showError);

/** What the user should know about the running tree or the recording. */
export const notes = computed(() => {
  const state = live.value;
  const { recording } = start.value ?? {};
  const found = (recording?.warnings ?? []).map(treeTexts.recordingLacks);
  if (state?.problem) found.push(state.problem);
  if (state?.connection && state.connection !== "connected" && state.detail && !isOutdated.value) found.push(state.detail);
  const [shown, at] = [drawing.value, call.value];
  if (shown && keys.value.length && drawnCall.value === (at?.key ?? "")) {
    const begin = at ? keys.value.indexOf(at.key) + 1 : 0;
    const running = at ? keys.value.slice(begin, begin + at.size) : keys.value;
    const missing = running.filter((key) => !nodesByKey.value.has(key)).length;
    const isCalled = at || missing < running.length || shown.trees.some(({ id, isMain }) => id === shown.tree && isMain);
    if (!isCalled) found.push(treeTexts.notRunning(shown.tree));
    else if (missing) found.push(treeTexts.missingNodes(missing));
  }
  return found;
});

/** How to run the shown file, so that it can be watched. */
export function RunHint() {
  const isLive = start.value?.live && !start.value.recording;
  const state = live.value;
  if (!isLive || !uri.value || (state?.connection && state.connection !== "waiting")) return null;
  const name = shownFile.value?.name ?? fileName(uri.value);
  const command = `btcore run ${/^[\w./-]+$/.test(name) ? name : `"${name}"`} --publish groot2`;
  const copy = () => navigator.clipboard.writeText(command).then(() => { message.value = treeTexts.commandCopied; }, showError);
  return (
    <section class="run-hint">
      <h2>{treeTexts.runTitle}</h2>
      <p>{state?.connection ? treeTexts.runHint : treeTexts.runHintConnect}</p>
      <p class="command"><code>{command}</code><button class="small" onClick={() => void copy()}>{treeTexts.operation.copy}</button></p>
      <p>{treeTexts.runFolder(start.value!.folder)}</p>
    </section>
  );
}

/** The choice among the running calls of the shown tree. */
export function CallChoice() {
  if (ownCalls.value.length < 2) return null;
  return (
    <label class="call-choice">
      {treeTexts.shownCall}
      <select value={call.value?.key} onChange={(event) => chooseCall(event.currentTarget.value)}>
        {ownCalls.value.map(({ key, path }, index) => <option key={key} value={key}>{index + 1}: {path}</option>)}
      </select>
    </label>
  );
}

/** The address of the running tree, in the toolbar. */
export function LiveControls() {
  const field = useRef<HTMLInputElement>(null);
  const state = live.value;
  const address = state?.address ?? "";
  useEffect(() => {
    if (field.current && address && document.activeElement !== field.current) field.current.value = address;
  }, [address]);
  if (!start.value?.live || start.value.recording || (state?.connection && !address)) return null;
  const proposed = start.value.address ?? DEFAULT_ADDRESS;
  const toggle = (event: Event) => {
    event.preventDefault();
    void send("btcore/watch", { address: address ? "" : field.current!.value.trim() || proposed });
  };
  return (
    <form class="live-controls" onSubmit={toggle}>
      <span class={`light ${state?.connection ?? ""}`} title={state?.detail || treeTexts.notConnected} />
      <input ref={field} placeholder={proposed} aria-label={treeTexts.address} />
      <button title={treeTexts.watchTitle}>{address ? treeTexts.disconnect : treeTexts.connect}</button>
      {state?.stopped && (
        <button type="button" class="continue" title={`${treeTexts.continue} (C)`} onClick={() => void release()}>{treeTexts.continue}</button>
      )}
      <ChangeControls />
    </form>
  );
}

const shownValues = new Map<string, string>();

/** The entries of the running tree's blackboard. */
export function Blackboard() {
  const state = live.value;
  if (!state?.connection || !state.entries.length) return null;
  if (shownValues.size > 10 * MAX_ENTRIES) shownValues.clear();
  const rows = [];
  let scope = "";
  for (const [path, key, value] of state.entries.slice(0, MAX_ENTRIES)) {
    if (path !== scope) {
      scope = path;
      rows.push(<tr key={`${path}\0`} class="scope"><th colSpan={2} scope="rowgroup">{path}</th></tr>);
    }
    const place = `${path}\0${key}`;
    const isNew = shownValues.has(place) && shownValues.get(place) !== value;
    shownValues.set(place, value);
    rows.push(<tr key={place} class={isNew ? "new" : ""}><th scope="row">{key}</th><EntryValue path={path} name={key} value={value} /></tr>);
  }
  return (
    <section class="blackboard">
      <h2>{treeTexts.blackboard}</h2>
      <table><tbody>{rows}</tbody></table>
    </section>
  );
}
