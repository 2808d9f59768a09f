// SPDX-License-Identifier: Apache-2.0
// One episode or attempt: the pictures, the plots in step with them, the stages, what was planned, and why it failed.
import type { JSX } from 'preact';
import { useEffect, useMemo, useRef } from 'preact/hooks';
import { getBytes, query, root, useResource } from '../core/api';
import { folderIn } from '../core/commands';
import { bytes, clock, count, day, fixed, number, short } from '../core/format';
import { useKeys } from '../core/keys';
import { link, location, navigate, parameter } from '../core/router';
import { readSafetensors, type Tensors } from '../core/safetensors';
import { episodeLink, home } from '../core/sources';
import { moduleColor } from '../core/theme';
import type { Attempts, Dataset, Episode } from '../core/types';
import { Chip, Command, Empty, Facts, Failed, Loaded, Panel, Select, Skeleton } from '../parts/basics';
import { Chart, type Line } from '../parts/chart';
import { PictureView, type Mark } from '../parts/picture';
import { Playhead } from '../parts/playhead';
import { MakeReplay, nearestAt, nearestText, poseOf, useRemake, useReplayFiles, type ReplayFiles } from '../parts/replay';
import { Space, type SpaceData } from '../parts/space';

export function EpisodePage() {
  const [, dataset, text] = location.value.path;
  const index = Number(text);
  const attempt = location.value.query.get('attempt');
  if (!dataset || !Number.isInteger(index)) return <Panel><Empty title="Which episode?">Choose one from the <a href="/dataset">dataset</a>.</Empty></Panel>;
  return attempt === null ? <Whole key={`${dataset}/${index}`} dataset={dataset} index={index} /> : <FailedAttempt key={`${dataset}/${index}/${attempt}`} dataset={dataset} index={index} attempt={Number(attempt)} />;
}

/** Of a dataset, as commands take it; null: of none. */
function useFolder(dataset: string | null): string {
  const about = useResource<Dataset>(dataset && `/datasets/${dataset}`);
  return folderIn(about.data ?? home.value?.sources.find((one) => one.id === dataset), 'DATASET');
}

/** `replay`: the dataset is that of a replay, shown below what is said of the attempt. */
function Whole(props: { dataset: string; index: number; replay?: string }) {
  const base = `/datasets/${props.dataset}/episodes/${props.index}`;
  const episode = useResource<Episode>(base);
  const folder = useFolder(props.replay ? null : props.dataset);
  const tracks = useResource<Tensors>(episode.data ? `${base}/tracks?points=${Math.max(4000, episode.data.steps)}` : null, { load: async (path, signal) => readSafetensors(await getBytes(path, signal)) });
  if (episode.error && !episode.data) {
    return (
      <>
        <Failed problem={episode.error} retry={episode.reload} />
        <p class="row"><a class="button" href={episodeLink(props.dataset, props.index - 1)}>Previous</a><a class="button" href={episodeLink(props.dataset, props.index + 1)}>Next</a></p>
        <Command text={`etude dataset verify ${folder}`} />
      </>
    );
  }
  return <Loaded of={episode} height={640}>{(data) => <Player key={data.index} episode={data} folder={folder} tracks={tracks.data} replay={props.replay} problem={tracks.error ? () => <Failed problem={tracks.error!} retry={tracks.reload} /> : null} />}</Loaded>;
}

/** The values of a track at each step. */
function track(tensors: Tensors | undefined, name: string): Float32Array | undefined {
  return tensors?.tensors.get(name)?.values as Float32Array | undefined;
}

function column(values: Float32Array, columns: number, at: number, factor = 1): Float64Array {
  return Float64Array.from({ length: values.length / columns }, (_one, i) => values[columns * i + at]! * factor);
}

function Player(props: { episode: Episode; folder: string; tracks: Tensors | undefined; replay: string | undefined; problem: (() => JSX.Element) | null }) {
  const { episode, tracks } = props;
  const remake = useRemake(props.replay ? null : { dataset: episode.dataset, index: episode.index, attempt: episode.attempt }, false);
  const files = useReplayFiles(props.replay ?? (remake.of?.state === 'ready' && remake.of.has_episode ? remake.of.id : null));
  const unlike = files.data && tracks ? difference(episode, tracks, files.data) : null;
  const shapes = unlike === null ? files.data : undefined;
  // an episode that is read again, as when the gateway comes back, is not begun anew
  const playhead = useMemo(() => new Playhead(episode.steps, episode.control_rate_hz), [episode.dataset, episode.index, episode.steps]);
  const [at, setAt] = parameter('step');
  const [cameraName, setCamera] = parameter('camera', episode.cameras[0]?.name ?? '');
  const camera = episode.cameras.find((one) => one.name === cameraName) ?? episode.cameras[0];
  const timer = useRef(0);
  useEffect(() => {
    playhead.seek(Number(at) || 0);
    return () => {
      window.clearTimeout(timer.current);
      playhead.stop();
    };
  }, [playhead]);
  const seek = (step: number) => {
    playhead.play(false);
    playhead.seek(step);
    // after a pause: browsers refuse to change the address at every key
    window.clearTimeout(timer.current);
    timer.current = window.setTimeout(() => setAt(playhead.step || null, true), 200);
  };
  const toggle = () => (playhead.playing ? seek(playhead.step) : playhead.play(true));
  const stride = episode.image_stride;
  const picture = (by: number) => seek((Math.floor(playhead.step / stride) + by) * stride);
  const speeds = [0.25, 0.5, 1, 2, 4];
  const speed = (by: number) => { playhead.speed = speeds[Math.max(0, Math.min(speeds.length - 1, speeds.indexOf(playhead.speed) + by))]!; playhead.seek(playhead.step); };
  const other = (index: number | null) => { if (index !== null) navigate(episodeLink(episode.dataset, index)); };
  useKeys([
    { keys: 'Space', does: 'play or pause', run: toggle },
    { keys: 'ArrowLeft', does: 'picture before', run: () => picture(-1) },
    { keys: 'ArrowRight', does: 'picture after', run: () => picture(1) },
    { keys: 'Shift+ArrowLeft', does: 'ten pictures back', run: () => picture(-10) },
    { keys: 'Shift+ArrowRight', does: 'ten pictures on', run: () => picture(10) },
    { keys: '[', does: 'episode before', run: () => other(episode.previous) },
    { keys: ']', does: 'episode after', run: () => other(episode.next) },
    { keys: ',', does: 'slower', run: () => speed(-1) },
    { keys: '.', does: 'faster', run: () => speed(1) },
  ]);
  const marks = useMemo(() => pictureMarks(episode, tracks), [episode, tracks]);
  // nor is it drawn anew: whoever turned it finds it as it was
  const space = useMemo(() => spaceData(episode, tracks, shapes), [playhead, tracks !== undefined, shapes !== undefined]);
  return (
    <>
      {props.replay
        ? <div class="page-head"><h2 class="figure">Made again</h2><Chip tone={episode.success ? 'good' : 'bad'}>{episode.success ? '✓' : '✕'} <span data-made-again>{episode.outcome}</span></Chip><q>{episode.instruction}</q></div>
        : <Head episode={episode} />}
      <div class="grid players">
        <Panel label="Picture">
          {camera ? <PictureView episode={episode} camera={camera} playhead={playhead} marks={marks} /> : <Empty title="No pictures were recorded">rollout.record was false; positions and plots are below.</Empty>}
          <div class="row small">
            {marks.map((mark) => <span class="row nowrap"><svg width="14" height="14" viewBox="-7 -7 14 14" aria-hidden="true">{mark.glyph === 'ring' ? <circle r="4.5" fill="none" stroke={`var(--${mark.token})`} stroke-width="2" /> : <path d="M-6 0H-2M2 0H6M0 -6V-2M0 2V6" stroke={`var(--${mark.token})`} stroke-width="2" />}</svg>{mark.label}</span>)}
            {episode.cameras.length > 1 && <Select label="Camera" value={cameraName} options={episode.cameras.map((one) => [one.name, one.name] as const)} choose={(name) => setCamera(name)} />}
            {camera && <a href={`${root}/datasets/${episode.dataset}/episodes/${episode.index}/video/${camera.name}.mp4`} download={`${episode.index}.mp4`}>mp4</a>}
          </div>
        </Panel>
        <Panel label="Space">{space ? <Space data={space} playhead={playhead} /> : props.problem ? props.problem() : <Skeleton height={320} />}
          <p class="small muted">Tool path by stage, commanded {shapes ? 'and planned ' : ''}dashed.{shapes ? '' : ' Objects are shown by place, not by shape.'}</p>
          {shapes && <Nearest files={shapes} playhead={playhead} />}
          {unlike !== null && <p class="bad" role="alert" data-other-replay>{unlike}</p>}
          {files.error && <Failed problem={files.error} retry={files.reload} />}
          {!props.replay && !files.data && <MakeReplay of={remake} label="Make it again, with shapes and plan" command={replayCommand(props.folder, episode.index, episode.attempt)} />}
        </Panel>
        <Details episode={episode} />
      </div>
      <Panel label="Time"><Bands episode={episode} playhead={playhead} seek={seek} /><Bar episode={episode} playhead={playhead} seek={seek} toggle={toggle} frames={camera?.frames ?? 0} /></Panel>
      {tracks ? <Plots episode={episode} tracks={tracks} playhead={playhead} seek={seek} /> : <Skeleton height={200} />}
    </>
  );
}

function Head(props: { episode: Episode }) {
  const { episode } = props;
  const details = episode.details as { reason?: string };
  return (
    <div class="page-head">
      <span class="row">
        {episode.previous !== null && <a class="button icon-only" href={episodeLink(episode.dataset, episode.previous)} aria-label={`Episode ${episode.previous}`}>◀</a>}
        <b class="figure" data-episode-index>#{episode.index}</b>
        {episode.next !== null && <a class="button icon-only" href={episodeLink(episode.dataset, episode.next)} aria-label={`Episode ${episode.next}`}>▶</a>}
      </span>
      <span class={`chip ${episode.success ? 'good' : 'bad'}`}>{episode.success ? '✓' : '✕'} {episode.outcome}</span>
      <p><b>{episode.task.replace('_', ' ')} {episode.target}</b>{episode.reference && ` ${episode.reference}`} <q data-instruction>{episode.instruction}</q></p>
      {details.reason && <p class="bad">{details.reason}</p>}
      <span class="fill" />
      <a href={link('dataset', { dataset: episode.dataset })}>All episodes</a>
    </div>
  );
}

interface Planned { stage: string; way?: string; kind?: string; samples?: number; checks?: number; steps?: number; blocked?: string }

function Details(props: { episode: Episode }) {
  const { episode } = props;
  const details = episode.details as { planned?: Planned[]; nearest_m?: number; nearest_pair?: string; progress_m?: number; pushes?: number; replans?: number };
  return (
    <Panel title="What it is">
      <Facts rows={[
        ['robot', episode.robot],
        ['seed', <span class="mono" data-seed>{episode.seed}</span>],
        ['attempt', String(episode.attempt)],
        ['length', `${count(episode.steps)} steps, ${fixed(episode.duration_s, 2)} s at ${number(episode.control_rate_hz)} Hz`],
        ['split', episode.split],
        ...(details.nearest_m !== undefined ? [['nearest', `${number(details.nearest_m * 1000)} mm${details.nearest_pair ? `, ${details.nearest_pair}` : ''}`] as [string, string]] : []),
        ...(details.progress_m !== undefined ? [['progress', `${number(details.progress_m)} m`] as [string, string]] : []),
        ...(details.pushes ? [['pushes', count(details.pushes)] as [string, string]] : []),
        ...(details.replans ? [['planned anew', count(details.replans)] as [string, string]] : []),
        ['scene', <span class="mono">{short(episode.scene_sha256)}</span>],
        ['content', `version ${episode.version}`],
        ...(episode.worker ? [['worker', `${episode.worker}${episode.t ? `, ${day(episode.t)}` : ''}`] as [string, string]] : []),
        ['file', bytes(episode.bytes)],
      ]} />
      {details.planned && details.planned.length > 0 && (
        <div class="scroll-x" tabIndex={0} role="group" aria-label="Planned motions">
          <table class="plain">
            <thead><tr><th>planned</th><th>way</th><th class="num">samples</th><th class="num">checks</th><th class="num">steps</th></tr></thead>
            <tbody>{details.planned.map((one) => <tr title={one.blocked ?? ''}><td>{one.stage}</td><td class="secondary">{one.way ?? one.kind}</td><td class="num">{count(one.samples)}</td><td class="num">{count(one.checks)}</td><td class="num">{count(one.steps)}</td></tr>)}</tbody>
          </table>
        </div>
      )}
    </Panel>
  );
}

function Bands(props: { episode: Episode; playhead: Playhead; seek: (step: number) => void }) {
  const { episode, playhead } = props;
  const box = useRef<HTMLDivElement>(null);
  useEffect(() => playhead.follow((step) => {
    box.current?.querySelectorAll('button').forEach((button, i) => {
      const stage = episode.stages[i]!;
      button.toggleAttribute('data-now', step >= stage.from && step < stage.to);
    });
  }) as () => void, [playhead]);
  const unsupervised = (from: number, to: number) => episode.unsupervised.some((one) => one.from <= from && one.to >= to);
  return (
    <div class="bands" ref={box} role="group" aria-label="Stages">
      {episode.stages.map((stage) => (
        <button type="button" style={{ flex: `${stage.to - stage.from} 0 0` }} title={`${stage.name}: steps ${stage.from} to ${stage.to - 1}`} onClick={() => props.seek(stage.from)}
          {...(unsupervised(stage.from, stage.to) ? { 'data-off': '' } : {})}>{stage.name}</button>))}
    </div>
  );
}

function Bar(props: { episode: Episode; playhead: Playhead; seek: (step: number) => void; toggle: () => void; frames: number }) {
  const { episode, playhead } = props;
  const slider = useRef<HTMLInputElement>(null);
  const text = useRef<HTMLSpanElement>(null);
  const play = useRef<HTMLButtonElement>(null);
  useEffect(() => playhead.follow((step) => {
    if (slider.current) slider.current.value = String(step);
    if (text.current) text.current.textContent = `${(step / episode.control_rate_hz).toFixed(2)} of ${episode.duration_s.toFixed(2)} s · picture ${Math.min(props.frames, Math.floor(step / episode.image_stride) + 1)} of ${props.frames} · step ${step} of ${episode.steps} · ${playhead.speed}×`;
    if (play.current) {
      play.current.textContent = playhead.playing ? '❚❚' : '▶';
      play.current.setAttribute('aria-label', playhead.playing ? 'Pause' : 'Play');
    }
  }) as () => void, [playhead]);
  return (
    <div class="player-bar">
      <button type="button" class="button icon-only" ref={play} aria-label="Play" onClick={props.toggle}>▶</button>
      <input type="range" ref={slider} aria-label="Step" min="0" max={episode.steps - 1} defaultValue="0" onInput={(event) => { playhead.play(false); playhead.seek(Number(event.currentTarget.value)); }} onChange={(event) => props.seek(Number(event.currentTarget.value))} />
      <span class="small secondary" ref={text} data-time />
    </div>
  );
}

function pictureMarks(episode: Episode, tracks: Tensors | undefined): Mark[] {
  const marks: Mark[] = [];
  const add = (token: string, label: string, glyph: Mark['glyph'], name: string) => {
    const pixels = track(tracks, name);
    if (pixels) marks.push({ token, label, glyph, pixels });
  };
  add('hand', 'hand', 'ring', 'eef_pixel');
  add('target', `target: ${episode.target}`, 'cross', `objects/${episode.target}/pixel`);
  if (episode.reference) add('reference', `reference: ${episode.reference}`, 'cross', `objects/${episode.reference}/pixel`);
  return marks;
}

function replayCommand(folder: string, index: number, attempt: number): string {
  return `etude attempt replay ${folder} --index ${index} --attempt ${attempt} --out attempt-${index}-${attempt}`;
}

/** Why the replay is not this episode; null: it is. Wrong shapes in right places would say nothing of it. */
function difference(episode: Episode, tracks: Tensors, files: ReplayFiles): string | null {
  if (files.plan.steps !== episode.steps) return `The replay has ${count(files.plan.steps)} steps, the episode ${count(episode.steps)}: another program made it. It is not drawn.`;
  for (const name of episode.objects) {
    const places = track(tracks, `objects/${name}/pose`);
    if (!places || places.length !== 7 * episode.steps) continue;  // merged buckets cannot be compared
    for (const step of [0, episode.steps - 1]) {
      const pose = poseOf(files, name, step);
      const off = pose && Math.hypot(...[0, 1, 2].map((c) => pose[c]! - places[7 * step + c]!));
      if (off === undefined || off > 0.001) return `In the replay ${name} is elsewhere${off === undefined ? '' : `, by ${number(1000 * off)} mm`}: another program made it. It is not drawn.`;
    }
  }
  return null;
}

/** What the arm is nearest to, in step with the pictures. */
function Nearest(props: { files: ReplayFiles; playhead: Playhead }) {
  const text = useRef<HTMLParagraphElement>(null);
  useEffect(() => props.playhead.follow((step) => {
    const near = nearestAt(props.files.plan, step);
    if (text.current) text.current.textContent = near ? `nearest ${nearestText(near)}: ${near.a} – ${near.b}` : 'nothing near';
  }) as () => void, [props.files, props.playhead]);
  return <p class="small" ref={text} data-nearest />;
}

const stageTokens = ['hand', 'language', 'reference', 'obstacle', 'others'];

function spaceData(episode: Episode, tracks: Tensors | undefined, files: ReplayFiles | undefined): SpaceData | null {
  const tool = track(tracks, 'eef_pos');
  if (!tool) return null;
  const commanded = track(tracks, 'actions_abs');
  const paths: SpaceData['paths'] = episode.stages.map((stage, i) => ({ points: tool.slice(3 * stage.from, 3 * Math.min(tool.length / 3, stage.to + 1)), token: stageTokens[i % stageTokens.length]!, dashed: false }));
  if (commanded) {
    const wide = commanded.length / (tool.length / 3);
    const points = new Float32Array(tool.length);
    for (let i = 0; i < tool.length / 3; i++) for (let c = 0; c < 3; c++) points[3 * i + c] = commanded[wide * i + c]!;
    paths.push({ points, token: 'muted', dashed: true });
  }
  for (const motion of files?.plan.motions ?? []) {
    if (motion.poses.length > 1) paths.push({ points: Float32Array.from(motion.poses.flatMap((pose) => pose.slice(0, 3))), token: motion.disturbance ? 'obstacle' : 'accent', dashed: true });
  }
  const token = (name: string) => (name === episode.target ? 'target' : name === episode.reference ? 'reference' : name === episode.obstacle ? 'obstacle' : 'muted');
  const objects = episode.objects.flatMap((name) => {
    const pose = track(tracks, `objects/${name}/pose`);
    return pose ? [{ name, token: token(name), pose }] : [];
  });
  const camera = episode.cameras[0];
  return { tool, paths, objects, camera: camera ? { position: camera.position_m, quaternion_wxyz: camera.quaternion_wxyz, fovy_rad: camera.fovy_rad } : null,
    replay: files ? { files, token: (body) => (episode.objects.includes(body) ? token(body) : 'edge') } : null };
}

interface Decision { step: number; checkpoint_step: number; touched: boolean; error_m?: Record<string, number> }

const lineTokens = ['target', 'hand', 'language', 'reference', 'obstacle', 'others', 'text', 'muted'];

function Plots(props: { episode: Episode; tracks: Tensors; playhead: Playhead; seek: (step: number) => void }) {
  const { episode, tracks, playhead } = props;
  const plots = useMemo(() => makePlots(episode, tracks), [episode, tracks]);
  const bands = episode.stages.map((stage) => ({ from: stage.from, to: stage.to, label: stage.name }));
  return (
    <div class="grid charts">
      {plots.map((plot) => <Panel><Chart {...plot} sync="episode" bands={bands} follow={playhead} pick={props.seek} /></Panel>)}
    </div>
  );
}

function makePlots(episode: Episode, tracks: Tensors): { title: string; unit: string; lines: Line[] }[] {
  const steps = tracks.tensors.get('step')?.values ?? Float64Array.from({ length: episode.steps }, (_one, i) => i);
  const x = Float64Array.from(steps);
  const plots: { title: string; unit: string; lines: Line[] }[] = [];
  const about = (name: string) => episode.tracks.find((one) => one.name === name);
  const actual = track(tracks, 'eef_pos');
  const wanted = track(tracks, 'actions_abs');
  const wide = about('actions_abs')?.columns ?? 10;
  if (actual) {
    plots.push({ title: 'Tool position', unit: 'm', lines: ['x', 'y', 'z'].flatMap((label, i) => [
      { label, token: lineTokens[i]!, x, values: column(actual, 3, i) },
      ...(wanted ? [{ label: `${label} commanded`, token: lineTokens[i]!, x, values: column(wanted, wide, i), dash: true, faint: true }] : []),
    ]) });
    if (wanted) {
      const error = Float64Array.from(x, (_one, i) => 1000 * Math.hypot(...[0, 1, 2].map((c) => wanted[wide * i + c]! - actual[3 * i + c]!)));
      plots.push({ title: 'Commanded less actual', unit: 'mm', lines: [{ label: 'distance', token: 'text', x, values: error }] });
    }
  }
  for (const [name, title, factor, unit] of [['joint_pos', 'Joints', 1, 'rad'], ['joint_vel', 'Joint velocity', 1, 'rad/s'], ['gripper_qpos', 'Gripper', 1, '']] as const) {
    const values = track(tracks, name);
    const meta = about(name);
    if (!values || !meta) continue;
    plots.push({ title, unit: unit || meta.unit, lines: Array.from({ length: meta.columns }, (_one, i) => ({ label: (meta.labels[i] ?? (meta.columns === 1 ? 'opening' : String(i + 1))).replace(/_joint$/, '').replace(/^.*_joint/, 'joint '), token: lineTokens[i % lineTokens.length]!, x, values: column(values, meta.columns, i, factor) })) });
  }
  const decisions = (episode.details as { decisions?: Decision[] }).decisions ?? [];
  const names = [...new Set(decisions.flatMap((one) => Object.keys(one.error_m ?? {})))];
  if (names.length) {
    const at = Float64Array.from(decisions, (one) => one.step);
    const token = (name: string) => (moduleColor(name) === 'motion' ? 'text' : moduleColor(name));
    plots.unshift({ title: 'Errors at each decision', unit: 'mm', lines: names.map((name) => ({ label: name, token: token(name), x: at, values: Float64Array.from(decisions, (one) => 1000 * (one.error_m?.[name] ?? NaN)), points: true })) });
  }
  return plots;
}

function FailedAttempt(props: { dataset: string; index: number; attempt: number }) {
  const rows = useResource<Attempts>(`/campaigns/${props.dataset}/attempts${query({ index: props.index, limit: 200 })}`);
  const folder = useFolder(props.dataset);
  const remake = useRemake(props, true);
  return (
    <Loaded of={rows}>
      {(data) => {
        const row = data.rows.find((one) => one.attempt === props.attempt);
        if (!row) return <Panel><Empty title={`Attempt ${props.attempt} of #${props.index} is not in the journal`}>The journal has {count(data.total)} attempts of this index.</Empty></Panel>;
        const others = data.rows.filter((one) => one !== row);
        return (
          <>
            <div class="page-head"><b class="figure">#{row.index}.{row.attempt}</b><Chip tone={row.outcome === 'success' ? 'good' : 'bad'}>{row.outcome === 'success' ? '✓' : '✕'} {row.outcome}</Chip><p>{row.task.replace('_', ' ')} <b>{row.target}</b></p></div>
            <div class="grid wide">
              <Panel title="Why">
                <p class="figure" data-reason>{row.reason ?? row.outcome}</p>
                <Facts rows={[['stage', row.stage ?? '–'], ['what touched', row.pair ?? '–'], ['robot', row.robot], ['seed', <span class="mono" data-seed>{row.seed}</span>], ['worker', row.worker ?? '–'], ['when', clock(row.t)],
                  ['planned', `${number(row.plan_s, 2)} s`], ['stepped', `${number(row.step_s, 2)} s`], ['rendered', `${number(row.render_s, 2)} s`]]} />
              </Panel>
              <Panel title="Look at it">
                <p class="secondary">A failed attempt leaves no picture, but it is a function of its seed: this makes the same attempt again, with video, planned motions and distances.</p>
                <MakeReplay of={remake} label="Make it again" />
                {remake.of?.state === 'ready' && !remake.of.has_episode && <p class="row"><Chip>made again</Chip>It ended before anything moved: there is nothing to see but the reason.</p>}
                <Command text={replayCommand(folder, row.index, row.attempt)} />
                {others.length > 0 && <><h2>Other attempts of this index</h2><ul class="links">{others.map((one) => <li><a href={episodeLink(props.dataset, one.index, one.has_pictures ? {} : { attempt: one.attempt })}>#{one.index}.{one.attempt}</a> {one.outcome}</li>)}</ul></>}
              </Panel>
            </div>
            {remake.of?.state === 'ready' && remake.of.has_episode && remake.of.id && <Whole key={remake.of.id} dataset={remake.of.id} index={props.index} replay={remake.of.id} />}
          </>
        );
      }}
    </Loaded>
  );
}
