// SPDX-License-Identifier: Apache-2.0
// Does it learn, is it fed, why does a stage stand. Colour is the run, the panel is the module.
import { useEffect, useMemo, useRef, useState } from 'preact/hooks';
import { getBytes, problemOf, query, root, useResource, type Problem, type Resource } from '../core/api';
import { epoch, useLive } from '../core/connection';
import { folderIn } from '../core/commands';
import { clock, count, duration, number, percent } from '../core/format';
import { useKeys } from '../core/keys';
import { readRange, writeRange, type Range } from '../core/range';
import { link, parameter, setParameters } from '../core/router';
import { readSafetensors } from '../core/safetensors';
import { listed, nameOf, sourceOf, sourcesOf, useChosen } from '../core/sources';
import { smooth, split } from '../core/stats';
import { hues } from '../core/theme';
import type { Checkpoints, Curriculum, Run, SeriesKey, State } from '../core/types';
import { Chip, Command, elsewhere, Empty, Failed, Loaded, Panel, Segments, Select, Skeleton, StateChip } from '../parts/basics';
import { Chart, type Line } from '../parts/chart';
import { Marker } from '../parts/marker';
import { Ladder } from './overview';

interface Curve { x: Float64Array; step: Float64Array; min: Float64Array; max: Float64Array; last: Float64Array }
type Curves = Map<string, Curve>;
interface LiveTrain { run: string; state: State; step: number; stage: number; stages: number; stage_name: string; loss: number | null; samples_per_s: number | null; data_wait: number | null; eta_s: number | null }

const axes = [['step', 'step'], ['elapsed', 'time'], ['samples', 'samples']] as const;
type Axis = (typeof axes)[number][0];

interface Asked { curves: Curves | undefined; problem: Problem | undefined; reload: () => void }

async function loadCurves(id: string, keys: string[], options: string, signal: AbortSignal): Promise<Curves> {
  const merged: Curves = new Map();
  for (let i = 0; i < keys.length; i += 32) {
    const part = keys.slice(i, i + 32);
    const { tensors } = readSafetensors(await getBytes(`/runs/${id}/series?keys=${part.map(encodeURIComponent).join(',')}${options}&points=600`, signal));
    for (const key of part) {
      const [x, step, min, max, last] = ['x', 'step', 'min', 'max', 'last'].map((name) => tensors.get(`${key}/${name}`)?.values as Float64Array | undefined);
      if (x && step && min && max && last) merged.set(key, { x, step, min, max, last });
    }
  }
  return merged;
}

/** Grows with each line of metrics, the last ones of a run included, which come with no round step. */
const linesOf = (run: Run | undefined) => (run?.keys ?? []).reduce((sum, one) => sum + one.n, 0);

/** The curves of one run; asked again when it has trained on. What was there stays beside the reason why no more comes. */
function useCurves(run: Run | undefined, keys: string[], axis: Axis, range: Range | null, round: number): Asked {
  const [asked, setAsked] = useState<{ of: string; curves?: Curves; problem?: Problem }>({ of: '' });
  const [again, setAgain] = useState(0);
  const text = keys.join(',');
  const id = run?.id;
  // what came for another run or axis is no curve of this one
  const of = `${id} ${axis}`;
  const generation = epoch.value;
  const wanted = useRef({ keys, stamp: '' });
  wanted.current = { keys, stamp: `${round} ${text}` };
  const goOn = useRef(() => {});
  useEffect(() => {
    if (!id) return;
    const abort = new AbortController();
    const options = `&x=${axis}${range ? `&from=${range[0]}&to=${range[1]}` : ''}`;
    let busy = false;
    let before = '';
    // lines that come faster than curves are read end no load: the newest are asked for when it is through
    const load = async () => {
      if (busy) return;
      busy = true;
      while (!abort.signal.aborted && wanted.current.keys.length && wanted.current.stamp !== before) {
        before = wanted.current.stamp;
        try {
          const curves = await loadCurves(id, wanted.current.keys, options, abort.signal);
          if (!abort.signal.aborted) setAsked({ of, curves });
        } catch (error) {
          if (!abort.signal.aborted) setAsked((old) => ({ ...(old.of === of ? old : {}), of, problem: problemOf(error) }));
        }
      }
      busy = false;
    };
    goOn.current = () => { void load(); };
    goOn.current();
    return () => abort.abort();
  }, [id, axis, range?.[0], range?.[1], generation, again]);
  useEffect(() => goOn.current(), [text, round]);
  const own = asked.of === of ? asked : undefined;
  return { curves: own?.curves, problem: own?.problem, reload: () => setAgain(again + 1) };
}

export function Training() {
  const ids = listed(useChosen('run'));
  if (!ids.length) return <Panel><Empty title="No run here yet" command="etude train --data data --config compact --out run --minutes 10">A run appears with its first line of metrics:</Empty></Panel>;
  return <Runs ids={ids.slice(0, 4)} />;
}

function Runs(props: { ids: string[] }) {
  const [id] = props.ids;
  const first = useResource<Run>(`/runs/${id}`, { every: 5000 });
  // of a run on the bus alone there are no files to ask for
  const here = first.data?.id === id && first.data?.folder !== null;
  const curriculum = useResource<Curriculum>(here ? `/runs/${id}/curriculum` : null, { every: 10000 });
  const checkpoints = useResource<Checkpoints>(here ? `/runs/${id}/checkpoints` : null, { every: 20000 });
  const live = useLive<LiveTrain>('train', { run: id }, 1);
  return <Loaded of={first} height={600}>{(run) => <Content key={run.id} ids={props.ids} run={run} live={live?.run === run.id ? live : undefined} curriculum={curriculum.data} checkpoints={checkpoints.data} />}</Loaded>;
}

function Content(props: { ids: string[]; run: Run; live: LiveTrain | undefined; curriculum: Curriculum | undefined; checkpoints: Checkpoints | undefined }) {
  const { run } = props;
  const axis = parameter('x', 'step')[0] as Axis;
  const [scale, setScale] = parameter('y', 'lin');
  const [width, setWidth] = parameter('smooth', '0');
  const [rangeText] = parameter('range');
  const range = useMemo(() => readRange(rangeText), [rangeText]);
  const zoom = (next: Range | null, replace?: boolean) => setParameters({ range: next && next[0] < next[1] ? writeRange(next) : null }, replace);
  useKeys([
    { keys: 'y', does: 'axis linear or logarithmic', run: () => setScale(scale === 'lin' ? 'log' : 'lin') },
    { keys: 's', does: 'smoothing', run: () => setWidth(width === '0' ? '200' : '0') },
  ]);
  const step = props.live?.step ?? run.step;
  // of a run on the bus alone there are no lines to write
  const filed = props.ids.filter((id) => id === run.id || typeof sourceOf(id)?.folder === 'string');
  const shared: Shared = { axis, log: scale === 'log', smoothing: Number(width), range, zoom, bands: bands(props.curriculum, run, axis), marks: marks(props.checkpoints, run, axis) };
  return (
    <>
      <div class="page-head">
        <StateChip state={props.live?.state ?? run.state} />
        <p data-run-summary>step <b>{count(step)}</b>{run.steps ? ` of ${count(run.steps)}` : ''} · stage <b>{props.live?.stage ?? run.stage} of {run.stages}</b> {props.live?.stage_name ?? run.stage_name} · {duration(run.elapsed_s)}{(props.live?.eta_s ?? run.eta_s) !== null && ` · ${duration(props.live?.eta_s ?? run.eta_s)} left`}{run.episodes !== null && ` · ${count(run.episodes)} episodes`}</p>
        <span class="fill" />
        <Segments label="Horizontal axis" value={axis} options={axes} choose={(value) => { setParameters({ x: value === 'step' ? null : value, range: null }); }} />
        <Segments label="Vertical axis" value={scale} options={[['lin', 'lin'], ['log', 'log']]} choose={(value) => setScale(value)} />
        <Select label="Smoothing" value={width} options={[['0', 'not smoothed'], ['100', 'over 100 steps'], ['200', 'over 200 steps'], ['500', 'over 500 steps'], ['1000', 'over 1,000 steps']]} choose={(value) => setWidth(value)} />
        {range && <button type="button" class="button" data-all onClick={() => zoom(null)}>All of the axis</button>}
        {run.folder !== null && <a class="button" href={`${root}/runs/${run.id}/series.csv${query({ run: filed.slice(1) })}`} download={`${filed.map(nameOf).join('-')}.csv`}>CSV</a>}
      </div>
      <Compare ids={props.ids} />
      {run.end?.cause === 'failed' && (props.live?.state ?? run.state) === 'failed' && <div class="problem" role="alert"><h2>The run ended with an error at step {count(run.end.step)}</h2><p>Checkpoint {count(run.checkpoint_step)} stands. See the <a href={link('logs', { level: 'warn' })}>logs</a>, then go on from there:</p><Command text={`etude train --data DATA --out ${folderIn(run, 'RUN')} --resume`} /></div>}
      {props.curriculum && <Panel title="Curriculum"><Ladder stages={props.curriculum.stages} /><Reasons of={props.curriculum} /></Panel>}
      <Goals of={run} />
      {!run.keys.length ? <NoCurves of={run} step={step} /> : <Charts ids={props.ids} run={run} round={linesOf(run)} shared={shared} />}
    </>
  );
}

/** Nothing is drawn: the files are elsewhere, or there is nothing in them yet. */
function NoCurves(props: { of: Run; step: number }) {
  const { of } = props;
  if (of.folder === null) return <Panel><div data-elsewhere><Empty title="No curves here" command="etude dashboard --dir FOLDER">{elsewhere('run')} A gateway on the machine that has them draws its curves:</Empty></div></Panel>;
  const episodes = of.episodes !== null ? ` ${count(of.episodes)} episodes are there so far.` : '';
  return <Panel><Empty title="Waiting for data">{props.step < 50 ? `The first line of metrics comes with step 50.${episodes}` : `No line of metrics has been read yet.${episodes}`}</Empty></Panel>;
}

function Compare(props: { ids: string[] }) {
  const others = sourcesOf('run').filter((one) => !props.ids.includes(one.id));
  if (props.ids.length < 2 && !others.length) return null;
  const set = (ids: string[]) => setParameters({ run: ids.join(',') });
  return (
    <div class="row">
      {props.ids.map((id, i) => (
        <span class="chip">{props.ids.length > 1 && <Marker of={i} token={hues[i]!} />}<span class="text">{nameOf(id)}</span>
          {props.ids.length > 1 && <button type="button" class="button plain" aria-label={`remove ${nameOf(id)}`} onClick={() => set(props.ids.filter((one) => one !== id))}>✕</button>}
        </span>))}
      {others.length > 0 && props.ids.length < 4 && <Select label="Compare with" value="" options={[['', 'compare with…'], ...others.map((one) => [one.id, nameOf(one.id)] as const)]} choose={(id) => { if (id) set([...props.ids, id]); }} />}
    </div>
  );
}

function Reasons(props: { of: Curriculum }) {
  const ended = props.of.stages.filter((one) => one.reason);
  if (!ended.length) return null;
  return (
    <ul class="small" data-advances>
      {ended.map((one) => <li><span class={one.cause === 'goal' ? 'good' : 'warn'}>{one.cause === 'goal' ? '✓' : '▲'} {one.stage} {one.name}</span> <span class="secondary">ended at {count(one.to_step)} by {one.cause}: {one.reason}</span></li>)}
    </ul>
  );
}

function Goals(props: { of: Run }) {
  if (!props.of.goals.length) return null;
  return (
    <section class="goals" aria-label="Goals of the modules">
      {props.of.goals.map((one) => (
        <div class="panel goal" data-goal={one.module}>
          <h2>{one.module}</h2>
          <p><span class="figure">{number(one.value, 2)}</span> <span class="muted small">{one.unit === '-' ? 'share wrong' : one.unit}</span></p>
          <p class="small">{one.reached === null ? <span class="muted">goal {number(one.goal)}</span> : one.reached ? <span class="good">✓ goal {number(one.goal)}</span> : <span class="warn">{one.value !== null ? `${number(one.value / one.goal, 2)} × ` : ''}goal {number(one.goal)}</span>}</p>
        </div>))}
    </section>
  );
}

interface Shared { axis: Axis; log: boolean; smoothing: number; range: Range | null; zoom: (range: Range | null, replace?: boolean) => void; bands: { from: number; to: number; label: string }[]; marks: { x: number; token: string; glyph: string }[] }

function bands(curriculum: Curriculum | undefined, run: Run, axis: Axis): Shared['bands'] {
  if (axis !== 'step' || !curriculum) return [];
  return curriculum.stages.filter((one) => one.from_step !== null).map((one) => ({ from: one.from_step!, to: one.to_step ?? run.step, label: one.name }));
}

function marks(checkpoints: Checkpoints | undefined, run: Run, axis: Axis): Shared['marks'] {
  if (axis !== 'step') return [];
  return [
    ...(checkpoints?.checkpoints ?? []).filter((one) => one.step !== null).map((one) => ({ x: one.step!, token: one.channels.includes('best') ? 'accent' : 'muted', glyph: one.channels.includes('best') ? '★' : '▾' })),
    ...run.lives.slice(1).map((one) => ({ x: one.from_step, token: 'warn', glyph: '↻' })),
  ];
}

const [rateKey, waitKey] = ['train/samples_per_second', 'train/data_wait'] as const;
const gradientEnd = '.gradient';
const units: Record<string, string> = { cm: 'cm', px: 'px', deg: '°', share: 'share', s: 's', '1/s': '1/s' };

function Charts(props: { ids: string[]; run: Run; round: number; shared: Shared }) {
  const { run, ids, shared } = props;
  const asked = useCurves(run, run.keys.map((one) => one.key), shared.axis, shared.range, props.round);
  const others = useOthers(ids.slice(1), shared);
  const problem = asked.problem && <Failed problem={asked.problem} retry={asked.reload} />;
  if (!asked.curves) return problem ?? <Skeleton height={480} />;
  // each with the colour and shape that its name has above, also while the curves of one before it are not there
  const runs = [{ id: run.id, r: 0, curves: asked.curves }, ...others.flatMap(({ id, asked: { curves } }) => (curves ? [{ id, r: ids.indexOf(id), curves }] : []))];
  // what any of the runs has: modules come with their stage, and configs differ
  const keys = [...new Map([run, ...others.flatMap((one) => one.run.data ?? [])].reverse().flatMap((one) => one.keys.map((key) => [key.key, key] as const))).values()];
  const lines = (entries: { key: SeriesKey; label: string; dash?: boolean; points?: boolean }[], smoothable = true): Line[] => runs.flatMap(({ id, r, curves }) => entries.flatMap(({ key, label, dash, points }) => {
    const curve = curves.get(key.key);
    if (!curve) return [];
    const name = runs.length > 1 ? `${nameOf(id)}${entries.length > 1 ? ` ${label}` : ''}` : label;
    const token = runs.length > 1 || entries.length < 2 ? hues[r]! : entries.length > 2 ? hues[entries.findIndex((one) => one.key === key) % hues.length]! : entries[0]!.key === key ? 'target' : 'hand';
    const line: Line = { label: name, token, x: curve.x, values: curve.last as unknown as (number | null)[], min: curve.min as unknown as number[], max: curve.max as unknown as number[], ...(dash ? { dash } : {}), ...(points ? { points } : {}), ...(runs.length > 1 ? { marker: r } : {}) };
    if (!smoothable || !shared.smoothing || points) return [line];
    return [{ ...line, faint: true, label: `${name} raw` }, { ...line, values: smooth(curve.step, line.values, shared.smoothing), min: undefined, max: undefined }];
  }));
  const find = (text: string) => keys.find((one) => one.key === text);
  const parts = runs.flatMap(({ id, r, curves }): Line[] => {
    const [rate, wait] = [curves.get(rateKey), curves.get(waitKey)];
    if (!rate || !wait) return [];
    const { x, part, rest } = split(rate, wait);
    const name = runs.length > 1 ? `${nameOf(id)} ` : '';
    const line = (label: string, token: string, values: number[], below: number[]): Line => ({ label: name + label, token, x, values, base: below, ...(runs.length > 1 ? { marker: r } : {}) });
    return [line('compute', runs.length > 1 ? hues[r]! : 'target', rest, x.map(() => 0)), { ...line('data', runs.length > 1 ? hues[r]! : 'hand', part, rest), dash: true }];
  });
  const common = { sync: 'training', bands: shared.bands, marks: shared.marks, range: shared.range, zoom: shared.zoom, log: shared.log, xLabel: shared.axis, ...(shared.axis === 'elapsed' ? { xFormat: duration } : {}) };
  const loss = [find('train/loss') && { key: find('train/loss')!, label: 'train' }, find('valid/loss') && { key: find('valid/loss')!, label: 'valid', points: true, dash: true }].filter(Boolean) as { key: SeriesKey; label: string; points?: boolean }[];
  const modules = [...run.modules];
  for (const { module } of keys) if (module !== null && !modules.includes(module)) modules.push(module);
  const gradients = keys.filter((one) => one.kind === 'train' && one.name.endsWith(gradientEnd)).map((key, i) => ({ key, label: key.module ?? '', dash: i >= hues.length }));
  const running = keys.filter((one) => one.kind === 'train' && one.module === null && one.name !== 'loss' && one.name !== 'stage' && !(parts.length && (one.key === rateKey || one.key === waitKey)));
  return (
    <>
      {problem}
      {others.map(({ run: { error, reload } }) => error && <Failed problem={error} retry={reload} />)}
      {others.map(({ asked: { problem: reason, reload } }) => reason && <Failed problem={reason} retry={reload} />)}
      <Panel label="Loss"><Chart title="Loss" lines={lines(loss)} height={220} {...common} note={shared.range ? 'zoomed; double click or 0 for all' : 'drag, or + and -, to zoom'} /></Panel>
      <h2>Validation</h2>
      <div class="grid narrow charts">
        {modules.map((module) => {
          const own = keys.filter((one) => one.kind === 'valid' && one.module === module);
          const byUnit = [...new Set(own.map((one) => one.unit))];
          const goal = run.goals.find((one) => one.module === module);
          return byUnit.map((unit) => {
            const entries = own.filter((one) => one.unit === unit).map((key) => ({ key, label: key.name.slice(module.length + 1), points: true }));
            // a goal of an accuracy is the share that may be wrong
            const held = goal && entries.some((one) => one.key.key === goal.key) ? (goal.unit === '-' ? 1 - goal.goal : goal.goal) : null;
            return <Panel><Chart title={`${module} ${unit === 'share' ? entries.map((one) => one.label).join(', ') : ''}`.trim()} unit={units[unit ?? ''] ?? ''} lines={lines(entries)} goal={held} {...common} /></Panel>;
          });
        })}
      </div>
      <h2>Losses of the modules</h2>
      <div class="grid narrow charts">
        {modules.map((module) => {
          const entries = keys.filter((one) => one.kind === 'train' && one.module === module && !one.name.endsWith(gradientEnd)).map((key) => ({ key, label: key.name.slice(module.length + 1), dash: key.name.endsWith('.attention') })).sort((a, b) => (a.label === 'decode' ? -1 : b.label === 'decode' ? 1 : 0));
          return entries.length > 0 && <Panel><Chart title={`${module} loss`} lines={lines(entries)} {...common} /></Panel>;
        })}
      </div>
      <h2>Running</h2>
      <div class="grid narrow charts">
        {parts.length > 0 && <Panel><Chart title="samples per second" unit="1/s" lines={parts} {...common} note="compute, and above it what waiting for data takes" /></Panel>}
        {gradients.length > 0 && <Panel><Chart title="gradient norm by part" lines={lines(gradients)} {...common} note="before clipping" /></Panel>}
        {running.map((key) => <Panel><Chart title={key.name.replaceAll('_', ' ')} unit={units[key.unit ?? ''] ?? ''} lines={lines([{ key, label: runs.length > 1 ? '' : 'train' }], !/rate|stage/.test(key.name))} {...common} /></Panel>)}
      </div>
      <p class="small muted">Newest line {clock(run.updated)}{run.nulls.length > 0 && <Chip tone="bad">{count(run.nulls_total)} values not finite</Chip>}{run.torn && ' · the last line was not whole and was left out'}{run.data_wait !== null && ` · waits for data ${percent(run.data_wait, 2)}`}{run.checkpoint_step === null ? '' : ` · checkpoint ${count(run.checkpoint_step)}`}</p>
    </>
  );
}

/** The runs beside the first, with the curves of what they themselves have, as they train on. */
function useOthers(ids: string[], shared: Shared): { id: string; run: Resource<Run>; asked: Asked }[] {
  // at most three beside the first; always three hooks, so that their number does not change
  const slots = [0, 1, 2].map((i) => {
    const id = ids[i];
    const run = useResource<Run>(id ? `/runs/${id}` : null, { every: 5000 });
    const data = run.pending ? undefined : run.data;
    return { id, run, asked: useCurves(data, (data?.keys ?? []).map((one) => one.key), shared.axis, shared.range, linesOf(data)) };
  });
  return slots.flatMap(({ id, run, asked }) => (id ? [{ id, run, asked }] : []));
}
