// SPDX-License-Identifier: Apache-2.0
// Numbers, durations and sizes as the pages write them. A missing value is an en dash, never a zero.

export type Maybe<T> = T | null | undefined;
export const none = '–';

export function finite(value: unknown): value is number {
  return typeof value === 'number' && Number.isFinite(value);
}

/** `digits` significant digits, thin for large numbers: 0.1532 → 0.153, 6589 → 6,589. */
export function number(value: Maybe<number>, digits = 3): string {
  if (!finite(value)) return none;
  const size = Math.abs(value);
  // also what rounding brings there: 999.7 has three digits as it is, and four when it is written
  if (size >= 10 ** digits || Number.isInteger(value) || Number(size.toPrecision(digits)) >= 10 ** digits) return Math.round(value).toLocaleString('en-US');
  if (size !== 0 && size < 0.001) return value.toExponential(Math.max(0, digits - 2)).replace('e-0', 'e-');
  return value.toPrecision(digits).replace(/(\.\d*?)0+$/, '$1').replace(/\.$/, '');
}

/** Places behind the point that a multiple of `step` needs. */
function placesOf(step: number): number {
  let places = 0;
  while (places < 9 && Math.abs(step * 10 ** places - Math.round(step * 10 ** places)) > 1e-6 * 10 ** places * step) places++;
  return places;
}

/** Labels of ticks that are evenly apart, in one unit and with what tells one from the next: 1.25M, 1.5M, 1.75M. */
export function axisLabels(ticks: readonly number[]): string[] {
  const largest = Math.max(...ticks.map(Math.abs));
  const gap = Math.min(...ticks.slice(1).map((value, i) => Math.abs(value - ticks[i]!)).filter((value) => value > 0));
  if (!finite(largest) || largest === 0 || !finite(gap)) return ticks.map((value) => number(value));
  const power = largest < 0.001 ? Math.floor(Math.log10(largest)) : 0;
  const [unit, suffix] = largest >= 1e6 ? [1e6, 'M'] : largest >= 1e4 ? [1e3, 'k'] : power ? [10 ** power, `e${power}`] : [1, ''];
  const places = placesOf(gap / unit);
  return ticks.map((value) => (Math.abs(value) < gap / 2 ? '0' : `${+(value / unit).toFixed(places)}${suffix}`));
}

/** With so many places, as the programs round: a tie goes to the even digit. */
export function rounded(value: number, places: number): string {
  const scaled = value * 10 ** places;
  const below = Math.floor(scaled);
  return scaled - below === 0.5 && below % 2 === 0 ? (below / 10 ** places).toFixed(places) : value.toFixed(places);
}

export function fixed(value: Maybe<number>, places: number): string {
  return finite(value) ? value.toLocaleString('en-US', { minimumFractionDigits: places, maximumFractionDigits: places }) : none;
}

export function count(value: Maybe<number>): string {
  return finite(value) ? Math.round(value).toLocaleString('en-US') : none;
}

/** A share in 0..1 as per cent with one place, none at 0 and 100. */
export function percent(share: Maybe<number>, places = 1): string {
  if (!finite(share)) return none;
  const value = share * 100;
  const text = rounded(value, places);
  return (Number.isInteger(+text) ? value.toFixed(0) : text) + ' %';
}

export function duration(seconds: Maybe<number>): string {
  if (!finite(seconds) || seconds < 0) return none;
  const whole = Math.round(seconds);
  const hours = Math.floor(whole / 3600);
  const minutes = Math.floor((whole % 3600) / 60);
  const rest = String(whole % 60).padStart(2, '0');
  return hours ? `${hours}:${String(minutes).padStart(2, '0')}:${rest}` : `${minutes}:${rest}`;
}

/** How long ago, short: 0.3 s, 14 s, 3 min, 5 h, 2 d. */
export function age(milliseconds: Maybe<number>): string {
  if (!finite(milliseconds)) return none;
  const seconds = Math.max(0, milliseconds / 1000);
  if (seconds < 10) return `${seconds.toFixed(1)} s`;
  if (seconds < 100) return `${Math.round(seconds)} s`;
  if (seconds < 5400) return `${Math.round(seconds / 60)} min`;
  if (seconds < 129600) return `${Math.round(seconds / 3600)} h`;
  return `${Math.round(seconds / 86400)} d`;
}

export function bytes(value: Maybe<number>): string {
  if (!finite(value)) return none;
  const units = ['B', 'kB', 'MB', 'GB', 'TB'];
  let size = value;
  let unit = 0;
  while (size >= 1000 && unit < units.length - 1) {
    size /= 1000;
    unit++;
  }
  return `${unit === 0 ? size : number(size)} ${units[unit]}`;
}

const dated = (date: Date, time: string) => `${date.toLocaleDateString('en-CA')} ${time}`;

/** Wall clock of an RFC 3339 time, an epoch in seconds or one in milliseconds; with the day where that is not today's. */
export function clock(of: Maybe<string | number>, seconds = true): string {
  const date = toDate(of);
  if (!date) return none;
  const time = date.toLocaleTimeString('en-GB', seconds ? {} : { hour: '2-digit', minute: '2-digit' });
  return date.toDateString() === new Date().toDateString() ? time : dated(date, time);
}

export function day(time: Maybe<string | number>): string {
  const date = toDate(time);
  return date ? dated(date, date.toLocaleTimeString('en-GB')) : none;
}

function toDate(time: Maybe<string | number>): Date | null {
  if (time === null || time === undefined || time === '') return null;
  const date = new Date(typeof time === 'number' && time < 1e11 ? time * 1000 : time);
  return Number.isNaN(date.getTime()) ? null : date;
}

export function short(hash: Maybe<string>, digits = 12): string {
  return hash ? hash.slice(0, digits) : none;
}

export function plural(n: number, word: string): string {
  return `${count(n)} ${word}${n === 1 ? '' : 's'}`;
}

/** p values as they are read: 0.69, 0.013, < 0.001. */
export function probability(p: Maybe<number>): string {
  if (!finite(p)) return none;
  return p < 0.001 ? '< 0.001' : p < 0.1 ? p.toFixed(3) : p.toFixed(2);
}
