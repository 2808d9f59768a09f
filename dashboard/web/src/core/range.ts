// SPDX-License-Identifier: Apache-2.0
// A part of an axis, as the address has it: 100..250.

export type Range = [number, number];

/** Null where it is none: the whole axis then. */
export function readRange(text: string): Range | null {
  const parts = text.split('..');
  const [from, to] = parts.map((part) => (part.trim() ? Number(part) : NaN)) as [number, number];
  return parts.length === 2 && Number.isFinite(from) && Number.isFinite(to) && from < to ? [from, to] : null;
}

/** To a thousandth of its width, however narrow. */
export function writeRange([from, to]: Range): string {
  const places = Math.min(12, Math.max(0, 3 - Math.floor(Math.log10(to - from))));
  return [from, to].map((value) => String(Number(value.toFixed(places)))).join('..');
}

/**
 * What a key makes of the range that is shown (null: the whole axis), about `at`; undefined: nothing. Out of a range that
 * shows no points the way back stays open, and there is none further in. Beyond what is drawn there may be more.
 */
export function zoomedBy(key: string, range: Range | null, x: ArrayLike<number>, at: number | null): Range | null | undefined {
  if (key === '0' || (key === '-' && !range)) return null;
  if (key === '-') return zoomed(range!, [Math.min(0, range![0]), Infinity], at ?? (range![0] + range![1]) / 2, 2);
  if (key !== '+' && key !== '=') return undefined;
  const shown = Array.from(x).filter((one) => !range || (one >= range[0] && one <= range[1]));
  if (shown.length < 2) return undefined;
  const drawn = range ?? ([shown[0], shown[shown.length - 1]] as Range);
  return zoomed(drawn, drawn, at ?? (drawn[0] + drawn[1]) / 2, 0.5);
}

/** `factor` times as wide about `at`, within `whole`; null: that is all of it. */
export function zoomed(range: Range, whole: Range, at: number, factor: number): Range | null {
  const width = (range[1] - range[0]) * factor;
  if (width >= whole[1] - whole[0]) return null;
  const from = at - (at - range[0]) * factor;
  const begin = Math.max(whole[0], Math.min(whole[1] - width, from));
  return [begin, begin + width];
}
