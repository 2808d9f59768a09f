// SPDX-License-Identifier: Apache-2.0
// A listing that grows while it is read: what is new is said and not put in, until one asks for it.
import { useEffect, useRef, useState } from 'preact/hooks';
import { epoch } from './connection';

export interface Held {
  /** So many there were when it was asked for. */
  held: number;
  setHeld: (to: number) => void;
}

/**
 * Begins anew, at `now`, where another listing, `of`, is asked for, and when the gateway has come back; also where there
 * are fewer than there were: its folder was made anew.
 */
export function useHeld(now: number, of: string): Held {
  const key = `${epoch.value} ${of}`;
  const pinned = useRef({ key, at: now });
  const [, redraw] = useState({});
  if (pinned.current.key !== key || now < pinned.current.at) pinned.current = { key, at: now };
  return {
    held: pinned.current.at,
    setHeld: (at) => {
      pinned.current = { key, at };
      redraw({});
    },
  };
}

// ms by which what the bus counts may be ahead of what the gateway has read of the files
const ahead = 700;

/** While the listing is `empty` there is nothing to hold still: what is new is asked for by itself. */
export function useFollow(empty: boolean, now: number, { held, setHeld }: Held): void {
  const ask = useRef(() => {});
  ask.current = () => setHeld(now);
  const behind = empty && held !== now;
  useEffect(() => {
    if (!behind) return;
    const timer = window.setTimeout(() => ask.current(), ahead);
    return () => window.clearTimeout(timer);
  }, [behind]);
}
