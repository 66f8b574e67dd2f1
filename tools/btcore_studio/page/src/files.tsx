import { batch, effect, signal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { ask } from "./dialog";
import { offsetAt, positionAt } from "./documents";
import type { Home } from "./home";
import type { TreeSummary } from "./protocol";
import { actions, drawing, files, message, reasonOf, selection, showError, start, tree, uri } from "./state";
import { rename } from "./text_pane";
import { texts } from "./texts";
import { focusPicture } from "./view";

/** The text of a new file. */
export const NEW_FILE = `<?xml version="1.0" encoding="UTF-8"?>
<root BTCPP_format="4" main_tree_to_execute="MainTree">
  <BehaviorTree ID="MainTree">
  </BehaviorTree>
</root>
`;
const MANY_FILES = 12;

/** Show a document and its main tree. */
export function openFile(address: string): void {
  batch(() => {
    tree.value = null;
    uri.value = address;
  });
}

/** Ask for the name of a new file, and create it. */
export function createFile(text = "tree.xml", reason = ""): void {
  ask({
    title: texts.newFile, label: texts.fileName, text, reason, choices: [texts.create],
    answer: (_, typed) => {
      const name = /\.[^/.]*$/.test(typed) ? typed : `${typed}.xml`;
      void actions.request<{ uri: string }>("btcore/create", { name, text: NEW_FILE })
        .then((created) => { openFile(created.uri); focusPicture(); }, (error) => createFile(typed, reasonOf(error)));
    },
  });
}

function createTree(text = "", reason = ""): void {
  ask({
    title: texts.newTree, label: texts.treeId, text, reason, choices: [texts.create],
    answer: (_, id) => void actions.edit({ kind: "add_tree", uri: uri.value, id }).then((result) => {
      if (!result) {
        createTree(id, message.value);
        return;
      }
      tree.value = id;
      focusPicture();
    }),
  });
}

function changeTree(home: Home, { id, place, isMain }: TreeSummary): void {
  const choices = [texts.rename, ...(isMain ? [] : [texts.makeMain]), texts.remove];
  ask({
    title: texts.changeTree(id), choices,
    answer: (choice) => {
      if (choice === texts.makeMain) void actions.edit({ kind: "set_main_tree", uri: uri.value, id });
      else if (choice === texts.remove) void actions.edit({ kind: "remove_tree", uri: place.uri, id });
      else void renameTree(home, place).catch(showError);
    },
  });
}

/** Rename a tree with its calls. The name is the value of the attribute ID. */
async function renameTree(home: Home, place: TreeSummary["place"]): Promise<void> {
  const text = await home.read(place.uri);
  const begin = offsetAt(text, place.position);
  const found = /\sID\s*=\s*["']/.exec(text.sliceString(begin, begin + 1000));
  if (found) await rename(place.uri, positionAt(text, begin + found.index + found[0].length));
}

/** Scroll each list to its current item. The page itself stays where it is. */
function showCurrent(nav: HTMLElement | null): void {
  for (const item of nav?.querySelectorAll("[aria-current]") ?? []) {
    const list = item.closest("ul")!;
    const [inner, outer] = [item.getBoundingClientRect(), list.getBoundingClientRect()];
    list.scrollTop += Math.min(0, inner.top - outer.top) || Math.max(0, inner.bottom - outer.bottom);
  }
}

effect(() => {
  // The first file of a folder that was empty.
  const [first] = files.value;
  if (start.value?.uri === "" && !start.value.versions && !uri.value && first) openFile(first.uri);
});

/** The files of the folder, and the trees of the shown document. */
export function Files({ home }: { home: Home }) {
  const trees = drawing.value?.trees ?? [];
  const canChange = !(start.value?.readOnly ?? true);
  const words = filter.value.toLowerCase();
  const nav = useRef<HTMLElement>(null);
  useEffect(() => showCurrent(nav.current), [uri.value, files.value.length, drawing.value?.tree]);
  return (
    <nav class="files" ref={nav} aria-label={texts.filesAndTrees}>
      {home.documents && (
        <>
          <div class="row">
            <h2>{texts.files}</h2>
            {canChange && <button class="small" onClick={() => createFile()} aria-label={texts.newFile} title={texts.newFile}>+</button>}
          </div>
          {files.value.length > MANY_FILES && (
            <input type="search" placeholder={texts.filterFiles} aria-label={texts.filterFiles} value={filter.value}
              onInput={(event) => { filter.value = event.currentTarget.value; }} />
          )}
          <ul>
            {files.value.filter(({ name }) => name.toLowerCase().includes(words)).map((file) => (
              <li key={file.uri}>
                <button class="plain" aria-current={file.uri === uri.value ? "page" : undefined} onClick={() => openFile(file.uri)}>
                  {file.name}{file.unsaved && <span class="dot" role="img" title={texts.unsaved} aria-label={texts.unsaved}> ●</span>}
                </button>
              </li>
            ))}
          </ul>
        </>
      )}
      <div class="row">
        <h2>{texts.trees}</h2>
        {canChange && uri.value && <button class="small" onClick={() => createTree()} aria-label={texts.newTree} title={texts.newTree}>+</button>}
      </div>
      <ul>
        {/* By number, so that the focus stays when a tree is renamed. */}
        {trees.map((item, number) => (
          <li key={number} class="row">
            <button class="plain" aria-current={item.id === drawing.value?.tree ? "true" : undefined} onClick={() => { tree.value = item.id; }}>
              {item.id} {item.isMain && <span class="tag">{texts.mainTree}</span>}
              <small>{item.callers.length ? texts.calledBy(item.callers) : item.isMain ? "" : texts.notCalled}</small>
            </button>
            {canChange && item.id === drawing.value?.tree && (
              <button class="small" onClick={() => changeTree(home, item)} aria-label={texts.changeTree(item.id)} title={texts.changeTree(item.id)}>…</button>
            )}
          </li>
        ))}
      </ul>
    </nav>
  );
}

const filter = signal("");

/** The trees through which the user came to the shown tree. */
const path = signal<readonly string[]>([]);

effect(() => {
  const shown = drawing.value;
  if (!shown) return;
  const byId = new Map(shown.trees.map((item) => [item.id, item]));
  const before = path.peek();
  const at = before.indexOf(shown.tree);
  const item = byId.get(shown.tree);
  const last = before.at(-1) ?? "";
  if (at >= 0) path.value = before.slice(0, at + 1);
  else if (item?.callers.includes(last)) path.value = [...before, shown.tree];
  else path.value = item?.callers[0] && !item.isMain ? [item.callers[0], shown.tree] : [shown.tree];
  // The caller's node is where the user came from.
  const called = at >= 0 && before[at + 1];
  const call = called && !selection.peek().length && shown.nodes.find((node) => node.calls === called);
  if (call) selection.value = [call.key];
});

/** Show a tree on the way to the shown tree, by default its caller. Return whether there is one. */
export function backTo(id = path.value.at(-2)): boolean {
  if (id === undefined) return false;
  batch(() => {
    selection.value = [];
    tree.value = id;
  });
  focusPicture();
  return true;
}

export function Breadcrumbs() {
  if (path.value.length < 2) return null;
  return (
    <nav class="breadcrumbs" aria-label={texts.breadcrumbs}>
      <ol>
        {path.value.map((id) => (
          <li key={id}>
            {id === path.value.at(-1) ? <span aria-current="page">{id}</span>
              : <button class="plain" onClick={() => backTo(id)}>{id}</button>}
          </li>
        ))}
      </ol>
    </nav>
  );
}
