// The node types that were inserted last, kept by the browser.

import { signal } from "@preact/signals";
import { store, stored } from "./storage";

const KEY = "btcore.lastUsed";
const MAX_ITEMS = 8;

function read(): string[] {
  try {
    const value: unknown = JSON.parse(stored(KEY) ?? "[]");
    return Array.isArray(value) ? value.filter((id): id is string => typeof id === "string").slice(0, MAX_ITEMS) : [];
  } catch {
    return [];
  }
}

export const lastUsed = signal<readonly string[]>(read());

export function noteUse(id: string): void {
  lastUsed.value = [id, ...lastUsed.value.filter((other) => other !== id)].slice(0, MAX_ITEMS);
  store(KEY, JSON.stringify(lastUsed.value));
}
