// The moments of a recording, and the slider over them, which runs have, too.

import { computed, effect, signal, untracked } from "@preact/signals";
import { useMemo } from "preact/hooks";
import type { Live, Moment, Recording, ShownRun } from "./protocol";
import { actions, live, showError, start } from "./state";
import { statuses, treeTexts } from "./texts";

export const moment = signal<Moment | null>(null);
/** A counterexample, a run with changes or a run with real leaves, which is shown in place of the recording of the page. */
export const shownRun = signal<ShownRun | null>(null);
const shown = computed<Recording | null>(() => shownRun.value ?? start.value?.recording ?? null);
const position = signal(0);
let isMoving = false;

effect(() => {
  const recording = shown.value;
  // Otherwise each new position would lead back to the start.
  if (recording) untracked(() => void goTo(recording.start));
});

/** Show the moment after a number of steps. While the slider moves, the newest position counts. */
async function goTo(wanted: number): Promise<void> {
  position.value = Math.max(0, Math.min(shown.value?.count ?? 0, wanted));
  if (isMoving) return;
  isMoving = true;
  try {
    for (let seen: Recording | null = null, at = -1; shown.value && (seen !== shown.value || at !== position.value);) {
      const recording: Recording = shown.value;
      const next: number = position.value;
      const data = await actions.request<Moment>("btcore/moment", { position: next, run: recording.run ?? 0 });
      if (recording !== shown.value) continue;
      showMoment(data, recording, { problem: data.problem && treeTexts.notReplayed(data.problem) });
      // A part that is shown for the first time is run in several replies.
      if (data.position === next || data.problem) [seen, at] = [recording, next];
    }
  } catch (error) {
    showError(error);
  } finally {
    isMoving = false;
  }
}

/** Show a moment of a recording or of a run in the picture. *more* is what the moment does not have. */
export function showMoment(data: Moment, { keys, calls }: Pick<Live, "keys" | "calls">, more: Partial<Live>): void {
  moment.value = data;
  live.value = {
    address: "", connection: "connected", detail: "", problem: data.problem, statuses: data.statuses, results: data.results,
    entries: data.entries, wanted: [], breakpoints: [], stopped: "", keys, calls, ...more,
  };
}

/** Go some steps forth, or back, if the page shows a recording or a counterexample. */
export function step(by: number): void {
  if (shown.value) void goTo(position.value + by);
}

interface TrackProps {
  /** The number of steps, and the status of the root after each *width* of them. */
  count: number;
  colours: string;
  width: number;
  /** The position of the slider, and the moment that is shown. */
  position: number;
  at: Moment | null;
  name: string;
  label: string;
  goTo: (position: number) => void;
}

/** The slider over the steps of a recording or a run, and its moment. */
export function Track({ count, colours, width, position, at, name, label, goTo }: TrackProps) {
  const runs = useMemo(() => [...colours.matchAll(/(.)\1*/g)], [colours]);
  const time = at ? treeTexts.seconds(at.time) : "";
  return (
    <>
      <div class="track">
        <input
          type="range" min={0} max={count} value={position} aria-label={label} aria-valuetext={at ? `${name}, ${time}, ${statuses[at.root]}` : ""}
          onInput={(event) => goTo(Number(event.currentTarget.value))}
        />
        <svg viewBox={`0 0 ${Math.max(1, count)} 1`} preserveAspectRatio="none" aria-hidden="true">
          {runs.map((run) => <rect key={run.index} class={`s${run[0][0]}`} x={run.index * width} width={run[0].length * width} height={1} />)}
        </svg>
      </div>
      <output>
        <b>{name}</b> · {time}
        {at && at.position !== position && !at.problem && <small> {treeTexts.runningTo(position)}</small>}
        {at && at.tick > 0 && <span class={`status s${at.root}`}>{statuses[at.root]}</span>}
      </output>
    </>
  );
}

export function Timeline() {
  const recording = shown.value;
  if (!recording) return null;
  const at = moment.value;
  const name = !at ? "" : at.tick ? treeTexts.tick(at.tick) : at.position ? treeTexts.halt : treeTexts.beginning;
  return (
    <section class="timeline" aria-label={treeTexts.timeline}>
      <div class="group">
        <button title={treeTexts.back} aria-label={treeTexts.back} disabled={position.value === 0} onClick={() => step(-1)}>◀</button>
        <button title={treeTexts.forth} aria-label={treeTexts.forth} disabled={position.value === recording.count} onClick={() => step(1)}>▶</button>
      </div>
      <Track {...recording} position={position.value} at={at} name={name} label={treeTexts.moment} goTo={(wanted) => void goTo(wanted)} />
    </section>
  );
}
