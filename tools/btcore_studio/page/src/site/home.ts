// The home of the page on a site of static files: the page has the texts, and Python runs in a Web Worker.

import { ChangeSet, type Text } from "@codemirror/state";
import { signal } from "@preact/signals";
import { type Reply, textOf } from "../documents";
import { NEW_FILE } from "../files";
import { PageHome } from "../home";
import type { Pushed, Recording, SharedFile, SharedText, Start } from "../protocol";
import { actions, message, start, tree, uri as shownUri } from "../state";
import { siteTexts } from "../texts";
import { fragmentOf, isFileName, type LinkedFile, linkedFiles, LinkError } from "./link";
import { type OpenedFile, saveFile } from "./local_files";
import { PythonWorker } from "./python_worker";

/** The folder of the documents in Python, which has no files. */
const FOLDER = "file:///studio";
const FIRST_FILE: LinkedFile = { name: "tree.xml", text: NEW_FILE, mark: false };

interface PageFile {
  name: string;
  /** Whether the file begins with a byte order mark. */
  mark: boolean;
  version: number;
  /** The text in the user's file; null if there is none. */
  saved: Text | null;
  /** The text that is in the user's file or in a link. It is the text of the page before the file is open in `documents`. */
  kept: Text;
  handle: FileSystemFileHandle | null;
}

export class SiteHome extends PageHome {
  /** The text of the recording in the link, or null. It is shown only when the user wishes. */
  readonly recording = signal<string | null>(null);
  private readonly files = new Map<string, PageFile>();
  private readonly python: PythonWorker;
  private shownFiles = "";

  constructor() {
    const python = new PythonWorker({
      "btcore/files": () => this.list(),
      "btcore/create": ({ name, text }: { name: string; text: string }) => this.create(name, text),
    });
    super(python, siteTexts.ended);
    this.python = python;
    this.python.start();
    this.documents.listen(() => this.show());
    addEventListener("beforeunload", (event) => {
      if ([...this.files.keys()].some((uri) => !this.text(uri).eq(this.file(uri).kept))) event.preventDefault();
    });
    // Another link was opened in this tab.
    addEventListener("hashchange", () => location.reload());
  }

  async begin(): Promise<Start> {
    const linked = await linkedFiles(location.hash).catch((error: unknown) => {
      message.value = siteTexts.linkRefused[error instanceof LinkError ? error.reason : "invalid"];
      return null;
    });
    this.recording.value = linked?.recording ?? null;
    const uris = (linked?.files ?? []).map((file) => this.add(file));
    if (!uris.length) uris.push(this.add(FIRST_FILE, true));
    void this.connect();
    return { folder: "", uri: uris[0]!, tree: linked?.tree ?? null, readOnly: false, live: false, recording: null };
  }

  /** End Python, and start it again. The texts are in the page. */
  restart(): Promise<void> {
    this.python.start();
    return this.connect();
  }

  /** Show the moments of the recording in the link. */
  async showRecording(): Promise<void> {
    const recording = await actions.request<Recording>("btcore/recording", { text: this.recording.value });
    start.value = { ...start.value!, recording };
  }

  /** Give the texts to a language server that has just started. */
  private async connect(): Promise<void> {
    this.forget();
    const initialized = this.initialize([{ uri: FOLDER, name: "studio" }]);
    await this.documents.reload();
    await Promise.all([...this.files.keys()].map((uri) => this.documents.load(uri)));
    // Rejected if Python is started again meanwhile.
    await initialized.catch(() => {});
    if (start.value?.recording) await this.showRecording();
  }

  /** Add an opened file, or replace the text of the file with its name, as one step of undo. */
  async open({ handle, ...file }: OpenedFile): Promise<string> {
    const known = [...this.files].find(([, { name }]) => name === file.name)?.[0];
    const uri = known ?? this.add(file);
    const text = textOf(file.text);
    await this.documents.load(uri);
    if (known) {
      const before = this.text(uri);
      this.history.apply(new Map([[uri, ChangeSet.of({ from: 0, to: before.length, insert: text }, before.length)]]));
    }
    Object.assign(this.file(uri), { mark: file.mark, handle, saved: text, kept: text });
    this.show();
    return uri;
  }

  async save(uri: string): Promise<boolean> {
    await this.documents.load(uri);
    const [file, text] = [this.file(uri), this.text(uri)];
    if (file.saved?.eq(text)) return false;
    const content = new Blob([file.mark ? "\ufeff" : "", text.toString()], { type: "application/xml" });
    file.handle = await saveFile(file.name, content, file.handle, (name, blob) => this.export(name, blob));
    file.saved = file.kept = text;
    this.show();
    return true;
  }

  /**
   * Return a link with all files, and the shown file first. The address of the page becomes this link.
   * @param recording The text of a recording in the link.
   */
  async link(recording: string | null): Promise<string> {
    const uris = [shownUri.value, ...[...this.files.keys()].filter((uri) => uri !== shownUri.value)];
    const texts = uris.map((uri) => this.text(uri));
    const files = uris.map((uri, index) => ({ name: this.file(uri).name, text: texts[index]!.toString(), mark: this.file(uri).mark }));
    window.history.replaceState(null, "", await fragmentOf({ files, tree: tree.value, recording }));
    uris.forEach((uri, index) => { this.file(uri).kept = texts[index]!; });
    return location.href;
  }

  protected readShared(uri: string): Promise<SharedText> {
    const { version } = this.file(uri);
    return Promise.resolve({ text: this.text(uri).toString(), version, unsaved: this.isUnsaved(uri) });
  }

  /** Nothing else changes a text: each edit is accepted. */
  protected push({ uri }: Pushed): Promise<Reply> {
    return Promise.resolve(++this.file(uri).version);
  }

  private file(uri: string): PageFile {
    const file = this.files.get(uri);
    if (!file) throw new Error(siteTexts.noFile(uri));
    return file;
  }

  private text(uri: string): Text {
    return this.documents.isOpen(uri) ? this.documents.text(uri) : this.file(uri).kept;
  }

  private isUnsaved(uri: string): boolean {
    return !this.file(uri).saved?.eq(this.text(uri));
  }

  /** Add a file. @param isSaved Whether it need not be saved before the user has changed it. */
  private add({ name, text, mark }: LinkedFile, isSaved = false): string {
    const uri = `${FOLDER}/${encodeURIComponent(name)}`;
    const kept = textOf(text);
    this.files.set(uri, { name, mark, version: 1, saved: isSaved ? kept : null, kept, handle: null });
    this.show();
    return uri;
  }

  private create(name: string, text: string): { uri: string } {
    if (name.endsWith(".py")) {
      void this.export(name, new Blob([text], { type: "text/x-python" }));
      return { uri: "" };
    }
    if (!isFileName(name)) throw new Error(siteTexts.nameRefused(name));
    if ([...this.files.values()].some((file) => file.name === name)) throw new Error(siteTexts.nameUsed(name));
    const uri = this.add({ name, text, mark: false });
    void this.documents.load(uri);
    return { uri };
  }

  private list(): SharedFile[] {
    return [...this.files].map(([uri, { name }]) => ({ uri, name, unsaved: this.isUnsaved(uri) }));
  }

  /** Show the list of files, if it has changed. */
  private show(): void {
    const list = this.list();
    const shown = JSON.stringify(list);
    if (shown === this.shownFiles) return;
    this.shownFiles = shown;
    this.python.receive({ method: "btcore/files", params: list });
  }
}
