// SPDX-License-Identifier: Apache-2.0
// Lines with points of their own, side by side over the points of all.

export type Column = (number | null | undefined)[];
export interface Points { x: ArrayLike<number>; values: ArrayLike<number | null>; min?: ArrayLike<number | null>; max?: ArrayLike<number | null>; base?: ArrayLike<number> }

/**
 * Of each line three columns: what is drawn, and the bounds of what is filled. Undefined: the line has no point there and
 * goes on; null: it has one that is not finite, and is broken.
 */
export function align(lines: readonly Points[]): { x: Float64Array; columns: Column[] } {
  const all = new Set<number>();
  for (const line of lines) for (let i = 0; i < line.x.length; i++) all.add(line.x[i]!);
  const x = Float64Array.from(all).sort();
  const place = new Map<number, number>();
  x.forEach((value, i) => place.set(value, i));
  const spread = (line: Points, values: ArrayLike<number | null> | undefined): Column => {
    const column: Column = new Array<undefined>(x.length).fill(undefined);
    if (!values) return column;
    for (let i = 0; i < line.x.length; i++) {
      const value = values[i];
      column[place.get(line.x[i]!)!] = value === null || value === undefined || !Number.isFinite(value) ? null : value;
    }
    return column;
  };
  return { x, columns: lines.flatMap((line) => {
    const { base } = line;
    const top = base ? Array.from(line.values, (value, i) => (value === null ? null : value + base[i]!)) : line.values;
    return [spread(line, top), spread(line, base ?? line.min), spread(line, base ? top : line.max)];
  }) };
}
