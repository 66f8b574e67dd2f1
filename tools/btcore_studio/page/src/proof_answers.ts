// Answers of a proof: their order, their number, and the questions in a text.

import type { ProofAnswer } from "./protocol";

const ORDER: readonly ProofAnswer["answer"][] = ["refuted", "possible", "unknown", "proved"];

/** Return the lines of a text that are not empty. */
export const linesOf = (text: string): string[] => text.split("\n").map((line) => line.trim()).filter(Boolean);

/** Return the answers: what is wrong comes first. */
export const inOrderOfConcern = (answers: readonly ProofAnswer[]): ProofAnswer[] =>
  ORDER.flatMap((wanted) => answers.filter(({ answer }) => answer === wanted));

/** Return the number of answers of each kind that occurs. */
export function summaryOf(answers: readonly ProofAnswer[]): Record<string, number> {
  const counts = ORDER.map((wanted) => [wanted, answers.filter(({ answer }) => answer === wanted).length] as const);
  return Object.fromEntries(counts.filter(([, count]) => count));
}
