// SPDX-License-Identifier: Apache-2.0
// Pages of a listing that says only what comes next: one is held at a time, and the way back to the first.
import { useState } from 'preact/hooks';

export interface Cursors {
  /** Of the page that is shown; null: the first. */
  at: string | null;
  depth: number;
  next: (cursor: string) => void;
  back: () => void;
}

/** Begins anew where another listing, `of`, is asked for. */
export function useCursors(of: string): Cursors {
  const [state, setState] = useState<{ of: string; way: string[] }>({ of, way: [] });
  const way = state.of === of ? state.way : [];
  return {
    at: way[way.length - 1] ?? null,
    depth: way.length,
    next: (cursor) => setState({ of, way: [...way, cursor] }),
    back: () => setState({ of, way: way.slice(0, -1) }),
  };
}
