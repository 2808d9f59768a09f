// SPDX-License-Identifier: Apache-2.0
// How often it succeeds, which rollouts failed, and whether one checkpoint is better than another on the same scenes.
import type { ComponentChildren } from 'preact';
import { useRef } from 'preact/hooks';
import { getJson, query, useResource, type Resource } from '../core/api';
import { evaluateInScenesOf } from '../core/commands';
import { useLive } from '../core/connection';
import { count, fixed, none, number, percent, probability, short } from '../core/format';
import { useKeys } from '../core/keys';
import { link, parameter, setParameters } from '../core/router';
import { episodeLink, listed, nameOf, refreshed, sourcesOf, useChosen } from '../core/sources';
import type { Diff, Eval, EvalRow, EvalRows, Pair, TaskReport } from '../core/types';
import { Chip, Command, Empty, Facts, Failed, Figure, Loaded, Pager, Panel, Segments, Select, Skeleton, StateChip } from '../parts/basics';
import { Difference, Dots } from '../parts/dots';

export function Evaluation() {
  const id = listed(useChosen('eval'))[0] ?? null;
  const first = useResource<Eval>(id && `/evals/${id}`, { every: 10000 });
  const live = useLive<Eval>(id ? 'eval' : null, { id: id ?? '' }, 1);
  if (!id) return <Panel><Empty title="No evaluation here yet" command="etude eval --checkpoint run/checkpoints/latest.safetensors --episodes 60 --out eval">Rollouts on scenes that training never saw, with the newest checkpoint:</Empty></Panel>;
  return <Loaded of={{ ...first, data: live?.id === id ? live : first.data }}>{(data) => <Content key={data.id} of={data} />}</Loaded>;
}

/** Rollouts that there will be: none of scenes that the expert cannot do (--first-draw). */
function wanted(of: Eval): number {
  return of.episodes - Number(of.scenes?.invalid ?? 0);
}

/** Rollouts that are still to come: none of an evaluation that is over, which may have given some up. */
function ahead(of: Eval): number {
  return of.state === 'finished' ? 0 : Math.max(0, wanted(of) - of.done);
}

function Content(props: { of: Eval }) {
  const { of } = props;
  const [named] = parameter('vs');
  // with itself it has nothing to be compared in
  const versus = named === of.id ? '' : named;
  const s = of.overall.success;
  return (
    <>
      <div class="page-head">
        <StateChip state={of.state} />
        <div class="row" data-eval-summary><Figure large value={of.done ? percent(s.share) : none} label="success" /><span class="secondary">[{fixed(100 * s.low, 1)} {fixed(100 * s.high, 1)}]<br /><span data-figure="successes">{count(s.successes)}</span> of {count(of.overall.n)}{ahead(of) > 0 ? `, ${count(ahead(of))} to go` : of.done < wanted(of) && `, ${count(wanted(of) - of.done)} given up`}</span></div>
        <span class="fill" />
        {of.checkpoint && <Chip>step {count(of.checkpoint.step)}{of.checkpoint.sha256 && <> · <span class="mono">{short(of.checkpoint.sha256)}</span></>}</Chip>}
        {of.run_id ? <a href={link('training', { run: of.run_id })}>run {nameOf(of.run_id)}</a> : <span class="muted">{of.run}</span>}
        <span class="muted">scenes of seed <span class="mono" data-seed>{of.seed}</span></span>
      </div>
      {ahead(of) > 0 && <div class="bar" role="img" aria-label={`${of.done} of ${wanted(of)}`}><div style={{ width: `${(100 * of.done) / Math.max(1, wanted(of))}%` }} /></div>}
      <div class="grid wide">
        <Panel title="Success by task" aside={<span class="small muted">strict judge</span>}><Dots label="Success by task" rows={[...of.per_task, of.overall].map((one) => proportion(one))} /></Panel>
        <Panel title="What else happened"><Reports of={of} /></Panel>
      </div>
      <ByCheckpoint of={of} />
      <Scenes of={of} versus={versus} />
    </>
  );
}

function proportion(one: TaskReport) {
  return { name: one.task, n: one.n, k: one.success.successes, share: one.success.share, low: one.success.low, high: one.success.high };
}

export const mostCompared = 24;

/** Other evaluations, the newest so many; what cannot be read is left out. */
export async function loadEvals(ids: string, signal: AbortSignal): Promise<Eval[]> {
  const all = await Promise.allSettled(ids.split(',').map((id) => getJson<Eval>(`/evals/${id}`, signal)));
  signal.throwIfAborted();
  const [first] = all;
  if (first?.status === 'rejected' && all.every((one) => one.status === 'rejected')) throw first.reason;
  return all.flatMap((one) => (one.status === 'fulfilled' ? [one.value] : []));
}

/** A row with its interval for every evaluation of a checkpoint of this run, by step. */
function ByCheckpoint(props: { of: Eval }) {
  const { of } = props;
  const [task] = parameter('task');
  const those = sourcesOf('eval').filter((one) => one.id !== of.id).slice(0, mostCompared);
  const ids = those.map((one) => one.id).join(',');
  const others = useResource<Eval[]>(of.run_id && ids ? ids : null, { load: loadEvals, ...refreshed(those) });
  if (!of.run_id || !of.checkpoint) return null;
  const step = (one: Eval) => one.checkpoint?.step ?? -1;
  const all = [of, ...(others.data ?? [])].filter((one) => one.run_id === of.run_id && step(one) >= 0).sort((a, b) => step(a) - step(b) || a.name.localeCompare(b.name));
  const rows = all.flatMap((one) => {
    const report = task ? one.per_task.find((part) => part.task === task) : one.overall;
    const twin = all.some((other) => other !== one && step(other) === step(one));
    const name = `step ${count(step(one))}${twin ? ` · ${nameOf(one.id)}` : ''}${one.seed === of.seed ? '' : ' ≠'}`;
    return report ? [{ ...proportion(report), name, link: link('evaluation', { eval: one.id, task }), ...(one === of ? { token: 'accent' } : {}) }] : [];
  });
  return (
    <Panel title={`Success by checkpoint${task ? `, ${task}` : ''}`} aside={<span class="small muted">evaluations of run {nameOf(of.run_id)}; this one in colour{all.some((one) => one.seed !== of.seed) && '; ≠: scenes of another seed'}</span>}>
      <div data-by-checkpoint><Dots label="Success by checkpoint" rows={rows} /></div>
      {all.length < 2 && <><p class="secondary">Another checkpoint of this run, in the same scenes, given the --seed that this one was given:</p><Command text={evaluateInScenesOf(of)} /></>}
    </Panel>
  );
}

function Reports(props: { of: Eval }) {
  const { of } = props;
  return (
    <div class="scroll-x" tabIndex={0} role="group" aria-label="By task">
      <table class="plain" data-reports>
        <thead><tr><th>task</th><th class="num">n</th><th class="num">latched</th><th class="num">violations</th><th class="num">others moved</th>{of.modules.map((name) => <th class="num">{name} cm</th>)}</tr></thead>
        <tbody>{[...of.per_task, of.overall].map((one) => (
          <tr><td>{one.task}</td><td class="num">{one.n}</td><td class="num">{one.success_latched ? percent(one.success_latched.share) : none}</td><td class="num" title={Object.entries(one.violations ?? {}).map(([name, n]) => `${name} ${n}`).join(', ')}>{one.with_violations ?? none}</td><td class="num">{one.with_others_moved ?? none}</td>
            {of.modules.map((name) => <td class="num nowrap" title="all decisions, in brackets those before contact">{number(one.error_cm?.[name], 2)} <span class="muted small">({number(one.error_before_contact_cm?.[name], 2)})</span></td>)}</tr>))}</tbody>
      </table>
    </div>
  );
}

function kind(row: EvalRow): string {
  return row.success ? 'success' : row.success_latched ? 'latched' : 'failure';
}

// cells at once
const mostScenes = 500;

/** The first failure of a listing, or what else it begins with; it stays while others come before it. */
function useFirst(page: Resource<EvalRows>, listing: string, choose: (rows: EvalRow[]) => EvalRow | undefined): EvalRow | undefined {
  const first = useRef<{ of: string; total: number; row: EvalRow | undefined }>({ of: '', total: 0, row: undefined });
  const rows = page.data?.rows ?? [];
  const total = page.data?.total ?? 0;
  // fewer than there were: its folder was made anew
  if (!page.pending && (first.current.of !== listing || total < first.current.total || !first.current.row)) first.current = { of: listing, total, row: choose(rows) };
  else if (!page.pending) first.current.total = total;
  const { row } = first.current;
  return rows.find((one) => one.index === row?.index) ?? row;
}

function Scenes(props: { of: Eval; versus: string }) {
  const { of } = props;
  const [order] = parameter('order', 'failures');
  const [task] = parameter('task');
  const [picked] = parameter('scene');
  const [from] = parameter('from', '0');
  const offset = Number(from) || 0;
  const setSorted = (value: string) => setParameters({ order: value === 'failures' ? null : value, from: null });
  useKeys([{ keys: 'f', does: 'failures first', run: () => setSorted(order === 'failures' ? 'index' : 'failures') }]);
  const listing = `/evals/${of.id}/rows${query({ sort: order, task, offset, limit: mostScenes })}`;
  // also when the rollouts are over: videos and what the policy said are written behind the last of them
  const round = `${of.done} ${of.updated}`;
  const page = useResource<EvalRows>(listing, { round });
  const rows = page.data?.rows ?? [];
  const [total, failed] = [page.data?.total ?? 0, page.data?.failed ?? 0];
  const here = rows.find((one) => String(one.index) === picked);
  const other = useResource<EvalRows>(picked && (page.data || page.error) && !here ? `/evals/${of.id}/rows${query({ index: picked })}` : null, { round });
  const first = useFirst(page, listing, (all) => (failed && order === 'failures' ? all[0] : all.find((one) => !one.success)));
  // of another scene than the one that is picked nothing is shown
  const row = picked ? here ?? (other.pending ? undefined : other.data?.rows[0]) : first;
  const open = ahead(of);
  return (
    <div class="columns main-side">
      <div class="stack">
      <Panel title="Scenes" aside={<><Select label="Task" value={task} options={[['', 'every task'], ...of.per_task.map((one) => [one.task, one.task] as const)]} choose={(value) => setParameters({ task: value, from: null })} /><Segments label="Order" value={order} options={[['failures', 'failures first'], ['index', 'by number']]} choose={setSorted} /></>}>
        {page.error && <Failed problem={page.error} retry={page.reload} />}
        <p class="small secondary" data-failed={failed}>{failed ? `${count(failed)} of ${count(total)} failed` : total ? `None of ${count(total)} failed.` : 'No rollout is finished yet.'} <span class="muted">✕ failed · ◐ succeeded, but not strictly · filled: success</span></p>
        <div class="seeds" role="group" aria-label="Rollouts">
          {rows.map((one) => (
            <a key={one.index} href={link('evaluation', { eval: of.id, ...current('vs', 'task', 'order', 'from'), scene: one.index })} data-outcome={kind(one)} data-scene={one.index} title={`#${one.index} ${one.task} ${one.target}: ${one.outcome}`}
              aria-label={`${one.index} ${one.task} ${one.target} ${one.outcome}`} {...(row === one ? { 'aria-current': 'true' as const } : {})}>{kind(one) === 'failure' ? '✕' : kind(one) === 'latched' ? '◐' : ''}</a>))}
          {Array.from({ length: task || offset + rows.length < total ? 0 : Math.max(0, Math.min(mostScenes - rows.length, open)) }, () => <span class="open" aria-hidden="true" />)}
        </div>
        <Pager what="scenes" from={offset} shown={rows.length} total={total} size={mostScenes} go={(next) => setParameters({ from: next || null })} />
      </Panel>
      <Compare of={of} versus={props.versus} />
      </div>
      {row ? <Scene of={of} row={row} /> : picked ? <NoScene picked={picked} of={other} /> : <Panel title="Scene"><p class="muted">Choose a scene to see its rollout.</p></Panel>}
    </div>
  );
}

/** In place of a scene that is picked: it is under way, cannot be had, or is not there. */
function NoScene(props: { picked: string; of: Resource<EvalRows> }) {
  const { picked, of } = props;
  return (
    <Panel title={`Scene ${picked}`}>
      {of.error ? <Failed problem={of.error} retry={of.reload} /> : of.data && !of.pending ? <p class="secondary" data-no-scene>Scene {picked} is not rolled out.</p> : <Skeleton height={240} />}
    </Panel>
  );
}

function current(...names: string[]): Record<string, string> {
  return Object.fromEntries(names.map((name) => [name, parameter(name)[0]]));
}

function Scene(props: { of: Eval; row: EvalRow }) {
  const { of, row } = props;
  return (
    <Panel title={`Scene ${row.index}`} aside={<>{row.insight && <a href={link('inside', { run: of.run_id, eval: of.id, scene: row.index })}>What the policy said</a>}{of.dataset && <a href={episodeLink(of.dataset, row.index)}>Step by step</a>}</>}>
      {row.video && <div class="picture"><video key={row.video} src={row.video} controls muted playsInline preload="metadata" aria-label={`Rollout ${row.index}`} /></div>}
      <p><span class={row.success ? 'good' : 'bad'}>{row.success ? '✓' : '✕'} {row.outcome}</span> <q>{row.instruction}</q></p>
      <Facts rows={[
        ['task', `${row.task} ${row.target}${row.reference ? ` ${row.reference}` : ''}`],
        ...(row.robot ? [['robot', row.robot] as [string, string]] : []),
        ['latched', row.success_latched ? 'yes' : 'no'],
        ...(row.violations.length ? [['violations', row.violations.join(', ')] as [string, string]] : []),
        ...(row.disturbed_objects.length ? [['moved others', row.disturbed_objects.join(', ')] as [string, string]] : []),
        ['length', `${count(row.steps)} steps, ${count(row.decisions)} decisions`],
        ...Object.entries(row.error_cm).map(([name, value]) => [name, `${number(value, 2)} cm, before contact ${number(row.error_before_contact_cm[name], 2)} cm`] as [string, string]),
        ...(row.first_bad ? [['first off', <FirstOff of={of} row={row} bad={row.first_bad} />] as [string, ComponentChildren]] : []),
        ['seed', <span class="mono">{row.seed}</span>],
      ]} />
    </Panel>
  );
}

/** Where to look first: the decision at which a module was off for the first time. */
function FirstOff(props: { of: Eval; row: EvalRow; bad: NonNullable<EvalRow['first_bad']> }) {
  const { of, row, bad } = props;
  const words = `${bad.module} by ${number(bad.error_cm, 2)} cm at decision ${bad.decision + 1}`;
  const there = row.insight ? link('inside', { run: of.run_id, eval: of.id, scene: row.index, decision: bad.decision, module: bad.module })
    : of.dataset ? episodeLink(of.dataset, row.index, { step: bad.step }) : null;
  return <span data-first-bad={bad.module}>{there ? <a href={there}>{words}</a> : words} <span class="muted">over {number(bad.over_cm)} cm</span></span>;
}

function Compare(props: { of: Eval; versus: string }) {
  const { of, versus } = props;
  const others = sourcesOf('eval').filter((one) => one.id !== of.id);
  const other = useResource<Eval>(versus ? `/evals/${encodeURIComponent(versus)}` : null, { every: 10000 });
  const pair = useResource<Pair>(versus ? `/evals/${of.id}/pair/${versus}` : null, { round: `${of.done} ${other.data?.done}` });
  const diff = useDiff(versus ? of.id : null, versus);
  if (!others.length) return <Panel title="Compare"><p class="secondary">With a second evaluation, given the --seed that this one was given, both are compared scene by scene:</p><Command text={evaluateInScenesOf(of)} /></Panel>;
  return (
    <Panel title="Compare" aside={<Select label="with" showLabel value={versus} options={[['', 'choose an evaluation'], ...others.map((one) => [one.id, nameOf(one.id)] as const)]} choose={(id) => setParameters({ vs: id })} />}>
      {!versus && <p class="secondary">A is {nameOf(of.id)}. Choose B: scenes that both rolled out are compared one by one.</p>}
      {pair.error && <div class="problem" role="alert"><h2>{pair.error.title}</h2><p>{pair.error.detail}</p></div>}
      {pair.data && !pair.pending && <Paired of={pair.data} a={of} b={versus} />}
      {other.data && !other.pending && <Runs a={of} b={other.data} />}
      {diff.data && !diff.pending && <Differences title="What else differs in the scenes" of={diff.data} />}
    </Panel>
  );
}

function Paired(props: { of: Pair; a: Eval; b: string }) {
  const { of } = props;
  const apart = of.low > 0 ? 'A is better' : of.high < 0 ? 'B is better' : 'not told apart';
  const differing = of.rows.filter((one) => one.a !== one.b);
  return (
    <div class="grid" data-pair>
      <div class="stack">
        <p><b class="figure">{of.difference >= 0 ? '+' : ''}{fixed(100 * of.difference, 1)}</b> points, A − B [{fixed(100 * of.low, 1)} {fixed(100 * of.high, 1)}] · {apart}</p>
        <Difference value={of.difference} low={of.low} high={of.high} />
        <p class="secondary small">{count(of.n)} shared scenes{of.unpaired > 0 && `, ${count(of.unpaired)} in one only`} · exact McNemar p = {probability(of.p)}</p>
      </div>
      <div class="scroll-x" tabIndex={0} role="group" aria-label="Pairs by task">
        <table class="plain">
          <thead><tr><th>task</th><th class="num">n</th><th class="num">both</th><th class="num">only A</th><th class="num">only B</th><th class="num">neither</th><th class="num">A − B</th></tr></thead>
          <tbody>{[...of.per_task, { ...of, task: 'overall' }].map((one) => <tr><td>{one.task}</td><td class="num">{one.n}</td><td class="num">{one.both}</td><td class="num">{one.only_a}</td><td class="num">{one.only_b}</td><td class="num">{one.neither}</td><td class="num">{fixed(100 * one.difference, 1)}</td></tr>)}</tbody>
        </table>
      </div>
      <div>
        <h2>Scenes that differ</h2>
        {differing.length ? <ul class="row">{differing.slice(0, 60).map((one) => <li><a class="button" href={link('evaluation', { eval: one.a ? props.b : props.a.id, vs: one.a ? props.a.id : props.b, scene: one.index })}>#{one.index} {one.task} {one.target}: only {one.a ? 'A' : 'B'}</a></li>)}</ul> : <p class="secondary">None: both succeed and fail on the same scenes.</p>}
      </div>
    </div>
  );
}

function useDiff(a: string | null, b: string | null) {
  return useResource<Diff>(a && b ? `/diff?a=${encodeURIComponent(a)}&b=${encodeURIComponent(b)}` : null);
}

/** What changed between the configs of the runs whose checkpoints these are. */
function Runs(props: { a: Eval; b: Eval }) {
  const { a, b } = props;
  const two = a.run_id !== b.run_id;
  const diff = useDiff(two ? a.run_id : null, two ? b.run_id : null);
  const kind = !a.run_id || !b.run_id ? 'unknown' : two ? 'two' : 'one';
  return (
    <div class="stack" data-runs={kind}>
      {kind === 'unknown' && <p class="secondary">The run of {a.run_id ? 'B' : 'A'} is not below the folders of this gateway: its config cannot be compared.</p>}
      {kind === 'one' && <p class="secondary">Both are of run <a href={link('training', { run: a.run_id })}>{nameOf(a.run_id)}</a>: steps {count(a.checkpoint?.step)} and {count(b.checkpoint?.step)} of one config.</p>}
      {kind === 'two' && <p class="secondary">A is of run <a href={link('training', { run: a.run_id })}>{nameOf(a.run_id)}</a>, B of <a href={link('training', { run: b.run_id })}>{nameOf(b.run_id)}</a> (<a href={link('training', { run: `${a.run_id},${b.run_id}` })}>both curves</a>).</p>}
      {diff.error && <Failed problem={diff.error} />}
      {diff.data && !diff.pending && <Differences title="What changed between the runs" of={diff.data} />}
    </div>
  );
}

function Differences(props: { title: string; of: Diff }) {
  const { of } = props;
  return (
    <>
      <h2>{props.title}: {count(of.total)} {of.total === 1 ? 'key' : 'keys'}</h2>
      {of.total > 0 && <div class="scroll-x" tabIndex={0} role="group" aria-label={props.title}><table class="plain" data-diff={props.title}><thead><tr><th>key</th><th>A</th><th>B</th></tr></thead><tbody>{of.keys.slice(0, 40).map((one) => <tr><td class="mono">{one.key}</td><td class="mono">{JSON.stringify(one.a)}</td><td class="mono">{JSON.stringify(one.b)}</td></tr>)}</tbody></table></div>}
    </>
  );
}
