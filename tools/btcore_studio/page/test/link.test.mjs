// Links with files: what was put in comes out, and hostile fragments are refused.
import assert from "node:assert/strict";
import { mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import path from "node:path";
import { after, test } from "node:test";
import { fileURLToPath, pathToFileURL } from "node:url";
import { deflateRawSync } from "node:zlib";
import { build } from "esbuild";

const here = path.dirname(fileURLToPath(import.meta.url));
const folder = mkdtempSync(path.join(tmpdir(), "btcore-page-"));
after(() => rmSync(folder, { recursive: true }));
const outfile = path.join(folder, "link.mjs");
await build({ entryPoints: [path.join(here, "../src/site/link.ts")], bundle: true, platform: "node", format: "esm", outfile });
const { fragmentOf, linkedFiles, MAX_CONTENT, MAX_FRAGMENT } = await import(pathToFileURL(outfile).href);

const FILE = { name: "tree.xml", text: "<root>\r\n\u2028 ü 🤖 \r </root>\n", mark: true };
const packed = (data) => `#files=${deflateRawSync(Buffer.from(data)).toString("base64url")}`;
const of = (data) => packed(JSON.stringify(data));
const refused = (fragment, reason) => assert.rejects(linkedFiles(fragment), { name: "LinkError", reason });

test("a link keeps every character", async () => {
  const content = { files: [FILE, { name: "über uns.btproj", text: "\n", mark: false }], tree: "Main", recording: "{}\n\u2028" };
  const fragment = await fragmentOf(content);
  assert.match(fragment, /^#files=[\w-]+$/);
  assert.deepEqual(await linkedFiles(fragment), content);
  const bare = { files: [FILE], tree: null, recording: null };
  assert.deepEqual(await linkedFiles(await fragmentOf(bare)), bare);
});

test("another fragment is no link", async () => {
  for (const fragment of ["", "#", "#picture", "#file=AA"]) assert.equal(await linkedFiles(fragment), null);
});

test("damaged links are refused", async () => {
  const good = await fragmentOf({ files: [FILE], tree: null, recording: null });
  for (const fragment of ["#files=", "#files=%%%", "#files=AA", good.slice(0, -6), packed(Buffer.from([0xff, 0xfe])), packed("{"), `${good}!`]) {
    await refused(fragment, "invalid");
  }
});

test("files that the page must not have are refused", async () => {
  const file = { name: "tree.xml", text: "" };
  for (const data of [
    null, 3, [], {}, { files: [] }, { files: "tree.xml" }, { files: [null] }, { files: [{ name: "tree.xml" }] }, { files: [file, file] },
    { files: [file], tree: 3 }, { files: [file], recording: 3 }, { files: [file], recording: "\ud800" }, { files: [{ ...file, mark: 1 }] }, { files: Array.from({ length: 33 }, (_, number) => ({ ...file, name: `${number}.xml` })) },
    { files: [{ ...file, text: "\ud800" }] },
    ...["", ".xml", "tree.py", "../tree.xml", "a/tree.xml", "a\\tree.xml", "c:tree.xml", "\0.xml", "a\n.xml", "\u202elmx.xml", `${"a".repeat(100)}.xml`, 3]
      .map((name) => ({ files: [{ ...file, name }] })),
  ]) await refused(of(data), "invalid");
});

test("a bomb is ended when it has become too large", async () => {
  const bomb = packed(Buffer.alloc(200 << 20));
  assert.ok(bomb.length < MAX_FRAGMENT);
  const before = process.memoryUsage().rss;
  await refused(bomb, "large");
  assert.ok(process.memoryUsage().rss - before < 100 << 20);
  await refused(`#files=${"A".repeat(MAX_FRAGMENT)}`, "large");
});

test("what is too large for a link is not put into one", async () => {
  let seed = 1;
  const random = Array.from({ length: MAX_FRAGMENT }, () => String.fromCharCode(33 + (seed = (seed * 48271) % 2147483647) % 90)).join("");
  for (const text of [random, "a".repeat(MAX_CONTENT)]) {
    await assert.rejects(fragmentOf({ files: [FILE], tree: null, recording: text }), { name: "LinkError", reason: "large" });
    await assert.rejects(fragmentOf({ files: [{ ...FILE, text }], tree: null, recording: null }), { name: "LinkError", reason: "large" });
  }
});
