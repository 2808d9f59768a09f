// SPDX-License-Identifier: Apache-2.0
// What this gateway runs for those who asked: each with its command, its last words and a way to end it.
import { useState } from 'preact/hooks';
import { reasonOf, stopJob, useResource } from '../core/api';
import { clock } from '../core/format';
import type { Job } from '../core/types';
import { Panel } from './basics';
import { useToken } from './sign_in';

export function Jobs() {
  const all = useResource<{ jobs: Job[] }>('/jobs', { every: 2000 });
  const running = (all.data?.jobs ?? []).filter((one) => one.state === 'running');
  const [said, say] = useState('');
  const access = useToken();
  if (!running.length) return null;
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
      {running.map((one) => (
        <div class="row wrap" key={one.id} data-job={one.action}>
          <b>{one.action}</b>
          <span class="mono small fill" title={one.log.slice(-3).join('\n')}>{one.command}</span>
          <span class="small muted">since {clock(one.started, false)}</span>
          <button type="button" class="button" disabled={!access.ready} onClick={() => { void stop(one.id); }}>Stop</button>
        </div>
      ))}
      {said && <p class="bad small" role="alert">{said}</p>}
      {access.field && <p class="row">{access.field}</p>}
    </Panel>
  );
}
