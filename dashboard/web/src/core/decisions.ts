// SPDX-License-Identifier: Apache-2.0
// Walking through the decisions of a rollout, of some of which nothing was kept.

type Kept = readonly { kept: boolean }[];

/** The decision to show: `wanted`, or where nothing was kept of it the next one, else the last before it; -1: none. */
export function decisionAt(decisions: Kept, wanted: number): number {
  const next = decisions.findIndex((one, k) => one.kept && k >= wanted);
  return next >= 0 ? next : decisions.map((one) => one.kept).lastIndexOf(true);
}

/** The one of which something was kept before (-1) or after (1) decision `at`; at either end `at` itself. */
export function decisionBeside(decisions: Kept, at: number, by: 1 | -1): number {
  for (let k = at + by; k >= 0 && k < decisions.length; k += by) if (decisions[k]!.kept) return k;
  return at;
}
