// SPDX-License-Identifier: Apache-2.0
// What this browser keeps from one visit to the next; one that keeps nothing for pages throws where it is asked.

/** Null: nothing. */
export function kept(slot: string): string | null {
  try {
    return window.localStorage.getItem(slot);
  } catch {
    return null;
  }
}

/** Null: nothing is kept. */
export function keep(slot: string, value: string | null): void {
  try {
    if (value === null) window.localStorage.removeItem(slot);
    else window.localStorage.setItem(slot, value);
  } catch { /* it holds for this page */ }
}
