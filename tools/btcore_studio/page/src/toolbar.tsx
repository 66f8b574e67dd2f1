import { effect, signal } from "@preact/signals";
import { canRedo, canUndo, type Home } from "./home";
import { printDrawing } from "./print";
import type { Drawing } from "./protocol";
import { actions, drawing, files, folded, message, reasonOf, shownFile, start, tree, uri } from "./state";
import { SiteHome } from "./site/home";
import { SiteTools } from "./site/site_tools";
import { store, stored } from "./storage";
import { texts } from "./texts";

type Theme = "system" | "light" | "dark";
const THEMES: readonly Theme[] = ["system", "light", "dark"];
const STORED = "btcore-studio-theme";
const PNG_SCALE = 2;

const theme = signal<Theme>(THEMES.find((name) => name === stored(STORED)) ?? "system");

effect(() => {
  const chosen = theme.value;
  if (chosen === "system") delete document.documentElement.dataset.theme;
  else document.documentElement.dataset.theme = chosen;
  store(STORED, chosen);
});

/** The panes that the user has hidden. */
type Pane = "left" | "right" | "text";
const PANES: readonly Pane[] = ["left", "right", "text"];
const HIDDEN = "btcore-studio-hidden";
export const hiddenPanes = signal<ReadonlySet<Pane>>(
  new Set(PANES.filter((name) => (stored(HIDDEN) ?? "").split(" ").includes(name))));

function togglePane(name: Pane): void {
  const hidden = new Set(hiddenPanes.value);
  if (!hidden.delete(name)) hidden.add(name);
  hiddenPanes.value = hidden;
  store(HIDDEN, [...hidden].join(" "));
}

type Format = "svg" | "png" | "pdf";
const FORMATS: readonly Format[] = ["svg", "png", "pdf"];

export const fileName = (address: string): string => decodeURIComponent(address.split("/").at(-1) ?? address);

async function exportDrawing(home: Home, format: Format): Promise<void> {
  try {
    if (format === "pdf" && !home.documents) throw new Error(texts.noPrinter);
    const shown = await actions.request<Drawing>("btcore/drawing", {
      textDocument: { uri: uri.value }, tree: tree.value, folded: [...folded.value], styled: true,
    });
    if (format === "pdf") {
      printDrawing(shown);
      return;
    }
    const content = new Blob([shown.svg], { type: "image/svg+xml" });
    const name = shown.tree.replace(/[^\p{L}\p{N}_.-]+/gu, "_") || "tree";
    await home.export(`${name}.${format}`, format === "svg" ? content : await rasterize(content));
    if (home.documents) message.value = texts.exported(`${name}.${format}`);
  } catch (error) {
    message.value = texts.exportRefused(reasonOf(error));
  }
}

async function rasterize(svg: Blob): Promise<Blob> {
  const image = new Image();
  image.src = URL.createObjectURL(svg);
  try {
    await image.decode();
    const canvas = document.createElement("canvas");
    canvas.width = PNG_SCALE * image.naturalWidth;
    canvas.height = PNG_SCALE * image.naturalHeight;
    canvas.getContext("2d")?.drawImage(image, 0, 0, canvas.width, canvas.height);
    return await new Promise((resolve, reject) => {
      canvas.toBlob((png) => (png ? resolve(png) : reject(new Error(texts.tooLarge))), "image/png");
    });
  } finally {
    URL.revokeObjectURL(image.src);
  }
}

export function Themes() {
  return (
    <select aria-label={texts.theme} value={theme.value} onChange={(event) => { theme.value = event.currentTarget.value as Theme; }}>
      {THEMES.map((name) => <option key={name} value={name}>{texts.themes[name]}</option>)}
    </select>
  );
}

/** File, commands and settings. */
export function Toolbar({ home }: { home: Home }) {
  const isFixed = start.value?.readOnly ?? false;
  const trees = drawing.value?.trees ?? [];
  const shown = drawing.value?.tree ?? tree.value ?? "";
  return (
    <>
      {home.documents && (
        <div class="title">
          <h1 title={uri.value}>{fileName(uri.value) || texts.title}</h1>
          {shownFile.value?.unsaved && <span class="tag">{texts.unsaved}</span>}
        </div>
      )}
      {home instanceof SiteHome && <SiteTools home={home} />}
      <div class="group">
        {home.documents && (
          <button onClick={() => actions.save()} disabled={isFixed || !files.value.some((file) => file.unsaved)} title={`${texts.save} (Ctrl+S)`}>{texts.save}</button>
        )}
        <button onClick={() => actions.undo()} disabled={!canUndo.value} title={`${texts.undo} (Ctrl+Z)`}>{texts.undo}</button>
        <button onClick={() => actions.redo()} disabled={!canRedo.value} title={`${texts.redo} (Ctrl+Shift+Z)`}>{texts.redo}</button>
      </div>
      <select aria-label={texts.tree} value={shown} hidden={trees.length < 2}
        onChange={(event) => { tree.value = event.currentTarget.value; }}>
        {trees.map(({ id }) => <option key={id} value={id}>{id}</option>)}
      </select>
      <div class="group" role="group" aria-label={texts.export}>
        {FORMATS.map((format) => (
          <button key={format} onClick={() => exportDrawing(home, format)} title={texts.exportAs[format]}>{format.toUpperCase()}</button>
        ))}
      </div>
      <div class="group" role="group" aria-label={texts.panes}>
        {PANES.filter((name) => home.documents || name !== "text").map((name) => (
          <button key={name} aria-pressed={!hiddenPanes.value.has(name)} onClick={() => togglePane(name)}>{texts.paneNames[name]}</button>
        ))}
      </div>
      {home.documents && <Themes />}
    </>
  );
}
