/** The address of the running tree, in the toolbar. */
export function LiveControls() {
  return null;
}

/** The entries of the running tree's blackboard. */
export function Blackboard() {
  return null;
}
