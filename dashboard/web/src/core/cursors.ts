// SPDX-License-Identifier: Apache-2.0
// Pages of a listing that says only what comes next: one is held at a time, and the address names it.
import { useRef } from 'preact/hooks';
import { readPage, writePage } from './paging';
import { parameter } from './router';

export interface Cursors {
  /** Of the page that is shown; null: the first. */
  at: string | null;
  depth: number;
  next: (cursor: string) => void;
  /** To the page before; to the first where that one was never seen, as behind a link. */
  back: () => void;
  first: () => void;
}

/** Begins anew where another listing, `of`, is asked for. */
export function useCursors(of: string): Cursors {
  const [text, set] = parameter('page');
  const seen = useRef(new Map<string, string>());
  const page = readPage(of, text);
  const depth = page?.depth ?? 0;
  if (page) seen.current.set(`${depth} ${of}`, text);
  return {
    at: page?.cursor ?? null,
    depth,
    next: (cursor) => set(writePage(of, depth + 1, cursor)),
    back: () => set(seen.current.get(`${depth - 1} ${of}`) ?? null),
    first: () => set(null),
  };
}
