// SPDX-License-Identifier: Apache-2.0
// How the address names a page of a listing.

/** FNV-1a: tells listings apart, no more. */
function hash(text: string): string {
  let value = 0x811c9dc5;
  for (let i = 0; i < text.length; i++) value = Math.imul(value ^ text.charCodeAt(i), 0x01000193);
  return (value >>> 0).toString(36);
}

/** How many pages are before it, of which listing it is, and where it begins. */
export function writePage(of: string, depth: number, cursor: string): string {
  return `${depth}-${hash(of)}-${cursor}`;
}

/** Null where the page is of another listing than `of`, which then begins at its first page. */
export function readPage(of: string, text: string): { depth: number; cursor: string } | null {
  const [, depth, listing, cursor] = /^([1-9]\d{0,8})-([a-z0-9]+)-(.+)$/s.exec(text) ?? [];
  return cursor !== undefined && listing === hash(of) ? { depth: Number(depth), cursor } : null;
}
