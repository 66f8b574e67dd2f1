// The settings that the user's browser keeps.

/** Return a setting; null if it is not set, or if the browser may not keep settings. */
export function stored(name: string): string | null {
  try {
    return localStorage.getItem(name);
  } catch {
    return null;
  }
}

export function store(name: string, value: string): void {
  try {
    localStorage.setItem(name, value);
  } catch {
    // The setting ends with the page.
  }
}
