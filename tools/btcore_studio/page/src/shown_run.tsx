// The name and the buttons of a counterexample, or of a run with changes, above the timeline.

import { signal } from "@preact/signals";
import type { Home } from "./home";
import { closeShownRun, showRun } from "./mock_run";
import type { ShownRun } from "./protocol";
import { message, showError } from "./state";
import { proofTexts } from "./texts";
import { shownRun } from "./timeline";

/** What the shown run is, and notes about it. */
const about = signal<{ title: string; notes: readonly string[] }>({ title: "", notes: [] });

/** Show a run on the timeline. */
export async function openRun(run: ShownRun, title: string, notes: readonly string[]): Promise<void> {
  about.value = { title, notes };
  await showRun(run);
}

export function ShownRunBar({ home }: { home: Home }) {
  const run = shownRun.value;
  if (!run) return null;
  const { title, notes } = about.value;
  const save = async () => {
    const name = "run.btrec.txt";
    await home.export(name, new Blob([run.text], { type: "text/plain" }));
    message.value = proofTexts.saved(name);
  };
  return (
    <section class="shown-run" aria-label={proofTexts.shownRun}>
      <p><b>{title}</b>{notes.map((note) => <span key={note}> {note}</span>)}</p>
      <div class="group">
        <button class="small" title={proofTexts.saveTitle} onClick={() => void save().catch(showError)}>{proofTexts.save}</button>
        <button class="small" title={proofTexts.closeRun} aria-label={proofTexts.closeRun} onClick={closeShownRun}>×</button>
      </div>
    </section>
  );
}
