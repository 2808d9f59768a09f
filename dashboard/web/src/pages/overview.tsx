// SPDX-License-Identifier: Apache-2.0
// Does it run, when is it done, did anything stop: the page for the lab's screen.
import { useState } from 'preact/hooks';
import { home, sourceOf } from '../core/sources';
import { clock, count, duration, number, percent, plural, age } from '../core/format';
import { link } from '../core/router';
import type { Home, Stage, Tiles } from '../core/types';
import { Chip, Empty, Figure, Panel, StateChip } from '../parts/basics';
import { Spark } from '../parts/chart';
import { Dots } from '../parts/dots';

const fewSources = 20;

export function Overview() {
  const [whole, setWhole] = useState(false);
  const data = home.value;
  if (!data) return null;
  if (!data.sources.length) return <><Ups of={data} />{data.warnings.length > 0 && <Warnings of={data} />}<Nothing home={data} /></>;
  const { tiles } = data;
  return (
    <>
      <div class="page-head">
        <StateChip state={data.state} />
        <p class="sentence figure" data-overview-sentence>{data.sentence}</p>
      </div>
      <Ups of={data} />
      {data.warnings.length > 0 && <Warnings of={data} />}
      <div class="grid three stretch">
        {tiles.demonstrations && <Demonstrations of={tiles.demonstrations} />}
        {tiles.training && <TrainingTile of={tiles.training} />}
        {tiles.checkpoint && <CheckpointTile of={tiles.checkpoint} />}
        {tiles.policy && <PolicyTile of={tiles.policy} />}
      </div>
      {tiles.ladder && <Panel title="Curriculum" aside={<a href={link('training', { run: tiles.ladder.source })}>Training</a>}><Ladder stages={tiles.ladder.stages} /></Panel>}
      <div class="grid wide stretch">
        {tiles.success && <Success of={tiles.success} />}
        <Panel title="Events">
          {tiles.events.length
            ? <ul class="events">{tiles.events.map((one) => <li><time dateTime={one.t}>{clock(one.t)}</time><span class={one.level === 'info' ? '' : one.level === 'warn' ? 'warn' : 'bad'}>{one.link ? <a href={one.link}>{one.text}</a> : one.text}</span></li>)}</ul>
            : <p class="muted">Nothing has happened yet.</p>}
        </Panel>
      </div>
      <Panel title="Sources" flush>
        <div class="scroll-x" tabIndex={0} role="group" aria-label="List of sources">
          <table class="plain sources">
            <thead><tr><th>name</th><th>what</th><th>state</th><th>folder</th><th class="num">changed</th></tr></thead>
            <tbody>{data.sources.slice(0, whole ? undefined : fewSources).map((one) => (
              <tr data-source={one.id}>
                <td><a href={sourceLink(one.kind, one.id)}>{one.name}</a></td>
                <td class="secondary">{one.role === 'rollouts' ? 'rollouts' : one.kind}</td>
                <td><StateChip state={one.state} /></td>
                <td class="muted">{one.folder ?? 'on the bus'}</td>
                <td class="num muted nowrap">{one.age_ms === null ? '' : `${age(one.age_ms)} ago`}</td>
              </tr>))}
            </tbody>
          </table>
        </div>
        {!whole && data.sources.length > fewSources && <p class="pad small"><button type="button" class="button" data-all-sources onClick={() => setWhole(true)}>{fewSources} of {data.sources.length}: show all</button></p>}
      </Panel>
    </>
  );
}

/** What `etude up` does in the folders of this gateway, before there is anything to show and after. */
function Ups(props: { of: Home }) {
  return (
    <>{props.of.ups.map((one) => (
      <p class="secondary row" data-up={one.state}>
        <StateChip state={one.state} /><span>etude up{one.phase && `: ${one.phase}`}{one.goal && ` (${one.goal})`}{one.exit !== null && `, exit ${one.exit}`}</span><span class="muted mono">{one.folder}</span>
      </p>
    ))}</>
  );
}

export function sourceLink(kind: string, id: string): string {
  switch (kind) {
    case 'run': return link('training', { run: id });
    case 'eval': return link('evaluation', { eval: id });
    case 'campaign': return link('generation', { dataset: id });
    default: return link('dataset', { dataset: id });
  }
}

function Nothing(props: { home: Home }) {
  const where = props.home.dirs.join(', ') || 'no folder';
  const bus = props.home.domain === null ? '' : ` or on DDS domain ${props.home.domain}`;
  return (
    <Panel><Empty title={`Nothing found in ${where}${bus}`} command="deploy/quickstart --keep-running">
      Looked for dataset.json, metrics.jsonl and eval.json in these folders and those below them, and for campaigns, trainers and policies on the bus. This collects, trains and evaluates from nothing:
    </Empty></Panel>
  );
}

function Warnings(props: { of: Home }) {
  return (
    <section aria-label="Warnings" class="panel flush"><ul class="warnings">
      {props.of.warnings.map((one) => (
        <li data-code={one.code} data-level={['campaign_error', 'loss_not_finite', 'run_failed'].includes(one.code) ? 'error' : 'warn'}>
          <span aria-hidden="true">▲</span><span>{one.text}</span>
          {one.since && <span class="muted small">since {clock(one.since)}</span>}
          <a href={one.link}>Show</a>
        </li>))}
    </ul></section>
  );
}

function Demonstrations(props: { of: NonNullable<Tiles['demonstrations']> }) {
  const one = props.of;
  const running = one.live && one.committed < one.total;
  return (
    <Panel title="Demonstrations" aside={<a href={sourceLink(sourceOf(one.source)?.kind ?? 'dataset', one.source)}>{one.name}</a>}>
      <div class="row apart">
        {running && one.per_min !== null ? <Figure large value={number(one.per_min)} unit="a minute" label="per_min" /> : <Figure large value={count(one.committed)} unit={`of ${count(one.total)}`} label="committed" />}
        <span class="secondary num">{running ? <>{count(one.committed)} of {count(one.total)}<br />{one.eta_s !== null && `${duration(one.eta_s)} left`}</> : one.committed >= one.total ? 'complete' : ''}</span>
      </div>
      <div class="bar" role="img" aria-label={`${one.committed} of ${one.total}`}><div style={{ width: `${(100 * one.committed) / Math.max(1, one.total)}%` }} /></div>
      {running && one.history_per_min.length > 1 && <Spark values={one.history_per_min} label="demonstrations a minute, last ten minutes" />}
      <p class="small secondary">{one.workers > 0 ? `${one.workers} workers, ` : ''}{count(one.failed)} failed attempts, {count(one.given_up)} given up</p>
    </Panel>
  );
}

function TrainingTile(props: { of: NonNullable<Tiles['training']> }) {
  const one = props.of;
  const errors = Object.entries(one.errors).filter(([name]) => /\.(cm|px)$/.test(name)).slice(0, 6);
  return (
    <Panel title="Training" aside={<a href={link('training', { run: one.source })}>{one.name}</a>}>
      <div class="row apart">
        <Figure large value={count(one.step)} unit={one.steps ? `of ${count(one.steps)} steps` : 'steps'} label="step" />
        <span class="secondary num">stage {one.stage} of {one.stages}<br />{one.stage_name}</span>
      </div>
      <div class="bar" role="img" aria-label={`step ${one.step} of ${one.steps ?? 'unknown'}`}><div style={{ width: `${one.steps ? (100 * one.step) / one.steps : one.finished ? 100 : 0}%` }} /></div>
      <p class="small secondary">{[one.finished ? 'finished' : one.eta_s !== null && `${duration(one.eta_s)} left`, one.samples_per_s !== null && `${count(one.samples_per_s)} samples/s`, one.data_wait !== null && `waits for data ${percent(one.data_wait, 2)}`].filter(Boolean).join(' · ')}</p>
      {errors.length > 0 && <p class="row small">{errors.map(([name, value]) => <span class="nowrap"><span class="muted">{name.split('.')[0]}</span> <b>{number(value, 2)}</b> <span class="muted">{name.split('.')[1]}</span></span>)}</p>}
    </Panel>
  );
}

/** The newest one, and who serves it or an older one. */
function CheckpointTile(props: { of: NonNullable<Tiles['checkpoint']> }) {
  const one = props.of;
  return (
    <Panel title="Newest checkpoint" aside={<a href={link('checkpoints', { run: one.source, ...(one.file ? { file: one.file } : {}) })}>{one.name}</a>}>
      <div class="row apart">
        <Figure large value={count(one.step)} unit="step" label="checkpoint_step" />
        <span class="secondary num">{one.age_ms === null ? 'not on this disk' : `${age(one.age_ms)} old`}</span>
      </div>
      {one.servers.length
        ? <ul class="small" data-served-by>{one.servers.slice(0, 6).map((server) => <li class={server.step === one.step ? 'secondary' : 'warn'}>{server.step === one.step ? `${server.host} serves it${server.since ? ` since ${clock(server.since)}` : ''}` : `${server.host} serves step ${count(server.step)}`}</li>)}{one.servers.length > 6 && <li class="muted">{count(one.servers.length - 6)} more</li>}</ul>
        : <p class="small muted" data-served-by>no policy server of this run is heard</p>}
    </Panel>
  );
}

function PolicyTile(props: { of: NonNullable<Tiles['policy']> }) {
  const one = props.of;
  return (
    <Panel title="Policy" aside={one.source ? <a href={link('checkpoints', { run: one.source })}>{one.name}</a> : <span class="muted">{one.name}</span>}>
      <div class="row apart">
        <Figure large value={count(one.checkpoint_step)} unit="step served" label="policy_step" />
        {one.may_drive === false && <Chip tone="warn">not trained to drive</Chip>}
      </div>
      <p class="small secondary">{[one.instances === 1 ? 'one server' : `${one.instances} servers`, one.sessions !== null && plural(one.sessions, 'session'), one.answers_per_s !== null && `${number(one.answers_per_s, 2)} answers/s`, one.p95_ms !== null && `p50 ${number(one.p50_ms, 2)} ms, p95 ${number(one.p95_ms, 2)} ms`, one.age_ms !== null && `heard ${age(one.age_ms)} ago`].filter(Boolean).join(' · ')}</p>
      {one.last_refusal && <p class="small warn">refused: {one.last_refusal}</p>}
    </Panel>
  );
}

export function Ladder(props: { stages: Stage[] }) {
  return (
    <ol class="ladder" aria-label="Stages">
      {props.stages.map((one) => (
        <li data-state={one.state === 'current' ? 'now' : one.state} title={one.reason ?? ''}>
          <span class="name">{one.stage} {one.name}</span>
          {one.state === 'ahead' ? 'ahead' : one.state === 'current' ? `since ${count(one.from_step)}` : `to ${count(one.to_step)}`}
          {one.cause && one.cause !== 'goal' && <span class="warn"> ▲ {one.cause}</span>}
        </li>))}
    </ol>
  );
}

function Success(props: { of: NonNullable<Tiles['success']> }) {
  const one = props.of;
  const rows = [...one.tasks, one.overall].map((task) => ({ name: task.task, n: task.n, k: task.success.successes, share: task.success.share, low: task.success.low, high: task.success.high }));
  return (
    <Panel title={one.kind === 'expert' ? 'Success of the expert' : 'Success'} aside={one.kind === 'eval' ? <a href={link('evaluation', { eval: one.source })}>{one.name}{one.done < one.episodes ? `, ${one.done} of ${one.episodes}` : ''}</a> : <span class="muted">{one.name}</span>}>
      <Dots rows={rows} label="Success by task" />
    </Panel>
  );
}

