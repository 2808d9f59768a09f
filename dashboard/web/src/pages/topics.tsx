// SPDX-License-Identifier: Apache-2.0
// The bus itself: who publishes, who listens, does QoS match, what was said last.
import { useState } from 'preact/hooks';
import { query, useResource } from '../core/api';
import { useLive } from '../core/connection';
import { age, bytes, count, none, number } from '../core/format';
import { link, parameter } from '../core/router';
import type { Peer, Samples, Topic, Topics } from '../core/types';
import { Chip, Command, Empty, Loaded, Panel } from '../parts/basics';
import { Table } from '../parts/table';

export function TopicsPage() {
  const first = useResource<Topics>('/topics', { every: 10000 });
  const live = useLive<Topics>('topics', {}, 1);
  const [selected] = parameter('topic');
  return (
    <Loaded of={{ ...first, data: live ?? first.data }}>
      {(data) => {
        if (data.domain === null) return <Panel><Empty title="This gateway reads no bus">It was started with --no-bus: what has ended is in the files.</Empty></Panel>;
        if (data.error) return <Panel><Empty title="The bus is not read">{data.error}</Empty></Panel>;
        if (!data.topics.length) return <Panel><Empty title={`Nobody else is on domain ${data.domain}`} command="etude doctor">Each host has a bus of its own unless a profile says otherwise. What is wrong with this machine's bus, if anything:</Empty></Panel>;
        const topic = data.topics.find((one) => one.topic === selected);
        return (
          <>
            <div class="page-head"><p data-topics-summary><b>{count(data.topics.length)}</b> topics on domain {data.domain} · <b>{bytes(data.topics.reduce((sum, one) => sum + (one.bytes_per_s ?? 0), 0))}</b> a second, as their writers count</p></div>
            <Panel flush label="Topics">
              <Table label="Topics" rows={data.topics} id={(row) => row.topic} selected={selected || null} link={(row) => link('topics', { topic: row.topic })} columns={[
                { key: 'topic', title: 'topic', width: 'minmax(180px, 2fr)', card: 'title', cell: (row) => <span class="row tight"><span>{row.topic.replace(/^etude\//, '')}</span>{row.bulk && <Chip title="episodes and checkpoints: counted by their writers, never read here">bulk</Chip>}</span> },
                { key: 'rate', title: 'a second', width: '9ch', number: true, cell: (row) => number(row.per_s) },
                { key: 'bytes', title: 'bytes/s', width: '10ch', number: true, cell: (row) => (row.bytes_per_s === null ? none : bytes(Math.round(row.bytes_per_s))) },
                { key: 'writers', title: 'writers', width: '8ch', number: true, cell: (row) => count(row.writers.length) },
                { key: 'readers', title: 'readers', width: '8ch', number: true, cell: (row) => count(row.readers.length) },
                { key: 'qos', title: 'QoS', width: 'minmax(190px, 3fr)', card: 'long', cell: (row) => row.problems.length ? <span class="bad">▲ {row.problems.join('; ')}</span> : <span class="secondary">{row.qos.join('; ')}</span> },
              ]} />
            </Panel>
            {topic && <Detail key={topic.topic} of={topic} />}
          </>
        );
      }}
    </Loaded>
  );
}

/** Names of peers with how often each stands. */
function peers(all: Peer[]): string[] {
  const names = new Map<string, number>();
  for (const one of all) {
    const name = one.peer || `participant ${one.participant.slice(0, 12)}`;
    names.set(name, (names.get(name) ?? 0) + 1);
  }
  return [...names].map(([name, times]) => (times > 1 ? `${name} ×${times}` : name)).sort();
}

function Detail(props: { of: Topic }) {
  const { of } = props;
  return (
    <div class="grid wide">
      <Panel title={of.topic}>
        <dl class="facts">
          <dt>type</dt><dd>{of.types.join(', ')}</dd>
          <dt>QoS</dt><dd>{of.qos.join('; ')}</dd>
          {of.problems.length > 0 && <><dt>does not fit</dt><dd class="bad">{of.problems.join('; ')}</dd></>}
          <dt>writers</dt><dd>{peers(of.writers).map((one) => <div>{one}</div>)}{!of.writers.length && none}</dd>
          <dt>readers</dt><dd>{peers(of.readers).map((one) => <div>{one}</div>)}{!of.readers.length && none}</dd>
        </dl>
        <Command text={of.bulk ? `etude topic hz ${of.topic}` : `etude topic echo ${of.topic}`} />
      </Panel>
      <Panel title="Newest sample">{of.bulk ? <p class="secondary">It carries episodes or checkpoints: a reader here would double their traffic.</p> : <Newest topic={of.topic} />}</Panel>
    </div>
  );
}

function Newest(props: { topic: string }) {
  const [paused, setPaused] = useState(false);
  const first = useResource<Samples>(`/topics/${encodeURIComponent(props.topic)}/newest${query({})}`);
  const live = useLive<Samples>(paused ? null : 'sample', { topic: props.topic }, 2);
  const [kept, keep] = useState<Samples | undefined>(undefined);
  const shown = paused ? kept : live ?? first.data;
  return (
    <>
      <p class="row"><button type="button" class="button" aria-pressed={paused} onClick={() => { keep(shown); setPaused(!paused); }}>{paused ? 'Go on' : 'Hold'}</button></p>
      {shown?.samples.length
        ? shown.samples.map((one) => (
          <div class="stack" data-sample={one.partition}>
            <p class="small muted">{one.partition} · {age(one.age_ms)} ago</p>
            <div class="tree scroll-x" tabIndex={0} role="group" aria-label={`Newest sample of ${one.partition}`}><Tree value={one.message} /></div>
          </div>))
        : <p class="secondary">{first.error ? first.error.detail ?? first.error.title : 'Waiting for the next message. Topics that only speak when something happens may stay silent for long.'}</p>}
    </>
  );
}

/** JSON as nested lists; long ones are cut and counted. Texts that are JSON themselves are opened up. */
function Tree(props: { value: unknown }) {
  const most = 40;
  let { value } = props;
  if (typeof value === 'string' && /^[[{]/.test(value) && value.length < 20000) {
    try { value = JSON.parse(value); } catch { /* it is only a text */ }
  }
  if (Array.isArray(value) && value.every((one) => typeof one === 'number')) return <span class="mono">[{value.slice(0, most).join(', ')}{value.length > most ? `, … ${value.length}` : ''}]</span>;
  if (value === null || typeof value !== 'object') return <span class="mono">{typeof value === 'string' ? (value.length > 400 ? `${value.slice(0, 400)}… ${value.length} characters` : value || '""') : String(value)}</span>;
  const entries = Object.entries(value);
  return (
    <ul>
      {entries.slice(0, most).map(([name, one]) => <li><span class="muted">{name}</span> <Tree value={one} /></li>)}
      {entries.length > most && <li class="muted">and {entries.length - most} more</li>}
    </ul>
  );
}
