// SPDX-License-Identifier: Apache-2.0
// Is the data balanced and sound: episodes by any filter, how they are distributed, which are odd.
import { useEffect, useState } from 'preact/hooks';
import { query, useResource } from '../core/api';
import { folderIn } from '../core/commands';
import { useCursors } from '../core/cursors';
import { bytes, count, duration, fixed, none, number } from '../core/format';
import { useFollow, useHeld } from '../core/held';
import { parameter, setParameters } from '../core/router';
import { episodeLink, useChosen } from '../core/sources';
import { mostTicks, readTicks, writeTicks } from '../core/ticks';
import type { Dataset, Episodes, Summary } from '../core/types';
import { ActionButton } from '../parts/actions';
import { Bars, Chip, Command, Empty, Failed, Loaded, Pager, Panel, Search, Select, StateChip } from '../parts/basics';
import { Histogram } from '../parts/chart';
import { Places } from '../parts/places';
import { Table } from '../parts/table';

const filters = ['task', 'target', 'robot', 'outcome', 'split', 'worker', 'key', 'words', 'steps', 'odd'] as const;

function useFilter(): Record<string, string> {
  return Object.fromEntries(filters.map((name) => [name, parameter(name)[0]]).filter(([, value]) => value));
}

export function DatasetPage() {
  const id = useChosen('dataset');
  const dataset = useResource<Dataset>(id && `/datasets/${id}`, { every: 10000 });
  if (!id) return <Panel><Empty title="No dataset here yet" command="etude collect deploy/campaigns/quickstart.yaml --out data">Episodes appear with the first commit:</Empty></Panel>;
  return <Loaded of={dataset}>{(data) => <Content key={data.id} of={data} reload={dataset.reload} />}</Loaded>;
}

function Content(props: { of: Dataset; reload: () => void }) {
  const { of } = props;
  const filter = useFilter();
  const text = query(filter);
  // a key that was saved may be the one that is filtered by
  const [saved, setSaved] = useState(0);
  const summary = useResource<Summary>(`/datasets/${of.id}/summary${text}`, { round: `${of.episodes} ${of.known} ${saved}` });
  const stats = of.statistics as { steps?: number; seconds?: number; frames?: number };
  return (
    <>
      <div class="page-head">
        <StateChip state={of.state} />
        <p data-dataset-summary><b>{count(of.episodes)}</b>{of.episodes < of.total && ` of ${count(of.total)}`} episodes · <b>{duration(stats.seconds)}</b> · <b>{count(stats.frames)}</b> pictures{of.bytes > 0 && <> · <b>{bytes(of.bytes)}</b></>}</p>
        {of.unreadable > 0 && <Chip tone="bad" title={of.unreadable_files.map((one) => `#${one.index}: ${one.reason}`).join('\n')}>{of.unreadable} of {of.episodes} files unreadable</Chip>}
        {of.role === 'rollouts' && <Chip>rollouts</Chip>}
      </div>
      <Filters summary={summary.data} keys={of.keys} />
      <div class="columns main-side">
        <Rows of={of} text={text} saved={saved} reload={() => { setSaved((n) => n + 1); props.reload(); }} />
        <div class="stack">
          <Loaded of={summary}>{(data) => <Distributions of={data} dataset={of} />}</Loaded>
        </div>
      </div>
    </>
  );
}

function Filters(props: { summary: Summary | undefined; keys: string[] }) {
  // names of the unfiltered dataset, so that a choice does not take the others away
  const [names, setNames] = useState<Record<string, string[]>>({});
  const { summary } = props;
  useEffect(() => {
    if (!summary) return;
    setNames((old) => Object.fromEntries((['tasks', 'targets', 'robots', 'outcomes', 'splits', 'workers'] as const).map((kind) => [kind, [...new Set([...(old[kind] ?? []), ...Object.keys(summary[kind])])]])));
  }, [summary]);
  const pick = (name: string, title: string, all: string[] | undefined) => {
    const [value] = parameter(name);
    const options = [['', `any ${title}`], ...[...new Set([...(all ?? []), ...(value ? [value] : [])])].map((one) => [one, one])] as [string, string][];
    return options.length > 2 || value ? <Select label={title} value={value} options={options} choose={(next) => setParameters({ [name]: next })} /> : null;
  };
  const set = filters.filter((name) => parameter(name)[0]);
  return (
    <div class="row" role="search">
      {pick('task', 'task', names['tasks'])}
      {pick('target', 'target', names['targets'])}
      {pick('robot', 'robot', names['robots'])}
      {pick('outcome', 'outcome', names['outcomes'])}
      {pick('split', 'split', names['splits'])}
      {pick('worker', 'worker', names['workers'])}
      {pick('key', 'filter key', props.keys)}
      <Search label="Words of the instruction" value={parameter('words')[0]} change={(value) => setParameters({ words: value }, true)} width={24} />
      <Search label="Steps, 200..400" value={parameter('steps')[0]} change={(value) => setParameters({ steps: value }, true)} width={16} />
      {set.length > 0 && <button type="button" class="button" onClick={() => setParameters(Object.fromEntries(filters.map((name) => [name, null])))}>Clear filters</button>}
    </div>
  );
}

interface Row { index: number; task: string | null; target: string | null; robot: string | null; instruction: string | null; steps: number | null; draws: number | null; odd: number | null; split: string; success: boolean | null; outcome: string | null }

function toRows(answer: Episodes): Row[] {
  const c = answer.columns;
  return c.index.map((index, i) => ({ index, task: c.task[i] ?? null, target: c.target[i] ?? null, robot: c.robot[i] ?? null, instruction: c.instruction[i] ?? null, steps: c.steps[i] ?? null, draws: c.draws[i] ?? null, odd: c.odd[i] ?? null, split: c.split[i] ?? '', success: c.success[i] ?? null, outcome: c.outcome[i] ?? null }));
}

/** Episodes that are ticked, and how to tick; all of it in the address. */
function useTicks(): { ticks: Set<number>; tick: (indices: readonly number[], on: boolean) => void } {
  const [text, setText] = parameter('ticks');
  const ticks = readTicks(text);
  const tick = (indices: readonly number[], on: boolean) => {
    const next = new Set(ticks);
    for (const index of indices) {
      if (on) next.add(index);
      else next.delete(index);
    }
    if (next.size <= mostTicks) setText(writeTicks(next) || null, true);
  };
  return { ticks, tick };
}

/** From ticks to a filter key. */
function Ticked(props: { of: Dataset; shown: number[]; whole: boolean; reload: () => void }) {
  const { ticks, tick } = useTicks();
  const [name, setName] = useState('');
  const good = /^[a-z0-9_][a-z0-9_-]{0,63}$/.test(name);
  const fits = props.whole && new Set([...ticks, ...props.shown]).size <= mostTicks;
  return (
    <div class="row ticked" role="group" aria-label="Ticked episodes">
      <span data-ticked><b>{count(ticks.size)}</b> ticked</span>
      {fits && props.shown.some((index) => !ticks.has(index)) && <button type="button" class="button" onClick={() => tick(props.shown, true)}>Tick all {count(props.shown.length)}</button>}
      {ticks.size > 0 && (
        <>
          <button type="button" class="button" onClick={() => tick([...ticks], false)}>Clear</button>
          <input class="field" type="text" size={14} maxLength={64} aria-label="Name of the filter key" placeholder="filter key" value={name} onInput={(event) => setName(event.currentTarget.value)} />
          <ActionButton label="Save as a key" disabled={!good} done={props.reload} of={{ action: 'mask', dataset: props.of.id, key: name, indices: writeTicks(ticks) }}
            about={`Gives ${ticks.size === 1 ? 'the ticked episode' : `the ${count(ticks.size)} ticked episodes`} the filter key “${name}”${props.of.keys.includes(name) ? ', in place of those that it has' : ''}. While a collector has the dataset, that writes it.`} />
          {name !== '' && !good && <span class="small bad" role="alert">a-z, 0-9, _ and - only</span>}
          {ticks.size >= mostTicks && <span class="small muted">at most {mostTicks} in an address</span>}
        </>
      )}
    </div>
  );
}

// of the table, at once
const mostRows = 200;

function Rows(props: { of: Dataset; text: string; saved: number; reload: () => void }) {
  const { ticks, tick } = useTicks();
  const [sort, setSort] = parameter('sort', '-index');
  const listing = `/datasets/${props.of.id}/episodes${props.text}${props.text ? '&' : '?'}sort=${sort}&limit=${mostRows}`;
  const page = useCursors(listing);
  const { held, setHeld } = useHeld(props.of.episodes, listing);
  // again also when files were read that had not been, and not for each new episode
  const first = useResource<Episodes>(`${listing}${page.at ? `&before=${encodeURIComponent(page.at)}` : ''}`, { round: `${held} ${props.of.episodes - props.of.known} ${props.saved}` });
  const data = first.data;
  useFollow(data?.total === 0, props.of.episodes, { held, setHeld });
  const fresh = data?.total === 0 ? 0 : props.of.episodes - held;
  const rows = data ? toRows(data) : [];
  return (
    <Panel title="Episodes" flush aside={
      <>
        {fresh > 0 && <button type="button" class="button pill" onClick={() => { setHeld(props.of.episodes); page.first(); }}>+{fresh} ▲</button>}
        {data && <span class="small muted" data-total>{count(data.total)}{data.total !== data.all && ` of ${count(data.all)}`}{data.known < data.all && `, ${count(data.known)} read so far`}</span>}
      </>}>
      {first.error && <Failed problem={first.error} retry={first.reload} />}
      {data && !data.total && <Empty title={data.all ? 'No episode fits these filters' : 'The first episode is under way'}>{data.all ? `${count(data.all)} are there without them.` : 'Episodes appear here when they are committed.'}</Empty>}
      {rows.length > 0 && <Ticked of={props.of} shown={rows.map((row) => row.index)} whole={data?.next === null && !page.depth} reload={props.reload} />}
      {rows.length > 0 && (
        <Table key={page.depth} label="Episodes" tick={(row) => tick([row.index], !ticks.has(row.index))} rows={rows} id={(row) => row.index} height={960} link={(row) => episodeLink(props.of.id, row.index)} sort={sort} setSort={(value) => setSort(value)}
          columns={[
            { key: 'tick', title: 'tick', width: '4ch', control: true, cell: (row) => <label class="tick"><input type="checkbox" checked={ticks.has(row.index)} disabled={!ticks.has(row.index) && ticks.size >= mostTicks} aria-label={`tick episode ${row.index}`} onChange={(event) => tick([row.index], event.currentTarget.checked)} /></label> },
            { key: 'index', title: '#', width: '6ch', sort: 'index', card: 'title', cell: (row) => row.index },
            ...(props.of.role === 'rollouts' ? [{ key: 'outcome', title: 'outcome', width: '10ch', cell: (row: Row) => row.success === null ? none : <span class={row.success ? 'good' : 'bad'}>{row.success ? '✓' : '✕'} {row.outcome}</span> }] : []),
            { key: 'task', title: 'task', width: 'minmax(84px, 1fr)', cell: (row) => row.task ?? none },
            { key: 'target', title: 'target', width: 'minmax(64px, 1fr)', cell: (row) => row.target ?? none },
            ...(((props.of.spec as { robots?: string[] }).robots?.length ?? 1) > 1 ? [{ key: 'robot', title: 'robot', width: '7ch', cell: (row: Row) => row.robot ?? none }] : []),
            { key: 'instruction', title: 'instruction', width: 'minmax(130px, 3fr)', card: 'long', cell: (row) => <span class="secondary" title={row.instruction ?? ''}>{row.instruction ?? none}</span> },
            { key: 'steps', title: 'steps', width: '6ch', number: true, sort: 'steps', cell: (row) => count(row.steps) },
            { key: 'draws', title: 'draws', width: '6ch', number: true, sort: 'draws', cell: (row) => count(row.draws) },
            { key: 'odd', title: 'odd', width: '6ch', number: true, sort: 'odd', cell: (row) => fixed(row.odd, 1) },
            { key: 'split', title: 'split', width: '6ch', cell: (row) => <span class="muted">{row.split}</span> },
          ]} />
      )}
      {data && <Pager what="episodes" from={page.depth * mostRows} shown={rows.length} total={data.total} size={mostRows} go={(from) => { if (from < page.depth * mostRows) page.back(); else if (data.next && !first.pending) page.next(data.next); }} />}
      {rows.length > 0 && <div class="more"><Command text={`etude dataset info ${folderIn(props.of, 'DATASET')}`} /></div>}
    </Panel>
  );
}

function Distributions(props: { of: Summary; dataset: Dataset }) {
  const { of } = props;
  if (!of.total) return null;
  const tasks = [...new Set(of.matrix.map((one) => one.task))];
  const targets = [...new Set(of.matrix.map((one) => one.target))];
  // expected of the whole dataset; so many of it are there
  const total = (values: (number | null | undefined)[]) => values.reduce<number>((sum, value) => sum + (value ?? 0), 0);
  const there = total(of.matrix.map((one) => one.count)) / (total(of.matrix.map((one) => one.expected)) || 1);
  return (
    <>
      <Panel title="Places of the targets at the start" aside={<span class="small muted">metres</span>}><Places of={of.places} dataset={props.dataset.id} /></Panel>
      <Panel title="Task and target">
        <div class="scroll-x" tabIndex={0} role="group" aria-label="Episodes by task and target">
          <table class="plain" data-task-target>
            <thead><tr><th>target</th>{tasks.map((task) => <th class="num">{task}</th>)}</tr></thead>
            <tbody>{targets.map((target) => <tr><td>{target}</td>{tasks.map((task) => {
              const cell = of.matrix.find((one) => one.task === task && one.target === target);
              const expected = (cell?.expected ?? 0) * there;
              const off = cell && expected ? (cell.count - expected) / Math.sqrt(expected) : 0;
              return <td class="num" title={expected ? `expected ${number(expected)} of these` : ''}>{cell ? <span class={Math.abs(off) > 3 ? 'warn' : ''}>{count(cell.count)}</span> : <span class="muted">·</span>}</td>;
            })}</tr>)}</tbody>
          </table>
        </div>
      </Panel>
      <Panel title="Length in steps"><Histogram edges={of.lengths.edges_steps} counts={of.lengths.counts} label="steps" format={(edge) => count(edge)} /></Panel>
      <Panel title="Words"><Bars label="Words of the instructions" rows={of.words.map((one) => ({ name: one.word, value: one.count }))} limit={10} /></Panel>
      {of.odd.length > 0 && (
        <Panel title="Odd ones" aside={<span class="small muted">largest robust z within a task</span>}>
          <ul class="events">{of.odd.slice(0, 8).map((one) => <li><span class="num strong">{fixed(one.odd, 1)}</span><span><a href={episodeLink(props.dataset.id, one.index)}>#{one.index}</a> {one.task} <span class="muted">by {one.what.replace('_', ' ')}</span></span></li>)}</ul>
        </Panel>
      )}
    </>
  );
}
