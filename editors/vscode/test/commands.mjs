// Random commands of the page, for a drawing.

/** Return a generator of numbers in [0, 1) that is the same each time (mulberry32). */
export function random(seed) {
  return () => {
    seed = (seed + 0x6d2b79f5) | 0;
    let t = Math.imul(seed ^ (seed >>> 15), 1 | seed);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 2 ** 32;
  };
}

let last = 0;

/** What makes a command of each kind; null if the drawing has no place for it. */
const MAKERS = {
  add: ({ parent }) => parent && { parent: parent.place, index: 0, id: "AlwaysSuccess" },
  paste: ({ parent }) => parent && { parent: parent.place, index: 0, xml: '<Fallback name="ä 🍳"><AlwaysFailure/></Fallback>' },
  move: ({ node, parent }) => node && parent && { nodes: [node.place], parent: parent.place, index: 0 },
  remove: ({ node }) => node && { nodes: [node.place] },
  duplicate: ({ node }) => node && { nodes: [node.place] },
  wrap: ({ node }) => node && { nodes: [node.place], id: "Inverter" },
  unwrap: ({ parent }) => parent && { node: parent.place },
  change_type: ({ parent }) => parent && { node: parent.place, id: "Fallback" },
  set: ({ node }) => node && { node: node.place, name: "name", text: `<"&ä🍳' ${++last}` },
  disable: ({ node }) => node && { nodes: [node.place] },
  enable: ({ disabled }) => disabled && { nodes: [disabled.place] },
  extract: ({ node }) => node && { node: node.place, id: `Extracted${++last}` },
  inline: ({ call }) => call && { node: call.place },
  add_tree: ({ uri }) => ({ uri, id: `Added${++last}` }),
  remove_tree: ({ uri, tree }) => tree && { uri, id: tree },
  set_main_tree: ({ uri, tree }) => tree && { uri, id: tree },
  set_model: ({ uri }) => ({
    uri, id: `Model${++last}`, type: "Action", ports: [{ name: "goal", direction: "in", type: "int", default: "1", about: "Where." }],
  }),
};

export const KINDS = Object.keys(MAKERS);

/** Return a command of a kind, or null. */
export function command(kind, uri, { nodes, trees }, next) {
  const choose = (items) => items[Math.floor(next() * items.length)];
  const chosen = {
    uri,
    node: choose(nodes),
    parent: choose(nodes.filter(({ children: [, most], calls }) => !calls && most !== 0)),
    call: choose(nodes.filter(({ calls }) => calls)),
    disabled: choose(nodes.filter((node) => node.disabled)),
    tree: choose(trees)?.id,
  };
  const made = MAKERS[kind](chosen);
  return made ? { kind, ...made } : null;
}
