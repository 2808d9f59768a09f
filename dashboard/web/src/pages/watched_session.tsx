// SPDX-License-Identifier: Apache-2.0
// What the policy of a play session sees and says while it drives, module by module and head by head.
import { useEffect, useMemo } from 'preact/hooks';
import { root, useResource } from '../core/api';
import { count } from '../core/format';
import { parameter } from '../core/router';
import { insightOf } from '../core/session';
import type { PlayInsight, PlaySession } from '../core/types';
import { lookOf } from '../parts/attention';
import { Empty, Loaded, Panel } from '../parts/basics';
import { Frame } from '../parts/frame';
import { Attends, Said } from '../parts/said';
import { Spotlight } from '../parts/spotlight';
import type { Shown } from './ask_policy';

export function WatchedSession(props: Shown & { session: string }) {
  const address = `/play/sessions/${encodeURIComponent(props.session)}`;
  const session = useResource<PlaySession>(address, { every: 500 });
  return (
    <Panel title={`While session ${props.session} drives`} aside={<a href="/play">Play</a>}>
      <Loaded of={session}>{(data) => <Watched {...props} of={data} address={address} />}</Loaded>
    </Panel>
  );
}

function Watched(props: Shown & { of: PlaySession; address: string }) {
  const { of, address } = props;
  // its policy shows what it sees for as long as somebody asks
  const seen = useResource<PlayInsight>(`${address}/insight?heads=each`, { every: 300 });
  const insight = useMemo(() => insightOf(seen.data, of), [seen.data]);
  useEffect(() => props.tell(insight), [insight]);
  useEffect(() => () => props.tell(undefined), []);
  const [head] = parameter('head');
  const attention = insight?.attention[props.module];
  const look = useMemo(() => attention && lookOf(attention, head), [attention, head]);
  const camera = of.scene['camera'] as { width: number; height: number } | undefined;
  return (
    <>
      <p class="row wrap"><span>{of.phase}</span><q data-sentence>{of.sentence}</q>{insight && <span class="small muted">step {count(insight.checkpoint_step)} of {of.run} says it</span>}</p>
      {!insight && <Empty title="Its policy has not shown anything yet">It is shown while the robot moves.</Empty>}
      <div class="columns main-side even">
        <div class="stack">
          {camera && of.frame > 0 && (
            <div class="picture" style={{ aspectRatio: `${camera.width} / ${camera.height}` }}>
              <Frame n={of.frame} address={(n) => `${root}${address}/frame.jpg?n=${n}`} />
              {insight && look && look.rows > 0 && <Spotlight module={props.module} attention={look} view={insight.view} width={camera.width} height={camera.height} />}
            </div>)}
        </div>
        {insight && <div class="stack"><Attends of={insight} module={props.module} /></div>}
      </div>
      {insight && <Said of={insight} module={props.module} planner={props.planner} />}
    </>
  );
}
