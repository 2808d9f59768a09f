// SPDX-License-Identifier: Apache-2.0
// What this gateway runs for those who asked: each with its command, its last words and a way to end it; and what failed
// within the last hour, perhaps after its dialog was closed.
import { useEffect, useState } from 'preact/hooks';
import { reasonOf, stopJob, useResource } from '../core/api';
import { clock } from '../core/format';
import { home } from '../core/sources';
import type { Job } from '../core/types';
import { Chip, Panel } from './basics';
import { useToken } from './sign_in';

const lately_ms = 3600e3;

/** By the gateway's clock, which says when it ended. */
function failedLately(of: Job): boolean {
  const there = Date.parse(home.value?.time ?? '') || Date.now();
  return of.state === 'failed' && of.ended !== null && there - Date.parse(of.ended) < lately_ms;
}

// ms in which a second click is none: it would end the job at once, with what it has not written
const doubleClick = 2000;

/** Ends a job of the gateway's, at once where it was asked to before (`stopping`); why it could not stands beside the button. */
export function StopJob(props: { id: string; label: string; stopping: boolean; stopped?: () => void }) {
  const [said, say] = useState('');
  const [asked, ask] = useState<'no' | 'just now' | 'yes'>('no');
  const access = useToken();
  useEffect(() => {
    if (asked !== 'just now') return;
    const timer = window.setTimeout(() => ask('yes'), doubleClick);
    return () => window.clearTimeout(timer);
  }, [asked]);
  const stop = async () => {
    const before = asked;
    ask('just now');
    try {
      await access.act(() => stopJob(props.id));
      say('');
      props.stopped?.();
    } catch (error) {
      ask(before);
      say(reasonOf(error));
    }
  };
  const label = asked === 'just now' ? 'Stopping…' : asked === 'yes' || props.stopping ? 'Stopping… end it at once' : props.label;
  return <><button type="button" class="button" data-stop disabled={!access.ready || asked === 'just now'} onClick={() => { void stop(); }}>{label}</button>{access.field}{said && <span class="small bad" role="alert">{said}</span>}</>;
}

export function Jobs() {
  const all = useResource<{ jobs: Job[] }>('/jobs', { every: 2000 });
  const shown = (all.data?.jobs ?? []).filter((one) => one.state === 'running' || failedLately(one));
  if (!shown.length) return null;
  return (
    <Panel title="Jobs of this gateway">
      {shown.map((one) => (
        <div class="row wrap" key={one.id} data-job={one.action}>
          <b>{one.action}</b>
          <span class="mono small fill" title={one.log.slice(-3).join('\n')}>{one.command}</span>
          {one.state === 'running'
            ? <><span class="small muted">since {clock(one.started, false)}</span><StopJob id={one.id} label="Stop" stopping={one.stopping} stopped={all.reload} /></>
            : <><Chip tone="bad">failed</Chip><span class="small muted">{one.exit_code !== null && `exit ${one.exit_code}, `}{clock(one.ended, false)}</span><span class="mono small secondary">{one.log[one.log.length - 1]}</span></>}
        </div>
      ))}
    </Panel>
  );
}
