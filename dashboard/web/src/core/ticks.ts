// SPDX-License-Identifier: Apache-2.0
// Episodes that somebody ticked. They live in the address, as spans: ticks=0-3,7.

/** More would make an address that browsers and proxies cut; a filter key holds any number. */
export const mostTicks = 200;

/** What is no number, and what is beyond the most, is left out. */
export function readTicks(text: string): Set<number> {
  const ticks = new Set<number>();
  for (const span of text.split(',')) {
    const found = /^(\d{1,15})(?:-(\d{1,15}))?$/.exec(span);
    if (!found) continue;
    const first = Number(found[1]);
    const last = Number(found[2] ?? found[1]);
    for (let i = first; i <= last && ticks.size < mostTicks; i++) ticks.add(i);
  }
  return ticks;
}

export function writeTicks(ticks: Iterable<number>): string {
  const sorted = [...new Set(ticks)].sort((a, b) => a - b);
  const spans: string[] = [];
  for (let i = 0; i < sorted.length; i++) {
    const first = sorted[i]!;
    while (sorted[i + 1] === sorted[i]! + 1) i++;
    spans.push(first === sorted[i] ? `${first}` : `${first}-${sorted[i]}`);
  }
  return spans.join(',');
}
