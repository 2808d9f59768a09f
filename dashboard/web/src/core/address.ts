// SPDX-License-Identifier: Apache-2.0
// What stands in an address, without a browser around it.

/** Parts of a path; one that is not UTF-8 stays as it is written. */
export function partsOf(pathname: string): string[] {
  return pathname.split('/').filter(Boolean).map((part) => {
    try {
      return decodeURIComponent(part);
    } catch {
      return part;
    }
  });
}

// what of an address is not about one source: the sources, and how whatever is looked at is drawn
const stays = ['dataset', 'run', 'eval', 'x', 'y', 'smooth'];

/** With another source: filters, ticks and what was selected were of the one before. */
export function withSource(query: URLSearchParams, name: string, id: string): URLSearchParams {
  const next = new URLSearchParams([...query].filter(([one]) => stays.includes(one)));
  next.set(name, id);
  return next;
}
