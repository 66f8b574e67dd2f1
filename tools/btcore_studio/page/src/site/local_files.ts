// Files of the user: by the File System Access API, or else by upload and download.

import { siteTexts } from "../texts";
import { isFileName, type LinkedFile } from "./link";

/** The maximum size of a file (bytes), as in `btcore studio`. */
const MAX_BYTES = 8 << 20;
const TYPES = [{ description: siteTexts.fileType, accept: { "application/xml": [".xml", ".btproj"] as const } }];

/** Without a *handle*, the browser cannot write the file. */
export interface OpenedFile extends LinkedFile { handle: FileSystemFileHandle | null }

// TypeScript does not declare the dialogs, which not every browser has.
declare global {
  interface Window {
    showOpenFilePicker?: (options: object) => Promise<FileSystemFileHandle[]>;
    showSaveFilePicker?: (options: object) => Promise<FileSystemFileHandle>;
  }
}

/** Let the user choose files. Rejects with the reason if a file cannot be opened; resolves to none if the user cancels. */
export async function chooseFiles(): Promise<OpenedFile[]> {
  if (!window.showOpenFilePicker) return Promise.all((await uploadedFiles()).map((file) => read(file, null)));
  const handles = await window.showOpenFilePicker({ multiple: true, types: TYPES }).catch(cancelled);
  return Promise.all((handles ?? []).map(async (handle) => read(await handle.getFile(), handle)));
}

/** Write a file, and return its handle. A browser without the API downloads the file. */
export async function saveFile(
  name: string, content: Blob, handle: FileSystemFileHandle | null, download: (name: string, content: Blob) => Promise<void>,
): Promise<FileSystemFileHandle | null> {
  if (!handle && window.showSaveFilePicker) {
    const chosen = await window.showSaveFilePicker({ suggestedName: name, types: TYPES }).catch(cancelled);
    if (!chosen) throw new Error(siteTexts.cancelled);
    handle = chosen;
  }
  if (!handle) {
    await download(name, content);
    return null;
  }
  const stream = await handle.createWritable();
  await stream.write(content);
  await stream.close();
  return handle;
}

function cancelled(error: unknown): null {
  if (error instanceof DOMException && error.name === "AbortError") return null;
  throw error;
}

function uploadedFiles(): Promise<File[]> {
  const input = document.createElement("input");
  input.type = "file";
  input.multiple = true;
  input.accept = ".xml,.btproj";
  return new Promise((resolve) => {
    input.onchange = () => resolve([...input.files ?? []]);
    input.oncancel = () => resolve([]);
    input.click();
  });
}

async function read(file: File, handle: FileSystemFileHandle | null): Promise<OpenedFile> {
  if (/\.(mcap|btlog|btrec\.txt)$/.test(file.name)) throw new Error(siteTexts.recording(file.name));
  if (!isFileName(file.name)) throw new Error(siteTexts.nameRefused(file.name));
  if (file.size > MAX_BYTES) throw new Error(siteTexts.fileTooLarge(file.name, MAX_BYTES >> 20));
  try {
    const text = new TextDecoder("utf-8", { fatal: true, ignoreBOM: true }).decode(await file.arrayBuffer());
    const mark = text.startsWith("\ufeff");
    return { name: file.name, text: mark ? text.slice(1) : text, mark, handle };
  } catch {
    throw new Error(siteTexts.notUtf8(file.name));
  }
}
