// Links whose fragment has files. A browser sends the fragment of an address to no server.

/** *mark* is whether the file begins with a byte order mark, which is not in *text*. */
export interface LinkedFile { name: string; text: string; mark: boolean }
/** The first file is shown, with a tree of it; null is its main tree. *recording* is the text of a recording, or null. */
export interface Linked { files: readonly LinkedFile[]; tree: string | null; recording: string | null }

const PREFIX = "#files=";
/** The maximum length of a fragment: browsers accept addresses of some 2,000,000 characters. */
export const MAX_FRAGMENT = 1_000_000;
/** The maximum number of bytes that a fragment may have when it is decompressed. */
export const MAX_CONTENT = 4 << 20;
export const MAX_FILES = 32;

/** Why a link cannot be made or opened. */
export class LinkError extends Error {
  constructor(readonly reason: "large" | "invalid") {
    super(reason);
    this.name = "LinkError";
  }
}

/** Return whether a file of the page may have this name: the name of a document in no folder. */
export const isFileName = (name: string): boolean =>
  name.length <= 100 && /^[^\p{C}/\\:*?"<>|.][^\p{C}/\\:*?"<>|]*\.(xml|btproj)$/u.test(name);

/** Return the fragment of a link, with its "#". */
export async function fragmentOf({ files, tree, recording }: Linked): Promise<string> {
  const json = JSON.stringify({
    files: files.map(({ name, text, mark }) => ({ name, text, ...(mark && { mark }) })), ...(tree !== null && { tree }), ...(recording !== null && { recording }),
  });
  const bytes = new TextEncoder().encode(json);
  if (bytes.length > MAX_CONTENT || files.length > MAX_FILES) throw new LinkError("large");
  const packed = await through(bytes, new CompressionStream("deflate-raw"), MAX_FRAGMENT);
  const fragment = PREFIX + base64(packed);
  if (fragment.length > MAX_FRAGMENT) throw new LinkError("large");
  return fragment;
}

/** Return what a fragment holds; null if it is not that of a link. */
export async function linkedFiles(fragment: string): Promise<Linked | null> {
  if (!fragment.startsWith(PREFIX)) return null;
  if (fragment.length > MAX_FRAGMENT) throw new LinkError("large");
  const packed = bytesOf(fragment.slice(PREFIX.length));
  const bytes = await through(packed, new DecompressionStream("deflate-raw"), MAX_CONTENT);
  try {
    const linked = checked(JSON.parse(new TextDecoder("utf-8", { fatal: true, ignoreBOM: true }).decode(bytes)));
    if (linked) return linked;
  } catch {
    // It is neither UTF-8 nor JSON.
  }
  throw new LinkError("invalid");
}

/** Return the JSON data of a link if it is valid, else null. */
function checked(data: unknown): Linked | null {
  const { files, tree = null, recording = null } = (data ?? {}) as { files?: unknown; tree?: unknown; recording?: unknown };
  if (!Array.isArray(files) || !files.length || files.length > MAX_FILES) return null;
  if (tree !== null && typeof tree !== "string") return null;
  if (recording !== null && !(typeof recording === "string" && recording.isWellFormed())) return null;
  const found = new Map<string, LinkedFile>();
  for (const item of files as unknown[]) {
    const { name, text, mark = false } = (item ?? {}) as { name?: unknown; text?: unknown; mark?: unknown };
    if (typeof name !== "string" || typeof text !== "string" || typeof mark !== "boolean") return null;
    if (!isFileName(name) || found.has(name) || !text.isWellFormed() || !name.isWellFormed()) return null;
    found.set(name, { name, text, mark });
  }
  return { files: [...found.values()], tree, recording };
}

/** Return the bytes that a stream makes of *bytes*. It is ended when it has made more than *most*. */
async function through(bytes: Uint8Array<ArrayBuffer>, stream: CompressionStream | DecompressionStream, most: number): Promise<Uint8Array> {
  const parts: Uint8Array<ArrayBuffer>[] = [];
  let length = 0;
  const reader = new Blob([bytes]).stream().pipeThrough(stream).getReader();
  for (;;) {
    const { value } = await reader.read().catch(() => { throw new LinkError("invalid"); });
    if (!value) break;
    parts.push(value);
    length += value.length;
    if (length > most) {
      void reader.cancel();
      throw new LinkError("large");
    }
  }
  return new Uint8Array(await new Blob(parts).arrayBuffer());
}

/** Encode in base64 with the alphabet of addresses, without padding. */
function base64(bytes: Uint8Array): string {
  let binary = "";
  for (let at = 0; at < bytes.length; at += 8192) binary += String.fromCharCode(...bytes.subarray(at, at + 8192));
  return btoa(binary).replaceAll("+", "-").replaceAll("/", "_").replace(/=+$/, "");
}

function bytesOf(text: string): Uint8Array<ArrayBuffer> {
  try {
    return Uint8Array.from(atob(text.replaceAll("-", "+").replaceAll("_", "/")), (character) => character.charCodeAt(0));
  } catch {
    throw new LinkError("invalid");
  }
}
