// One stack of undo for all documents. Undo restores the texts byte for byte; edits of others stay.

import type { ChangeSet } from "@codemirror/state";
import type { Change, Documents } from "./documents";

const JOIN_WITHIN_MS = 500;
const MAX_STEPS = 2000;

interface Step {
  /** The changes that undo the step, by document. */
  parts: Map<string, ChangeSet>;
  /** Whether more typing can join. */
  isTyping: boolean;
  time: number;
  /** What the user had selected before the step. */
  selection: readonly string[];
}

/** What an undone or repeated step has changed. */
export interface Done { uris: string[]; selection: readonly string[] }

export class History {
  private undone: Step[] = [];
  private done: Step[] = [];
  private collecting: Step | null = null;
  private selection: readonly string[] = [];

  /**
   * @param changed Called after each change of the stacks.
   * @param selected Returns what the user has selected.
   */
  constructor(
    private readonly documents: Documents,
    private readonly changed: () => void = () => {},
    private readonly selected: () => readonly string[] = () => [],
    private readonly now: () => number = () => performance.now(),
  ) {
    documents.listen((change) => this.note(change));
  }

  get canUndo(): boolean {
    return this.done.length > 0;
  }

  get canRedo(): boolean {
    return this.undone.length > 0;
  }

  /** Apply the changes of a command to all its documents, as one step. */
  apply(changes: ReadonlyMap<string, ChangeSet>): void {
    this.collecting = { parts: new Map(), isTyping: false, time: 0, selection: this.selected() };
    for (const [uri, part] of changes) this.documents.change(uri, part, "command");
    const step = this.collecting;
    this.collecting = null;
    if (step.parts.size) this.add(step);
  }

  /** Let the next typed character begin a step. */
  separate(): void {
    const last = this.done.at(-1);
    if (last) last.isTyping = false;
  }

  undo(): Done | null {
    return this.move(this.done, this.undone);
  }

  redo(): Done | null {
    return this.move(this.undone, this.done);
  }

  private move(from: Step[], to: Step[]): Done | null {
    const step = from.pop();
    if (!step) return null;
    const parts = new Map<string, ChangeSet>();
    for (const [uri, part] of step.parts) {
      parts.set(uri, part.invert(this.documents.text(uri)));
      this.documents.change(uri, part, "undo");
    }
    to.push({ parts, isTyping: false, time: 0, selection: this.selected() });
    this.changed();
    return { uris: [...parts.keys()], selection: step.selection };
  }

  private add(step: Step): void {
    this.done.push(step);
    if (this.done.length > MAX_STEPS) this.done.shift();
    this.undone = [];
    this.changed();
  }

  private note(change: Change): void {
    const { uri, changes, before, origin, userEvent } = change;
    if (origin === "remote") {
      this.done = rebased(this.done, uri, changes);
      this.undone = rebased(this.undone, uri, changes);
      this.changed();
    } else if (origin === "command" || origin === "typing") {
      const inverse = changes.invert(before);
      if (this.collecting) {
        const part = this.collecting.parts.get(uri);
        this.collecting.parts.set(uri, part ? inverse.compose(part) : inverse);
        return;
      }
      const isTyping = userEvent.startsWith("input.type") || userEvent.startsWith("delete");
      const [time, last] = [this.now(), this.done.at(-1)];
      const known = last?.parts.get(uri);
      if (isTyping && last?.isTyping && known && time - last.time < JOIN_WITHIN_MS && touches(changes, known)) {
        last.parts.set(uri, inverse.compose(known));
        last.time = time;
        this.undone = [];
        this.changed();
      } else this.add({ parts: new Map([[uri, inverse]]), isTyping, time, selection: this.selection });
    }
    this.selection = this.selected();
  }
}

/** Return whether both change the same place of the same text. */
function touches(changes: ChangeSet, others: ChangeSet): boolean {
  let found = false;
  changes.iterChangedRanges((from, to) => {
    others.iterChangedRanges((start, end) => {
      if (from <= end && to >= start) found = true;
    });
  });
  return found;
}

/** Return the steps, the last of which applies to the text after *remote*. */
function rebased(steps: Step[], uri: string, remote: ChangeSet): Step[] {
  const kept: Step[] = [];
  for (const step of steps.toReversed()) {
    const part = step.parts.get(uri);
    if (part) {
      const parts = new Map(step.parts);
      const mapped = part.map(remote);
      if (mapped.empty) parts.delete(uri);
      else parts.set(uri, mapped);
      remote = remote.map(part, true);
      if (parts.size) kept.push({ ...step, parts, isTyping: false });
    } else kept.push(step);
  }
  return kept.reverse();
}
