// SPDX-License-Identifier: Apache-2.0
// What fails, where and why, and what the time goes into.
import { useEffect, useMemo, useRef, useState } from 'preact/hooks';
import { getBytes, query, root, useResource } from '../core/api';
import { useLive } from '../core/connection';
import { count, duration, none, number, percent } from '../core/format';
import { useFollow, useHeld } from '../core/held';
import { link, navigate, parameter, setParameters } from '../core/router';
import { readSafetensors } from '../core/safetensors';
import { episodeLink, useChosen } from '../core/sources';
import { color, paints } from '../core/theme';
import type { Attempt, Attempts, Campaign, CampaignStatus, Timing } from '../core/types';
import { ActionButton } from '../parts/actions';
import { Chip, Empty, elsewhere, Failed, Figure, Loaded, Panel, Segments, Select, StateChip } from '../parts/basics';
import { Histogram } from '../parts/chart';
import { Table } from '../parts/table';

/** What the gateway says of attempts; `campaign`: of which one. */
interface LiveAttempts { campaign?: string; status: CampaignStatus; total: number; rows: Attempt[] }

export function Generation() {
  const id = useChosen('campaign');
  if (!id) return <Panel><Empty title="No campaign here yet" command="etude collect deploy/campaigns/quickstart.yaml --out data">Attempts appear with the first worker:</Empty></Panel>;
  // of each campaign anew: what was said of another one is no difference to this one
  return <OfCampaign key={id} id={id} />;
}

function OfCampaign(props: { id: string }) {
  const { id } = props;
  const campaign = useResource<Campaign>(`/campaigns/${id}`, { every: 5000 });
  const newest = useLive<LiveAttempts>('attempts', { campaign: id }, 1);
  const live = newest?.campaign === undefined || newest.campaign === id ? newest : undefined;
  // of one that was seen on the bus first the folder has come: from then on that is what it is chosen by
  const folder = campaign.data?.dataset ?? null;
  useEffect(() => { if (folder !== null && folder !== id) setParameters({ dataset: folder }, true); }, [folder]);
  return (
    <Loaded of={campaign}>
      {(data) => {
        const status = live?.status ?? data.status;
        const failed = Math.max(0, status.attempts - status.committed);
        return (
          <>
            <div class="page-head">
              {data.state === 'running' && status.control ? <Chip><span aria-hidden="true">{glyphs[status.control]}</span> {status.control}</Chip> : <StateChip state={data.state} />}
              <p data-attempts-summary>{status.live && status.per_min !== null && <><b>{number(status.per_min)}</b> a minute · </>}<b>{count(status.attempts)}</b> attempts · <b>{count(status.committed)}</b> of {count(status.total)} committed · <b>{count(failed)}</b> failed{status.attempts > 0 && ` (${percent(failed / status.attempts)})`} · <b>{count(status.given_up)}</b> given up</p>
              {status.error && <p class="bad breaks" data-campaign-error>{status.error}</p>}
              {status.eta_s !== null && status.live && <span class="muted">{duration(status.eta_s)} left</span>}
              <Controls campaign={id} running={status.live && status.committed < status.total} control={status.control} />
            </div>
            <div class="grid wide">
              <Matrix of={data} failed={failed} />
              <Time of={data.timing} />
            </div>
            {data.dataset !== null ? <Cells id={id} round={status.attempts} /> : <Panel title="Seeds"><p class="secondary" data-elsewhere>{elsewhere('dataset')} Which seeds are done is in them.</p></Panel>}
            <Latest id={id} round={status.attempts} dataset={data.dataset} />
          </>
        );
      }}
    </Loaded>
  );
}

// of a campaign that is held up
const glyphs = { paused: '❚❚', draining: '❚❚', stopping: '■' };

/** Once there they stay while the page does: a dialog that stopped the campaign says how that ended. */
function Controls(props: { campaign: string; running: boolean; control: CampaignStatus['control'] }) {
  const { campaign, running, control } = props;
  const ran = useRef(running);
  ran.current ||= running;
  if (!ran.current) return null;
  // a collector that is about to end takes no more orders
  const disabled = !running || control === 'stopping';
  const waits = control === 'paused' || control === 'draining';
  return (
    <><span class="fill" /><span class="row">
      <ActionButton label="Pause" about="Nothing new is leased to workers; what is leased is finished and committed." of={{ action: 'pause', campaign }} disabled={disabled || waits} />
      <ActionButton label="Drain" about="As pause, and waits until nothing is leased any more." of={{ action: 'drain', campaign }} disabled={disabled || control === 'draining'} />
      <ActionButton label="Resume" about="Leases again." of={{ action: 'resume', campaign }} disabled={disabled || !waits} />
      <ActionButton label="Stop" about="Ends the collector. What is committed stays; started again, it resumes." of={{ action: 'stop', campaign }} disabled={disabled} />
    </span></>
  );
}

type Failures = Campaign['failures_by'][number];

/** Reason by task, of one robot or of all: numbers with bars of one hue, since nine reasons cannot be nine colours. */
function Matrix(props: { of: Campaign; failed: number }) {
  const { of } = props;
  const [robot, setRobot] = parameter('robot');
  const robots = [...new Set([...of.robots, ...of.failures_by.map((one) => one.robot)])].filter(Boolean);
  // a campaign of which no journal is here counts reasons alone
  const byReason = !of.failures_by.length;
  const all: Failures[] = byReason ? Object.entries(of.failures).map(([reason, n]) => ({ reason, stage: null, task: '', robot: '', count: n })) : of.failures_by;
  const tasks = byReason ? [] : of.tasks;
  const failures = byReason ? all : all.filter((one) => !robot || one.robot === robot);
  // of very many the gateway adds up the rare ones without stage and robot: no filter finds those alone
  const merged = all.some((one) => one.robot) ? all.filter((one) => !one.robot) : [];
  const reasons = [...new Set(failures.map((one) => [one.reason, one.stage].filter(Boolean).join(' ')))];
  const named = (reason: string) => failures.filter((one) => [one.reason, one.stage].filter(Boolean).join(' ') === reason);
  const cell = (reason: string, task: string) => named(reason).filter((one) => one.task === task).reduce((sum, one) => sum + one.count, 0);
  const most = Math.max(1, ...reasons.flatMap((reason) => tasks.map((task) => cell(reason, task))));
  const whole = (reason: string, task: string) => !named(reason).some((one) => one.task === task && merged.includes(one));
  const choice = !byReason && (robots.length > 1 || robot) && <Select label="Robot" showLabel value={robot} options={[['', 'every robot'], ...robots.map((one) => [one, one] as const)]} choose={(value) => setRobot(value)} />;
  return (
    <Panel title="Failures by reason and task" aside={choice}>
      {!all.length
        ? <p class="secondary" data-no-failures>{props.failed === 0 ? `0 of ${count(of.status.attempts)} attempts failed.` : `${count(props.failed)} attempts failed; no journal says why.`}</p>
        : !failures.length ? <p class="secondary">None of them with {robot}.</p>
        : <div class="scroll-x" tabIndex={0} role="group" aria-label="Failures by reason and task">
          <table class="plain" data-matrix>
            <thead><tr><th>reason, stage</th>{tasks.map((task) => <th class="num">{task}</th>)}<th class="num">all</th></tr></thead>
            <tbody>{reasons.map((reason) => {
              // with those that are counted without a task
              const sum = named(reason).reduce((total, one) => total + one.count, 0);
              const code = failures.find((one) => [one.reason, one.stage].filter(Boolean).join(' ') === reason);
              return <tr><td>{reason}</td>{tasks.map((task) => {
                const n = cell(reason, task);
                return <td class="num">{n && !whole(reason, task) ? <><Meter share={n / most} />{n}</> : n ? <a href={link('generation', { dataset: of.id, reason: code?.reason ?? '', stage: code?.stage, task, robot, outcome: 'failed' })}><Meter share={n / most} />{n}</a> : <span class="muted">·</span>}</td>;
              })}<td class="num strong">{sum}</td></tr>;
            })}</tbody>
          </table>
        </div>}
      {byReason && all.length > 0 && <p class="small muted">Counted by reason alone: no journal says more.</p>}
      {merged.length > 0 && <p class="small muted" data-merged>{count(merged.reduce((sum, one) => sum + one.count, 0))} rare ones are added up without stage and robot{robot && ', and are not among these'}.</p>}
    </Panel>
  );
}

function Meter(props: { share: number }) {
  return <svg width="32" height="8" aria-hidden="true"><rect x={32 * (1 - props.share)} width={32 * props.share} height="8" fill="var(--accent)" opacity="0.5" /></svg>;
}

function Time(props: { of: Timing | null }) {
  const timing = props.of;
  if (!timing || !timing.attempts) return <Panel title="Time of an attempt"><p class="secondary">No journal of times: this dataset is from before commits.jsonl, or nothing has been committed.</p></Panel>;
  const parts: [string, number, string][] = [['plan', timing.plan_s, 'hand'], ['step', timing.step_s, 'target'], ['render', timing.render_s, 'reference'], ['deflate', timing.deflate_s, 'language'], ['send', timing.send_s ?? 0, 'others']];
  const sum = parts.reduce((total, [, value]) => total + value, 0) || 1;
  let at = 0;
  return (
    <Panel title="Time of an attempt" aside={<span class="muted small">{count(timing.attempts)} attempts</span>}>
      <div class="row apart"><Figure value={number(sum / timing.attempts, 3)} unit="s each" label="attempt_s" /><span class="secondary">plan p50 {number(timing.plan_p50_s, 2)} s, p95 {number(timing.plan_p95_s, 2)} s</span></div>
      <svg width="100%" height="16" role="img" aria-label={parts.map(([name, value]) => `${name} ${percent(value / sum, 0)}`).join(', ')}>
        {parts.map(([, value, token]) => {
          const x = at;
          at += value / sum;
          return <rect x={`${100 * x}%`} width={`${100 * (value / sum)}%`} height="16" fill={`var(--${token})`} />;
        })}
      </svg>
      <p class="row small">{parts.filter(([, value]) => value > 0).map(([name, value, token]) => <span class="row nowrap"><svg width="10" height="10" aria-hidden="true"><rect width="10" height="10" fill={`var(--${token})`} /></svg>{name} <b>{percent(value / sum, 0)}</b> <span class="muted">{number(value / timing.attempts, 2)} s</span></span>)}</p>
      <h2>Seconds of planning, logarithmic bins</h2>
      <Histogram edges={timing.plan_histogram.edges_s} counts={timing.plan_histogram.counts} label="plan seconds" format={(edge) => `${number(edge, 2)} s`} height={72} />
    </Panel>
  );
}

const cellNames = ['open', 'committed', 'committed after failures', 'given up', 'failed so far'];
const cellTokens = ['line', 'good', 'warn', 'bad', 'hand'];

// px of the device: browsers draw nothing on a taller one
const tallestCanvas = 32000;

/** One square an index; where one points, or the arrow keys have gone, is said in words. */
function Cells(props: { id: string; round: number }) {
  const answer = useResource<ArrayBuffer>(`/campaigns/${props.id}/cells`, { load: getBytes, every: 10000 });
  const canvas = useRef<HTMLCanvasElement>(null);
  const [over, setOver] = useState<number | null>(null);
  const [cursor, setCursor] = useState<number | null>(null);
  const [width, setWidth] = useState(0);
  const paint = paints.value;
  const content = useMemo(() => (answer.data ? readSafetensors(answer.data) : undefined), [answer.data]);
  const cells = content?.tensors.get('cells')?.values;
  const tally = useMemo(() => {
    const sums = cellNames.map(() => 0);
    cells?.forEach((value) => { if (sums[value] !== undefined) sums[value]! += 1; });
    return sums;
  }, [cells]);
  // of a shard its own episodes alone, every so many
  const indexOf = (at: number) => Number(content?.metadata.first ?? 0) + at * Number(content?.metadata.step ?? 1);
  const size = (cells?.length ?? 0) > 4000 ? 5 : 10;
  const across = Math.max(1, Math.floor(width / size));
  useEffect(() => {
    const box = canvas.current?.parentElement;
    if (!box) return;
    const watch = new ResizeObserver(() => { if (box.clientWidth > 0) setWidth(box.clientWidth); });
    watch.observe(box);
    setWidth(box.clientWidth);
    return () => watch.disconnect();
  }, [cells !== undefined]);
  useEffect(() => {
    const element = canvas.current;
    const context = element?.getContext('2d');
    if (!element || !context || !cells || !width) return;
    const height = Math.ceil(cells.length / across) * size;
    const scale = Math.min(devicePixelRatio, tallestCanvas / height);
    element.width = across * size * scale;
    element.height = height * scale;
    element.style.width = `${across * size}px`;
    element.style.height = `${height}px`;
    context.scale(scale, scale);
    cells.forEach((value, i) => {
      context.fillStyle = color(cellTokens[value] ?? 'line');
      context.fillRect((i % across) * size, Math.floor(i / across) * size, size - 1, size - 1);
    });
  }, [answer.data, width, paint]);
  const index = (event: MouseEvent) => {
    const box = canvas.current!.getBoundingClientRect();
    const at = Math.floor((event.clientY - box.top) / size) * across + Math.floor((event.clientX - box.left) / size);
    return cells && at >= 0 && at < cells.length ? at : null;
  };
  const failed = answer.error && <Failed problem={answer.error} retry={answer.reload} />;
  if (!cells) return failed ? <Panel title="Seeds">{failed}</Panel> : null;
  const open = (at: number | null) => {
    if (at === null) return;
    if (cells[at] === 1 || cells[at] === 2) navigate(episodeLink(props.id, indexOf(at)));
    else setParameters({ index: indexOf(at) });
  };
  const press = (event: KeyboardEvent) => {
    const from = cursor ?? 0;
    const to = ({ ArrowLeft: from - 1, ArrowRight: from + 1, ArrowUp: from - across, ArrowDown: from + across, Home: 0, End: cells.length - 1 } as Record<string, number>)[event.key];
    if (to !== undefined) setCursor(Math.max(0, Math.min(cells.length - 1, to)));
    else if (event.key === 'Enter' || event.key === ' ') open(from);
    else return;
    event.preventDefault();
  };
  const told = over ?? cursor;
  return (
    <Panel title="Seeds" aside={<span class="small secondary" role="status" data-seed-at>{told === null ? `${count(cells.length)} indices, one square each` : `#${indexOf(told)}: ${cellNames[cells[told] ?? 0]}`}</span>}>
      {failed}
      <div class="seed-map" role="group" tabIndex={0} data-arrows data-seed-map aria-label="Seeds: arrow keys go from one to the next, Enter opens it" onKeyDown={press} onFocus={(event) => { if (event.currentTarget.matches(':focus-visible')) setCursor(cursor ?? 0); }} onBlur={() => setCursor(null)}>
        <canvas ref={canvas} role="img" aria-label={cellNames.map((name, i) => `${tally[i]} ${name}`).join(', ')} onMouseMove={(event) => setOver(index(event))} onMouseLeave={() => setOver(null)} onClick={(event) => open(index(event))} />
        {cursor !== null && <span class="seed-cursor" style={{ left: `${(cursor % across) * size - 2}px`, top: `${Math.floor(cursor / across) * size - 2}px`, width: `${size + 3}px`, height: `${size + 3}px` }} />}
      </div>
      <p class="row small" data-cells>{cellNames.map((name, i) => tally[i]! > 0 && <span class="row"><svg width="10" height="10" aria-hidden="true"><rect width="10" height="10" fill={`var(--${cellTokens[i]})`} /></svg>{name} <b>{count(tally[i])}</b></span>)}</p>
    </Panel>
  );
}

function Latest(props: { id: string; round: number; dataset: string | null }) {
  const [outcome, setOutcome] = parameter('outcome', 'all');
  const names = ['task', 'reason', 'stage', 'robot', 'index'] as const;
  const filter = Object.fromEntries(names.map((name) => [name, parameter(name)[0]]));
  const listing = `/campaigns/${props.id}/attempts${query({ ...filter, outcome: outcome === 'all' ? '' : outcome, limit: 100 })}`;
  const { held, setHeld } = useHeld(props.round, listing);
  const rows = useResource<Attempts>(listing, { round: held });
  const set = names.filter((name) => filter[name]);
  const data = rows.data;
  const empty = data?.rows.length === 0;
  useFollow(empty, props.round, { held, setHeld });
  const fresh = empty ? 0 : props.round - held;
  const tiles = data?.rows.slice(0, 8) ?? [];
  return (
    <Panel title="Latest attempts" flush aside={
      <>
        {fresh > 0 && <button type="button" class="button pill" onClick={() => setHeld(props.round)}>{fresh} new ▲</button>}
        {set.map((name) => <button type="button" class="button" onClick={() => setParameters({ [name]: null })} aria-label={`remove the filter ${name}`}>{name}: {filter[name]} ✕</button>)}
        <Segments label="Outcome" value={outcome} options={[['all', 'all'], ['success', 'ok'], ['failed', 'failed']]} choose={(value) => setOutcome(value)} />
      </>}>
      {rows.error && <Failed problem={rows.error} retry={rows.reload} />}
      {empty && (props.round > 0 && (set.length > 0 || outcome === 'success')
        ? <Empty title="No attempt fits these filters">{`${count(props.round)} are there without them.`}</Empty>
        : <Empty title={outcome === 'failed' ? 'No failed attempt' : 'No attempt yet'}>{outcome === 'failed' ? 'Nothing that was tried has failed.' : 'The first one appears here when a worker has finished it.'}</Empty>)}
      {tiles.length > 0 && <div class="tiles pad" data-tiles>{tiles.map((one) => <Tile of={one} dataset={props.dataset ?? props.id} />)}</div>}
      {data && data.rows.length > 0 && (
        <Table label="Attempts" rows={data.rows} id={(row) => `${row.index}.${row.attempt}`} height={440} link={(row) => attemptLink(props.dataset ?? props.id, row)}
          columns={[
            { key: 'index', title: '#', width: '7ch', card: 'title', cell: (row) => <>{row.index}{row.attempt > 0 && <span class="muted">.{row.attempt}</span>}</> },
            { key: 'outcome', title: 'outcome', width: 'minmax(110px, 1fr)', cell: (row) => <span class={row.outcome === 'success' ? 'good' : 'bad'}>{row.outcome === 'success' ? '✓ ok' : `✕ ${row.outcome}`}</span> },
            { key: 'task', title: 'task', width: 'minmax(90px, 1fr)', cell: (row) => row.task },
            { key: 'target', title: 'target', width: 'minmax(70px, 1fr)', cell: (row) => row.target },
            { key: 'robot', title: 'robot', width: '8ch', cell: (row) => row.robot },
            { key: 'reason', title: 'reason', width: 'minmax(220px, 4fr)', card: 'long', cell: (row) => <span class="secondary" title={row.reason ?? ''}>{row.reason ?? ''}</span> },
            { key: 'plan', title: 'plan s', width: '7ch', number: true, cell: (row) => row.plan_s === null ? none : number(row.plan_s, 2) },
            { key: 'step', title: 'step s', width: '7ch', number: true, card: 'none', cell: (row) => number(row.step_s, 2) },
            { key: 'render', title: 'render s', width: '8ch', number: true, card: 'none', cell: (row) => number(row.render_s, 2) },
            { key: 'worker', title: 'worker', width: 'minmax(120px, 1.5fr)', card: 'none', cell: (row) => <span class="muted">{row.worker ?? ''}</span> },
          ]} />
      )}
      {data && <p class="more small muted">{count(data.rows.length)} of {count(data.total)} shown, newest first</p>}
    </Panel>
  );
}

function attemptLink(dataset: string, of: Attempt): string {
  return episodeLink(dataset, of.index, of.has_pictures ? {} : { attempt: of.attempt });
}

/** Pictures are those of the episode, or of the attempt made again; one that failed and was not says why in words. */
function Tile(props: { of: Attempt; dataset: string }) {
  const one = props.of;
  const pictured = one.has_pictures ? props.dataset : one.replay;
  const good = one.outcome === 'success';
  return (
    <a class="tile" href={attemptLink(props.dataset, one)} data-tile={good ? 'ok' : 'failed'}>
      {pictured
        ? <img loading="lazy" decoding="async" alt="" src={`${root}/datasets/${pictured}/episodes/${one.index}/strip.webp`} />
        : <span class="words secondary">{one.reason ?? one.outcome}</span>}
      <span class="caption"><span>#{one.index}{one.attempt > 0 && `.${one.attempt}`} {one.task} {one.target}</span><span class={good ? 'good' : 'bad'}>{good ? '✓' : `✕ ${one.outcome}`}</span></span>
    </a>
  );
}
