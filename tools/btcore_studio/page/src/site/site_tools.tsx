// What only the page on a site of static files shows: files, links, and the state of Python.

import { openFile } from "../files";
import { filesOfRun, mockRun } from "../mock_run";
import { drawing, message, showError, start } from "../state";
import { siteTexts } from "../texts";
import type { SiteHome } from "./home";
import { LinkError } from "./link";
import { chooseFiles } from "./local_files";
import { failure, python } from "./python_worker";

async function open(home: SiteHome): Promise<void> {
  const files = await chooseFiles();
  const uris = await Promise.all(files.map((file) => home.open(file)));
  if (uris[0] === undefined) return;
  openFile(uris[0]);
  message.value = siteTexts.opened(files.map(({ name }) => name).join(", "));
}

/** @param withRun Whether the link contains the run, or the recording, that is shown. */
async function copyLink(home: SiteHome, withRun = false): Promise<void> {
  let link: string;
  try {
    const run = !withRun ? null : mockRun.value ? (await filesOfRun(false))[0]!.text : home.recording.value;
    link = await home.link(run);
  } catch (error) {
    message.value = error instanceof LinkError ? siteTexts.noLink : String(error);
    return;
  }
  message.value = await navigator.clipboard.writeText(link).then(() => siteTexts.linkCopied, () => siteTexts.linkShown);
}

/** The buttons for files and links. */
export function SiteTools({ home }: { home: SiteHome }) {
  return (
    <div class="group" role="group" aria-label={siteTexts.filesAndLinks}>
      <button onClick={() => void open(home).catch(showError)} title={siteTexts.openTitle}>{siteTexts.open}</button>
      <button onClick={() => void copyLink(home)} title={siteTexts.copyLinkTitle}>{siteTexts.copyLink}</button>
      {(mockRun.value?.state.count || home.recording.value !== null)
        && <button onClick={() => void copyLink(home, true)} title={siteTexts.copyRunTitle}>{siteTexts.copyRun}</button>}
    </div>
  );
}

/** The offer to show the recording of the link: opening a link runs nothing. */
export function LinkedRecording({ home }: { home: SiteHome }) {
  if (home.recording.value === null || start.value?.recording) return null;
  return (
    <p>
      {siteTexts.hasRecording}{" "}
      <button class="small" disabled={!drawing.value} onClick={() => void home.showRecording().catch(showError)}>{siteTexts.showRecording}</button>
    </p>
  );
}

/** What Python does, unless it is ready. */
export function PythonNotice({ home }: { home: SiteHome }) {
  const state = python.value;
  if (state === "ready") return null;
  return (
    <p>
      {siteTexts.python[state]}{state === "failed" && ` ${failure.value}`}{" "}
      {state !== "starting" && <button class="small" onClick={() => void home.restart()}>{siteTexts.restart}</button>}
    </p>
  );
}
