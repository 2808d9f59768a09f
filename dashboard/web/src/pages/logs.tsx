// SPDX-License-Identifier: Apache-2.0
// Lines of the log files, newest at the foot; older ones on request.
import { useEffect, useRef, useState } from 'preact/hooks';
import { query, useResource } from '../core/api';
import { useLive } from '../core/connection';
import { useCursors } from '../core/cursors';
import { bytes, clock, count, day, plural } from '../core/format';
import { parameter } from '../core/router';
import { adviceFor, type Advice } from '../core/advice';
import type { Events, LogLine, Logs } from '../core/types';
import { AdviceBelow, useAdvice } from '../parts/advice';
import { Empty, Loaded, Panel, Search, Select } from '../parts/basics';

export function LogsPage() {
  const [source, setSource] = parameter('source');
  const [level, setLevel] = parameter('level');
  const [q, setQ] = parameter('q');
  const [follow, setFollow] = useState(true);
  // what was shown when it was held, of these filters
  const [held, hold] = useState<{ of: string; data: Logs } | null>(null);
  const args = { ...(source ? { source } : {}), ...(level ? { level } : {}), ...(q ? { q } : {}), limit: 200 };
  const text = query(args);
  const page = useCursors(text);
  // beside the channel, which says nothing of what fails
  const first = useResource<Logs>(`/logs${query({ ...args, before: page.at })}`, { round: follow, ...(follow && !page.depth ? { every: 10000 } : {}) });
  const live = useLive<Logs>(follow && !page.depth ? 'logs' : null, args, 1);
  const newest = (!page.depth && (follow ? live : held?.of === text ? held.data : undefined)) || first.data;
  const setFollowing = (on: boolean) => {
    hold(on || !newest ? null : { of: text, data: newest });
    setFollow(on);
  };
  const warned = useLive<Events>('events', { ...(level === 'error' ? { level } : {}), ...(q ? { q } : {}), limit: 50 }, 1);
  const box = useRef<HTMLDivElement>(null);
  const shown = newest?.lines.length ?? 0;
  useEffect(() => { if (follow && !page.depth && box.current) box.current.scrollTop = box.current.scrollHeight; }, [newest?.lines[shown - 1]?.n]);
  // a page begins at its foot, which is next to the one that it was reached from
  useEffect(() => { if (!first.pending && box.current) box.current.scrollTop = box.current.scrollHeight; }, [page.at, first.pending]);
  const advice = useAdvice(newest?.lines.some(isError) ?? false);
  // also beside an error the filters are those of the files known
  const known = useRef<Logs['sources']>([]);
  known.current = newest?.sources ?? known.current;
  const files = known.current;
  const nothing = newest !== undefined && !files.length && !warned?.total;
  return (
    <>
      {!nothing && (
        <div class="page-head">
          <Select label="Level" value={level} options={[['', 'every level'], ['info', 'info and above'], ['warn', 'warnings and errors'], ['error', 'errors']]} choose={(value) => setLevel(value)} />
          <Select label="Source" value={source} options={[['', files.length ? `all ${files.length} files` : 'every file'], ...files.map((one) => [one.id, `${one.name} (${bytes(one.bytes)})`] as const)]} choose={(value) => setSource(value)} />
          <Search label="Text in the line" value={q} change={(value) => setQ(value, true)} width={28} />
          <span class="fill" />
          {page.depth > 0 && first.error && <button type="button" class="button" data-newest onClick={page.first}>Newest lines</button>}
          <label class="inline"><input type="checkbox" checked={follow} onChange={(event) => setFollowing(event.currentTarget.checked)} /> follow</label>
        </div>)}
      <Loaded of={{ ...first, data: newest }}>
        {(data) => {
          const { next, lines } = data;
          if (nothing) return <Panel><Empty title="No log files">Processes that etude up, collect or eval start write to logs/ beside what they make; others write to their terminal.</Empty></Panel>;
          return (
            <>
              {warned !== undefined && warned.total > 0 && <OfBus of={warned} />}
              <Panel flush label="Lines">
                <div class="log-box" ref={box} tabIndex={0} role="group" aria-label="Log lines">
                {next && <div class="more"><button type="button" class="button" disabled={first.pending} onClick={() => page.next(next)}>Older lines</button></div>}
                {lines.length
                  ? <ol class="log" data-log-lines={lines.length}>{lines.map((one) => <Line key={`${one.source}:${one.n}`} of={one} source={name(data, one.source)} advice={advice} />)}</ol>
                  : <Empty title="No line fits">{`${searched(data)} were searched.`}</Empty>}
                {lines.length > 0 && data.back_to && <p class="more small muted" data-back-to>{`${searched(data)} were searched.`}</p>}
                {page.depth > 0 && <div class="more"><button type="button" class="button" onClick={page.back}>Newer lines</button></div>}
                </div>
              </Panel>
            </>
          );
        }}
      </Loaded>
    </>
  );
}

/** Errors are what the documentation says something of; programs write them without a level, too. */
function isError(line: LogLine): boolean {
  return line.level === 'error' || line.level === 'warn' || line.level === null;
}

function Line(props: { of: LogLine; source: string; advice: Advice[] }) {
  const { of } = props;
  const known = isError(of) ? adviceFor(of.text, props.advice) : undefined;
  return (
    <li data-level={of.level ?? ''}>
      <span class="muted" title={of.t ?? ''}>{of.at ? clock(of.at) : of.t ?? ''}</span><span class={of.level === 'warn' ? 'warn' : of.level === 'error' ? 'bad' : 'muted'}>{of.level ?? ''}</span><span class="muted">{props.source}</span>
      <span>{of.text}{known && <AdviceBelow of={known} />}</span>
    </li>
  );
}

/** What processes on the bus warned of, on whatever host: newest first. */
function OfBus(props: { of: Events }) {
  return (
    <Panel title="Warned on the bus" flush aside={<span class="small muted">{count(props.of.total)} heard, newest first</span>}>
      <div class="event-box" tabIndex={0} role="group" aria-label="Events of processes">
        <ol class="log" data-events={props.of.total}>{props.of.events.map((one) => <li key={`${one.process}:${one.n}`} data-level={one.level}><span class="muted">{clock(one.t)}</span><span class={one.level === 'error' ? 'bad' : 'warn'}>{one.level}</span><span class="muted">{one.role} {one.host}</span><span>{one.text}</span></li>)}</ol>
      </div>
    </Panel>
  );
}

/** What was looked at for these lines. */
function searched(of: Logs): string {
  return `${plural(of.searched, 'file')}${of.back_to ? `, back to ${day(of.back_to)},` : ''}`;
}

function name(data: Logs, id: string): string {
  return data.sources.find((one) => one.id === id)?.name ?? id;
}
