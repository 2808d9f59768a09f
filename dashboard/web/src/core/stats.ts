// SPDX-License-Identifier: Apache-2.0
// The few statistics that a page computes itself, from figures that it was given.

export interface Summary { n: number; missing: number; min: number; max: number; last: number }

/** Of the finite values; `missing` counts the others. */
export function summarize(values: ArrayLike<number | null | undefined>): Summary {
  const result = { n: 0, missing: 0, min: NaN, max: NaN, last: NaN };
  for (let i = 0; i < values.length; i++) {
    const value = values[i];
    if (value === undefined) continue;
    if (value === null || !Number.isFinite(value)) {
      result.missing++;
      continue;
    }
    result.n++;
    if (!(value >= result.min)) result.min = value;
    if (!(value <= result.max)) result.max = value;
    result.last = value;
  }
  return result;
}

/** A rate in two parts by a share of it that is known at the same x; points that only one of them has are left out. */
export function split(rate: { x: ArrayLike<number>; last: ArrayLike<number> }, share: { x: ArrayLike<number>; last: ArrayLike<number> }): { x: number[]; part: number[]; rest: number[] } {
  const known = new Map(Array.from(share.x, (x, i) => [x, share.last[i]!]));
  const x = Array.from(rate.x).filter((one) => known.has(one));
  const all = new Map(Array.from(rate.x, (one, i) => [one, rate.last[i]!]));
  const part = x.map((one) => all.get(one)! * Math.min(1, Math.max(0, known.get(one)!)));
  return { x, part, rest: x.map((one, i) => all.get(one)! - part[i]!) };
}

/** Exponential smoothing weighted by the distance in x, so that denser logging does not smooth less. `width` is in units of x. */
export function smooth(x: ArrayLike<number>, y: ArrayLike<number | null>, width: number): (number | null)[] {
  const result: (number | null)[] = [];
  let weight = 0;
  let sum = 0;
  let before = 0;
  for (let i = 0; i < y.length; i++) {
    const value = y[i];
    const at = x[i] ?? 0;
    if (value === null || value === undefined || !Number.isFinite(value)) {
      result.push(null);
      continue;
    }
    const keep = Math.exp(-(at - before) / width);
    sum = sum * keep + value;
    weight = weight * keep + 1;
    before = at;
    result.push(sum / weight);
  }
  return result;
}

/** First multiple of a tenth below the lowest bound: where an axis of proportions begins. */
export function axisStart(lows: number[]): number {
  const lowest = Math.min(1, ...lows);
  return Math.max(0, Math.min(0.9, Math.ceil(lowest * 10 - 1 - 1e-9) / 10));
}
