// Every English text of the picture, the palette, the form and the running tree.

import type { Target } from "./drop_targets";
import type { DrawnNode } from "./protocol";
import type { Structure } from "./tree";

const count = (number: number, noun: string) => `${number} ${noun}${number === 1 ? "" : "s"}`;

export const tree = {
  // the picture
  picture: "Picture of the tree",
  treeLabel: (id: string) => `Tree ${id}`,
  nodeLabel: ({ name, id, kind, calls }: DrawnNode, isDisabled: boolean) =>
    `${name}, ${kind}${name === id ? "" : ` ${id}`}${calls && calls !== name ? ` ${calls}` : ""}${isDisabled ? ", disabled" : ""}`,
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
    open: "Show the called tree alone",
    text: "Show in the text",
    fold: "Fold or unfold",
    unfold: "Unfold",
    breakpoint: "Set or remove a breakpoint",
    noBreakpoint: "Remove the breakpoint",
  },
  groups: { edit: "Edit", clipboard: "Clipboard", move: "Move", tree: "Trees", view: "View", page: "Page", select: "Select" },
  refusal: {
    readOnly: "The studio was started with --read-only.",
    noSelection: "Select a node first.",
    several: "Select a single node.",
    notConsecutive: "The selected nodes are not a row of siblings.",
    oneRoot: "A tree has exactly one root node. Wrap the root into a control node first.",
    root: "The root stays where it is. Wrap it, or change its children.",
    full: ({ name, id, children }: DrawnNode) =>
      `${name === id ? id : `${name} (${id})`} can have ${["no children", "only one child"][children[1] ?? 0] ?? `at most ${children[1]} children`}.`,
    format3: "Format 3 has no _skipIf, with which a node is disabled. Convert the file to format 4 first.",
    callUnwrap: "The nodes below are those of another tree. Replace the call by the tree's nodes instead.",
    noChildren: "The node has no children.",
    noCall: "The node calls no tree.",
    noPlace: "There is no place for another node here. Select its parent, or wrap a node.",
    first: "The node is the first child.",
    last: "The node is the last child.",
    top: "The parent is the root of the tree.",
    noParent: "No sibling beside can have another child.",
    notLive: "Running trees cannot be watched here.",
  },
  copied: (number: number) => `Copied ${count(number, "node")} as XML.`,
  clipboardRefused: "The browser does not allow access to the clipboard. Paste works in this page only.",
  nothingToPaste: "The clipboard contains no text.",
  nodeName: "Name",
  treeId: "ID of the new tree",

  // dragging
  dragged: (nodes: readonly DrawnNode[]) => nodes.length === 1 ? nodes[0]!.name : count(nodes.length, "node"),
  noTarget: "not here",
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
    { group: "select", keys: "Esc", text: "Select none, cancel a drag" },
    { group: "select", keys: "/", text: "Search nodes" },
    { group: "view", keys: "+ −", text: "Zoom" },
    { group: "view", keys: "0", text: "Show the whole tree" },
    { group: "view", keys: ", .", text: "One tick of a recording back, forward" },
    { group: "page", keys: "Enter", text: "Edit the attributes of the node" },
    { group: "page", keys: "Shift+F10", text: "Menu of the node" },
    { group: "page", keys: "Ctrl+Z", text: "Undo" },
    { group: "page", keys: "Ctrl+Shift+Z", text: "Redo" },
    { group: "page", keys: "Ctrl+S", text: "Save" },
    { group: "page", keys: "?", text: "This list" },
  ] as const,
  mouse: "Mouse: drag a node to another place, or with Ctrl a copy. Ctrl+click and Shift+click select several nodes, Shift+drag all "
    + "nodes in a rectangle. Touch: hold a node to drag it, or release it for the menu.",

  // the palette
  palette: "Palette",
  searchPalette: "Search node types",
  lastUsed: "Last used",
  results: (number: number) => count(number, "result"),
  paletteHint: "Drag a node into the picture, or click to insert it at the selected node.",

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
  notConnected: "not connected",
  address: "Address of the running tree",
  watchTitle: "Watch the running tree at this address",
  connect: "Connect",
  disconnect: "Disconnect",
  continue: "Continue",
  blackboard: "Blackboard",
  seconds: (seconds: number) => `${seconds.toFixed(seconds < 10 ? 2 : seconds < 100 ? 1 : 0)} s`,
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
