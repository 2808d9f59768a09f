// SPDX-License-Identifier: Apache-2.0
// Parts of a picture, as an address has them and as the keyboard moves them.

/** u, v, width, height in px of the picture. */
export type Rectangle = [number, number, number, number];

const most = 8;

/** "100,80,12,12;..." as an address has it; what is no rectangle is left out. */
export function readRectangles(text: string): Rectangle[] {
  return text.split(';').map((one) => one.split(',').map(Number)).filter((one) => one.length === 4 && one.every(Number.isFinite) && one[2]! > 0 && one[3]! > 0).slice(-most) as Rectangle[];
}

export function writeRectangles(all: Rectangle[]): string {
  return all.slice(-most).map((one) => one.map(Math.round).join(',')).join(';');
}

const clamp = (value: number, low: number, high: number) => Math.max(low, Math.min(high, value));

/** The brush after a key; null: the key means nothing to it. */
export function moved([u, v, width, height]: Rectangle, key: string, size: boolean, whole: { width: number; height: number }): Rectangle | null {
  const way = ({ ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] } as Record<string, [number, number]>)[key];
  if (!way) return null;
  const by = 4;
  if (size) return [u, v, clamp(width + by * way[0], by, whole.width - u), clamp(height + by * way[1], by, whole.height - v)];
  return [clamp(u + by * way[0], 0, whole.width - width), clamp(v + by * way[1], 0, whole.height - height), width, height];
}
