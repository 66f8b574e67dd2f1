// The name and the buttons of a counterexample, a run with changes, a run with real leaves, or a recording, above the timeline.

import { computed, signal } from "@preact/signals";
import type { Home } from "./home";
import { closeShownRun, isEdited, mockRun, showRun } from "./mock_run";
import type { RunFile, ShownRun, WhatIf } from "./protocol";
import { actions, message, showError, start, uri } from "./state";
import { proofTexts, runTexts } from "./texts";
import { shownRun } from "./timeline";

interface About {
  title: string;
  notes: readonly string[];
  /** The number of the run that "What if" changes: the shown run, or the run that was changed. */
  base: number;
  /** Whether a test can expect that the tree does the same again; a counterexample shows what must not happen. */
  isTestable: boolean;
}
const about = signal<About>({ title: "", notes: [], base: 0, isTestable: false });

/** The number of the run that "What if" changes; 0 for the recording of the studio, and null if no run is shown. */
export const baseRun = computed(() =>
  shownRun.value ? about.value.base : mockRun.value?.state.run ?? (start.value?.recording ? 0 : null));

/** Show a run on the timeline. @param base The run that "What if" changes; null for a counterexample. */
export function openRun(run: ShownRun, title: string, notes: readonly string[], base: number | null = null): void {
  about.value = { title, notes, base: base ?? run.run, isTestable: base !== null };
  showRun(run);
}

/** What is changed: the results of leaves and the entries in ticks, and the tree, if *isEditedTree*. */
interface Changes { results?: WhatIf["results"]; entries?: WhatIf["entries"]; isEditedTree?: boolean }

/** Run the run again with changes, and show what happens then. */
export async function whatIf(title: string, { results = [], entries = [], isEditedTree = false }: Changes): Promise<void> {
  const base = baseRun.value;
  if (base === null) return;
  const params: WhatIf = { run: base, textDocument: isEditedTree ? { uri: uri.value } : null, results, entries };
  try {
    const run = await actions.request<ShownRun>("btcore/whatIf", params);
    openRun(run, title, run.report, base);
    message.value = run.report.join("; ");
  } catch (error) {
    showError(error);
  }
}

/** The button that runs the edited tree with the leaves of the run. */
export function EditedTreeButton() {
  return (
    <button class="small" title={proofTexts.whatIfEditedTitle} onClick={() => void whatIf(proofTexts.editedRun, { isEditedTree: true })}>
      {proofTexts.whatIfEdited}
    </button>
  );
}

export function ShownRunBar({ home }: { home: Home }) {
  const run = shownRun.value;
  if (!run && !start.value?.recording) return null;
  const { title, notes, isTestable } = run ? about.value : { title: proofTexts.recordedRun, notes: [], isTestable: true };
  const save = async (test: boolean) => {
    try {
      const tree = decodeURIComponent(uri.value.split("/").at(-1)!);
      const { files } = await actions.request<{ files: RunFile[] }>("btcore/runFiles", { run: run?.run ?? 0, test, tree });
      for (const { name, text } of files) await home.export(name, new Blob([text], { type: "text/plain" }));
      message.value = runTexts.saved(files.map(({ name }) => name), test);
    } catch (error) {
      showError(error);
    }
  };
  return (
    <section class="shown-run" aria-label={proofTexts.shownRun}>
      <p><b>{title}</b>{notes.map((note) => <span key={note}> {note}</span>)}</p>
      {isEdited.value && run && <EditedTreeButton />}
      <div class="group">
        {run && <button class="small" title={runTexts.recordingTitle} onClick={() => void save(false)}>{runTexts.recording}</button>}
        {isTestable && <button class="small" title={runTexts.testTitle} onClick={() => void save(true)}>{runTexts.test}</button>}
        {run && <button class="small" title={proofTexts.closeRun} aria-label={proofTexts.closeRun} onClick={closeShownRun}>×</button>}
      </div>
    </section>
  );
}
