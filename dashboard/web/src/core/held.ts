// SPDX-License-Identifier: Apache-2.0
// A listing that grows while it is read: what is new is said and not put in, until one asks for it.
import { useRef, useState } from 'preact/hooks';
import { epoch } from './connection';

export interface Held {
  /** So many there were when it was asked for. */
  held: number;
  setHeld: (to: number) => void;
}

/** Begins anew, at `now`, where another listing, `of`, is asked for, and when the gateway has come back. */
export function useHeld(now: number, of: string): Held {
  const key = `${epoch.value} ${of}`;
  const pinned = useRef({ key, at: now });
  const [, redraw] = useState({});
  if (pinned.current.key !== key) pinned.current = { key, at: now };
  return {
    held: pinned.current.at,
    setHeld: (at) => {
      pinned.current = { key, at };
      redraw({});
    },
  };
}
