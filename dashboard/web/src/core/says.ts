// SPDX-License-Identifier: Apache-2.0
// What a module says, in words and units, and how far that is from the truth or from another answer.
import { none, number } from './format';
import type { Insight, ModuleError, ModuleSays } from './types';

/** With all its digits. */
export function words(one: ModuleSays | undefined): string {
  if (!one || one.value === undefined) return none;
  const { value } = one;
  if (typeof value === 'string') return `${value}${one.probability !== undefined ? ` ${number(one.probability, 2)}` : ''}`;
  if (Array.isArray(value)) return `(${value.map((part) => number(part as number, 3)).join(', ')}) ${one.unit ?? ''}`;
  return JSON.stringify(value);
}

/** As a box of the drawing holds it: places in cm, of a pose the place alone. */
export function brief(one: ModuleSays | undefined): string {
  if (!one || one.value === undefined) return '';
  if (!Array.isArray(one.value)) return words(one);
  const cm = one.unit === 'm';
  return `(${one.value.slice(0, 3).map((part) => number((part as number) * (cm ? 100 : 1), 3)).join(', ')}) ${cm ? 'cm' : one.unit ?? ''}`;
}

export function distance(value: number, unit: string | undefined): string {
  return unit === 'm' ? `${number(100 * value, 2)} cm` : `${number(value, 2)} ${unit ?? ''}`;
}

/** What a module is off on average, in the unit people use for what it decodes; not known what that is: as it is written. */
export function meanError(of: { quantity: string | null; error: number | null }): string {
  if (of.error === null) return none;
  switch (of.quantity) {
    case null: return number(of.error, 2);
    case 'class': case 'task': return `${number(100 * of.error, 2)} % wrong`;
    case 'pixel': return `${number(of.error, 2)} px`;
    default: return `${number(100 * of.error, 2)} cm`;
  }
}

/** How far from the truth; '' where that is not known. */
export function errorText(error: ModuleError | undefined): string {
  if (!error) return '';
  if (typeof error.truth === 'string') return error.error === 0 ? 'right' : `wrong: ${error.truth}`;
  const turned = error.turned_rad === undefined ? '' : `, ${number((180 * error.turned_rad) / Math.PI, 2)}°`;
  return `${distance(error.error, error.unit)} off${turned}`;
}

export function truthText(error: ModuleError | undefined): string {
  return error ? words({ value: error.truth, unit: error.unit }) : none;
}

/** How far two answers of a module are apart. */
export function difference(a: ModuleSays | undefined, b: ModuleSays | undefined): string {
  if (!a || !b || a.value === undefined || b.value === undefined) return none;
  if (Array.isArray(a.value) && Array.isArray(b.value)) {
    const others = b.value as number[];
    return distance(Math.hypot(...(a.value as number[]).map((part, i) => part - (others[i] ?? 0))), a.unit);
  }
  return a.value === b.value ? 'same' : 'another';
}

/** Mean distance of waypoints, m; null: one of both is not there. */
export function apart(a: number[][], b: number[][]): number | null {
  const n = Math.min(a.length, b.length);
  if (!n) return null;
  const far = (one: number[], other: number[]) => Math.hypot(one[0]! - other[0]!, one[1]! - other[1]!, one[2]! - other[2]!);
  return a.slice(0, n).reduce((sum, one, k) => sum + far(one, b[k]!), 0) / n;
}

/** Of a module that decodes the waypoints, which stand beside what modules say. */
export function plan(of: Insight): { says: string; error: string; change: string } {
  const changed = apart(of.waypoints, of.what_if_waypoints);
  return {
    says: of.waypoints.length ? `${of.waypoints.length} waypoints` : none,
    error: of.truth.waypoints_error_m === null || !of.waypoints.length ? '' : `${distance(of.truth.waypoints_error_m, 'm')} off`,
    change: changed === null ? none : distance(changed, 'm'),
  };
}
