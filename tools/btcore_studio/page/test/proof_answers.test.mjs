// The answers of a proof: their order and their numbers, and the questions in a text.
import assert from "node:assert/strict";
import { mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import path from "node:path";
import { after, test } from "node:test";
import { fileURLToPath, pathToFileURL } from "node:url";
import { build } from "esbuild";

const folder = mkdtempSync(path.join(tmpdir(), "btcore-page-"));
after(() => rmSync(folder, { recursive: true }));
const outfile = path.join(folder, "proof_answers.mjs");
const source = path.join(path.dirname(fileURLToPath(import.meta.url)), "../src/proof_answers.ts");
await build({ entryPoints: [source], bundle: true, platform: "node", format: "esm", outfile });
const { inOrderOfConcern, linesOf, summaryOf } = await import(pathToFileURL(outfile).href);

const ANSWERS = ["proved", "unknown", "refuted", "proved", "possible"].map((answer, index) => ({ question: `q${index}`, answer }));

test("what is wrong comes first, in the order of the questions", () => {
  assert.deepEqual(inOrderOfConcern(ANSWERS).map(({ question }) => question), ["q2", "q4", "q1", "q0", "q3"]);
});

test("only answers that occur are counted", () => {
  assert.deepEqual(summaryOf(ANSWERS), { refuted: 1, possible: 1, unknown: 1, proved: 2 });
  assert.deepEqual(summaryOf([{ answer: "proved" }]), { proved: 1 });
});

test("each line is a question, except empty lines", () => {
  assert.deepEqual(linesOf(" never A \n\n\tB before C\r\n"), ["never A", "B before C"]);
});
