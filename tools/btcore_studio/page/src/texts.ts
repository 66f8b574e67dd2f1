// Every English text of the page.

import type { Target } from "./drop_targets";
import type { Change, Command, Difference, DrawnNode, Spot } from "./protocol";
import type { Structure } from "./tree";

/** The names of the statuses, by their numbers. */
export const statuses = ["IDLE", "RUNNING", "SUCCESS", "FAILURE", "SKIPPED"];

const count = (number: number, noun: string) => `${number} ${noun}${number === 1 ? "" : "s"}`;

export const texts = {
  title: "btcore studio",
  lost: "The studio's process does not answer. Start btcore studio again; your edits stay on this page.",
  readOnly: "The studio was started with --read-only: the files cannot be changed. Start it without this option to edit.",
  save: "Save",
  saved: (name: string) => `Saved ${name}.`,
  nothingToSave: "Nothing to save.",
  emptyFolder: "This folder has no trees.",
  showTrees: "Draw its trees",
  saveRefused: (reason: string) => `Not saved: ${reason}`,
  editRefused: (reason: string) => `The studio's process does not accept the edit: ${reason}`,
  unsaved: "unsaved",
  undone: "Undone.",
  redone: "Repeated.",
  undo: "Undo",
  redo: "Redo",
  nothingToUndo: "Nothing to undo.",
  nothingToRedo: "Nothing to redo.",
  tree: "Tree",
  theme: "Colours",
  themes: { system: "System colours", light: "Light", dark: "Dark" },
  export: "Export",
  exportAs: {
    svg: "Save the picture as an SVG file", png: "Save the picture as a PNG file",
    pdf: "Print the picture; the browser's printer “Save as PDF” writes a PDF file",
  },
  exported: (name: string) => `Saved the picture as ${name}.`,
  exportRefused: (reason: string) => `The picture was not saved: ${reason}`,
  tooLarge: "the picture is too large for a PNG file; save it as SVG",
  noPrinter: "VS Code does not print. Save it as SVG, or open the file with btcore studio in a browser.",
  panes: "Panes",
  paneNames: { left: "Nodes", right: "Form", text: "Text" },
  files: "Files",
  palette: "Palette",
  text: "Text",
  node: "Node",
  trees: "Trees",
  filesAndTrees: "Files and trees",
  filterFiles: "Filter files",
  newFile: "New file",
  fileName: "Name",
  newTree: "New tree",
  treeId: "ID",
  create: "Create",
  changeTree: (id: string) => `Change the tree ${id}`,
  makeMain: "Make it the main tree",
  remove: "Remove",
  mainTree: "main",
  calledBy: (callers: string[]) => `called by ${callers.join(", ")}`,
  notCalled: "not called",
  problems: "Problems",
  checking: "Checking …",
  noProblems: "No errors or warnings",
  problemSummary: (errors: number, warnings: number) => {
    const parts = [errors && count(errors, "error"), warnings && count(warnings, "warning")].filter(Boolean);
    return `${parts.join(", ") || texts.noProblems}.`;
  },
  newProblem: (isError: boolean, problem: string) => `New ${isError ? "error" : "warning"}: ${problem.replace(/[.!?]?$/, ".")}`,
  opened: (file: string, tree: string, nodes: number) =>
    `${file && `Opened ${file}. `}${tree ? `Tree ${tree}, ${count(nodes, "node")}.` : "The file has no tree."}`,
  errors: (number: number) => count(number, "error"),
  warnings: (number: number) => count(number, "warning"),
  gone: "This node is not in the text any more.",
  fixes: "Fixes of this line",
  noFixes: "There is no fix for this line.",
  wouldAdd: (isError: boolean, problem: string, more: number) =>
    `Adds ${isError ? "an error" : "a warning"}: ${problem}${more ? ` (and ${more} more)` : ""}`,
  moreProblems: (number: number) => `${count(number, "further problem")} not shown`,
  broken: (reason: string) => `The file has an error. The picture shows the part before it. ${reason}`,
  stale: (reason: string) => `The picture shows the last text that could be drawn. ${reason}`,
  rename: "Rename",
  renameTo: "New name",
  cancel: "Cancel",
  noDefinition: "No definition here.",
  nothingToRename: "Nothing to rename here.",
  breadcrumbs: "Calls",
  diskConflict: (name: string) => `${name} has changed on disk, in lines that are changed here, too.`,
  keepDisk: "Take the text on disk",
  keepPage: "Keep this text",
  sizes: { left: "Width of the left pane", right: "Width of the right pane", form: "Height of the form" },
  skip: "Skip to the picture",
  editorLabel: (name: string) => `Text of ${name}`,
};

/** The picture, the palette, the form and the running tree. */
export const treeTexts = {
  // the picture
  picture: "Picture of the tree",
  treeLabel: (id: string) => `Tree ${id}`,
  nodeLabel: ({ name, id, kind, calls }: DrawnNode, isDisabled: boolean, stop: string, isStopped: boolean) =>
    `${name}, ${kind}${name === id ? "" : ` ${id}`}${calls && calls !== name ? ` ${calls}` : ""}${isDisabled ? ", disabled" : ""}`
    + (isStopped ? ", the tree waits here" : "") + ({ set: ", breakpoint", pending: ", breakpoint, not set yet" }[stop] ?? ""),
  lastResult: (status: string) => `last result ${status}`,
  severity: { 1: "has an error", 2: "has a warning" },
  search: "Search nodes",
  noneFound: "none found",
  zoom: "Zoom",
  zoomIn: "Zoom in (+)",
  zoomOut: "Zoom out (−)",
  fit: "Fit",
  fitTitle: "Show the whole tree (0)",
  fold: "Fold",
  foldTitle: "Fold all subtrees",
  unfold: "Unfold",
  unfoldTitle: "Show all nodes",
  hideNodes: "Hide the nodes below",
  addChild: "Insert a node below",
  noTree: "This file has no tree yet.",
  createTree: "Create a tree",
  emptyTree: "This tree is empty. Drag a node from the palette to here, or press I.",
  insertRoot: "Insert the first node",

  // operations
  operation: {
    insert: "Insert a node",
    wrap: "Wrap into a node",
    unwrap: "Unwrap: replace by the children",
    type: "Change the type",
    rename: "Rename",
    toggle: "Disable or enable",
    disable: "Disable",
    enable: "Enable",
    duplicate: "Duplicate",
    copy: "Copy",
    cut: "Cut",
    paste: "Paste",
    remove: "Delete",
    earlier: "Move before the previous sibling",
    later: "Move after the next sibling",
    out: "Move out, after the parent",
    in: "Move into the sibling beside",
    extract: "Extract into a new tree",
    inline: "Replace the call by the tree's nodes",
    model: "New node type",
    open: "Show the called tree alone",
    text: "Show in the text",
    fold: "Fold or unfold",
    unfold: "Unfold",
    breakpoint: "Set or remove a breakpoint",
    release: "Continue the tree that waits at a breakpoint",
    noBreakpoint: "Remove the breakpoint",
  },
  groups: { edit: "Edit", clipboard: "Clipboard", move: "Move", tree: "Trees", view: "View", page: "Page", select: "Select", run: "Run", text: "Text" },
  refusal: {
    readOnly: "The studio was started with --read-only. Start it without this option to edit.",
    noSelection: "Select a node first.",
    several: "Select a single node.",
    extractSeveral: "A tree has one root node. Wrap the nodes into a control node first.",
    notConsecutive: "The selected nodes are not a row of siblings. Move them beside each other first.",
    oneRoot: "A tree has exactly one root node. Wrap the root into a control node first.",
    root: "The root stays where it is. Wrap it, or change its children.",
    full: ({ name, id, calls, children: [, most] }: DrawnNode) => {
      const label = name === id ? id : `${name} (${id})`;
      if (calls) return `${label} calls a tree. Open the tree, and add the node there.`;
      if (!most) return `${label} can have no children. Put the node beside it, or wrap it into a Sequence first.`;
      return most === 1 ? `${label} can have only one child. Wrap the child into a Sequence first, and add the node there.`
        : `${label} can have at most ${most} children. Wrap some of them into a Sequence first.`;
    },
    itself: "A node cannot be moved into itself.",
    noTarget: "Drop it between two children, or onto their parent.",
    format3: "Format 3 has no _skipIf, with which a node is disabled. Convert the file to format 4 first.",
    callUnwrap: "The nodes below are those of another tree. Replace the call by the tree's nodes instead.",
    leafUnwrap: "The node has no children. Delete it instead.",
    noChildren: "The node has no children.",
    noCall: "The node calls no tree. Select a SubTree node.",
    noPlace: "There is no place for another node here. Select its parent, or wrap a node.",
    first: "The node is the first child.",
    last: "The node is the last child.",
    top: "The parent is the root of the tree. Wrap the root into a control node first.",
    noParent: "No sibling beside can have another child. Wrap one of them into a Sequence first.",
    notStopped: "The tree does not wait at a breakpoint.",
    readOnlyRun: "This studio is read-only: it does not change a running tree.",
    noReply: "The robot has not replied yet what it allows.",
    notLive: "Running trees cannot be watched here.",
  },
  copied: (number: number) => `Copied ${count(number, "node")} as XML.`,
  placeOf: (position: number, siblings: number, parent: string) => `${position} of ${siblings} in ${parent}`,
  /** What a command has done; *place* is where the selected node is now. */
  edited: (command: Command, selected: number, place: string): string => {
    switch (command.kind) {
      case "add": return `Inserted ${command.id}${place && `, ${place}`}.`;
      case "paste": return `Pasted ${count(selected, "node")}${place && `, ${place}`}.`;
      case "move": return `Moved ${count(command.nodes.length, "node")}${place && `: ${place}`}.`;
      case "remove": return `Deleted ${count(command.nodes.length, "node")}.`;
      case "duplicate": return `Duplicated ${count(command.nodes.length, "node")}.`;
      case "wrap": return `Wrapped into ${command.id}.`;
      case "unwrap": return "Replaced the node by its children.";
      case "change_type": return `Changed the type to ${command.id}.`;
      case "set": return command.text === null ? `Removed ${command.name}.` : `Set ${command.name} to ${command.text}.`;
      case "disable": return `Disabled ${count(command.nodes.length, "node")}.`;
      case "enable": return `Enabled ${count(command.nodes.length, "node")}.`;
      case "extract": return `Extracted into the tree ${command.id}.`;
      case "inline": return "Replaced the call by the tree's nodes.";
      case "add_tree": return `Created the tree ${command.id}.`;
      case "remove_tree": return `Deleted the tree ${command.id}.`;
      case "set_main_tree": return `${command.id} is the main tree now.`;
      case "set_model": return "";
      case "remove_model": return `Deleted the node type ${command.id}.`;
    }
  },
  clipboardRefused: "The browser does not allow access to the clipboard. Paste works in this page only.",
  nothingToPaste: "The clipboard contains no text.",
  nodeName: "Name",
  treeId: "ID of the new tree",

  // dragging
  dragged: (nodes: readonly DrawnNode[]) => nodes.length === 1 ? nodes[0]!.name : count(nodes.length, "node"),
  target: (target: Target, structure: Structure) => {
    const name = (index: number) => structure.nodes[index]?.name ?? "";
    if (target.kind === "root") return "as the root";
    if (target.kind === "around") return `around ${name(target.node)}`;
    const children = structure.children[target.parent]!;
    if (target.kind === "inside") return children.length ? `into ${name(target.parent)}, as the last child` : `into ${name(target.parent)}`;
    const before = children[target.index - 1];
    return before === undefined ? `into ${name(target.parent)}, first` : `into ${name(target.parent)}, after ${name(before)}`;
  },

  // popups
  quick: { insert: "Insert a node", wrap: "Wrap into …", type: "Change the type to …" },
  nodeTypes: "Node types",
  where: "Place of the new node",
  wheres: { child: "as child", after: "after", before: "before", around: "as parent" },
  whereKeys: { child: "Alt+↓", after: "Alt+→", before: "Alt+←", around: "Alt+↑" },
  menu: "Operations",
  close: "Close",
  helpTitle: "Keys (?)",
  pageKeys: [
    { group: "select", keys: "← ↑ → ↓", text: "Select the node in this direction" },
    { group: "select", keys: "Shift+arrows", text: "Select further nodes" },
    { group: "select", keys: "Ctrl+A", text: "Select all" },
    { group: "select", keys: "Esc", text: "Select none, cancel a drag; then back to the calling tree" },
    { group: "select", keys: "Home End", text: "Select the first, the last node" },
    { group: "select", keys: "/", text: "Search nodes" },
    { group: "view", keys: "+ −", text: "Zoom" },
    { group: "view", keys: "0", text: "Show the whole tree" },
    { group: "view", keys: ", .", text: "One tick of a recording or a run back, forward" },
    { group: "run", keys: "R", text: "Run the tree with mock leaves, pause, go on" },
    { group: "run", keys: "S", text: "Step into the next node" },
    { group: "run", keys: "V", text: "Step over the node" },
    { group: "run", keys: "Shift+V", text: "Step out, to the end of the parent" },
    { group: "run", keys: "Y", text: "Why did the node do what it did?" },
    { group: "run", keys: "1 2 3", text: "The leaf that is asked succeeds, fails, is running" },
    { group: "page", keys: "Enter", text: "Edit the attributes of the node" },
    { group: "page", keys: "Shift+F10", text: "Menu of the node" },
    { group: "page", keys: "Tab", text: "In the list of node types: the place of the new node" },
    { group: "page", keys: "Ctrl+Z", text: "Undo" },
    { group: "page", keys: "Ctrl+Y", text: "Redo, as Ctrl+Shift+Z" },
    { group: "page", keys: "Ctrl+S", text: "Save" },
    { group: "page", keys: "F6", text: "Next pane; Shift+F6: the pane before" },
    { group: "page", keys: "? F1", text: "This list" },
    { group: "text", keys: "Tab", text: "Leave the text" },
    { group: "text", keys: "Ctrl+] [", text: "Indent more, less" },
    { group: "text", keys: "Ctrl+Space", text: "Complete" },
    { group: "text", keys: "F8", text: "Next problem" },
    { group: "text", keys: "Ctrl+.", text: "Fixes of the line" },
    { group: "text", keys: "F12", text: "Definition" },
    { group: "text", keys: "F2", text: "Rename in all files" },
  ] as const,
  marks: "A running tree: ▶ RUNNING, ✔ SUCCESS, ✘ FAILURE, ↷ SKIPPED; at an idle node, its last result. ‖: the tree waits at a breakpoint.",
  mouse: "Mouse: drag a node to another place, or with Ctrl a copy. Ctrl+click and Shift+click select several nodes, Shift+drag all "
    + "nodes in a rectangle. A double-click renames a node or shows a called tree. Touch: hold a node to drag it, or release it for the menu.",

  // the palette
  palette: "Palette",
  searchPalette: "Search node types",
  lastUsed: "Last used",
  results: (number: number) => count(number, "result"),
  paletteHint: "Drag a node into the picture, or click to insert it at the selected node.",

  // the form of a node type
  newModel: "New node type",
  newModelOf: (id: string) => `New node type ${id} …`,
  editModel: "Edit type",
  modelOf: (id: string) => `Node type ${id}`,
  modelHint: "The type is written into the <TreeNodesModel> of this file. It has no code until a library registers a node with this ID.",
  renamesType: (id: string) => `${id} gets this ID in all files.`,
  renamesPort: (name: string) => `The port ${name} gets this name in all files.`,
  removeModel: "Delete the type",
  modelWritten: (id: string) => `Wrote the node type ${id}.`,
  id: "ID",
  type: "Type",
  modelTypes: { Action: "action", Condition: "condition", Control: "control", Decorator: "decorator" },
  portColumns: { name: "Name", direction: "Direction", type: "Type", default: "Default", about: "Description" },
  portField: (column: string, number: number) => `${column} of port ${number}`,
  addPort: "Add a port",
  removePort: (name: string, number: number) => `Remove the port ${name || number}`,
  write: "Write",
  writeLeaf: "Write, with Python code",
  leafHint: "Python code is written into two new files: the node, and its test.",
  leafWritten: (name: string, test: string) => `Wrote ${name} and ${test}. To load the node, start the studio with --plugin ${name}; in VS Code, add it to the setting btcore.plugins.`,
  cancel: "Cancel",

  // the form
  node: "Node",
  selectNode: "Select a node to see and edit its attributes.",
  selectedNodes: (number: number) => `${number} nodes are selected.`,
  kinds: { action: "action", condition: "condition", control: "control", decorator: "decorator", subtree: "subtree", undefined: "unknown node" },
  disabled: "disabled",
  changeType: "Change type",
  openTree: "Open tree",
  ports: "Ports",
  conditions: "Conditions and scripts",
  other: "Other attributes",
  remapping: "Keys of the subtree",
  keyInside: (id: string) => `in ${id}`,
  keyOutside: "here",
  directions: { in: "input", out: "output", inout: "input and output" },
  required: "required",

  // the running tree
  absent: "not in the running tree",
  raised: "raised an error",
  runTitle: "Run this file",
  runHint: "Run this command in a terminal. The page then shows the running tree.",
  runHintConnect: "Run this command in a terminal, and press Connect. The page then shows the running tree.",
  runFolder: (folder: string) => `The folder is ${folder}. Without a robot, the nodes of btcore_robot drive a simulated one.`,
  commandCopied: "Copied the command.",
  guide: "Guide to the studio",
  notConnected: "not connected",
  address: "Address of the running tree",
  watchTitle: "Watch the running tree at this address",
  connect: "Connect",
  disconnect: "Disconnect",
  continue: "Continue",
  connected: (address: string) => `Connected to ${address}.`,
  disconnected: "Disconnected.",
  stoppedAt: (name: string) => `The tree waits at the breakpoint before ${name}. C continues it.`,
  continued: "The tree continues.",
  force: { SUCCESS: "✔ Succeed", FAILURE: "✘ Fail" },
  forceTitle: (name: string, status: string) => `${name} returns ${status} without being ticked, and the tree continues`,
  forced: (status: string) => `The node returns ${status}, and the tree continues.`,
  reload: "Reload",
  reloadTitle: "Replace the running tree by the text of this page, between two ticks. It keeps its blackboard.",
  reloading: "Waiting for the end of the tick …",
  reloaded: "The running tree has the text of this page.",
  notReloaded: (reason: string) => `The tree was not reloaded: ${reason}`,
  set: "Set",
  setValue: (key: string) => `Set ${key}`,
  valueOf: (key: string, value: string) => `${value}, set ${key}`,
  valueSet: (key: string) => `Set ${key}.`,
  blackboard: "Blackboard",
  seconds: (seconds: number) => `${seconds.toFixed(seconds < 10 ? 2 : seconds < 100 ? 1 : 0)} s`,
  shownCall: "Call",
  notRunning: (tree: string) => `The running tree does not call ${tree}. Show its main tree to see it run.`,
  missingNodes: (number: number) => number === 1
    ? "The file differs from the running tree: 1 of its nodes is not in this picture."
    : `The file differs from the running tree: ${number} of its nodes are not in this picture.`,

  // the recording
  recordingLacks: (warning: string) => `This recording: ${warning}.`,
  timeline: "Timeline of the recording",
  moment: "Moment of the recording",
  back: "One tick back",
  forth: "One tick forward",
  tick: (tick: number) => `Tick ${tick}`,
  halt: "Halt",
  beginning: "Start",
  runningTo: (position: number) => `running to step ${position} …`,
  notReplayed: (problem: string) => `The recording cannot be run again from here on: ${problem}`,
};

/** Runs with mock leaves. */
export const runTexts = {
  bar: "Run with mock leaves",
  start: "Run",
  startTitle: "Run the shown tree with mock leaves",
  stepInto: "Step",
  hint: "Runs this tree here, in simulated time. You decide what its leaves do.",
  noRun: "There is no run. Press R to start one.",
  cannotRun: "There is no tree that can be run here.",
  ended: "The run has ended.",
  paused: "Paused.",
  play: "Play or pause",
  speed: "Speed",
  steps: "Steps",
  back: "Back: a tick, or a step within the tick",
  tick: "To the end of the tick",
  step: {
    into: "Step into: to the next begin or end of a node",
    over: "Step over: to the end of this node",
    out: "Step out: to the end of the parent",
  },
  stepKeys: { into: "S", over: "V", out: "Shift+V" },
  moment: "Moment of the run",
  within: (tick: number) => `In tick ${tick}`,
  cut: "Continue from here",
  cutTitle: "Forget what follows this moment, so that leaves can answer otherwise",
  wasCut: "The run continues from this moment.",
  recording: "Recording",
  recordingTitle: "Save the run as a recording (.btrec.txt)",
  test: "Test",
  testTitle: "Save the run as a test for pytest, with its recording",
  saved: (names: readonly string[], isTest: boolean) =>
    `Saved ${names.join(" and ")}${isTest ? "; the test expects the file of the tree beside it" : ""}.`,
  stop: "End the run",
  edited: "The tree was edited since the run began.",
  again: "Run again with the same answers",
  asks: (name: string) => `${name} is ticked: what does it do? 1 success, 2 failure, 3 running.`,
  at: (name: string, tick: number) => `At ${name}, in tick ${tick}.`,
  after: (tick: number, root: number) => (tick ? `Tick ${tick}: ${statuses[root]}${root > 1 ? ". The tree has ended; the next tick starts it again" : ""}.` : "Before the first tick."),
  question: (name: string) => `What does ${name} do?`,
  elsewhere: (path: string) => `The leaf is not in this picture: ${path}`,
  results: { S: "Success", F: "Failure", R: "Running", K: "Skipped", X: "Exception" },
  more: "More results",
  always: "Answer so from now on",
  plan: (name: string) => `${name} in this run`,
  modes: { ask: "asks me", S: "always succeeds", F: "always fails", outcomes: "follows outcomes …", chance: "succeeds by chance …" },
  outcomes: "Outcomes",
  outcomesHint: "For each start a letter per tick: R running, S success, F failure, K skipped, X exception; | separates starts; S(port=value) writes an output.",
  chance: "Success in %",
  seed: "Seed",
  why: "Why?",
  whyTitle: "Explain why this node did what it did in the last tick (Y)",
  explanation: "Why",
  outside: "outside of the tree",
  closeWhy: "Close the explanation",
  noMoment: "Run the tree, or open a recording, to ask why.",
};

/** The world of the running tree. */
export const sceneTexts = {
  title: "World",
  label: "The robot and its world from above",
};

/** Runs with real leaves. */
export const realRunTexts = {
  bar: "Run with real leaves",
  start: "Run real leaves",
  startTitle: "Run the shown tree with its real leaves, in a process of its own",
  options: "Options of btcore run",
  example: "--world office:3 --people 2 --set key=value",
  hint: "The code of the leaves is executed. Without other options, the nodes of btcore_robot drive a simulated robot.",
  cancel: "Cancel",
  starting: "The run is starting.",
  running: "Running with real leaves",
  end: "End the run",
  endTitle: "Interrupt the run, as Ctrl-C does. A leaf that does not return is ended with the process after some seconds.",
  ending: "The run is ending.",
  ended: (code: number | null) =>
    (code === 0 ? "The run has ended." : code === 1 ? "The run has ended with FAILURE."
      : code === 130 ? "The run was interrupted." : code !== null && code < 0 ? `The process of the run was killed by signal ${-code}.`
        : `The run has ended with the exit code ${code}.`),
  output: "Output",
  open: "Show on the timeline",
  openTitle: "Show the recording of the run at any moment",
  opened: "The slider shows each moment of the run.",
  recording: "Recording of the run with real leaves",
  close: "Close",
  closeTitle: "Show the edited tree without the run",
};

/** Proofs, and the runs that they show. */
export const proofTexts = {
  open: "Prove",
  openTitle: "Ask questions about all possible runs of this tree",
  panel: "Proof",
  close: "Close the proof",
  about: "Leaves may return any result at any time. The standard questions are always asked.",
  questions: "Own questions, one per line",
  questionsHint: "never Drive & Turn\nDoorClosed leads to OpenDoor\nGrasp is SUCCESS before Lift",
  given: "Keys that the program sets",
  seconds: "Time limit (s)",
  ask: "Search all runs",
  stop: "Stop",
  searching: ({ searched, states, ticks }: { searched: number; states: number; ticks: number }) =>
    `${searched.toLocaleString("en")} of ${states.toLocaleString("en")} states searched, ${ticks.toLocaleString("en")} ticks run`,
  starting: "The search starts …",
  stopped: "The search was stopped.",
  outdated: "The tree was edited since: these answers are about the tree before.",
  answers: { proved: "proved", refuted: "refuted", possible: "possible", unknown: "unknown" },
  vacuous: "its premise never occurs",
  summary: (counts: Record<string, number>, tree: string) =>
    `${tree}: ${Object.entries(counts).map(([answer, count]) => `${count} ${answer}`).join(", ")}.`,
  searched: (states: number, ticks: number) => `${states.toLocaleString("en")} states, ${ticks.toLocaleString("en")} ticks run`,
  play: "Show the run",
  playTitle: (question: string) => `Show the counterexample of: ${question}`,
  counterexample: (question: string) => `Counterexample: ${question}`,
  cycle: (tick: number) => `From tick ${tick} on, the ticks repeat forever.`,
  shown: (count: number) => `The counterexample has ${count === 1 ? "one step" : `${count} steps`}. Step with , and . and press Y to ask why.`,
  shownRun: "Shown run",
  recordedRun: "Recording",
  closeRun: "Close this run",
  whatIf: "What if",
  whatIfEdited: "What if with the edited tree",
  whatIfEditedTitle: "Run the edited tree with what the leaves did in this run",
  editedRun: "What if with the edited tree:",
  changedRun: (change: string, tick: number) => `What if ${change} in tick ${tick}:`,
  whatIfHint: (tick: number) => `Run this run again with another input in tick ${tick}.`,
  leafResult: (name: string) => `Result of ${name}`,
  entry: "Entry of the main tree",
  value: "Value",
  runAgain: "Run again",
};

/** The page on a site of static files. */
export const siteTexts = {
  python: {
    starting: "Python is starting in this page. You can edit the text already; the picture and the problems follow.",
    ready: "Python is ready.",
    busy: "Python has not replied for some time. Your texts are kept if you start it again.",
    failed: "Python cannot start in this browser, so that trees are neither drawn nor checked. You can edit and save the text.",
  },
  restart: "Start Python again",
  notLoaded: "The script of the worker was not loaded.",
  ended: "Python was ended before it replied.",
  filesAndLinks: "Files and links",
  open: "Open",
  openTitle: "Open files of this computer",
  opened: (names: string) => `Opened ${names}.`,
  copyLink: "Copy link",
  copyLinkTitle: "Copy a link that contains the files of this page",
  copyRun: "Copy link with run",
  copyRunTitle: "Copy a link that contains the files of this page, and the run or recording that is shown",
  hasRecording: "The link contains the recording of a run, which comes from the author of the link.",
  showRecording: "Show the recording",
  linkCopied: "Copied a link that contains the files. No server receives them: they are in the part of the address after #.",
  linkShown: "The browser does not allow access to the clipboard. Copy the address of this page: it contains the files.",
  noLink: "The files are too large for a link. Save them, and send the files.",
  linkRefused: {
    large: "The files in the link are too large: they are not opened.",
    invalid: "The link is damaged: nothing is opened. Copy the whole link.",
  },
  fileType: "Behavior trees",
  cancelled: "cancelled",
  noFile: (uri: string) => `The page has no file ${uri}.`,
  nameRefused: (name: string) => `${name} is refused: the name of a file ends with .xml or .btproj, and has no folder.`,
  nameUsed: (name: string) => `There is a file ${name} already.`,
  recording: (name: string) => `${name} is a recording. This command shows it: btcore studio ${name}`,
  fileTooLarge: (name: string, most: number) => `${name} is too large: at most ${most} MB are permitted.`,
  notUtf8: (name: string) => `${name} is not UTF-8: convert it first.`,
};

/** Two versions of a file. */
export const comparisonTexts = {
  title: "Differences",
  sides: ["Old", "New"] as const,
  noFile: "no file",
  noTree: (id: string) => (id ? `This version has no tree ${id}.` : "This version has no tree."),
  changes: { added: "added", removed: "removed", moved: "moved", changed: "changed" },
  list: (changes: readonly Change[]): string => changes.map((change) => comparisonTexts.changes[change]).join(", "),
  picture: (side: string, tree: string) => `${side} version of the tree ${tree}`,
  tree: "Tree",
  treeOption: (id: string, number: number) => (number ? `${id} (${count(number, "difference")})` : id),
  outside: "Outside of the trees",
  equal: "The trees are equal. Comments, white space and the order of attributes are not compared.",
  previous: "Previous difference (P)",
  next: "Next difference (N)",
  position: (index: number, number: number, { name, id, changes }: Difference) =>
    `${index + 1}/${number} ${name || id}, ${comparisonTexts.list(changes)}`,
  nodes: (number: number) => count(number, "node"),
  type: "node type",
  notSet: "not set",
  child: ({ parent, number }: Spot) => `child ${number} of ${parent}`,
  further: (number: number) => `${count(number, "further difference")} not listed`,
  ended: "The comparison has ended: its process does not answer.",
};
