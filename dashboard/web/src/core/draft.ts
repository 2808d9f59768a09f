// SPDX-License-Identifier: Apache-2.0
// A field whose text is set after a pause in typing.
import { useEffect, useRef, useState } from 'preact/hooks';

export interface Draft {
  /** What was typed while it is not set yet, else what is set: whatever is drawn anew meanwhile takes no letter away. */
  shown: string;
  change: (text: string) => void;
}

/** `pause`: how long nobody types before the text is set, ms. `staysEmpty`: once emptied, also where `value` then is what stands in for it. */
export function useDraft(value: string, set: (text: string) => void, pause: number, staysEmpty = false): Draft {
  const [typed, setTyped] = useState<string | null>(null);
  const timer = useRef(0);
  const latest = useRef(set);
  latest.current = set;
  useEffect(() => () => window.clearTimeout(timer.current), []);
  const change = (text: string) => {
    setTyped(text);
    window.clearTimeout(timer.current);
    timer.current = window.setTimeout(() => {
      if (text !== '' || !staysEmpty) setTyped(null);
      latest.current(text);
    }, pause);
  };
  return { shown: typed ?? value, change };
}
