// SPDX-License-Identifier: Apache-2.0
// Hosts and their workers: does an added one work, and is it worth it.
import { useEffect, useRef, useState } from 'preact/hooks';
import { query, useResource } from '../core/api';
import { now, useLive } from '../core/connection';
import { age, count, none, number, percent, short } from '../core/format';
import { link, parameter, setParameters } from '../core/router';
import { sourcesOf } from '../core/sources';
import type { Fleet as FleetAnswer, Host, Worker } from '../core/types';
import { Age, Chip, Empty, Loaded, Pager, Panel, Search } from '../parts/basics';
import { Jobs } from '../parts/jobs';
import { Table, type Column } from '../parts/table';

const phases: Record<string, string> = { i: 'line', p: 'hand', y: 'target', s: 'reference', '.': 'bad' };

/** The phases of the last minute; an empty place was not heard. */
function Strip(props: { text: string }) {
  const n = Math.max(1, props.text.length);
  return (
    <svg class="strip" viewBox={`0 0 ${n} 1`} preserveAspectRatio="none" role="img" aria-label={summary(props.text)}>
      {[...props.text].map((one, i) => one !== '.' && <rect x={i} y={one === 'i' ? 0.7 : 0} width="1.02" height={one === 'i' ? 0.3 : 1} fill={`var(--${phases[one] ?? 'muted'})`} />)}
    </svg>
  );
}

function summary(text: string): string {
  const share = (letter: string) => Math.round((100 * [...text].filter((one) => one === letter).length) / Math.max(1, text.length));
  return `idle ${share('i')} %, plans ${share('p')} %, plays ${share('y')} %, sends ${share('s')} %`;
}

// at once; the gateway gives no more
const [mostHosts, mostWorkers] = [200, 2000];

type Row = { host: Host; worker: Worker | null };

export function Fleet() {
  const [filter] = parameter('filter');
  const [sort, setSort] = parameter('sort', 'host');
  const [from] = parameter('from', '0');
  const [most, setMost] = parameter('workers', '200');
  const args = { sort, ...(filter ? { filter } : {}), limit: mostHosts, offset: Number(from) || 0, workers: Math.min(mostWorkers, Number(most) || 200) };
  // beside the channel, which says nothing of what fails
  const first = useResource<FleetAnswer>(`/fleet${query(args)}`, { every: 10000 });
  const live = useLive<FleetAnswer>('fleet', args);
  const at = useRef(Date.now());
  const data = live ?? first.data;
  const before = useRef(data);
  if (before.current !== data) {
    before.current = data;
    at.current = Date.now();
  }
  // hosts that somebody folded or opened; others are folded where there are many workers
  const [fold] = parameter('fold');
  const [open] = parameter('open');
  const [folded, opened] = [fold, open].map((text) => new Set(text.split(',').filter(Boolean))) as [Set<string>, Set<string>];
  const frozen = useFrozen(data, sort, first.pending ? undefined : first.data);
  return (
    <Loaded of={{ ...first, data }}>
      {(fleet) => {
        if (!fleet.workers && !filter && !fleet.hosts.some((one) => one.processes.length)) {
          return <><Panel><Empty title="No worker has been heard and no journal names one" command="etude worker --campaign NAME">On this machine, and with --profile (deploy/dds) for every process on others too, a worker joins a campaign by its name:</Empty></Panel><Jobs /></>;
        }
        const hosts = [...fleet.hosts].sort((a, b) => place(frozen.order, a.host) - place(frozen.order, b.host));
        const moving = hosts.filter((one, i) => one !== fleet.hosts[i]).length;
        const many = fleet.workers > 200;
        const isFolded = (name: string) => folded.has(name) || (many && !opened.has(name));
        const cut = fleet.hosts.filter((one) => one.workers.length < one.slots);
        const rows: Row[] = hosts.flatMap((host) => [{ host, worker: null }, ...(isFolded(host.host) ? [] : host.workers.map((worker) => ({ host, worker })))]);
        const toggle = (name: string) => {
          const [from, to] = isFolded(name) ? [folded, opened] : [opened, folded];
          from.delete(name);
          to.add(name);
          setParameters({ fold: [...folded].join(',') || null, open: [...opened].join(',') || null }, true);
        };
        return (
          <>
            <Head of={fleet} filter={filter} />
            <section class="panel flush" aria-label="Hosts and workers" {...frozen.on}>
              <Table label="Hosts and workers" rows={rows} id={(row) => row.worker?.worker ?? row.host.host} height={720} sort={sort} setSort={(value) => setSort(value)}
                columns={columns(fleet, at.current, toggle, isFolded)} />
            </section>
            {moving > 0 && <p class="small muted" data-held>{count(moving)} rows would move: their order is held while you are at them.</p>}
            <Pager what="hosts" from={args.offset} shown={hosts.length} total={fleet.total} size={mostHosts} go={(next) => setParameters({ from: next || null })} />
            {cut.length > 0 && <p class="row small" data-cut>{cut.slice(0, 5).map((one) => <span>{one.host}: {count(one.workers.length)} of {count(one.slots)} workers are listed</span>)}{args.workers < mostWorkers ? <button type="button" class="button" onClick={() => setMost(Math.min(mostWorkers, args.workers + 400))}>Show more</button> : <span class="muted">find the others by the filter</span>}</p>}
            <p class="small muted row" aria-hidden="true">{([['i', 'idle'], ['p', 'plans'], ['y', 'plays'], ['s', 'sends']] as const).map(([letter, word]) => <span class="row"><svg width="12" height="12"><rect width="12" height={letter === 'i' ? 4 : 12} y={letter === 'i' ? 8 : 0} fill={`var(--${phases[letter]})`} /></svg>{word}</span>)}</p>
            <Processes of={fleet} />
            <Jobs />
          </>
        );
      }}
    </Loaded>
  );
}

function Head(props: { of: FleetAnswer; filter: string }) {
  const { of: fleet, filter } = props;
  return (
    <div class="page-head">
      <p data-fleet-summary><b>{count(fleet.total)}</b> {fleet.total === 1 ? 'host' : 'hosts'} · <b>{count(fleet.workers)}</b> {fleet.workers === 1 ? 'worker' : 'workers'}{fleet.per_min !== null && <> · <b>{number(fleet.per_min)}</b> a minute</>}{fleet.ok !== null && <> · <b>{percent(fleet.ok)}</b> of attempts ok</>}</p>
      {oneOf(fleet, (host) => host.version) && <span class="muted">version {oneOf(fleet, (host) => host.version)}</span>}
      {oneOf(fleet, (host) => host.fingerprint) && fleet.total > 1 && <span class="muted">fingerprints equal</span>}
      {!fleet.live && <Chip>from journals: nothing is on the bus</Chip>}
      <span class="fill" />
      <Search label="Filter hosts, workers, tasks" value={filter} change={(value) => setParameters({ filter: value, from: null }, true)} width={28} />
    </div>
  );
}

/**
 * The order of rows as it was when the pointer or the focus came to them, until both have gone. Of another one that is
 * asked for meanwhile that of its first `answer` (undefined: it has not come).
 */
function useFrozen(data: FleetAnswer | undefined, sort: string, answer: FleetAnswer | undefined) {
  const of = (fleet: FleetAnswer | undefined) => fleet?.hosts.map((one) => one.host) ?? [];
  const now = of(data);
  const [held, hold] = useState<{ order: string[]; sort: string } | null>(null);
  const here = useRef({ pointer: false, focus: false });
  const set = (what: 'pointer' | 'focus', on: boolean) => {
    here.current[what] = on;
    if (!here.current.pointer && !here.current.focus) hold(null);
    else if (on) hold((old) => old ?? { order: now, sort });
  };
  useEffect(() => { if (answer) hold((old) => (old && old.sort !== sort ? { order: of(answer), sort } : old)); }, [answer, sort]);
  const on = {
    onPointerEnter: () => set('pointer', true),
    onPointerLeave: () => set('pointer', false),
    onFocusIn: () => set('focus', true),
    onFocusOut: (event: FocusEvent) => { if (!(event.currentTarget as Element).contains(event.relatedTarget as Node | null)) set('focus', false); },
  };
  return { order: held && (held.sort === sort || !answer) ? held.order : now, on };
}

/** What is not a worker: who collects, trains, serves and shows. */
function Processes(props: { of: FleetAnswer }) {
  const rows = props.of.hosts.flatMap((host) => host.processes.filter((one) => one.role !== 'worker').map((one) => ({ host: host.host, ...one })));
  if (!rows.length) return null;
  return (
    <Panel title="Processes" flush>
      <Table label="Processes" rows={rows} id={(row) => row.process} columns={[
        { key: 'role', title: 'process', width: 'minmax(110px, 1fr)', card: 'title', cell: (row) => row.role },
        { key: 'host', title: 'host', width: 'minmax(110px, 1fr)', cell: (row) => row.host },
        { key: 'pid', title: 'pid', width: '9ch', number: true, cell: (row) => String(row.pid) },
        { key: 'rss', title: 'memory', width: '9ch', number: true, cell: (row) => `${number(row.rss_mb, 3)} MB` },
        { key: 'cpu', title: 'cores', width: '7ch', number: true, cell: (row) => number(row.cpu, 2) },
        { key: 'disk', title: 'disk free', width: '10ch', number: true, cell: (row) => row.disk_free === null ? none : <span class={row.disk_free < 0.1 ? 'bad' : ''}>{percent(row.disk_free)}</span> },
        { key: 'folder', title: 'writes to', width: 'minmax(120px, 3fr)', card: 'long', cell: (row) => <span class="muted">{row.folder ?? ''}</span> },
        { key: 'version', title: 'version', width: '10ch', cell: (row) => row.version },
        { key: 'age', title: 'heard', width: '7ch', number: true, cell: (row) => <span class={row.age_ms > 3000 ? 'warn' : ''}>{age(row.age_ms)}</span> },
      ]} />
    </Panel>
  );
}

/** What all hosts have in common, else nothing. */
function oneOf(fleet: FleetAnswer, of: (host: Host) => string | null): string | null {
  const all = new Set(fleet.hosts.map(of));
  return all.size === 1 ? [...all][0] ?? null : null;
}

function place(order: string[], host: string): number {
  const at = order.indexOf(host);
  return at < 0 ? order.length : at;
}

function columns(fleet: FleetAnswer, at: number, toggle: (host: string) => void, isFolded: (host: string) => boolean): Column<Row>[] {
  const prints = new Set(fleet.hosts.map((one) => one.fingerprint).filter(Boolean));
  void now.value;
  const told = (one: (host: Host) => unknown) => fleet.hosts.some((host) => one(host) !== null);
  const all: Column<Row>[] = [
    { key: 'name', title: 'host and worker', width: 'minmax(116px, 1.2fr)', sort: 'host', card: 'title', cell: (row) => row.worker
      ? <span class="secondary">{madeBy(row.worker)}</span>
      : <button type="button" class="button plain" aria-expanded={!isFolded(row.host.host)} onClick={() => toggle(row.host.host)}><b>{isFolded(row.host.host) ? '▸' : '▾'} {row.host.host}</b></button> },
    { key: 'slots', title: 'busy', width: '5ch', number: true, sort: 'slots', cell: (row) => row.worker ? '' : `${row.host.busy}/${row.host.slots}` },
    { key: 'per_min', title: 'a minute', width: '7ch', number: true, sort: 'per_min', cell: (row) => number((row.worker ?? row.host).per_min) },
    { key: 'ok', title: 'ok', width: '7ch', number: true, cell: (row) => row.worker ? (row.worker.episodes + row.worker.failures ? percent(row.worker.episodes / (row.worker.episodes + row.worker.failures)) : none) : percent(row.host.ok) },
    { key: 'episodes', title: 'done', width: '6ch', number: true, cell: (row) => row.worker ? count(row.worker.episodes) : count(row.host.episodes) },
    { key: 'failures', title: 'failed', width: '6ch', number: true, cell: (row) => failed(row.worker ? row.worker.failures : row.host.failures) },
    { key: 'now', title: 'makes', width: 'minmax(150px, 4fr)', card: 'long', cell: (row) => row.worker ? making(row.worker) : '' },
    { key: 'last', title: 'last', width: 'minmax(76px, 1fr)', cell: (row) => row.worker ? <span class={row.worker.last && row.worker.last !== 'success' ? 'warn' : 'muted'}>{row.worker.last ?? ''}</span> : '' },
    { key: 'strip', title: 'last 60 s', width: '72px', card: 'none', cell: (row) => row.worker && row.worker.strip ? <Strip text={row.worker.strip} /> : '' },
    { key: 'plan', title: 'plan p50, p95', width: '11ch', number: true, cell: (row) => row.worker || row.host.plan_p50_s === null ? '' : `${number(row.host.plan_p50_s, 2)}, ${number(row.host.plan_p95_s, 2)} s` },
    { key: 'rss', title: 'memory', width: '7ch', number: true, cell: (row) => row.worker || row.host.rss_mb === null ? '' : `${number(row.host.rss_mb / 1000, 2)} GB` },
    { key: 'cpu', title: 'cores', width: '5ch', number: true, cell: (row) => row.worker || row.host.cpu === null ? '' : number(row.host.cpu, 2) },
    { key: 'version', title: 'version', width: '9ch', cell: (row) => row.worker ? '' : row.host.version ?? '' },
    { key: 'print', title: 'fingerprint', width: '11ch', cell: (row) => row.worker || !row.host.fingerprint ? '' : <span class={`mono${prints.size > 1 ? ' warn' : ''}`}>{short(row.host.fingerprint, 18)}</span> },
    { key: 'age', title: 'heard', width: '6ch', number: true, sort: 'age', cell: (row) => fleet.live ? <Age ms={(row.worker ?? row.host).age_ms} at={at} /> : '' },
  ];
  const differ = (one: (host: Host) => string | null) => new Set(fleet.hosts.map(one).filter(Boolean)).size > 1;
  const absent = new Set([!told((host) => host.plan_p50_s) && 'plan', !told((host) => host.rss_mb) && 'rss', !told((host) => host.cpu) && 'cpu', !differ((host) => host.version) && 'version', !differ((host) => host.fingerprint) && 'print', !fleet.live && 'age', !fleet.live && 'strip']);
  return all.filter((one) => !absent.has(one.key));
}

/** The worker, as a link to what it made where that is on this disk. */
function madeBy(worker: Worker) {
  const known = sourcesOf('dataset').some((one) => one.id === worker.campaign);
  return known ? <a href={link('dataset', { dataset: worker.campaign, worker: worker.worker })}>{worker.worker}</a> : worker.worker;
}

/** Attempts that came to nothing. */
function failed(n: number) {
  return <span class={n ? 'warn' : 'muted'} data-failures={n}>{count(n)}</span>;
}

function making(worker: Worker): string {
  if (worker.index === null) return worker.phase;
  const what = [worker.task, worker.robot, worker.target].filter(Boolean).join(' ');
  const where = worker.stage ? `${worker.stage}${worker.step !== null ? `, step ${worker.step}` : ''}` : worker.phase;
  return `#${worker.index}${worker.attempt ? ` try ${worker.attempt + 1}` : ''} ${what} · ${where}`;
}
