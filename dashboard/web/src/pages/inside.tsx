// SPDX-License-Identifier: Apache-2.0
// The policy's modules as they are wired: what each reads, is supervised by and says, and how far it is trained.
import type { ComponentChildren } from 'preact';
import { useMemo, useState } from 'preact/hooks';
import { useResource } from '../core/api';
import { count, none, short } from '../core/format';
import { useKeys } from '../core/keys';
import { link, linkHere, navigate, parameter } from '../core/router';
import { brief, errorText, meanError, plan } from '../core/says';
import { isOf } from '../core/session';
import { listed, nameOf, refreshed, sourceOf, sourcesOf, useChosen } from '../core/sources';
import { moduleColor } from '../core/theme';
import type { Eval, Graph, GraphNode, Insight, PlaySession, Run } from '../core/types';
import { Chip, Command, Empty, Facts, Loaded, Panel, Select } from '../parts/basics';
import { Elsewhere } from '../parts/elsewhere';
import { Table } from '../parts/table';
import { AskPolicy } from './ask_policy';
import { loadEvals, mostCompared } from './evaluation';
import { KeptInsight } from './kept_insight';
import { WatchedSession } from './watched_session';

export function Inside() {
  // of runs that are compared the first
  const named = listed(parameter('run')[0])[0];
  const [evaluation] = parameter('eval');
  const kept = useResource<Eval>(evaluation ? `/evals/${evaluation}` : null, refreshed(sourcesOf('eval').filter((one) => one.id === evaluation)));
  // another run that is picked leaves the files of this one
  const from = kept.data && (!named || !kept.data.run_id || kept.data.run_id === named) ? kept.data : undefined;
  const choice = listed(useChosen('run', !evaluation))[0] ?? null;
  const id = from ? from.run_id : choice;
  const here = sourceOf(id)?.folder !== null;
  const graph = useResource<Graph>(id && here && !(evaluation && kept.pending) ? `/runs/${id}/graph` : null, { every: 15000 });
  if (evaluation && !kept.data) return <Loaded of={kept}>{() => null}</Loaded>;
  if (from && !id) return <WithoutRun of={from} />;
  if (!id) return <Panel><Empty title="No run here yet" command="etude policy graph compact/base">A policy's modules without a run:</Empty></Panel>;
  if (!here) return <Elsewhere of={id} />;
  return <Loaded of={graph}>{(data) => <Content key={id} of={data} run={id} from={from} />}</Loaded>;
}

/** Of a policy whose run is not below the gateway's folders: what it said is there, how it is wired is not. */
function WithoutRun(props: { of: Eval }) {
  const [said, tell] = useState<Insight | undefined>(undefined);
  const names = Object.keys(said?.modules ?? {});
  const [module] = parameter('module', names[names.length - 1] ?? '');
  return <KeptInsight key={props.of.id} of={props.of} module={module} planner="" tell={tell} />;
}

/** Evaluations of a run, the newest, of whose rollouts it was kept what the policy said. */
function useKept(run: string): Eval[] {
  const those = sourcesOf('eval').slice(0, mostCompared);
  const all = useResource<Eval[]>(those.map((one) => one.id).join(',') || null, { load: loadEvals, ...refreshed(those) });
  return (all.data ?? []).filter((one) => one.run_id === run && one.insights > 0);
}

/** Live play sessions: all (undefined: not known yet), and those that a run's policy drives. */
function useSessions(run: string): { heard: PlaySession[] | undefined; own: PlaySession[] } {
  const heard = useResource<{ sessions: PlaySession[] }>('/play/sessions', { every: 10000 }).data?.sessions;
  const about = useResource<Run>(heard?.length ? `/runs/${run}` : null);
  return { heard, own: (heard ?? []).filter((one) => isOf(one, about.data?.identity ?? null)) };
}

/** Whom the page asks: the policy server, the files of an evaluation, or a play session's policy as it drives. */
function Source(props: { kept: Eval[]; from: Eval | undefined; session: string; run: string }) {
  const { from, session, run } = props;
  const { heard, own } = useSessions(run);
  const sessions = own.map((one) => one.session);
  const gone = heard !== undefined && !heard.some((one) => one.session === session);
  const evals = from && !props.kept.some((one) => one.id === from.id) ? [from, ...props.kept] : props.kept;
  const options = [...evals.map((one) => [`eval ${one.id}`, `files of ${nameOf(one.id)}`] as const), ...(session && !sessions.includes(session) ? [session, ...sessions] : sessions).map((name) => [`session ${name}`, `play session ${name}${name === session && gone ? ' (not heard)' : ''}`] as const)];
  if (!options.length) return null;
  const choose = (text: string) => {
    const [kind = '', name = ''] = text.split(' ');
    navigate(link('inside', { run, ...(kind ? { [kind]: name } : {}) }));
  };
  return <Select label="from" showLabel value={from ? `eval ${from.id}` : session ? `session ${session}` : ''} options={[['', 'its server, about a recorded picture'], ...options]} choose={choose} />;
}

function about(node: GraphNode): string {
  const entity = { ee: 'hand', command: 'task' }[node.entity] ?? node.entity;
  return node.quantity === 'class' ? `names the ${entity}` : node.quantity === 'task' ? 'names the task' : node.quantity === 'displacement' ? `way to the ${entity}` : node.quantity === 'trajectory' ? 'waypoints of the hand' : `${node.quantity} of the ${entity}`;
}

function Content(props: { of: Graph; run: string; from: Eval | undefined }) {
  const { of, from } = props;
  const kept = useKept(props.run);
  const [session] = parameter('session');
  const [selected, select] = parameter('module', of.nodes[of.nodes.length - 1]?.name ?? '');
  const [insight, tell] = useState<Insight | undefined>(undefined);
  const node = of.nodes.find((one) => one.name === selected);
  const planner = of.nodes.find((one) => one.quantity === 'trajectory')?.name ?? '';
  const shown = { module: selected, planner, tell };
  const heard = new Set(of.edges.filter((one) => one.kind === 'decoded').map((one) => one.from));
  const read = new Set(of.edges.map((one) => one.from));
  useKeys(of.nodes.slice(0, 9).map((one, i) => ({ keys: String(i + 1), does: `module ${one.name}`, run: () => select(one.name, true) })));
  if (!of.nodes.length) return <Panel><Empty title="No policy is described here">The run's config.yaml has no modules.</Empty></Panel>;
  return (
    <>
      <div class="page-head">
        <p><b>{of.nodes.length}</b> modules in {new Set(of.nodes.map((one) => one.level)).size} levels · {count(of.nodes.reduce((sum, one) => sum + (one.parameters ?? 0), 0))} parameters{of.checkpoint ? <> · errors of <a href={link('checkpoints', { run: props.run })}>{of.checkpoint}</a></> : ' · nothing saved yet'}</p>
        <Source kept={kept} from={from} session={session} run={props.run} />
        {of.architecture && <Chip>architecture <span class="mono">{short(of.architecture)}</span></Chip>}
      </div>
      <Panel title="What reads what" aside={<Legend />}><Drawing of={of} insight={insight} selected={selected} select={(name) => select(name, true)} /></Panel>
      {from ? <KeptInsight key={from.id} of={from} {...shown} /> : session ? <WatchedSession key={session} session={session} {...shown} /> : <AskPolicy run={props.run} kept={kept} heard={heard} read={read} {...shown} />}
      {node && <Side node={node} graph={of} insight={insight} run={props.run} />}
      <Panel title="Modules" flush>
        <Table label="Modules" rows={of.nodes} id={(row) => row.name} selected={selected} link={(row) => linkHere({ module: row.name })} columns={[
          { key: 'name', title: 'module', width: 'minmax(80px, 1fr)', card: 'title', cell: (row) => row.name },
          { key: 'level', title: 'level', width: '6ch', number: true, cell: (row) => row.level },
          { key: 'about', title: 'says', width: 'minmax(140px, 2fr)', card: 'long', cell: (row) => about(row) },
          { key: 'reads', title: 'reads', width: 'minmax(150px, 3fr)', card: 'long', cell: (row) => <span class="secondary">{row.reads.join(', ')}</span> },
          { key: 'attend', title: 'attention supervised on', width: 'minmax(150px, 2fr)', card: 'long', cell: (row) => <span class="secondary">{row.attend.join(', ')}</span> },
          { key: 'error', title: 'error', width: 'minmax(90px, 1fr)', number: true, cell: (row) => meanError(row) },
          { key: 'trained', title: 'trained steps', width: '13ch', number: true, cell: (row) => row.trained ? count(row.trained_steps) : <span class="muted">stage {row.stage}</span> },
          { key: 'parameters', title: 'parameters', width: '11ch', number: true, cell: (row) => count(row.parameters) },
        ]} />
      </Panel>
      <Panel title="While it drives"><p class="secondary">What every module says at each decision, with another sentence or a part of the picture hidden:</p><Command text="etude policy watch --run RUN --sentence 'push the pepsi can'" /></Panel>
    </>
  );
}

function Legend() {
  return (
    <span class="row small muted">
      {([['register', ''], ['query', '6 3'], ['decoded value', '1.5 3.5']] as const).map(([name, dash]) => (
        <span class="row nowrap"><svg width="26" height="8" aria-hidden="true"><line x1="0" x2="26" y1="4" y2="4" stroke="var(--secondary)" stroke-width="1.75" {...(dash ? { 'stroke-dasharray': dash, 'stroke-linecap': 'round' as const } : {})} /></svg>{name}</span>))}
    </span>
  );
}

const box = { width: 154, height: 68, inputHeight: 36, across: 58, down: 20 };

interface Place { x: number; y: number; height: number }

/** Columns left to right; within one, by the mean place of what is read, once. */
function layout(of: Graph): { places: Map<string, Place>; width: number; height: number } {
  const known = new Set(of.nodes.map((one) => one.name));
  const columns = of.columns.length ? of.columns : [of.inputs, ...[...new Set(of.nodes.map((one) => one.level))].sort((a, b) => a - b).map((level) => of.nodes.filter((one) => one.level === level).map((one) => one.name))];
  const rank = new Map<string, number>();
  const ordered = columns.map((column) => {
    const weight = (name: string) => {
      const before = of.edges.filter((edge) => edge.to === name && rank.has(edge.from)).map((edge) => rank.get(edge.from)!);
      return before.length ? before.reduce((sum, one) => sum + one, 0) / before.length : 0.5;
    };
    const sorted = column.map((name) => ({ name, weight: weight(name) })).sort((a, b) => a.weight - b.weight).map((one) => one.name);
    sorted.forEach((name, i) => rank.set(name, (i + 0.5) / sorted.length));
    return sorted;
  });
  const tall = (column: string[]) => column.reduce((sum, name) => sum + (known.has(name) ? box.height : box.inputHeight) + box.down, -box.down);
  const height = Math.max(240, ...ordered.map(tall));
  const places = new Map<string, Place>();
  ordered.forEach((column, c) => {
    let y = (height - tall(column)) / 2;
    for (const name of column) {
      const own = known.has(name) ? box.height : box.inputHeight;
      places.set(name, { x: c * (box.width + box.across), y, height: own });
      y += own + box.down;
    }
  });
  return { places, width: ordered.length * (box.width + box.across) - box.across, height };
}

function Drawing(props: { of: Graph; insight: Insight | undefined; selected: string; select: (name: string) => void }) {
  const { of, selected } = props;
  const { places, width, height } = useMemo(() => layout(of), [of.architecture, of.nodes.length]);
  const touches = (edge: Graph['edges'][number]) => edge.from === selected || edge.to === selected;
  const edges = [...of.edges].sort((a, b) => Number(touches(a)) - Number(touches(b)));
  return (
    <div class="graph" tabIndex={0} role="group" aria-label="Drawing of the modules">
      <svg style={{ maxWidth: `${width + 4}px` }} viewBox={`-2 -8 ${width + 4} ${height + 16}`} role="group" aria-label="Modules and what flows between them">
        {edges.map((edge) => <Edge edge={edge} places={places} on={touches(edge)} into={edge.to === selected} />)}
        {of.inputs.map((name) => {
          const at = places.get(name);
          return at && <g transform={`translate(${at.x} ${at.y})`}><rect width={box.width} height={at.height} rx={at.height / 2} fill="var(--hover)" stroke="var(--line)" /><text x={box.width / 2} y={at.height / 2 + 5} font-size="14" text-anchor="middle" fill="var(--secondary)">{inputNames[name] ?? name}</text></g>;
        })}
        {of.nodes.map((node) => {
          const at = places.get(node.name);
          return at && <Box node={node} insight={props.insight} at={at} selected={node.name === selected} select={() => props.select(node.name)} />;
        })}
      </svg>
    </div>
  );
}

const inputNames: Record<string, string> = { image: 'picture', language: 'words', joints: 'joints' };

/** What a module says of the picture that is asked about, and how far that is from the truth; without one, what it is about. */
function linesOf(node: GraphNode, insight: Insight | undefined): { says: string; error: string } {
  const known = node.trained ? meanError(node) : `stage ${node.stage ?? none}, not trained`;
  if (!insight) return { says: about(node), error: known };
  const planned = node.quantity === 'trajectory' ? plan(insight) : null;
  const error = planned ? planned.error : errorText(insight.truth.errors[node.name]);
  return { says: (planned ? planned.says : brief(insight.modules[node.name])) || about(node), error: node.trained && error ? error : known };
}

function Box(props: { node: GraphNode; insight: Insight | undefined; at: Place; selected: boolean; select: () => void }) {
  const { node, at } = props;
  const { says, error } = linesOf(node, props.insight);
  const choose = (event: KeyboardEvent) => {
    if (event.key !== 'Enter' && event.key !== ' ') return;
    event.preventDefault();
    props.select();
  };
  return (
    <g transform={`translate(${at.x} ${at.y})`} class="node" role="button" tabindex={0} aria-pressed={props.selected} data-node={node.name} onClick={props.select} onKeyDown={choose}>
      <rect width={box.width} height={at.height} rx="4" fill="var(--panel)" stroke={props.selected ? 'var(--accent)' : 'var(--edge)'} stroke-width={props.selected ? 2 : 1} {...(node.trained ? {} : { 'stroke-dasharray': '4 3' })} />
      <rect x="1" y="1" width="5" height={at.height - 2} rx="2" fill={`var(--${moduleColor(node.name)})`} />
      <text x="16" y="22" font-size="14" font-weight="600" fill="var(--text)">{node.name}{node.frozen ? ' (frozen)' : ''}</text>
      <text x="16" y="40" font-size="12" fill="var(--secondary)" data-box-says>{says}</text>
      <text x="16" y="57" font-size="12" fill={node.trained ? 'var(--text)' : 'var(--muted)'} data-box-error>{error}</text>
    </g>
  );
}

function Edge(props: { edge: Graph['edges'][number]; places: Map<string, Place>; on: boolean; into: boolean }) {
  const from = props.places.get(props.edge.from);
  const to = props.places.get(props.edge.to);
  if (!from || !to) return null;
  const kind = props.edge.kind;
  const shift = kind === 'register' ? 0 : kind === 'query' ? -14 : 14;
  const x0 = from.x + box.width;
  const y0 = from.y + from.height / 2 + shift * 0.5;
  const x1 = to.x;
  const y1 = to.y + to.height / 2 + shift;
  const bend = Math.max(30, (x1 - x0) / 2);
  const same = x1 <= from.x;
  const path = same ? `M${x0} ${y0} C${x0 + 40} ${y0} ${x0 + 40} ${y1} ${to.x + box.width} ${y1}` : `M${x0} ${y0} C${x0 + bend} ${y0} ${x1 - bend} ${y1} ${x1 - 5} ${y1}`;
  const stroke = props.on ? `var(--${props.into ? 'accent' : 'text'})` : 'var(--edge)';
  return (
    <g opacity={props.on ? 1 : 0.45} data-edge={`${props.edge.from}>${props.edge.to}`}>
      <path d={path} fill="none" stroke={stroke} stroke-width={props.on ? 2 : 1.25} {...(kind === 'query' ? { 'stroke-dasharray': '6 3' } : kind === 'decoded' ? { 'stroke-dasharray': '1.5 3.5', 'stroke-linecap': 'round' as const } : {})} />
      {kind === 'query' ? <path d={`M${x1 - 8} ${y1} l4 -4 l4 4 l-4 4Z`} fill={stroke} /> : <path d={`M${x1 - 7} ${y1 - 3.5} L${x1} ${y1} L${x1 - 7} ${y1 + 3.5}Z`} fill={stroke} />}
    </g>
  );
}

function linesHere(node: GraphNode, insight: Insight): string {
  const { says, error } = linesOf(node, insight);
  return `${says}, ${error}`;
}

function Side(props: { node: GraphNode; graph: Graph; insight: Insight | undefined; run: string }) {
  const { node, graph } = props;
  const names = new Set(graph.nodes.map((one) => one.name));
  const list = (all: string[]) => (all.length ? <>{all.map((one, i) => <>{i > 0 && ', '}{names.has(one) ? <a href={linkHere({ module: one })}>{one}</a> : one}</>)}</> : none);
  const readers = [...new Set(graph.edges.filter((one) => one.from === node.name).map((one) => one.to))];
  return (
    <Panel title={node.name} aside={<a href={link('training', { run: props.run })}>Its curves</a>}>
      <Facts two rows={[
        ['error', <b>{meanError(node)}</b>],
        ['says', about(node)],
        ...(props.insight ? [['here', linesHere(node, props.insight)] as [string, ComponentChildren]] : []),
        ['level', String(node.level)],
        ['reads', list(node.reads)],
        ['query from', node.query ? list([node.query]) : 'learned'],
        ['attention supervised on', list(node.attend)],
        ['decoder takes', list(node.inputs)],
        ...(node.from.length ? [['values of', list(node.from)] as [string, ComponentChildren]] : []),
        ...(node.relative_to ? [['relative to', list([node.relative_to])] as [string, ComponentChildren]] : []),
        ['read by', list(readers)],
        ['gradient', node.detach ? 'stops at what it reads' : 'flows into what it reads'],
        ['parameters', count(node.parameters)],
        ['trained', node.trained ? `${count(node.trained_steps)} steps, since stage ${node.stage ?? none}` : `not yet, stage ${node.stage ?? none}`],
        ['frozen', node.frozen ? 'yes' : 'no'],
      ]} />
    </Panel>
  );
}
