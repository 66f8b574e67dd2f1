// What only the page on a site of static files shows: files, links, and the state of Python.

import { openFile } from "../files";
import { message, showError } from "../state";
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

async function copyLink(home: SiteHome): Promise<void> {
  let link: string;
  try {
    link = await home.link();
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
    </div>
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
