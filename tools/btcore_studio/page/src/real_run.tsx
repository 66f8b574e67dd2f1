// A run of the shown tree with its real leaves, in a process to which the page is attached as to any running tree.

import { effect, signal, untracked } from "@preact/signals";
import { useId } from "preact/hooks";
import { closeShownRun, endRun, mockRun } from "./mock_run";
import type { RealRun, ShownRun } from "./protocol";
import { openRun } from "./shown_run";
import { actions, drawing, live, message, showError, start, tree, uri } from "./state";
import { store, stored } from "./storage";
import { realRunTexts, treeTexts } from "./texts";
import { shownRun } from "./timeline";

/** The run, from its start until it is closed. */
export const realRun = signal<RealRun | null>(null);
const isAsking = signal(false);
const isBusy = signal(false);
const isExpanded = signal(false);

/** The name of the setting with the options of a file. */
const optionsOf = (file: string) => `btcore.runOptions ${file}`;

/** Follow the process of the run. */
export function receiveRealRun(state: RealRun): void {
  const before = realRun.value;
  realRun.value = state;
  if (!before?.running || state.running) return;
  message.value = realRunTexts.ended(state.code);
  if (state.code !== 0) isExpanded.value = true;
  // The run has ended before the page was connected, for example because of an error of the tree.
  if (live.value?.connection === "waiting") void actions.request("btcore/watch", { address: "" }).catch(showError);
}

async function inTurn(act: () => Promise<void>): Promise<void> {
  if (isBusy.value) return;
  isBusy.value = true;
  try {
    await act();
  } catch (error) {
    showError(error);
  } finally {
    isBusy.value = false;
  }
}

const startRealRun = (options: string) => inTurn(async () => {
  if (mockRun.value) await endRun();
  store(optionsOf(uri.value), options);
  isExpanded.value = false;
  message.value = realRunTexts.starting;
  await actions.request("btcore/startRealRun", { textDocument: { uri: uri.value }, tree: tree.value, options });
  isAsking.value = false;
});

const endRealRun = () => inTurn(async () => {
  message.value = realRunTexts.ending;
  await actions.request("btcore/endRealRun", {});
});

/** Show no run any more: the picture is the edited tree alone. */
const close = () => inTurn(async () => {
  await actions.request("btcore/watch", { address: "" });
  if (shownRun.value) closeShownRun();
  realRun.value = null;
});

const openRecording = () => inTurn(async () => {
  const run = await actions.request<ShownRun>("btcore/openRecording", {});
  openRun(run, realRunTexts.recording, run.warnings.map(treeTexts.recordingLacks), run.run);
  message.value = realRunTexts.opened;
});

/** The button beside that of a run with mock leaves; only if the user trusts the folder. */
export function RealRunButton() {
  if (!start.value?.trusted || !start.value.live) return null;
  return (
    <button title={realRunTexts.startTitle} aria-expanded={isAsking.value} onClick={() => { isAsking.value = !isAsking.value; }}>
      {realRunTexts.start} …
    </button>
  );
}

/** The options of the run that is to be started. */
export function RealRunForm() {
  const id = useId();
  if (!isAsking.value || !drawing.value?.tree) return null;
  const submit = (event: Event) => {
    event.preventDefault();
    const data = new FormData(event.currentTarget as HTMLFormElement);
    void startRealRun(String(data.get("options")).trim());
  };
  const leave = (event: KeyboardEvent) => {
    if (event.key !== "Escape") return;
    event.stopPropagation();
    isAsking.value = false;
  };
  return (
    <form class="real-run" onSubmit={submit} onKeyDown={leave}>
      <label>
        {realRunTexts.options}
        <input key={uri.value} name="options" ref={(field) => field?.focus()} defaultValue={stored(optionsOf(uri.value)) ?? ""} maxLength={2000}
          placeholder={realRunTexts.example} spellcheck={false} autocomplete="off" aria-describedby={id} />
      </label>
      <button class="play" disabled={isBusy.value}>{realRunTexts.start}</button>
      <button type="button" onClick={() => { isAsking.value = false; }}>{realRunTexts.cancel}</button>
      <p id={id}>{realRunTexts.hint}</p>
    </form>
  );
}

/** The bar of the run, and what its process has printed. */
export function RealRunBar() {
  const run = realRun.value;
  if (!run) return null;
  return (
    <section class="run-bar real" aria-label={realRunTexts.bar}>
      <div class="timeline">
        <b class={run.running ? "status s1" : `status s${run.code === 0 ? 2 : 3}`}>{run.running ? realRunTexts.running : realRunTexts.ended(run.code)}</b>
        <div class="group">
          {run.running
            ? <button disabled={isBusy.value} title={realRunTexts.endTitle} onClick={() => void endRealRun()}>{realRunTexts.end}</button>
            : (
              <>
                {run.recorded && !shownRun.value && <button disabled={isBusy.value} title={realRunTexts.openTitle} onClick={() => void openRecording()}>{realRunTexts.open}</button>}
                <button disabled={isBusy.value} title={realRunTexts.closeTitle} onClick={() => void close()}>{realRunTexts.close}</button>
              </>
            )}
        </div>
      </div>
      {run.output && (
        <details class="output" open={isExpanded.value} onToggle={(event) => { isExpanded.value = event.currentTarget.open; }}>
          <summary>{realRunTexts.output}</summary>
          <pre tabIndex={0} ref={(box) => { if (box) box.scrollTop = box.scrollHeight; }}>{run.output}</pre>
        </details>
      )}
    </section>
  );
}

// Another file has no run.
let shown = "";
effect(() => {
  const now = uri.value;
  if (shown && now !== shown && untracked(() => realRun.value && !realRun.value.running)) untracked(() => void close());
  shown = now;
});
