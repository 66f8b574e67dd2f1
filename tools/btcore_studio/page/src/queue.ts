// Steps that run one after the other.

/** Return a function that runs a step when all earlier steps have ended; at once, if they have. */
export function createQueue(): <T>(step: () => Promise<T>) => Promise<T> {
  let last: Promise<void> | null = null;
  return (step) => {
    const done = last ? last.then(step) : step();
    const ended: Promise<void> = done.then(() => {}, () => {}).then(() => { if (last === ended) last = null; });
    last = ended;
    return done;
  };
}
