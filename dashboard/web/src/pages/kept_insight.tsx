// SPDX-License-Identifier: Apache-2.0
// What a policy said at each decision of a rollout, from the files that its evaluation kept: nobody need serve it. Which
// rollout and which decision stands in the address.
import { useEffect, useRef } from 'preact/hooks';
import { query, useResource } from '../core/api';
import { decisionAt, decisionBeside } from '../core/decisions';
import { useDraft } from '../core/draft';
import { count, fixed } from '../core/format';
import { useKeys } from '../core/keys';
import { link, parameter } from '../core/router';
import { episodeLink } from '../core/sources';
import type { Episode, Eval, EvalRow, EvalRows, Insight, KeptInsights } from '../core/types';
import { Empty, Failed, Loaded, Panel, Select } from '../parts/basics';
import { PlanInSpace } from '../parts/plan';
import { Attends, Said, Seen } from '../parts/said';
import { Joints } from '../parts/worth';
import type { Shown } from './ask_policy';

/** Failures first. */
const mostRows = 1000;

export function KeptInsight(props: Shown & { of: Eval }) {
  const { of } = props;
  const rows = useResource<EvalRows>(`/evals/${of.id}/rows${query({ limit: mostRows, sort: 'failures' })}`, { round: `${of.done} ${of.insights}` });
  const [scene] = parameter('scene');
  // one that failed since comes before it, and does not take its place
  const first = useRef('');
  const title = `What was kept of ${of.name}`;
  return (
    <Loaded of={rows}>{(data) => {
      const kept = data.rows.filter((one) => one.insight);
      first.current ||= String(kept[0]?.index ?? '');
      const index = scene || first.current;
      if (!index) return <Panel title={title}><Empty title="Nothing was kept of these rollouts" command="etude eval --checkpoint FILE --out OUT --insight">The same command as before, with one word more, asks the policy about each decision and keeps what it says:</Empty></Panel>;
      return <Rollout key={`${of.id}/${index}`} {...props} title={title} rows={kept} index={index} />;
    }}</Loaded>
  );
}

function nameOf(row: EvalRow): string {
  return `#${row.index} ${row.success ? '✓' : '✕'} ${row.task.replace('_', ' ')} ${row.target}`;
}

function Rollout(props: Shown & { of: Eval; title: string; rows: EvalRow[]; index: string }) {
  const { of, rows, index } = props;
  const base = `/evals/${of.id}/insights/${index}`;
  const kept = useResource<KeptInsights>(base);
  const episode = useResource<Episode>(kept.data ? `/datasets/${kept.data.dataset}/episodes/${index}` : null);
  const [, choose] = parameter('scene');
  const aside = <Select label="rollout" showLabel value={index} options={[...(rows.some((one) => String(one.index) === index) ? [] : [[index, `#${index}`] as const]), ...rows.map((one) => [String(one.index), nameOf(one)] as const)]} choose={(value) => choose(value)} />;
  const problem = kept.error ?? episode.error;
  if (problem) return <Panel title={props.title} aside={aside}><Failed problem={problem} retry={() => { kept.reload(); episode.reload(); }} /></Panel>;
  return (
    <Panel title={props.title} aside={aside}>
      <Loaded of={episode} height={320}>{(data) => <Walk {...props} episode={data} kept={kept.data!} base={base} />}</Loaded>
    </Panel>
  );
}

function Walk(props: Shown & { of: Eval; kept: KeptInsights; episode: Episode; base: string }) {
  const { kept, episode } = props;
  const { decisions } = kept;
  const [wanted, set] = parameter('decision');
  // the address takes it after a pause: browsers refuse to change it many times a second
  const draft = useDraft(wanted, (text) => set(text, true), 200);
  const go = (k: number) => draft.change(String(k));
  const at = decisionAt(decisions, Number(draft.shown) || 0);
  const decision = decisions[at];
  const answer = useResource<Insight>(decision ? `${props.base}/${at}` : null);
  const data = answer.data;
  useEffect(() => props.tell(data), [data]);
  useEffect(() => () => props.tell(undefined), []);
  const beside = (by: 1 | -1) => go(decisionBeside(decisions, at, by));
  useKeys([
    { keys: 'ArrowLeft', does: 'decision before', run: () => beside(-1) },
    { keys: 'ArrowRight', does: 'decision after', run: () => beside(1) },
  ]);
  const camera = episode.cameras[0];
  if (!decision || !camera) return <Empty title="Nothing was kept of this rollout's decisions" />;
  const old = answer.pending && data ? ' stale' : '';
  return (
    <>
      <p class="row wrap"><span class={episode.success ? 'good' : 'bad'}>{episode.success ? '✓' : '✕'} {episode.outcome}</span><q data-sentence>{data?.sentence ?? kept.instruction}</q>
        {data && <span class="small muted" data-kept-step={data.checkpoint_step}>step {count(data.checkpoint_step)} of {data.run} said it</span>}
        <span class="fill" /><a href={episodeLink(episode.dataset, episode.index, { step: decision.step })}>Step by step</a><a href={link('evaluation', { eval: kept.eval, scene: kept.index })}>Its evaluation</a></p>
      <label class="row"><span class="nowrap">decision</span><input class="grow" type="range" min={0} max={decisions.length - 1} value={at} aria-label="Decision of the rollout" onInput={(event) => go(decisionAt(decisions, Number(event.currentTarget.value)))} />
        <span class="num nowrap" data-decision={at}>{at + 1}/{decisions.length} · {fixed(decision.step / episode.control_rate_hz, 2)} s</span></label>
      {answer.error && <Failed problem={answer.error} retry={answer.reload} />}
      <div class={`columns main-side even${old}`}>
        <div class="stack">
          {decision.picture !== null && <Seen episode={episode} picture={decision.picture} module={props.module} of={data}>
            {(marks) => <svg viewBox={`0 0 ${camera.width_px} ${camera.height_px}`} aria-hidden="true">{marks}</svg>}
          </Seen>}
          {data && <Attends of={data} module={props.module} />}
        </div>
        {data && <div class="stack"><PlanInSpace episode={episode} of={data} /></div>}
      </div>
      {data && <div class={`stack${old}`}><Said of={data} module={props.module} planner={props.planner} /><Joints of={data} /></div>}
    </>
  );
}
