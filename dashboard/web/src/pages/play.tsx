// SPDX-License-Identifier: Apache-2.0
// Play: a scene, a sentence, and the policy that obeys it or does not.
import { useEffect, useMemo, useRef, useState } from 'preact/hooks';
import { getBytes, getJson, jobGone, postJson, query, reasonOf, root, useResource } from '../core/api';
import { epoch, now, useLive } from '../core/connection';
import { none } from '../core/format';
import { useKeys } from '../core/keys';
import { parameter, setParameters } from '../core/router';
import { home } from '../core/sources';
import { moduleColor } from '../core/theme';
import type { Job, PlayInsight, PlaySession } from '../core/types';
import { Chip, Command, Empty, Facts, Failed, Loaded, Panel, Select } from '../parts/basics';
import { Frame } from '../parts/frame';
import { PixelMark } from '../parts/mark';
import { Spotlight } from '../parts/spotlight';
import { TableTop, type Standing } from '../parts/table_top';
import { TokenField, useToken } from '../parts/sign_in';

interface Sessions { enabled: boolean; sessions: PlaySession[]; policies: string[]; campaigns: string[] }
interface Meaning { sentence: string; words: { text: string; seen: boolean }[]; task: string; target: string; reference: string; why: string; words_of: 'training' | 'campaign' }
interface Scene { campaign: string; robot: string; index: number; seed: string; tasks: string[]; objects: Standing[]; table_half_m: number; camera: View }
interface View { width: number; height: number; fovy: number; position: number[]; quaternion: number[] }
interface Judge { doing?: string; judged?: boolean; done?: boolean; held?: number; dwell?: number; words?: string; violations?: unknown[]; disturbed?: string[] }

export function PlayPage() {
  const [session] = parameter('session');
  const all = useResource<Sessions>('/play/sessions', { every: 2000 });
  return (
    <Loaded of={all}>
      {(data) => {
        if (!data.enabled) return <Panel><Empty title="This gateway reads no bus" command="etude dashboard --dir . --domain 0">Play needs the bus, on which a policy is served.</Empty></Panel>;
        const there = data.sessions.some((one) => one.session === session);
        return (
          <>
            <Opener data={data} session={session} there={there} />
            {there && <Table session={session} key={session} />}
            {!session && <Panel><Empty title="No session is chosen" command="etude play open deploy/campaigns/quickstart.yaml --run RUN">Open one above, or on the command line.</Empty></Panel>}
          </>
        );
      }}
    </Loaded>
  );
}

interface Opened { session: string; job: string }

const openingMs = 20000;

/**
 * Who of those that are served is meant by NAME, or NAME@ID, an id may be cut. A server of a file has another id when it
 * is started again: then who has its name now, where there is one alone.
 */
function servedAs(policies: string[], policy: string): string | undefined {
  const exact = policy.includes('@') && policies.find((one) => one.startsWith(policy));
  const [sole, ...others] = policies.filter((one) => one.split('@')[0] === policy.split('@')[0]);
  return exact || (others.length ? undefined : sole);
}

/** What a session is opened with; all of it in the address. */
function useWish(data: Sessions) {
  const [campaign] = parameter('campaign', 'quickstart');
  const [index] = parameter('index', '0');
  const [seed] = parameter('seed');
  const [policy] = parameter('policy');
  const run = (policy ? servedAs(data.policies, policy) ?? policy : data.policies[0]) ?? '';
  return { spec: campaign, run, index: Number(index) || 0, ...(seed ? { seed } : {}) };
}

/** Choosing a session brings its scene into the address, as far as it says which one it is. */
function choose(data: Sessions, name: string): void {
  const one = data.sessions.find((all) => all.session === name);
  const scene = one?.scene as unknown as Scene | undefined;
  const known = scene && data.campaigns.includes(scene.campaign);
  setParameters({ session: name, ...(known ? { campaign: scene.campaign, index: scene.index, seed: null, policy: one!.run } : {}) });
}

function Opener(props: { data: Sessions; session: string; there: boolean }) {
  const { data, session } = props;
  const wish = useWish(data);
  const [said, setSaid] = useState('');
  const [command, setCommand] = useState('');
  const [shown, show] = useState('');
  const [token, setToken] = useState('');
  const [opened, setOpened] = useState<Opened | null>(null);
  const [opening, setOpening] = useState(false);
  // its scene, where it was heard here: only what is chosen below can be opened again
  const heard = data.sessions.find((one) => one.session === session);
  const last = useRef<PlaySession | undefined>(undefined);
  if (heard) last.current = heard;
  const scene = last.current?.session === session ? (last.current.scene as unknown as Scene) : undefined;
  const same = !scene || (scene.campaign === wish.spec && scene.index === wish.index);
  // an address says nothing of how far its session is: whoever just came waits as long as one takes to open, and a
  // gateway that was started again hears of sessions only when it is asked for them
  const generation = epoch.value;
  const came = useMemo(() => Date.now(), [generation]);
  const waiting = session !== '' && !props.there && opened?.session !== session && now.value - came < openingMs;
  const coming = session !== '' && !props.there && opened?.session === session;
  const job = useResource<Job>(coming ? `/jobs/${opened.job}` : null, { every: 1000 });
  const gone = coming && job.error?.status === 404;
  const ended = session !== '' && !props.there && !waiting && (!coming || gone || (job.data !== undefined && job.data.state !== 'running'));
  const text = JSON.stringify(wish);
  const picture = `${encodeURIComponent(wish.spec)}/${wish.index}.png${query({ seed: wish.seed })}`;
  useEffect(() => {
    setCommand('');
    if (!wish.run) return;
    const abort = new AbortController();
    postJson<{ command: string }>('/play/sessions', { ...wish, dry_run: true }, abort.signal).then((answer) => { setCommand(answer.command); setSaid(''); }).catch((error: unknown) => { if (!abort.signal.aborted) setSaid(reasonOf(error)); });
    return () => abort.abort();
  }, [text]);
  const open = async () => {
    if (opening) return;  // each is a simulator of its own
    setOpening(true);
    try {
      if (token) await postJson('/session', { token });
      setToken('');
      const started = await postJson<Opened>('/play/sessions', wish);
      setSaid('');
      show('');
      setOpened(started);
      setParameters({ session: started.session });
    } catch (error) {
      setSaid(reasonOf(error));
    } finally {
      setOpening(false);
    }
  };
  const actions = home.value?.actions ?? true;
  const set = (name: string) => (value: string) => setParameters({ [name]: value || null }, true);
  return (
    <Panel title="Sessions">
      {(waiting || (coming && !ended)) && <p role="status" class="muted">{waiting ? `${session} is looked for.` : `${session} is being opened.`}</p>}
      {ended && <Ended session={session} log={job.data?.log ?? []} gone={gone} same={same} again={actions && same ? () => { void open(); } : null} able={wish.run !== ''} />}
      <div class="row wrap">
        {data.sessions.length > 0 && <Select showLabel label="Session" value={session} options={[['', 'choose one'], ...data.sessions.map((one) => [one.session, `${one.session} (${one.phase})`] as const)]} choose={(name) => choose(data, name)} />}
        <Select showLabel label="Scene of" value={wish.spec} options={listed(data.campaigns, wish.spec)} choose={set('campaign')} />
        <label class="inline">Number<input class="field" type="number" min="0" value={wish.index} onInput={(event) => set('index')(event.currentTarget.value)} /></label>
        <label class="inline">Seed<input class="field" inputMode="numeric" size={12} maxLength={20} placeholder="the campaign's" value={wish.seed ?? ''} onInput={(event) => set('seed')(event.currentTarget.value.trim())} /></label>
        <Select showLabel label="Policy" value={wish.run} options={wish.run ? listed(data.policies, wish.run) : [['', 'none is served']]} choose={set('policy')} />
        {actions && <TokenField value={token} change={setToken} />}
        <button type="button" class="button" onClick={() => show(picture)}>Preview</button>
        {actions && <button type="button" class="button" disabled={!wish.run || opening} onClick={() => { void open(); }}>Open</button>}
      </div>
      {shown === picture && <Preview of={shown} />}
      {command && <Command text={command} />}
      {said && <p class="small bad" role="alert">{said}</p>}
      {!actions && <p class="small muted">This gateway was started without --token-file: it opens nothing. Copy the command.</p>}
      {!data.policies.length && <Command text="etude policy --checkpoint FILE" />}
    </Panel>
  );
}

/** `gone`: the gateway knows nothing of its job any more. `same`: its scene is the one that is chosen. `again`: opens it again. */
function Ended(props: { session: string; log: string[]; gone: boolean; same: boolean; again: (() => void) | null; able: boolean }) {
  return (
    <div class="problem" role="alert" data-ended={props.session}>
      <h2>The session {props.session} has ended</h2>
      {props.log.slice(-3).map((line) => <p class="small mono">{line}</p>)}
      {props.gone && <p>{jobGone.title}. {jobGone.detail}</p>}
      <p>It is not heard any more. {props.same ? 'Its scene is chosen below.' : 'What is chosen below is another scene.'}</p>
      {props.again && <button type="button" class="button" disabled={!props.able} onClick={props.again}>Open the same scene again</button>}
    </div>
  );
}

/** The scene as it begins, or why there is no picture of it. */
function Preview(props: { of: string }) {
  const picture = useResource<string>(`/scenes/${props.of}`, { load: async (path, signal) => URL.createObjectURL(new Blob([await getBytes(path, signal)], { type: 'image/png' })) });
  const { data } = picture;
  useEffect(() => () => { if (data) URL.revokeObjectURL(data); }, [data]);
  if (picture.error) return <Failed problem={picture.error} retry={picture.reload} />;
  if (!data || picture.pending) return <p role="status" class="muted">The scene is being drawn.</p>;
  return <img class="play-scene" src={data} alt={`The scene ${props.of}`} />;
}

/** All that there are, and the one of the address. */
function listed(names: string[], value: string): (readonly [string, string])[] {
  return [...new Set([...names, value])].map((one) => [one, names.includes(one) ? one : `${one} (not here)`] as const);
}

function Table(props: { session: string }) {
  const address = `/play/sessions/${encodeURIComponent(props.session)}`;
  const first = useResource<PlaySession>(address, { every: 5000 });
  const live = useLive<PlaySession>('play', { session: props.session }, 10);
  const [selected, select] = useState('');
  const [refusal, setRefusal] = useState('');
  const access = useToken();
  const send = async (action: string, values: Record<string, unknown> = {}): Promise<boolean> => {
    try {
      const answer = await access.act(() => postJson<{ accepted: boolean; refusal: string }>(`${address}/commands`, { action, arguments: values }));
      setRefusal(answer.refusal);
      return answer.accepted;
    } catch (error) {
      setRefusal(reasonOf(error));
      return false;
    }
  };
  const signIn = () => access.act(() => Promise.resolve()).then(() => setRefusal(''), (error: unknown) => setRefusal(reasonOf(error)));
  return (
    <Loaded of={{ ...first, data: live ?? first.data }}>
      {(state) => {
        const scene = state.scene as unknown as Scene;
        const resting = state.phase === 'rest';
        const place = (name: string, x: number, y: number) => {
          const yaw = scene.objects.find((one) => one.name === name)?.yaw ?? 0;
          return send('scene', { keep: true, objects: [{ name, x, y, yaw }] });
        };
        return (
          <div class="play">
            <Panel title={`${scene.campaign} ${scene.index}, ${scene.robot}`} aside={<Chip>{state.run}</Chip>}>
              <Live session={props.session} state={state} scene={scene} />
              <p class="row wrap small"><span>{(state.judge as Judge).doing ?? state.phase}</span><span class="num">step {state.step}{state.max_steps ? ` of ${state.max_steps}` : ''}</span><span class="num">policy {state.policy_ms.toFixed(0)} ms</span>{!resting && <span class="num">{state.speed.toFixed(1)}× real time</span>}</p>
            </Panel>
            <div class="stack">
              <Say address={address} state={state} scene={scene} send={send} />
              <Verdict state={state} />
              <Panel title="Table">
                <TableTop half={scene.table_half_m} objects={scene.objects} selected={selected} select={select} move={resting ? place : null} />
                <Moves selected={scene.objects.find((one) => one.name === selected)} send={send} reset={() => { void send('reset'); }} />
                {refusal && <p class="bad" role="alert">{refusal}</p>}
                {access.field && <form class="row" data-play-sign-in onSubmit={(event) => { event.preventDefault(); void signIn(); }}>{access.field}<button type="submit" class="button" disabled={!access.ready}>Sign in</button></form>}
              </Panel>
              <Modules modules={state.modules as Record<string, unknown>} step={state.checkpoint_step} />
            </div>
          </div>
        );
      }}
    </Loaded>
  );
}

/** The policy's own picture: what a module attends to as light, where modules see things, where it wants the hand to go. */
function Live(props: { session: string; state: PlaySession; scene: Scene }) {
  const { state } = props;
  const { camera } = props.scene;
  const [look, setLook] = parameter('look');
  const moving = state.phase === 'moving';
  const address = `/play/sessions/${encodeURIComponent(props.session)}`;
  // its policy shows what it sees for as long as somebody asks
  const seen = useResource<PlayInsight>(moving && look !== 'none' ? `${address}/insight` : null, { every: 150 });
  const all = Object.entries(seen.data?.attention ?? {}).filter(([, one]) => one.rows > 0).map(([name]) => name);
  const module = all.includes(look) ? look : all.find((name) => seen.data?.modules[name]?.entity === 'target') ?? all[0];
  const attention = module ? seen.data?.attention[module] : undefined;
  const points = moving ? state.waypoints.map((one) => project(camera, one)).filter((one) => one !== null) : [];
  return (
    <>
      <div class="play-picture" style={{ aspectRatio: `${camera.width} / ${camera.height}` }}>
        {state.frame > 0 && <Frame n={state.frame} address={(n) => `${root}${address}/frame.jpg?n=${n}`} width={camera.width} height={camera.height} />}
        {moving && seen.data && module && attention && <Spotlight module={module} attention={attention} view={seen.data.view} width={camera.width} height={camera.height} />}
        <svg viewBox={`0 0 ${camera.width} ${camera.height}`} aria-hidden="true">
          {moving && pixelsOf(state.modules).map(([name, at]) => <PixelMark key={name} token={moduleColor(name)} glyph={moduleColor(name) === 'hand' ? 'ring' : 'cross'} at={at} />)}
          {points.length > 1 && <polyline points={points.map((one) => one.join(',')).join(' ')} />}
          {points.map(([u, v], i) => <circle class="waypoint" cx={u} cy={v} r={camera.width / 90} opacity={1 - (0.7 * i) / points.length} />)}
        </svg>
      </div>
      <p class="row wrap small">
        <Select showLabel label="Attention of" value={look === 'none' ? 'none' : all.includes(look) ? look : ''} choose={(name) => setLook(name || null, true)}
          options={[['', module && look !== 'none' ? `the target's module (${module})` : "the target's module"], ...all.map((name) => [name, name] as const), ['none', 'none']]} />
        <span class="muted" data-looks>{look === 'none' ? '' : attention ? `${Math.round(100 * attention.share)} % of it on the picture` : moving ? 'its policy has not shown it yet' : 'shown while it moves'}</span>
      </p>
    </>
  );
}

/** Where modules say that something is in the picture, px. */
function pixelsOf(modules: Record<string, unknown>): [string, number[]][] {
  return Object.entries(modules).flatMap(([name, said]): [string, number[]][] => {
    const { quantity, value } = said as { quantity?: unknown; value?: unknown };
    return quantity === 'pixel' && Array.isArray(value) && value.length === 2 && value.every(Number.isFinite) ? [[name, value as number[]]] : [];
  });
}

/** World (m) to picture (px); null behind the camera. The camera looks along its -z, y up. */
function project(camera: View, p: number[]): [number, number] | null {
  const [w = 1, x = 0, y = 0, z = 0] = camera.quaternion;
  const d = [0, 1, 2].map((i) => (p[i] ?? 0) - (camera.position[i] ?? 0)) as [number, number, number];
  // rotated by the inverse of the camera's orientation
  const t = [2 * (d[1] * z - d[2] * y), 2 * (d[2] * x - d[0] * z), 2 * (d[0] * y - d[1] * x)] as [number, number, number];
  const c = [d[0] + w * t[0] + (t[1] * z - t[2] * y), d[1] + w * t[1] + (t[2] * x - t[0] * z), d[2] + w * t[2] + (t[0] * y - t[1] * x)] as [number, number, number];
  if (c[2] >= -1e-6) return null;
  const focal = camera.height / 2 / Math.tan(camera.fovy / 2);
  return [camera.width / 2 + (focal * c[0]) / -c[2], camera.height / 2 - (focal * c[1]) / -c[2]];
}

/** What a sentence is judged by; without a task it is not judged. */
interface Intent { task: string; target: string; reference: string }

/** Chosen by hand in the address, "push,coke" or "none"; null: what the sentence means. */
function intentIn(text: string): Intent | null {
  const [task = '', target = '', reference = ''] = text.split(',');
  return text ? { task: task === 'none' ? '' : task, target, reference } : null;
}

function Say(props: { address: string; state: PlaySession; scene: Scene; send: (action: string, values?: Record<string, unknown>) => Promise<boolean> }) {
  const [kept, keep] = parameter('sentence');
  const [sentence, setSentence] = useState(kept);
  const [asked, setAsked] = useState('');
  const [by, setBy] = parameter('judge');
  const [failed, fail] = useState('');
  useEffect(() => fail(''), [sentence, by]);
  useEffect(() => {
    // the address takes what was typed after a pause: browsers refuse to change it at every key
    const timer = window.setTimeout(() => {
      setAsked(sentence.trim());
      keep(sentence.trim(), true);
    }, 200);
    return () => window.clearTimeout(timer);
  }, [sentence]);
  // a name means one object or another by what stands on the table
  const table = props.scene.objects.map((one) => (one.hidden ? '' : one.name)).join();
  const meaning = useResource<Meaning>(asked ? `${props.address}/meaning${query({ sentence: asked })}` : null, { round: table });
  const sending = useRef(false);
  const resting = props.state.phase === 'rest';
  const means = meaning.data;
  const run = async () => {
    const text = sentence.trim();
    if (!resting || !text || sending.current) return;
    sending.current = true;
    fail('');
    try {
      // asked anew: what was typed a moment ago was not yet, and without a task nobody judges
      const { task, target, reference } = intentIn(by) ?? await getJson<Meaning>(`${props.address}/meaning${query({ sentence: text })}`);
      await props.send('say', { sentence: text, task, target, reference });
    } catch (error) {
      fail(`${reasonOf(error)}: choose by what it is judged, or nobody`);
    } finally {
      sending.current = false;
    }
  };
  const judged = <JudgedBy by={by} choose={(text) => setBy(text || null, true)} scene={props.scene} />;
  useKeys([{ keys: 'r', does: 'run the sentence', run: () => { void run(); }, when: () => resting }]);
  return (
    <Panel title="Say">
      <form class="row" onSubmit={(event) => { event.preventDefault(); void run(); }}>
        <input class="field fill" aria-label="Sentence" placeholder="push the red can" value={sentence} maxLength={500} onInput={(event) => setSentence(event.currentTarget.value)} />
        <button type="submit" class="button" disabled={!resting || !sentence.trim() || (asked !== '' && means === undefined && !meaning.error)}>Run</button>
        <button type="button" class="button" disabled={resting} onClick={() => { void props.send('stop'); }}>Stop</button>
      </form>
      {means && asked && (
        <div aria-live="polite">
          <p data-words={means.words_of}>{means.words.map((word) => <><span class={word.seen ? '' : 'unseen'} title={`${training(means)} ${word.seen ? 'says' : 'never says'} it`}>{word.text}</span> </>)}</p>
          <p class="small" data-meaning>{means.task ? <>means <b>{means.task} {means.target}{means.reference && `, ${means.reference}`}</b></> : <span class="warn">not judged: {means.why}</span>}{means.words.some((word) => !word.seen) && <span class="muted" data-unseen> · {training(means)} never said: {means.words.filter((word) => !word.seen).map((word) => word.text).join(', ')}</span>}</p>
          {judged}
        </div>
      )}
      {asked && !means && meaning.error && <><p class="small bad" role="alert" data-no-meaning>What it means is not known: {meaning.error.detail ?? meaning.error.title}</p>{judged}</>}
      {failed && <p class="small bad" role="alert" data-not-said>{failed}</p>}
    </Panel>
  );
}

/** By what the sentence means, or by what one chooses: it may say it in words that nobody foresaw. */
function JudgedBy(props: { by: string; choose: (by: string) => void; scene: Scene }) {
  const { choose, scene } = props;
  const intent = intentIn(props.by);
  const objects = scene.objects.map((one) => one.name);
  const write = (one: Intent) => choose([one.task, one.target, one.reference].join(',').replace(/,+$/, ''));
  // an address, and a choice, outlive the scene that they were made in
  const offered = (names: string[], value = '') => listed(names, value).filter(([one]) => one);
  return (
    <p class="row wrap small" data-judged-by>
      <Select showLabel label="Judged by" value={intent ? intent.task || 'none' : ''} options={[['', 'what it means'], ...offered(scene.tasks, intent?.task), ['none', 'nobody']]}
        choose={(task) => (task && task !== 'none' ? write({ task, target: intent?.target || (objects[0] ?? ''), reference: intent?.reference ?? '' }) : choose(task))} />
      {intent?.task && <Select label="Object that it is judged by" value={intent.target} options={offered(objects, intent.target)} choose={(target) => write({ ...intent, target })} />}
      {intent?.task && <Select label="Reference that it is judged by" value={intent.reference} options={[['', 'no reference'], ...offered(objects.filter((one) => one !== intent.target), intent.reference)]} choose={(reference) => write({ ...intent, reference })} />}
    </p>
  );
}

/** Whose words are known: those of the checkpoint's training, else of the scene's campaign, as a training on it has them. */
function training(means: Meaning): string {
  return means.words_of === 'training' ? "the policy's training" : 'training on this campaign';
}

function Verdict(props: { state: PlaySession }) {
  const { state } = props;
  const judge = state.judge as Judge;
  if (!state.sentence) return null;
  const tone = state.outcome === 'success' ? 'good' : state.outcome === '' || state.outcome === 'unjudged' || state.outcome === 'stopped' ? '' : 'bad';
  return (
    <Panel title="Judge" class="verdict" aside={<span class="num small">{state.successes} of {state.attempts} done</span>}>
      <p>“{state.sentence}” {state.outcome ? <Chip tone={tone}>{state.outcome === 'success' ? '✓ ' : ''}{state.outcome}</Chip> : <Chip>▶ under way</Chip>}</p>
      {state.reason && <p class="small">{state.reason}</p>}
      {judge.words && <p class="small secondary">{judge.words}</p>}
      {judge.judged && <p class="small muted">held {judge.held ?? 0} of {judge.dwell ?? 0} steps · {judge.violations?.length ?? 0} violations{judge.disturbed?.length ? ` · disturbed: ${judge.disturbed.join(', ')}` : ''}</p>}
    </Panel>
  );
}

const nudges: [string, string, number, number][] = [['←', 'left', 0.03, 0], ['→', 'right', -0.03, 0], ['↑', 'away', 0, -0.03], ['↓', 'nearer', 0, 0.03]];

function Moves(props: { selected: Standing | undefined; send: (action: string, values?: Record<string, unknown>) => Promise<boolean>; reset: () => void }) {
  const { selected, send } = props;
  return (
    <div class="row wrap">
      <span class="small">{selected ? selected.name : 'choose an object'}</span>
      {nudges.map(([glyph, name, dx, dy]) => <button type="button" class="button icon-only" aria-label={`Nudge ${name} by 3 cm`} disabled={!selected || selected.hidden} onClick={() => { void send('nudge', { object: selected!.name, dx, dy }); }}>{glyph}</button>)}
      <button type="button" class="button" disabled={!selected} onClick={() => { void send(selected!.hidden ? 'show' : 'hide', { object: selected!.name }); }}>{selected?.hidden ? 'Show' : 'Hide'}</button>
      <span class="fill" />
      <button type="button" class="button" onClick={props.reset}>Reset</button>
      <button type="button" class="button" onClick={() => { void send('close'); }}>Close</button>
    </div>
  );
}

function Modules(props: { modules: Record<string, unknown>; step: number }) {
  const rows = Object.entries(props.modules).map(([name, said]) => [name, text(said)] as [string, string]);
  if (!rows.length) return null;
  return <Panel title="Modules" aside={<span class="num small">checkpoint {props.step}</span>}><Facts rows={rows} /></Panel>;
}

function text(said: unknown): string {
  // what a trajectory says is drawn over the picture
  if (said !== null && typeof said === 'object' && !('value' in said)) return none;
  const value = said !== null && typeof said === 'object' ? (said as { value: unknown }).value : said;
  if (Array.isArray(value)) return value.map((one) => (typeof one === 'number' ? one.toFixed(3) : String(one))).join(' ');
  return typeof value === 'number' ? value.toFixed(3) : typeof value === 'string' ? value : JSON.stringify(value);
}
