// A run of the shown tree with mock leaves: its state, and the requests that change it.

import { computed, effect, signal, untracked } from "@preact/signals";
import type { LeafPlan, Live, RunFile, RunningCall, RunResult, RunState, RunStep, ShownRun } from "./protocol";
import { actions, drawing, live, message, nameOf, showError, start, tree, uri } from "./state";
import { createQueue } from "./queue";
import { runTexts } from "./texts";
import { moment, showMoment, shownRun, step as stepInRecording } from "./timeline";
import { view } from "./view";

/** The shortest time between two requests while the run is played. */
const FRAME_MS = 50;
/** The simulated time between two ticks, the default of btcore/run. */
const PERIOD_MS = 100;
const MAX_TICKS = 1000;

interface MockRun {
  state: RunState;
  keys: string[];
  calls: RunningCall[];
  leaves: ReadonlyMap<string, LeafPlan>;
  uri: string;
  tree: string | null;
}

export const mockRun = signal<MockRun | null>(null);
/** Whether a text has changed since the run began, or since it is shown. */
export const isEdited = signal(false);
/** Whether ticks follow each other until a leaf asks, and again after the answer. */
export const isPlaying = signal(false);
export const SPEEDS = [0.5, 1, 2, 5, 20, 100] as const;
export const speed = signal(1);
/** Whether trees can be run here. */
export const canRun = computed(() =>
  start.value !== null && !start.value.recording && !shownRun.value && !live.value?.address && Boolean(drawing.value?.tree));

/** How leaves answer in the next run, by key. */
const plans = new Map<string, LeafPlan>();
/** The state of the connection with running trees, which is shown again after the run. */
let connection: Live | null = null;
let target: RunStep["to"] = "tick";

// --- requests, one after the other

const requests = createQueue();

const inTurn = (act: () => Promise<void>): Promise<void> => requests(act).catch((error: unknown) => {
  isPlaying.value = false;
  showError(error);
});

async function request<T>(method: string, params: object): Promise<T> {
  const run = mockRun.value;
  if (!run) throw new Error(runTexts.noRun);
  return actions.request<T>(method, { run: run.state.run, ...params });
}

async function update(method: string, params: object): Promise<void> {
  show(await request<RunState>(method, params));
}

function show(state: RunState): void {
  const run = mockRun.value;
  if (!run) return;
  mockRun.value = { ...run, state };
  const { wanted = [] } = live.value ?? {};
  showMoment(state.moment, run, { problem: state.problem, wanted, breakpoints: wanted, stopped: state.stopped });
}

/** Follow the connection with running trees, which cannot be used while a run is shown. */
export function receiveLive(state: Live): void {
  // The nodes are sent only if they have changed.
  const isCovered = mockRun.value || shownRun.value;
  connection = { ...(isCovered ? connection : live.value), ...state };
  if (isCovered) live.value = { ...live.value!, wanted: state.wanted, breakpoints: state.wanted };
  else live.value = connection;
}

/** The run with mock leaves that is shown again after a counterexample, or a run with changes. */
let suspended: MockRun | null = null;

/** Show a counterexample, or a run with changes, on the timeline. */
export function showRun(run: ShownRun): void {
  isPlaying.value = isEdited.value = false;
  if (mockRun.value) {
    suspended = mockRun.value;
    mockRun.value = null;
  } else if (!shownRun.value) connection = live.value;
  shownRun.value = run;
}

/** Show again what was shown before `showRun`. */
export function closeShownRun(): void {
  shownRun.value = null;
  if (suspended) {
    const { state } = mockRun.value = suspended;
    suspended = null;
    show(state);
  } else if (!start.value?.recording) showConnection();
}

function showConnection(): void {
  moment.value = null;
  live.value = connection;
}

// --- what the user does

/** Start a run. @param isAgain Whether it begins with the answers of the present run. */
export function startRun(isAgain = false): Promise<void> {
  return inTurn(async () => {
    if (!canRun.value) throw new Error(runTexts.cannotRun);
    const before = isAgain ? mockRun.value : null;
    const chosen = before ?? { uri: uri.value, tree: tree.value ?? drawing.value!.tree };
    const state = await actions.request<RunState>("btcore/run", {
      textDocument: { uri: chosen.uri }, tree: chosen.tree, plans: Object.fromEntries(plans), again: before?.state.run ?? 0,
    });
    if (!mockRun.value) connection = live.value;
    isEdited.value = false;
    mockRun.value = {
      state, keys: state.keys!, calls: state.calls!, leaves: new Map(Object.entries(state.leaves!)), uri: chosen.uri, tree: chosen.tree,
    };
    show(state);
    if (before) report();
  });
}

export function endRun(): Promise<void> {
  isPlaying.value = false;
  return inTurn(async () => {
    await request("btcore/endRun", {}).catch(() => {}); // its process may be gone
    mockRun.value = null;
    showConnection();
    message.value = runTexts.ended;
  });
}

/** Note that a text has changed. */
export function noteEdit(): void {
  if (mockRun.value || shownRun.value) isEdited.value = true;
}

const stepParams = (ticks = 1): RunStep => ({ to: target, ticks, breakpoints: live.value?.wanted ?? [] });

/** Go to the end of the tick, or to a moment in it; start a run if there is none. */
export async function advance(to: RunStep["to"]): Promise<void> {
  if (!mockRun.value) await startRun();
  if (!mockRun.value) return;
  target = to;
  await inTurn(() => update("btcore/runStep", stepParams()));
  report();
}

/** Answer the question of the run, if there is one. Resolves to whether the answer was accepted. */
export async function answer(result: RunResult, outputs: Record<string, string> = {}): Promise<boolean> {
  const asked = mockRun.value?.state.question;
  if (!asked) return false;
  let isAccepted = false;
  await inTurn(async () => {
    // A second click on the same button must not answer the next question.
    if (mockRun.value?.state.question !== asked) return;
    await update("btcore/runAnswer", { result, outputs });
    isAccepted = true;
  });
  if (isAccepted) goOn();
  return isAccepted;
}

/** Answer by a key of the picture: what the fields of the question contain is used. */
export const answerQuestion = (result: RunResult): void => {
  const form = document.querySelector<HTMLFormElement>(".question form");
  form?.querySelector<HTMLButtonElement>(`button[value="${result}"]`)?.click();
};

/** The moment to go to when the requests before have been answered. */
let nextMoment: { position: number; event: number } | null = null;

/** Go to a moment of the run. While the slider moves, the newest moment counts. */
export function goTo(position: number, event = 0): Promise<void> {
  isPlaying.value = false;
  nextMoment = { position, event };
  return inTurn(async () => {
    if (!nextMoment) return;
    const params = nextMoment;
    nextMoment = null;
    await update("btcore/runMoment", params);
  });
}

/** Go a tick, or a moment in a tick, back or forward; of a recording, a tick. */
export function step(by: number): void {
  const state = mockRun.value?.state;
  if (!state) stepInRecording(by);
  else if (by > 0) void advance("tick");
  else if (state.event) void goTo(state.moment.position, state.event - 1).then(report);
  else void goTo(state.moment.position - 1).then(report);
}

/** Forget what follows the present moment. */
export function cut(): Promise<void> {
  const { moment: at } = mockRun.value!.state;
  return inTurn(() => update("btcore/runMoment", { position: at.position, cut: true })).then(() => { message.value = runTexts.wasCut; });
}

/** Let a leaf answer by a plan from now on. Resolves to whether the plan is valid. */
export async function setPlan(key: string, plan: LeafPlan): Promise<boolean> {
  let isValid = false;
  await inTurn(async () => {
    await request("btcore/runLeaf", { key, plan });
    isValid = true;
    plans.set(key, plan);
    const run = mockRun.value!;
    mockRun.value = { ...run, leaves: new Map([...run.leaves, [key, plan]]) };
    if (run.state.question?.key === key) await update("btcore/runStep", stepParams());
  });
  if (isValid) goOn();
  return isValid;
}

export async function filesOfRun(isTest: boolean): Promise<RunFile[]> {
  const name = decodeURIComponent(mockRun.value!.uri.split("/").at(-1)!);
  return (await request<{ files: RunFile[] }>("btcore/runFiles", { test: isTest, tree: name })).files;
}

// --- play

let playing = 0;

/** Start a run, or let it go on, or pause it. */
export function togglePlay(): void {
  if (isPlaying.value) {
    isPlaying.value = false;
    message.value = runTexts.paused;
  } else if (!mockRun.value) {
    void startRun().then(() => { if (mockRun.value) void play(); });
  } else void play();
}

/** Whether the run is not played further: the tree has ended, it is at a breakpoint, or it cannot be run. */
const mustPause = ({ moment: { tick, root }, event, problem }: RunState) => (tick > 0 && root !== 1) || event > 0 || problem !== "";

/** Report the moment after an answer or a plan, and play on if the run was played. */
function goOn(): void {
  report();
  const state = mockRun.value?.state;
  if (!isPlaying.value || !state || state.question) return;
  if (mustPause(state)) isPlaying.value = false;
  else void play();
}

async function play(): Promise<void> {
  const number = ++playing;
  isPlaying.value = true;
  target = "tick";
  const wait = () => PERIOD_MS / speed.value;
  while (isPlaying.value && number === playing) {
    const begun = performance.now();
    const ticks = Math.min(MAX_TICKS, Math.max(1, Math.round(FRAME_MS / wait())));
    await inTurn(() => update("btcore/runStep", stepParams(ticks)));
    const state = mockRun.value?.state;
    if (!state || state.question) break;
    if (mustPause(state)) isPlaying.value = false;
    else await new Promise((resolve) => setTimeout(resolve, Math.max(0, Math.max(FRAME_MS, wait()) - (performance.now() - begun))));
  }
  if (number === playing) report();
}

// --- messages

/** Show and announce the question, or the moment. */
function report(): void {
  const run = mockRun.value;
  if (!run) return;
  const { question, problem, stopped, event, moment: at } = run.state;
  if (question) message.value = runTexts.asks(nameOf(question.key, question.path));
  else if (problem) message.value = problem;
  else if (event) message.value = runTexts.at(nameOf(stopped), at.tick);
  else message.value = runTexts.after(at.tick, at.root);
  const index = view.value?.structure.at(question?.key ?? stopped) ?? -1;
  if (index >= 0) view.value?.reveal(index);
}

// Another file ends the run.
effect(() => {
  const run = mockRun.value;
  if (run && uri.value && uri.value !== run.uri) untracked(() => void endRun());
});
