// The text of a document in CodeMirror, with the features of the language server.

import {
  autocompletion, closeBrackets, closeBracketsKeymap, type Completion, type CompletionContext, completionKeymap,
  type CompletionResult, snippet,
} from "@codemirror/autocomplete";
import { defaultKeymap } from "@codemirror/commands";
import { xml } from "@codemirror/lang-xml";
import {
  bracketMatching, codeFolding, foldGutter, foldKeymap, HighlightStyle, indentOnInput, syntaxHighlighting,
} from "@codemirror/language";
import { type Action, type Diagnostic as LintDiagnostic, lintGutter, lintKeymap, setDiagnostics } from "@codemirror/lint";
import { highlightSelectionMatches, search, searchKeymap } from "@codemirror/search";
import {
  Annotation, type ChangeSet, type ChangeSpec, EditorSelection, EditorState, type Extension, Prec, RangeSet, RangeSetBuilder,
  StateEffect, StateField, type Text, Transaction, type TransactionSpec,
} from "@codemirror/state";
import {
  Decoration, type DecorationSet, drawSelection, EditorView, gutter, GutterMarker, highlightActiveLine, highlightActiveLineGutter,
  highlightSpecialChars, hoverTooltip, keymap, lineNumbers, MatchDecorator, rectangularSelection, ViewPlugin, type ViewUpdate,
} from "@codemirror/view";
import { tags } from "@lezer/highlight";
import { effect, signal, untracked } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { type Change, offsetAt, positionAt, rangeAt } from "./documents";
import type { PageHome } from "./home";
import { ask } from "./dialog";
import { openFile } from "./files";
import { toggleBreakpoints } from "./live";
import { fixes, fixesOf } from "./problems";
import type { Place, Position, Range, WorkspaceEdit } from "./protocol";
import { rendered } from "./markdown";
import {
  actions, diagnostics, drawing, isSamePlace, keyAt, live, message, msSinceDrawing, nodesByKey, selectedNode, selection, showError, start,
  uri,
} from "./state";
import { texts } from "./texts";
import { fileName } from "./toolbar";

/** The document in the text pane: that of the drawing, or one that it includes. */
const shownUri = signal("");
/** Where the cursor should go; set by `reveal`. */
const wantedPlace = signal<(Place & { focus: boolean }) | null>(null);

/** Show a place in the text pane. */
export function revealText(place: Place, focus = true): void {
  shownUri.value = place.uri;
  wantedPlace.value = { ...place, focus };
}

const openPlace = (address: string, line: number) => revealText({ uri: address, position: { line, character: 0 } });

const COLOUR_WAIT_MS = 120;
/** From the picture of a change to its text. */
const AFTER_PICTURE_MS = 40;
/** The longest time from a change to its text, while the picture changes again and again. */
const MAX_BEHIND_MS = 300;
const MANY_LINES = 2000;
const HOVER_WAIT_MS = 350;
const SEVERITIES = ["error", "error", "warning", "info", "hint"] as const;
const COMPLETION_TYPES: Record<number, string> = {
  3: "function", 5: "property", 6: "variable", 7: "class", 10: "property", 12: "constant", 13: "enum", 14: "keyword",
  15: "text", 17: "text", 18: "text", 20: "constant", 21: "constant", 22: "type",
};

/** Edits that the documents have already. */
const external = Annotation.define<boolean>();

interface CompletionItem {
  label: string;
  detail?: string;
  documentation?: string | { value: string };
  kind?: number;
  sortText?: string;
  filterText?: string;
  insertTextFormat?: 1 | 2;
  textEdit?: { range: Range; newText: string };
}

const textDocument = () => ({ textDocument: { uri: shownUri.value } });

// --- completion

async function complete(context: CompletionContext): Promise<CompletionResult | null> {
  const before = context.state.sliceDoc(Math.max(0, context.pos - 1), context.pos);
  const isTrigger = /[<\/ "'{]/.test(before);
  if (!context.explicit && !isTrigger && !/[\w@$.:-]/.test(before)) return null;
  const kind = isTrigger && !context.explicit ? { triggerKind: 2, triggerCharacter: before } : { triggerKind: 1 };
  const found = await actions.request<CompletionItem[] | { items: CompletionItem[] } | null>("textDocument/completion", {
    ...textDocument(), position: positionAt(context.state.doc, context.pos), context: kind,
  }).catch(() => null);
  const items = Array.isArray(found) ? found : (found?.items ?? []);
  const first = items[0]?.textEdit;
  if (!items.length || context.aborted) return null;
  const from = first ? offsetAt(context.state.doc, first.range.start) : context.pos;
  const options = items.map((item, index): Completion => {
    const text = item.textEdit?.newText ?? item.label;
    const about = typeof item.documentation === "string" ? item.documentation : item.documentation?.value;
    const completion: Completion = {
      label: item.filterText ?? item.label, displayLabel: item.label, sortText: item.sortText ?? String(index).padStart(5, "0"),
      apply: item.insertTextFormat === 2 ? snippet(text.replace(/\$(\d+)/g, "$${$1}").replace(/\$\{(\d+)\|([^,|}]*)[^}]*\}/g, "$${$1:$2}")) : text,
    };
    if (item.detail) completion.detail = item.detail;
    if (about) completion.info = () => rendered(about, openPlace);
    const type = COMPLETION_TYPES[item.kind ?? 0];
    if (type) completion.type = type;
    return completion;
  });
  const to = first ? offsetAt(context.state.doc, first.range.end) : context.pos;
  return { from, to: Math.max(to, context.pos), options, validFor: /^[\w@$.:-]*$/ };
}

// --- hover

const hover = hoverTooltip(async (view, pos) => {
  const found = await actions.request<{ contents: { value: string }; range?: Range } | null>("textDocument/hover", {
    ...textDocument(), position: positionAt(view.state.doc, pos),
  }).catch(() => null);
  if (!found?.contents.value) return null;
  const from = found.range ? offsetAt(view.state.doc, found.range.start) : pos;
  const { value } = found.contents;
  return { pos: Math.min(from, pos), above: true, create: () => ({ dom: rendered(value, openPlace) }) };
}, { hoverTime: HOVER_WAIT_MS });

// --- colours of scripts and keys

const TOKEN_TYPES = ["variable", "property", "number", "string", "keyword", "operator", "enumMember"];
const setColours = StateEffect.define<DecorationSet>();
const colours = StateField.define<DecorationSet>({
  create: () => Decoration.none,
  update: (value, transaction) => {
    for (const item of transaction.effects) if (item.is(setColours)) return item.value;
    return value.map(transaction.changes);
  },
  provide: (field) => EditorView.decorations.from(field),
});
/** Whether only the visible lines are coloured. */
const isLong = (doc: Text) => doc.lines > MANY_LINES;
const tokenMarks = TOKEN_TYPES.map((type) => Decoration.mark({ class: `token-${type}` }));

const colourer = ViewPlugin.fromClass(class {
  private timer = 0;

  constructor(private readonly view: EditorView) {
    this.wait(0);
  }

  update(update: ViewUpdate) {
    if (update.docChanged || (update.viewportChanged && isLong(update.state.doc))) this.wait(COLOUR_WAIT_MS);
  }

  destroy() {
    clearTimeout(this.timer);
  }

  private wait(ms: number) {
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => void this.request(), ms);
  }

  private async request() {
    const { doc } = this.view.state;
    const { from: first, to: last } = this.view.viewport;
    const [method, range] = isLong(doc) ? ["range", { range: rangeAt(doc, first, last) }] : ["full", {}];
    const found = await actions.request<{ data: number[] } | null>(
      `textDocument/semanticTokens/${method}`, { ...textDocument(), ...range }).catch(() => null);
    if (!found || this.view.state.doc !== doc) return;
    const builder = new RangeSetBuilder<Decoration>();
    let [line, character] = [0, 0];
    for (let index = 0; index + 4 < found.data.length; index += 5) {
      const [lines, units, length, type] = found.data.slice(index, index + 4) as [number, number, number, number];
      line += lines;
      character = lines ? units : character + units;
      const from = offsetAt(doc, { line, character });
      const mark = tokenMarks[type];
      if (mark && length && from + length <= doc.length) builder.add(from, from + length, mark);
    }
    this.view.dispatch({ effects: setColours.of(builder.finish()) });
  }
});

// --- breakpoints before the nodes that begin in a line

const setStops = StateEffect.define<RangeSet<GutterMarker>>();
const stops = StateField.define<RangeSet<GutterMarker>>({
  create: () => RangeSet.empty,
  update: (value, transaction) => {
    for (const item of transaction.effects) if (item.is(setStops)) return item.value;
    return value.map(transaction.changes);
  },
});
const stopMarker = new (class extends GutterMarker {
  override elementClass = "stop";
})();

/** Return the drawn nodes of a document by the lines in which they begin. */
function keysByLine(uri: string): Map<number, string[]> {
  const found = new Map<number, string[]>();
  for (const { key, place } of drawing.value?.nodes ?? []) {
    if (place.uri !== uri) continue;
    found.set(place.position.line, [...(found.get(place.position.line) ?? []), key]);
  }
  return found;
}

function toggleStops(line: number): boolean {
  const keys = keysByLine(shownUri.value).get(line) ?? [];
  if (!keys.length || !start.value?.live) return false;
  void toggleBreakpoints(keys);
  return true;
}

const stopGutter = [stops, gutter({
  class: "cm-stops", markers: (view) => view.state.field(stops),
  domEventHandlers: { mousedown: (view, block) => toggleStops(positionAt(view.state.doc, block.from).line) },
})];

// --- line breaks: a CR before an LF belongs to the line, and is neither shown nor reached by the cursor

const returns = new MatchDecorator({ regexp: /\r$/g, decoration: Decoration.replace({}) });
const hideReturns = ViewPlugin.fromClass(class {
  decorations: DecorationSet;
  constructor(view: EditorView) { this.decorations = returns.createDeco(view); }
  update(update: ViewUpdate) { this.decorations = returns.updateDeco(update, this.decorations); }
}, {
  decorations: (plugin) => plugin.decorations,
  provide: (plugin) => EditorView.atomicRanges.of((view) => view.plugin(plugin)?.decorations ?? Decoration.none),
});

const isInBreak = (text: Text, offset: number) => offset > 0 && text.sliceString(offset - 1, Math.min(offset + 1, text.length)) === "\r\n";

/** The user's edits change whole line breaks, and write those of the first line. */
const wholeBreaks = EditorState.transactionFilter.of((transaction) => {
  const { startState: { doc }, newDoc } = transaction;
  if (transaction.annotation(external)) return transaction;
  const specs: TransactionSpec[] = [transaction];
  if (transaction.docChanged) {
    const hasReturns = doc.line(1).text.endsWith("\r");
    const changes: ChangeSpec[] = [];
    transaction.changes.iterChanges((from, to, start, end, inserted) => {
      if (from < to && isInBreak(doc, from)) changes.push({ from: start - 1, to: start });
      for (const { index } of hasReturns ? inserted.toString().matchAll(/(?<!\r)\n/g) : []) changes.push({ from: start + index, insert: "\r" });
      // The command of Enter replaces the white space after the cursor, and so the CR.
      if (from < to && isInBreak(doc, to)) changes.push(inserted.length ? { from: end, insert: "\r" } : { from: end, to: end + 1 });
    });
    if (changes.length) specs.push({ changes, sequential: true });
  } else if (transaction.selection?.ranges.some(({ anchor, head }) => isInBreak(newDoc, anchor) || isInBreak(newDoc, head))) {
    const before = (offset: number) => (isInBreak(newDoc, offset) ? offset - 1 : offset);
    const ranges = transaction.selection.ranges.map(({ anchor, head }) => EditorSelection.range(before(anchor), before(head)));
    specs.push({ selection: EditorSelection.create(ranges, transaction.selection.mainIndex), sequential: true });
  }
  return specs;
});

// --- commands

const cursorOf = ({ state }: EditorView): Position => positionAt(state.doc, state.selection.main.head);

/** Go to the definition of what is at the cursor. */
function goToDefinition(view: EditorView): boolean {
  const position = cursorOf(view);
  type Location = { uri: string; range: Range };
  void actions.request<Location | Location[] | null>("textDocument/definition", { ...textDocument(), position }).then((found) => {
    const place = Array.isArray(found) ? found[0] : found;
    if (place) revealText({ uri: place.uri, position: place.range.start });
    else message.value = texts.noDefinition;
  }, showError);
  return true;
}

/** Ask for the new name of what is at a position, and rename it in all files. */
export async function rename(address: string, position: Position): Promise<void> {
  const place = { textDocument: { uri: address }, position };
  const found = await actions.request<{ placeholder?: string } | null>("textDocument/prepareRename", place);
  if (!found) {
    message.value = texts.nothingToRename;
    return;
  }
  ask({
    title: texts.rename, label: texts.renameTo, text: found.placeholder ?? "", choices: [texts.rename],
    answer: (_, newName) => void actions.request<WorkspaceEdit | null>("textDocument/rename", { ...place, newName })
      .then((edit) => { if (edit) actions.apply(edit); }, showError),
  });
}

function startRename(view: EditorView): boolean {
  void rename(shownUri.value, cursorOf(view)).catch(showError);
  return true;
}

/** Offer the fixes of the problems in the line of the cursor. */
function offerFixes(view: EditorView): boolean {
  const { line } = cursorOf(view);
  const items = (diagnostics.value.get(shownUri.value) ?? []).filter(({ range }) => range.start.line <= line && line <= range.end.line);
  const found = new Map(items.flatMap((item) => fixesOf(shownUri.value, item)).map((fix) => [fix.title, fix]));
  if (found.size) {
    ask({
      title: texts.fixes, choices: [...found.keys()],
      answer: (title) => { const fix = found.get(title); if (fix) actions.apply(fix.edit); },
    });
  } else message.value = texts.noFixes;
  return true;
}

// --- appearance

const highlight = HighlightStyle.define([
  { tag: tags.tagName, class: "xml-tag" },
  { tag: tags.attributeName, class: "xml-attribute" },
  { tag: tags.attributeValue, class: "xml-value" },
  { tag: [tags.comment, tags.processingInstruction, tags.documentMeta], class: "xml-comment" },
  { tag: [tags.angleBracket, tags.definitionOperator], class: "xml-bracket" },
  { tag: tags.invalid, class: "xml-invalid" },
]);

const look = EditorView.theme({
  "&": { height: "100%", color: "var(--text)", backgroundColor: "var(--panel)", fontSize: "12.5px" },
  "&.cm-focused": { outline: "2px solid var(--accent)", outlineOffset: "-2px" },
  ".cm-scroller": { fontFamily: "var(--mono)", lineHeight: "1.5" },
  ".cm-content": { caretColor: "var(--text)" },
  ".cm-gutters": { backgroundColor: "var(--panel)", color: "var(--dim)", borderRight: "1px solid var(--line)" },
  ".cm-activeLine, .cm-activeLineGutter": { backgroundColor: "var(--hover)" },
  ".cm-stops": { width: "14px", cursor: "pointer" },
  ".cm-stops .stop::after": {
    content: "''", display: "block", width: "10px", height: "10px", margin: "4px 2px 0", borderRadius: "50%", backgroundColor: "var(--failure)",
  },
  ".cm-cursor": { borderLeftColor: "var(--text)" },
  "&.cm-focused > .cm-scroller > .cm-selectionLayer .cm-selectionBackground, .cm-selectionBackground": { backgroundColor: "var(--chosen)" },
  ".cm-selectionMatch, .cm-searchMatch": { backgroundColor: "var(--mark)" },
  ".cm-searchMatch-selected": { backgroundColor: "var(--found)" },
  "&.cm-focused .cm-matchingBracket": { backgroundColor: "var(--mark)" },
  ".cm-tooltip, .cm-panels": { backgroundColor: "var(--panel)", color: "var(--text)", border: "1px solid var(--line)", borderRadius: "6px" },
  ".cm-panels": { borderRadius: "0" },
  ".cm-tooltip .about, .cm-completionInfo": { padding: "6px 10px", maxWidth: "52ch", overflowWrap: "anywhere" },
  ".about p": { margin: "0 0 6px" },
  ".about ul": { margin: "0 0 6px", paddingLeft: "18px" },
  ".about td": { padding: "1px 10px 1px 0", verticalAlign: "top" },
  ".about code": { fontFamily: "var(--mono)" },
  ".about a": { color: "var(--accent)" },
  ".cm-tooltip-autocomplete > ul > li[aria-selected]": { backgroundColor: "var(--accent)", color: "var(--on-accent)" },
  ".cm-completionDetail": { fontStyle: "normal", opacity: "0.8" },
  ".cm-textfield, .cm-button": {
    font: "inherit", color: "inherit", backgroundColor: "var(--panel)", backgroundImage: "none", border: "1px solid var(--control)",
    borderRadius: "6px", padding: "3px 8px",
  },
  ".cm-foldPlaceholder": { backgroundColor: "var(--hover)", borderColor: "var(--line)", color: "var(--dim)", padding: "0 6px" },
  ".cm-diagnosticAction": { font: "inherit", backgroundColor: "var(--accent)", color: "var(--on-accent)", borderRadius: "5px", padding: "2px 8px", cursor: "pointer" },
  ".xml-tag": { color: "var(--accent)" },
  ".xml-value": { color: "var(--key)" },
  ".xml-comment, .xml-bracket": { color: "var(--dim)" },
  ".xml-invalid": { color: "var(--error)" },
  ".token-variable, .token-property": { color: "var(--variable)", fontWeight: "600" },
  ".token-number, .token-enumMember, .token-keyword": { color: "var(--number)" },
  ".token-string": { color: "var(--success-text)" },
  ".token-operator": { color: "var(--text)" },
});

const extensions = (home: PageHome): Extension => [
  EditorState.lineSeparator.of("\n"),
  start.peek()?.live ? stopGutter : [], lineNumbers(), foldGutter(), codeFolding(), lintGutter(), highlightSpecialChars(),
  // Each key would start the animation of a blinking cursor again, and Chromium would paint the next picture a frame later.
  drawSelection({ cursorBlinkRate: 0 }),
  EditorState.allowMultipleSelections.of(true), rectangularSelection(), indentOnInput(), bracketMatching(), closeBrackets(),
  highlightActiveLine(), highlightActiveLineGutter(), highlightSelectionMatches(), search({ top: true }),
  autocompletion({ override: [complete], activateOnTyping: true, interactionDelay: 40 }),
  Prec.low(colours), xml(), syntaxHighlighting(highlight), look, hover, colourer, hideReturns, wholeBreaks,
  EditorState.readOnly.of(start.peek()?.readOnly ?? false),
  Prec.highest(EditorView.domEventHandlers({
    beforeinput: (event) => {
      // The menu of the browser; the keys are the page's.
      if (event.inputType === "historyUndo") void actions.undo();
      else if (event.inputType === "historyRedo") void actions.redo();
      else return false;
      event.preventDefault();
      return true;
    },
    mousedown: (event, view) => {
      if (!(event.ctrlKey || event.metaKey) || event.button !== 0) return false;
      const offset = view.posAtCoords({ x: event.clientX, y: event.clientY });
      if (offset === null) return false;
      view.dispatch({ selection: { anchor: offset } });
      goToDefinition(view);
      event.preventDefault();
      return true;
    },
    blur: () => {
      home.history.separate();
      return false;
    },
  })),
  keymap.of([
    { key: "F12", run: goToDefinition },
    { key: "F2", run: startRename },
    { key: "Mod-.", run: offerFixes },
    ...closeBracketsKeymap, ...completionKeymap, ...searchKeymap, ...foldKeymap, ...lintKeymap,
    // Tab moves the focus. Mod-] and Mod-[ indent.
    ...defaultKeymap,
  ]),
  EditorView.scrollHandler.of((view, { head }) => {
    // The text follows the picture without moving the page.
    if (view.hasFocus) return false;
    const { scrollDOM } = view;
    const { top, bottom } = view.lineBlockAt(head);
    const margin = Math.min(60, scrollDOM.clientHeight / 3);
    scrollDOM.scrollTop = Math.max(bottom + margin - scrollDOM.clientHeight, Math.min(scrollDOM.scrollTop, top - margin));
    return true;
  }),
];

// --- problems

const marks = (state: EditorState, address: string): LintDiagnostic[] =>
  (diagnostics.value.get(address) ?? []).map((item): LintDiagnostic => {
    const from = offsetAt(state.doc, item.range.start);
    return {
      from, to: Math.max(from, offsetAt(state.doc, item.range.end)), severity: SEVERITIES[item.severity ?? 1] ?? "error",
      message: item.message, source: String(item.code ?? ""),
      actions: fixesOf(address, item).map((fix): Action => ({ name: fix.title, apply: () => actions.apply(fix.edit) })),
    };
  });

// --- the pane

/** The text, in both directions with the documents and with the selected node. */
export function TextPane({ home }: { home: PageHome }) {
  const frame = useRef<HTMLDivElement>(null);
  useEffect(() => {
    const place = frame.current;
    if (!place) return;
    // In a shadow root CodeMirror adopts its style sheets, so that the page needs no inline styles.
    const root = place.shadowRoot ?? place.attachShadow({ mode: "open", delegatesFocus: true });
    const states = new Map<string, EditorState>();
    let shown = "";
    let keyOfCursor: string | null = null;
    const view = new EditorView({
      root,
      parent: root,
      dispatchTransactions: (transactions, editor) => {
        // The server draws while CodeMirror shows the change.
        for (const transaction of transactions) {
          if (transaction.docChanged && !transaction.annotation(external)) {
            home.documents.change(shown, transaction.changes, "typing", transaction.annotation(Transaction.userEvent) ?? "");
          }
        }
        editor.update(transactions);
        const isMoved = transactions.some((transaction) => transaction.selection && !transaction.annotation(external));
        // After a change, the nodes are where the cursor is only in the next drawing.
        if (isMoved && !transactions.some((transaction) => transaction.docChanged)) selectAtCursor();
      },
    });

    const isInText = () => root.activeElement === view.contentDOM;

    // Showing a change in the text takes as long as showing it in the picture, which comes first.
    const later: (() => void)[] = [];
    const catchUp = () => {
      for (const step of later.splice(0)) step();
    };
    const afterPicture = (step: () => void) => {
      later.push(step);
      if (isInText() || document.hidden) catchUp();
      else if (later.length === 1) wait(performance.now());
    };
    const wait = (begun: number) => setTimeout(() => {
      if (msSinceDrawing() < AFTER_PICTURE_MS && performance.now() - begun < MAX_BEHIND_MS) wait(begun);
      else catchUp();
    }, AFTER_PICTURE_MS);
    const events = ["focusin", "pointerdown", "keydown", "drop"] as const;
    for (const event of events) place.addEventListener(event, catchUp, true);

    const selectAtCursor = () => {
      const best = keyAt(shown, cursorOf(view));
      const placeOf = (key: string | null) => nodesByKey.peek().get(key ?? "")?.place;
      // A tree that is called several times is drawn several times.
      const isSelected = selection.peek().some((key) => key === best || isSamePlace(placeOf(key), placeOf(best)));
      if (!best || isSelected) return;
      keyOfCursor = best;
      selection.value = [best];
    };

    /** Follow the selected node, which may have moved. */
    const followNode = () => {
      const node = selectedNode.peek();
      if (node?.place.uri !== shown || node.key !== keyOfCursor) return;
      const atCursor = nodesByKey.peek().get(keyAt(shown, cursorOf(view)) ?? "");
      if (!isSamePlace(atCursor?.place, node.place)) revealText(node.place, false);
    };

    const showDocument = (address: string) => {
      if (shown) states.set(shown, view.state);
      shown = address;
      const label = texts.editorLabel(fileName(address));
      const known = states.get(address);
      const doc = home.documents.text(address);
      view.setState(known?.doc.eq(doc) ? known : EditorState.create({
        doc, selection: known ? EditorSelection.cursor(Math.min(known.selection.main.head, doc.length)) : EditorSelection.cursor(0),
        extensions: [extensions(home), EditorView.contentAttributes.of({ "aria-label": label, tabindex: "0", spellcheck: "false" })],
      }));
      showMarks();
      showStops();
    };

    const moveTo = (offset: number) => view.dispatch({
      selection: { anchor: offset }, annotations: external.of(true), effects: EditorView.scrollIntoView(offset, { y: "nearest", yMargin: 60 }),
    });

    const showStops = () => {
      const wanted = new Set(live.value?.wanted);
      if (!start.value?.live || (!wanted.size && !view.state.field(stops).size)) return;
      const lines = [...keysByLine(shown)].filter(([, keys]) => keys.some((key) => wanted.has(key))).map(([line]) => line);
      const markers = lines.sort((a, b) => a - b).map((line) => stopMarker.range(offsetAt(view.state.doc, { line, character: 0 })));
      const found = RangeSet.of(markers);
      if (!RangeSet.eq([found], [view.state.field(stops)])) view.dispatch({ effects: setStops.of(found) });
    };

    const showMarks = () => {
      view.dispatch(setDiagnostics(view.state, marks(view.state, shown)));
    };

    home.documents.listen(({ uri: address, changes, origin }: Change) => {
      if (address !== shown || origin === "typing") return;
      afterPicture(() => {
        if (address !== shown) return;
        view.dispatch({ changes, annotations: external.of(true) });
        if (origin === "undo") moveTo(lastChange(changes));
      });
    });
    const ends = [
      effect(() => { shownUri.value = uri.value; }),
      effect(() => {
        const address = shownUri.value;
        const wanted = wantedPlace.value;
        if (!address) return;
        const show = () => {
          if (address !== shownUri.peek()) return;
          if (shown !== address) showDocument(address);
          if (wanted && wanted === wantedPlace.peek() && wanted.uri === address) {
            wantedPlace.value = null;
            moveTo(offsetAt(view.state.doc, wanted.position));
            if (wanted.focus) {
              view.focus();
              selectAtCursor();
            }
          }
        };
        void home.documents.load(address).then(() => {
          afterPicture(show);
          if (wanted?.focus) catchUp();
        }, showError);
      }),
      effect(() => {
        const key = selection.value.at(-1) ?? null;
        untracked(() => {
          const node = selectedNode.value;
          // While the user types, a broken text can lack the selected node.
          if (node && key !== keyOfCursor && !isInText()) revealText(node.place, false);
          keyOfCursor = key;
        });
      }),
      effect(() => {
        if (drawing.value) untracked(() => {
          if (isInText()) selectAtCursor();
          else followNode();
        });
      }),
      effect(() => {
        if (live.value && drawing.value) untracked(() => afterPicture(showStops));
      }),
      effect(() => {
        if (diagnostics.value && fixes.value) untracked(() => afterPicture(() => { if (shown) showMarks(); }));
      }),
    ];
    return () => {
      for (const end of ends) end();
      for (const event of events) place.removeEventListener(event, catchUp, true);
      later.length = 0;
      view.destroy();
    };
  }, [home]);
  return (
    <section class="text" aria-label={texts.text}>
      <div class="row">
        <h2>{fileName(shownUri.value) || texts.text}</h2>
        {shownUri.value !== uri.value && <button class="small" onClick={() => openFile(shownUri.value)}>{texts.showTrees}</button>}
      </div>
      <div class="editor" ref={frame} />
    </section>
  );
}

function lastChange(changes: ChangeSet): number {
  let last = 0;
  changes.iterChangedRanges((_from, _to, _start, end) => { last = end; });
  return last;
}
