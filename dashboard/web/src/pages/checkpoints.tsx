// SPDX-License-Identifier: Apache-2.0
// Which weights there are, how good each part is, and which drive a robot now. Headers only are read.
import type { ComponentChildren } from 'preact';
import { useRef } from 'preact/hooks';
import { getJson, root, useResource } from '../core/api';
import { bytes, clock, count, day, none, number, short } from '../core/format';
import { link, parameter } from '../core/router';
import { meanError } from '../core/says';
import { listed, sourceOf, useChosen } from '../core/sources';
import type { Checkpoint, Checkpoints } from '../core/types';
import { ActionButton, type Choice } from '../parts/actions';
import { Elsewhere } from '../parts/elsewhere';
import { Chip, Command, Empty, Facts, Loaded, Panel } from '../parts/basics';
import { Table, type Column } from '../parts/table';

export function CheckpointsPage() {
  // of runs that are compared the first
  const id = listed(useChosen('run'))[0] ?? null;
  const here = sourceOf(id)?.folder !== null;
  const answer = useResource<Checkpoints>(id && here ? `/runs/${id}/checkpoints` : null, { every: 10000 });
  if (!id) return <Panel><Empty title="No run here yet" command="etude train --data data --config compact --out run --minutes 10">Checkpoints come with a run:</Empty></Panel>;
  if (!here) return <Elsewhere of={id} />;
  return <Loaded of={answer}>{(data) => <Content key={data.run} of={data} run={data.run} />}</Loaded>;
}

/** Figures in cm and px, in the order of the curriculum. */
function metricColumns(rows: Checkpoint[]): string[] {
  const names = [...new Set(rows.flatMap((one) => Object.keys(one.metrics)))];
  const wanted = names.filter((name) => /\.(cm|px)$/.test(name) );
  const rank = (name: string) => ['LANG', 'EE2D', 'TAR2D', 'EE3D', 'TAR3D', 'REF', 'DISP', 'CTRL'].findIndex((one) => name.startsWith(one));
  return wanted.sort((a, b) => rank(a) - rank(b)).slice(0, 6);
}

const served: Column<Checkpoint> = {
  key: 'served', title: 'served by', width: 'minmax(120px, 1.5fr)', card: 'long',
  cell: (one) => one.refused ? <span class="bad">refused: {one.refused}</span> : one.served_by.length ? one.served_by.map((server) => `${server.host}${server.since ? ` since ${clock(server.since, false)}` : ''}`).join(', ') : <span class="muted">{none}</span>,
};

/** Other tasks, another robot or camera than those of the run's dataset. */
const scenes: Choice = {
  argument: 'scenes', label: 'Scenes', none: 'those of its dataset; else pick, push, put down with the UR5',
  values: () => getJson<{ campaigns: string[] }>('/play/sessions').then((answer) => answer.campaigns),
};

function Content(props: { of: Checkpoints; run: string }) {
  const rows = props.of.checkpoints;
  const { subscribers } = props.of;
  const named = `${subscribers.slice(0, 4).map((one) => one.peer ?? `participant ${short(one.participant)}`).join(', ')}${subscribers.length > 4 ? ' …' : ''}`;
  const [picked] = parameter('file');
  // what nobody picked stays while newer ones are saved, and what was looked at while older ones go
  const first = useRef('');
  first.current ||= rows[0]?.file ?? '';
  const file = picked || first.current;
  const kept = rows.find((one) => one.file === file);
  const known = useRef(kept);
  if (kept) known.current = kept;
  const row = kept ?? (known.current?.file === file ? known.current : undefined);
  if (!rows.length && !row) return <Panel><Empty title="Nothing saved yet">{props.of.next_step !== null ? `The first save is due at step ${count(props.of.next_step)}.` : 'A run saves at the interval that checkpoint.every_steps says.'}</Empty></Panel>;
  const columns: Column<Checkpoint>[] = [
    { key: 'step', title: 'step', width: '8ch', card: 'title', cell: (one) => count(one.step) },
    { key: 'stage', title: 'stage', width: 'minmax(110px, 1fr)', cell: (one) => one.error ? <span class="bad" title={one.error}>cannot be read</span> : <>{one.stage}/{one.stages} {one.stage_name}</> },
    { key: 'channel', title: 'channel', width: 'minmax(110px, 1fr)', cell: (one) => <span class="row tight">{one.channels.map((name) => <Chip tone={name === 'best' ? 'good' : ''}>{name === 'best' ? '★ best' : name}</Chip>)}{!one.error && !one.control_trained && <Chip tone="warn">hand untrained</Chip>}</span> },
    ...metricColumns(rows).map((name): Column<Checkpoint> => ({ key: name, title: name.replace('.', ' '), width: '9ch', number: true, cell: (one) => number(one.metrics[name], 2) })),
    { key: 'bytes', title: 'size', width: '9ch', number: true, cell: (one) => bytes(one.bytes) },
    { key: 'sha', title: 'sha256', width: '14ch', cell: (one) => <span class="mono" title={one.sha256 ?? ''}>{one.sha256 ? short(one.sha256) : <span class="muted">computing</span>}</span> },
    ...(rows.some((one) => one.served_by.length || one.refused) ? [served] : []),
  ];
  return (
    <>
      <div class="page-head"><p><b>{count(rows.length)}</b> kept{props.of.next_step !== null && ` · next at step ${count(props.of.next_step)}`}{' · '}<span data-subscribers title={subscribers.map((one) => one.peer ?? one.participant).join('\n')}>{subscribers.length ? <><b>{count(subscribers.length)}</b> subscribed: {named}</> : 'nobody subscribes'}</span></p></div>
      <Panel flush label="Checkpoints"><Table label="Checkpoints" rows={rows} id={(one) => one.file} columns={columns} selected={file} link={(one) => link('checkpoints', { run: props.run, file: one.file })} /></Panel>
      {row ? <Detail of={row} run={props.run} gone={!kept} /> : <Panel label="Checkpoint"><div data-not-kept><Empty title={`${file} is not kept`}>The run never saved it, or newer ones have taken its place. Choose one above.</Empty></div></Panel>}
    </>
  );
}

/** `gone`: the run keeps it no longer; what was known of it stays for whoever looks at it. */
function Detail(props: { of: Checkpoint; run: string; gone: boolean }) {
  const { of, gone } = props;
  const parameters = Object.entries(of.parameters);
  const total = parameters.reduce((sum, [, n]) => sum + n, 0);
  return (
    <div class="grid wide">
      <Panel title={of.file} aside={gone ? <Chip tone="warn">no longer kept</Chip> : !of.error && <a class="button" href={`${root}/runs/${props.run}/checkpoints/${encodeURIComponent(of.file)}`} download={of.file}>Download {bytes(of.bytes)}</a>}>
        {of.error
          ? <p class="bad">{of.error}</p>
          : <Facts rows={[
            ['sha256', <span class="mono" data-sha256>{of.sha256 ?? 'computing'}</span>],
            ['run', of.run ?? none], ['robot', of.robot ?? none], ['joints', count(of.joints)], ['demonstrations', count(of.train_episodes)],
            ['dataset', <span class="mono">{short(of.dataset)}</span>], ['architecture', <span class="mono">{short(of.architecture)}</span>], ['written', day(of.modified)], ['version', of.version ?? none],
          ] as [string, ComponentChildren][]} />}
        {!of.error && <p class="row">
          <ActionButton label="Make it best" disabled={gone || of.channels.includes('best')} about="The run's channel best names this checkpoint from then on." of={{ action: 'promote', run: props.run, file: of.file }} />
          <ActionButton label="Evaluate" disabled={gone} about="Rolls it out in 40 scenes that no collection has." of={{ action: 'evaluate', run: props.run, file: of.file }} choice={scenes} />
          <ActionButton label="Serve" disabled={gone} about="Starts a policy server that answers with this checkpoint, until the job is stopped." of={{ action: 'serve', run: props.run, file: of.file }} />
        </p>}
        <h2>Follow on another machine</h2>
        <Command text={`etude checkpoint watch --run ${of.run ?? 'RUN'} --channel ${of.channels.includes('best') ? 'best' : 'latest'} --out DIR`} />
      </Panel>
      {!of.error && <Panel title="Modules" aside={<span class="small muted">{count(total)} parameters</span>}>
        <div class="scroll-x" tabIndex={0} role="group" aria-label="Modules of this checkpoint"><table class="plain"><thead><tr><th>module</th><th class="num">error</th><th class="num">trained steps</th><th class="num">parameters</th></tr></thead>
          <tbody>{[...new Set([...Object.keys(of.modules), ...Object.keys(of.parameters)])].map((name) => <tr><td>{name}</td><td class="num">{of.modules[name] ? meanError(of.modules[name]) : none}</td><td class="num">{count(of.modules[name]?.trained_steps)}</td><td class="num">{count(of.parameters[name])}</td></tr>)}</tbody></table></div>
      </Panel>}
    </div>
  );
}
