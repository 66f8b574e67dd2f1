// The form of a node type: its ID, its type and its ports, written as a model of the file.

import { useSignal } from "@preact/signals";
import { Fragment } from "preact";
import { useEffect, useLayoutEffect, useRef } from "preact/hooks";
import { edit } from "./operations";
import type { Leaf, PaletteItem, PalettePort } from "./protocol";
import { modelForm } from "./quick_state";
import { actions, files, message, reasonOf, refusedField, uri } from "./state";
import { treeTexts } from "./texts";

type ModelType = keyof typeof treeTexts.modelTypes;
/** A port, its name before, and a number that no other port has. */
type Row = PalettePort & { row: number; before: string };

const TYPES = Object.keys(treeTexts.modelTypes) as ModelType[];
const DIRECTIONS = ["in", "out", "inout"] as const;
const COLUMNS = ["name", "direction", "type", "default", "about"] as const;
const PORT_TYPES = ["std::string", "int", "unsigned int", "double", "bool", "std::vector<std::string>", "std::vector<double>"];
const NEW_PORT: PalettePort = { name: "", direction: "in", type: "", default: "", about: "" };

export function ModelForm() {
  return modelForm.value && <OpenForm {...modelForm.value} />;
}

/** Write the Python code of a node and its test into new files in a folder. Return their names. */
async function writeLeaf(address: string, folder: string, id: string): Promise<[name: string, test: string]> {
  const leaf = await actions.request<Leaf>("btcore/leaf", { textDocument: { uri: address }, id });
  const names: [string, string] = [folder + leaf.name, folder + leaf.testName];
  await actions.request("btcore/create", { name: names[0], text: leaf.text });
  await actions.request("btcore/create", { name: names[1], text: leaf.test });
  return names;
}

function OpenForm({ item, id: proposed = "" }: { item: PaletteItem | null; id?: string }) {
  const dialog = useRef<HTMLDialogElement>(null);
  const id = useSignal(item?.id ?? proposed);
  const type = useSignal(TYPES.find((name) => name.toLowerCase() === item?.kind) ?? "Action");
  const rows = useSignal<readonly Row[]>((item?.ports ?? []).map((port, row) => ({ ...port, row, before: port.name })));
  const nextRow = useRef(rows.value.length);
  const toFocus = useRef<number | null>(null);
  const refusal = useSignal({ text: "", field: "" });
  const isWriting = useSignal(false);
  // The form is for the file that was shown when it was opened.
  const address = useRef(uri.value).current;
  const file = files.value.find((other) => other.uri === address)?.name;
  useEffect(() => dialog.current!.showModal(), []);
  useLayoutEffect(() => {
    if (toFocus.current === null) return;
    const names = dialog.current!.querySelectorAll<HTMLElement>(".model-port [name=name], [name=add]");
    names[Math.min(toFocus.current, names.length - 1)]?.focus();
    toFocus.current = null;
  }, [rows.value]);
  const add = () => {
    toFocus.current = rows.value.length;
    rows.value = [...rows.value, { ...NEW_PORT, row: nextRow.current++, before: "" }];
  };
  const remove = (index: number) => {
    toFocus.current = index;
    rows.value = rows.value.filter((_, other) => other !== index);
  };
  const change = (index: number, column: string, text: string) => {
    rows.value = rows.value.map((port, other) => other === index ? { ...port, [column]: text } : port);
  };
  const submit = async (event: SubmitEvent) => {
    event.preventDefault();
    if (isWriting.value) return;
    isWriting.value = true;
    const withLeaf = (event.submitter as HTMLButtonElement | null)?.name === "leaf";
    const ports = rows.value.map(({ row: _, before: __, name, ...port }) => ({ ...port, name: name.trim() }));
    const name = id.value.trim();
    const renamed = Object.fromEntries(rows.value.flatMap((port) =>
      port.before && port.before !== port.name.trim() ? [[port.before, port.name.trim()]] : []));
    const result = await edit({ kind: "set_model", uri: address, id: name, type: type.value, ports, before: item?.id ?? "", renamed });
    refusal.value = result ? { text: "", field: "" } : { text: message.value, field: refusedField.value };
    try {
      if (result && withLeaf) message.value = treeTexts.leafWritten(...await writeLeaf(address, file!.slice(0, file!.lastIndexOf("/") + 1), name));
    } catch (error) {
      refusal.value = { text: reasonOf(error), field: "" };
    }
    isWriting.value = false;
    if (refusal.value.text) return;
    message.value ||= treeTexts.modelWritten(name);
    dialog.current?.close();
  };
  const removeType = async () => {
    const result = await edit({ kind: "remove_model", uri: address, id: item!.id });
    refusal.value = { text: result ? "" : message.value, field: "" };
    if (result) dialog.current?.close();
  };
  // The reason is beside its field, which gets the focus.
  useLayoutEffect(() => {
    const [, row, column] = refusal.value.field.split("/");
    if (row) dialog.current!.querySelectorAll(".model-port")[Number(row)]?.querySelector<HTMLElement>(`[name=${column}]`)?.focus();
    else if (refusal.value.field) dialog.current!.querySelector<HTMLElement>("[name=id]")?.focus();
  }, [refusal.value]);
  const reasonAt = (field: string) => refusal.value.field === field ? refusal.value.text : "";
  const reason = (field: string) => reasonAt(field) && <p class="error" role="alert" id="model-refusal">{refusal.value.text}</p>;
  const invalid = (field: string) => reasonAt(field) ? { "aria-invalid": true, "aria-describedby": "model-refusal" } : {};
  return (
    <dialog class="model" ref={dialog} aria-labelledby="model-title" onClose={() => { modelForm.value = null; }}>
      <h2 id="model-title">{item ? treeTexts.modelOf(item.id) : treeTexts.newModel}</h2>
      <form onSubmit={submit}>
        <label>
          {treeTexts.id}
          <input
            name="id" value={id.value} autofocus={item === null} required spellcheck={false} autocomplete="off"
            {...invalid("id")} onInput={(event) => { id.value = event.currentTarget.value; }}
          />
          {item && id.value.trim() !== item.id && <small>{treeTexts.renamesType(item.id)}</small>}
        </label>
        <label>
          {treeTexts.type}
          <select name="type" value={type.value} onChange={(event) => { type.value = event.currentTarget.value as ModelType; }}>
            {TYPES.map((name) => <option key={name} value={name}>{treeTexts.modelTypes[name]}</option>)}
          </select>
        </label>
        {reason("id")}
        <fieldset>
          <legend>{treeTexts.ports}</legend>
          {rows.value.map((port, index) => (
            <Fragment key={port.row}>
            <div class="model-port">
              {COLUMNS.map((column) => {
                const label = treeTexts.portField(treeTexts.portColumns[column], index + 1);
                return column === "direction" ? (
                  <select
                    key={column} name={column} aria-label={label} value={port.direction}
                    onChange={(event) => change(index, column, event.currentTarget.value)}
                  >{DIRECTIONS.map((name) => <option key={name} value={name}>{treeTexts.directions[name]}</option>)}</select>
                ) : (
                  <input
                    key={column} name={column} aria-label={label} placeholder={treeTexts.portColumns[column]} value={port[column]}
                    spellcheck={false} autocomplete="off" {...invalid(`ports/${index}/${column}`)} list={column === "type" ? "model-port-types" : undefined}
                    onInput={(event) => change(index, column, event.currentTarget.value)}
                  />
                );
              })}
              <button type="button" aria-label={treeTexts.removePort(port.name, index + 1)} title={treeTexts.removePort(port.name, index + 1)} onClick={() => remove(index)}>×</button>
            </div>
            {port.before && port.name.trim() !== port.before && <small>{treeTexts.renamesPort(port.before)}</small>}
            {COLUMNS.map((column) => reason(`ports/${index}/${column}`))}
            </Fragment>
          ))}
          <button type="button" name="add" onClick={add}>{treeTexts.addPort}</button>
          <datalist id="model-port-types">{PORT_TYPES.map((name) => <option key={name} value={name} />)}</datalist>
        </fieldset>
        <p>{treeTexts.modelHint}{file && ` ${treeTexts.leafHint}`}</p>
        {reason("")}
        <button type="submit" class="primary">{treeTexts.write}</button>
        {file && <button type="submit" name="leaf">{treeTexts.writeLeaf}</button>}
        <button type="button" onClick={() => dialog.current?.close()}>{treeTexts.cancel}</button>
        {item && <button type="button" name="remove" onClick={() => void removeType()}>{treeTexts.removeModel}</button>}
      </form>
    </dialog>
  );
}
