// SPDX-License-Identifier: Apache-2.0
// What the documentation says of an error, below the line that has its text. Loaded with the first line that may have one.
import { useEffect, useState } from 'preact/hooks';
import { readAdvice, type Advice } from '../core/advice';
import { Command } from './basics';

let loaded: Advice[] | null = null;

/** Empty until it is there. */
export function useAdvice(wanted: boolean): Advice[] {
  const [all, show] = useState<Advice[]>(() => loaded ?? []);
  useEffect(() => {
    if (!wanted || loaded) return;
    // without it a log is still a log
    import('../../../../deploy/docs/troubleshooting.md').then((page) => show(loaded = readAdvice(page.default)), () => undefined);
  }, [wanted]);
  return all;
}

function Words(props: { text: string }) {
  return <p>{props.text.split('`').map((part, i) => (i % 2 ? <code>{part}</code> : part))}</p>;
}

export function AdviceBelow(props: { of: Advice }) {
  return (
    <details class="advice" data-advice={props.of.title}>
      <summary>what to do</summary>
      <div class="stack tight">{props.of.body.map((one) => (one.command ? <Command text={one.text} /> : <Words text={one.text} />))}</div>
    </details>
  );
}
