// SPDX-License-Identifier: Apache-2.0
// What this gateway runs for those who asked: each with its command, its last words and a way to end it; and what failed
// within the last hour, perhaps after its dialog was closed.
import { useState } from 'preact/hooks';
import { reasonOf, stopJob, useResource } from '../core/api';
import { clock } from '../core/format';
import type { Job } from '../core/types';
import { Chip, Panel } from './basics';
import { useToken } from './sign_in';

const lately_ms = 3600e3;

function failedLately(of: Job): boolean {
  return of.state === 'failed' && of.ended !== null && Date.now() - Date.parse(of.ended) < lately_ms;
}

export function Jobs() {
  const all = useResource<{ jobs: Job[] }>('/jobs', { every: 2000 });
  const shown = (all.data?.jobs ?? []).filter((one) => one.state === 'running' || failedLately(one));
  const [said, say] = useState('');
  const access = useToken();
  if (!shown.length) return null;
  const stop = async (id: string) => {
    try {
      await access.act(() => stopJob(id));
      say('');
      all.reload();
    } catch (error) {
      say(reasonOf(error));
    }
  };
  return (
    <Panel title="Jobs of this gateway">
      {shown.map((one) => (
        <div class="row wrap" key={one.id} data-job={one.action}>
          <b>{one.action}</b>
          <span class="mono small fill" title={one.log.slice(-3).join('\n')}>{one.command}</span>
          {one.state === 'running'
            ? <><span class="small muted">since {clock(one.started, false)}</span><button type="button" class="button" disabled={!access.ready} onClick={() => { void stop(one.id); }}>Stop</button></>
            : <><Chip tone="bad">failed</Chip><span class="small muted">{one.exit_code !== null && `exit ${one.exit_code}, `}{clock(one.ended, false)}</span><span class="mono small secondary">{one.log[one.log.length - 1]}</span></>}
        </div>
      ))}
      {said && <p class="bad small" role="alert">{said}</p>}
      {access.field && <p class="row">{access.field}</p>}
    </Panel>
  );
}
