import { actions, drawing, files, tree, uri } from "./state";
import { texts } from "./texts";

/** The files of the folder, and the trees of the shown document. */
export function Files() {
  const trees = drawing.value?.trees ?? [];
  return (
    <nav class="files" aria-label={texts.files}>
      {files.value.length > 0 && <h2>{texts.files}</h2>}
      <ul>
        {files.value.map((file) => (
          <li key={file.uri}>
            <button class="plain" aria-current={file.uri === uri.value ? "page" : undefined}
              onClick={() => { tree.value = null; uri.value = file.uri; }}>
              {file.name}{file.unsaved && <span class="dot" title={texts.unsaved} aria-label={texts.unsaved}> ●</span>}
            </button>
          </li>
        ))}
      </ul>
      <h2>{texts.trees}</h2>
      <ul>
        {trees.map(({ id, callers, isMain, place }) => (
          <li key={id}>
            <button class="plain" aria-current={id === drawing.value?.tree ? "true" : undefined}
              onClick={() => { tree.value = id; }} onDblClick={() => actions.reveal(place)}>
              {id} {isMain && <span class="tag">{texts.mainTree}</span>}
              <small>{callers.length ? texts.calledBy(callers) : isMain ? "" : texts.notCalled}</small>
            </button>
          </li>
        ))}
      </ul>
    </nav>
  );
}

/** The trees that lead from the main tree to the shown one. */
export function Breadcrumbs() {
  const shown = drawing.value;
  if (!shown) return null;
  const byId = new Map(shown.trees.map((item) => [item.id, item]));
  const path = [shown.tree];
  for (let item = byId.get(shown.tree); item && !item.isMain && item.callers[0];) {
    if (path.includes(item.callers[0])) break;
    path.unshift(item.callers[0]);
    item = byId.get(item.callers[0]);
  }
  if (path.length < 2) return null;
  return (
    <nav class="breadcrumbs" aria-label={texts.breadcrumbs}>
      <ol>
        {path.map((id) => (
          <li key={id}>
            {id === shown.tree ? <span aria-current="page">{id}</span>
              : <button class="plain" onClick={() => { tree.value = id; }}>{id}</button>}
          </li>
        ))}
      </ol>
    </nav>
  );
}
