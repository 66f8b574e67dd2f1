// The requests of the studio beside those of the language server, and the data in them.
// Positions are those of the Language Server Protocol: lines and UTF-16 units, both from 0.

export interface Position { line: number; character: number }
export interface Range { start: Position; end: Position }
export interface TextEdit { range: Range; newText: string }
/** *versions* are those of the texts before the edit; only in VS Code, which applies it to later texts, too. */
export interface WorkspaceEdit { changes: Record<string, TextEdit[]>; versions?: Record<string, number> }
export interface Document { textDocument: { uri: string } }

/** An element of a document: *position* is where its start tag begins. */
export interface Place { uri: string; position: Position }

// --- textDocument/publishDiagnostics

export interface Problem {
  /** 1 error, 2 warning, 3 information, 4 hint. */
  severity?: 1 | 2 | 3 | 4;
  message: string;
  data?: {
    /** The attributes of the element that the problem is about. */
    attributes: readonly string[];
    /** The start and the end of the marked part of the attribute's value, in characters (Unicode); both 0: the whole value. */
    characters: readonly [start: number, end: number];
  };
}

export interface Diagnostic extends Problem {
  range: Range;
  code?: string | number;
}

// --- btcore/drawing: DrawingParams → Drawing

export interface DrawingParams extends Document {
  /** The ID of the tree; null for the main tree, or the first. */
  tree: string | null;
  /** The keys of the nodes whose children are hidden. */
  folded: string[];
  /** The key of the running SubTree node whose tree this is. The keys of the drawn nodes are then those of the nodes below it. */
  call: string;
  /** The number of the drawing that the page has: its nodes that have only moved are not sent again. */
  since?: number;
  /** Whether the SVG is the whole drawing, with its style sheet and the descriptions of the nodes, so that it can be saved. */
  styled?: boolean;
}

/** A node of the earlier drawing: its index, its index there, and what may have changed. A null edge is the same. */
export type MovedNode = [
  index: number, before: number, parent: number, line: number, character: number, endLine: number, endCharacter: number,
  x: number, y: number, edge: string | null,
];

export interface Drawing {
  tree: string;
  format: 3 | 4;
  number: number;
  /** The SVG without cards and edges, or with `styled` the whole. */
  svg: string;
  /** Where the coordinates of the cards begin in the SVG. */
  left: number;
  top: number;
  width: number;
  height: number;
  nodes: DrawnNode[];
  /** The nodes that are not in *nodes*; `complete` in picture.ts adds them. */
  moved: MovedNode[];
  /** The description of each node type in *nodes* by its ID. */
  about: Record<string, string>;
  trees: TreeSummary[];
  /** Why the document ends early in the drawing, or "". */
  broken: string;
  /** Only in VS Code: the versions of the drawn texts. It finds the places of a command in later texts by them. */
  versions?: Record<string, number>;
}

export interface DrawnNode {
  /** Identifies the node in drawings of later texts, too. */
  key: string;
  /** 1 + the index of the parent; 0 for the root. */
  parent: number;
  id: string;
  name: string;
  kind: "action" | "condition" | "control" | "decorator" | "subtree" | "undefined";
  /** The ID of the called tree, or "". */
  calls: string;
  ports: [name: string, text: string][];
  /** The element, and its range: that of the call's tree is in another document if it is included. */
  place: Place;
  end: Position;
  /** The number of hidden nodes below, if the node is folded. */
  hidden: number;
  leaf: boolean;
  disabled: boolean;
  /** How many children the node may have: [minimum, maximum]; null is no limit. */
  children: [number, number | null];
  /** The card, in units of the drawing. */
  x: number;
  y: number;
  width: number;
  height: number;
  /** The SVG of the card without its number; "" below a folded node. */
  card: string;
  /** The path from the parent, relative to (x, y); "" for the root. */
  edge: string;
}

export interface TreeSummary { id: string; place: Place; callers: string[]; isMain: boolean }

// --- btcore/palette: Document → Palette

export interface Palette { items: PaletteItem[] }

export interface PaletteItem {
  id: string;
  kind: DrawnNode["kind"];
  /** The library, model file or document from which the node is known; "BehaviorTree.CPP" for built-in nodes. */
  group: string;
  about: string;
  /** The SVG path of the symbol in the node's badge, around (0, 0) within a radius of 9 units. */
  symbol?: string;
  ports: PalettePort[];
  /** Whether the document has the model, or could have it: the node has no code, and no other model. */
  isEditable: boolean;
}

export interface PalettePort { name: string; direction: "in" | "out" | "inout"; type: string; default: string; about: string }

// --- btcore/node: Place → NodeForm

export interface NodeForm {
  id: string;
  name: string;
  kind: DrawnNode["kind"];
  about: string;
  fields: Field[];
  /** The IDs of node types that may replace the type of this node. */
  types: string[];
}

export interface Field {
  /** The attribute. */
  name: string;
  group: "name" | "port" | "condition" | "subtree" | "other";
  /** The attribute's text; null if it is not written. */
  text: string | null;
  direction: "in" | "out" | "inout" | "";
  type: string;
  default: string | null;
  isRequired: boolean;
  about: string;
  /** Keys in braces, members of enums, IDs of trees. */
  choices: string[];
  /** Whether the text is a script. */
  isScript: boolean;
}

// --- btcore/edit: EditParams → EditResult. An operation that cannot be applied is an error with the reason.
// Its data may have the *field* of a node type's form to which the reason belongs: "id", or "ports/0/name".

/** *drawing* is what to draw after the edit. */
export interface EditParams { command: Command; drawing?: DrawingParams; versions?: Drawing["versions"] }

export type Command =
  | { kind: "add"; parent: Place; index: number; id: string }
  | { kind: "paste"; parent: Place; index: number; xml: string }
  | { kind: "move"; nodes: Place[]; parent: Place; index: number }
  | { kind: "remove"; nodes: Place[] }
  | { kind: "duplicate"; nodes: Place[] }
  | { kind: "wrap"; nodes: Place[]; id: string }
  | { kind: "unwrap"; node: Place }
  | { kind: "change_type"; node: Place; id: string }
  | { kind: "set"; node: Place; name: string; text: string | null }
  | { kind: "disable"; nodes: Place[] }
  | { kind: "enable"; nodes: Place[] }
  | { kind: "extract"; node: Place; id: string }
  | { kind: "inline"; node: Place }
  | { kind: "add_tree"; uri: string; id: string }
  | { kind: "remove_tree"; uri: string; id: string }
  | { kind: "set_main_tree"; uri: string; id: string }
  /** *before* is the present ID of a node type that gets another ID in all files; *renamed* has new names of ports. */
  | {
    kind: "set_model"; uri: string; id: string; type: "Action" | "Condition" | "Control" | "Decorator" | "SubTree"; ports: PalettePort[];
    before?: string; renamed?: Record<string, string>;
  }
  | { kind: "remove_model"; uri: string; id: string };

export interface EditResult {
  edit: WorkspaceEdit;
  /** The elements to select, in the text after the edit. */
  select: Place[];
  /** What a pasted text misses, and new warnings; with a drawing, btcore/warnings returns them. */
  notes: string[];
  /** Null if it was not requested, or if the edit changes no document or others than the drawn one. */
  drawing: Drawing | null;
}

// --- btcore/warnings: {} → { messages: string[] }: the warnings that the last edit with a drawing has added.

// --- btcore/preview: EditParams → Preview: the problems that an operation would add.

export interface Preview { problems: Problem[] }

// --- btcore/leaf: Document & { id } → Leaf: the Python code of a node without code, and its test.

export interface Leaf { name: string; text: string; testName: string; test: string }

// --- btcore/copy: { nodes: Place[] } → { xml }: the elements, with the models that they need.

// --- btcore/watch { address } ("" ends it), btcore/breakpoints { keys }, btcore/release { status: "" | "SUCCESS" | "FAILURE" }: → null.
// btcore/setEntry { path, key, value }, btcore/reload Document: → null, or the reason of a refusal.
// The notification btcore/live has the state of the running tree; *keys* and *calls* only if the nodes have changed.

/** A SubTree node of a running tree. The *size* nodes after it are below it. *path* has the names of the calls down to it. */
export interface RunningCall { key: string; tree: string; path: string; size: number }

export interface Live {
  address: string;
  connection: "" | "waiting" | "connected" | "lost" | "ended";
  detail: string;
  problem: string;
  /** A digit for each node of the running tree: 0 idle, 1 running, 2 success, 3 failure, 4 skipped. */
  statuses: string;
  /** The same, for the last status other than idle and running. */
  results: string;
  entries: [path: string, key: string, value: string][];
  wanted: string[];
  breakpoints: string[];
  stopped: string;
  /** The key of the node that raised the last error, or "". */
  raised?: string;
  /** Why something is not possible, or "". Empty until the robot has replied. */
  refusals?: { breakpoints?: string; force?: string; values?: string; reload?: string };
  keys?: string[];
  calls?: RunningCall[];
  /** The robot and its world from above; sent only if something has moved. */
  scene?: Scene | null;
}

/** Lengths are in m, angles in rad. */
export interface Scene {
  /** The lowest first. The corners are x, y, … */
  bodies: [color: [red: number, green: number, blue: number, opacity: number], corners: number[]][];
  places: [name: string, x: number, y: number][];
  /** The kind is path, cloud, goal, estimate or odometry; the poses are x, y, yaw, … */
  poses: [kind: string, poses: number[]][];
  /** The x, y, … of the echoes of the laser. */
  scan: number[];
}

// --- btcore/moment { position, run } → Moment, of a ShownRun, or of the recording that the studio shows (0; see Start.recording).

export interface Recording {
  /** The number of a ShownRun. */
  run?: number;
  /** The keys of the nodes, in the order of *statuses* in each moment. */
  keys: string[];
  calls: RunningCall[];
  /** The number of steps, and the position to show at first. */
  count: number;
  start: number;
  /** The status of the root over time: a digit for every *width* steps. */
  colours: string;
  width: number;
  warnings: string[];
}

export interface Moment {
  position: number;
  /** 0 for a halt, and before the first step. */
  tick: number;
  /** Seconds since the recording began. */
  time: number;
  root: number;
  statuses: string;
  results: string;
  entries: [path: string, key: string, value: string][];
  /** The leaves that were ticked in the step, by key. */
  leaves: Record<string, {
    status: number; inputs: Record<string, string>; outputs: Record<string, string>; error: string;
  }>;
  problem: string;
}

// --- btcore/run RunParams → RunState: start a run of a tree with mock leaves. Each further request has the number of the run:
// btcore/runStep RunStep, btcore/runAnswer { result, outputs }, btcore/runMoment { position, event, cut } → RunState;
// btcore/runLeaf { key, plan: LeafPlan } → null; btcore/runFiles { test, tree } → { files: RunFile[] }; btcore/endRun → null.

/** How a leaf answers: it follows outcomes such as RRS|F, or a chance; otherwise the user is asked. */
export interface LeafPlan { outcomes?: string; chance?: number | null; seed?: number }

export interface RunParams extends Document {
  tree: string | null;
  plans: Record<string, LeafPlan>;
  /** The number of the run whose answers are given again; 0 for none. */
  again: number;
}

/** *breakpoints* are the keys of nodes at whose begin the run stops. */
export interface RunStep { to: "tick" | "into" | "over" | "out"; ticks: number; breakpoints: string[] }

/** What a leaf does: SUCCESS, FAILURE, RUNNING, SKIPPED, or it raises an exception. */
export type RunResult = "S" | "F" | "R" | "K" | "X";

export interface RunQuestion {
  key: string;
  path: string;
  inputs: Record<string, string>;
  outputs: { name: string; type: string; key: string }[];
  canRun: boolean;
}

export interface RunState {
  run: number;
  count: number;
  colours: string;
  width: number;
  moment: Moment;
  /** The number of begins and ends of nodes in the step after the moment; 0 between two steps. */
  event: number;
  /** The key of the node that has begun or ended last in the step, or "". */
  stopped: string;
  question: RunQuestion | null;
  problem: string;
  /** Only in the reply to btcore/run. */
  keys: string[] | null;
  calls: RunningCall[] | null;
  leaves: Record<string, LeafPlan> | null;
}

export interface RunFile { name: string; text: string }

// --- btcore/startRealRun { textDocument, tree, options } → null: run the text with its real leaves, in a process to which the page
// is connected (btcore/live). The notification btcore/realRun has a RealRun. btcore/endRealRun → null, when the process has ended;
// btcore/openRecording → ShownRun: its recording.

export interface RealRun {
  address: string;
  running: boolean;
  /** The exit code, or minus the number of the signal that has killed the process; null while it runs. */
  code: number | null;
  /** The end of what the process has printed. */
  output: string;
  /** Whether the run has ended and has a recording. */
  recorded: boolean;
}

// --- btcore/prove ProofParams → ProofResult: search all runs of a tree. The notification btcore/proofProgress ProofProgress
// comes from time to time. btcore/stopProof {} → null ends the search, whose request fails then.
// btcore/counterexample { proof, answer } → ShownRun: the run of the answer with an index.

export interface ProofParams extends Document {
  tree: string | null;
  /** In addition to the standard questions, such as "never A", "A leads to B" and "A before B". */
  questions: string[];
  /** The keys that the program sets before the first tick. */
  given: string[];
  seconds: number;
}

export interface ProofProgress { searched: number; states: number; ticks: number }

export interface ProofAnswer {
  question: string;
  answer: "proved" | "refuted" | "possible" | "unknown";
  /** What is wrong, what bounded the search, or under which condition the question is proved; "". */
  detail: string;
  /** Whether the premise of the question never occurs. */
  vacuous: boolean;
  ticks: number;
  states: number;
  /** Whether there is a counterexample to show. */
  playable: boolean;
  /** The number of the tick from which on the counterexample repeats its ticks forever; 0 for none. */
  cycle: number;
}

export interface ProofResult { proof: number; answers: ProofAnswer[]; ticks: number }

/** btcore/whatIf: WhatIf → ShownRun: a run of the page, or the recording (0), again with changes. */
export interface WhatIf {
  run: number;
  /** The document with the tree to run; null for the tree of the run. */
  textDocument: { uri: string } | null;
  /** Other results of leaves, by key. */
  results: { tick: number; key: string; result: "S" | "F" | "R" | "K" }[];
  /** Entries of the main tree that are written before a tick. */
  entries: { tick: number; key: string; value: string }[];
}

/** A run on the timeline; *report* is what a run with changes did. btcore/runFiles returns its files, too. */
export interface ShownRun extends Recording { run: number; report: string[] }

// --- btcore/why { key, position, run } → Why: why a node did what it did in the last tick before *position* steps of the
// run with a number, or of the recording (0).

/** The node with the key "" is outside of the tree; *tried* is what another result changes in a replay, or "". */
export interface Why { question: string; answer: string; links: { key: string; tick: number; because: string; tried: string }[] }

// --- btcore/comparison { tree } → Comparison; only if the studio compares two versions of a file (see Start.versions).
// The notification btcore/compared: one of the files has changed.

export type Change = "added" | "removed" | "moved" | "changed";

export interface Comparison {
  /** The IDs of the trees that can be shown. */
  trees: string[];
  tree: string;
  /** The drawings; null if a version has not the tree. */
  old: Drawing | null;
  new: Drawing | null;
  /** For each version, why its text is not XML, or "". */
  broken: [string, string];
  /** The indices of each node that both drawings show. */
  pairs: [old: number, new: number][];
  differences: Difference[];
}

export interface Difference {
  changes: Change[];
  /** The tree in which the difference is; "" for the rest of the document. */
  tree: string;
  id: string;
  name: string;
  /** The number of added or removed nodes: the node itself and those below it. */
  count: number;
  /** The name "" is the ID of the node itself. */
  attributes: [name: string, old: string | null, new: string | null][];
  /** If the node was moved, its places. Numbers of children begin with 1. */
  spots: [Spot, Spot] | null;
  /** The indices of the nodes in the drawings. */
  old: number[];
  new: number[];
}

export interface Spot { parent: string; number: number }

// --- only in the browser: the shared files of all pages -------------------------------------------------------
// The page's address is http://127.0.0.1:PORT/TOKEN/, with studio.js and studio.css beside it. "socket" beside it
// is the WebSocket; each of its text messages is one message of JSON-RPC.

/** btcore/start: {} → Start. */
export interface Start {
  folder: string;
  /** The address of the studio's guide, if it is known. */
  guide?: string | null;
  /** The document to show, and its tree. */
  uri: string;
  tree: string | null;
  readOnly: boolean;
  /** Whether running trees can be watched. */
  live: boolean;
  /** Whether trees can be run with their real leaves. */
  trusted?: boolean;
  /** The address that is proposed. */
  address?: string;
  recording: Recording | null;
  /** If two versions of a file are compared: their names; "" if there is no file. Then there is no document. */
  versions?: [old: string, new: string] | null;
}

/** btcore/files: {} → SharedFile[]; the notification btcore/files has the same list, after a change. */
export interface SharedFile { uri: string; name: string; unsaved: boolean }

/** btcore/read: { uri } → SharedText. The page sends textDocument/didOpen itself. */
export interface SharedText { text: string; version: number; unsaved: boolean }

/**
 * btcore/push: Pushed → { version }: the edits of a page, whose text has *version*. Fails with the code -32801
 * (ContentModified) if another page or the disk was faster: the page receives btcore/pushed, rebases and repeats.
 * The notification btcore/pushed has the edits of others.
 */
export interface Pushed { uri: string; version: number; edits: TextEdit[] }

/** btcore/save: { uri } → whether the text was written, or fails with a reason. btcore/create: { name, text } → { uri }. */
/** The notification btcore/disk: a file changed on disk while it had unsaved changes that overlap. */
export interface DiskConflict { uri: string; text: string }
/** btcore/resolve: { uri, keep: "disk" | "page" } → null. */
