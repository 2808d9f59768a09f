// SPDX-License-Identifier: Apache-2.0
// The policy that serves a run, asked about a recorded picture: what each module says and looks at, and what would
// follow from another sentence, a hidden part, or a module that says something else or thinks of another sentence.
// Nothing of it reaches a robot. All of the question stands in the address.
import { useEffect, useMemo, useRef } from 'preact/hooks';
import { patiently, postJson, query, useResource } from '../core/api';
import { useDraft, type Draft } from '../core/draft';
import { count } from '../core/format';
import { focusOn, useKeys } from '../core/keys';
import { link, parameter } from '../core/router';
import { readRectangles, writeRectangles, type Rectangle } from '../core/rectangles';
import { useChosen } from '../core/sources';
import type { Episode, Episodes, Eval, Insight } from '../core/types';
import { ActionButton } from '../parts/actions';
import { Empty, Failed, Panel, Select, Skeleton } from '../parts/basics';
import { Mask } from '../parts/mask';
import { PlanInSpace } from '../parts/plan';
import { Attends, Said, Seen } from '../parts/said';
import { Joints, Worth } from '../parts/worth';

/** `planner`: the module that decodes waypoints, '' for none. `tell`: hears each answer, and undefined while there is none. */
export interface Shown { module: string; planner: string; tell: (of: Insight | undefined) => void }

/**
 * `kept`: evaluations of the run whose files can be looked at while nobody serves it. `heard`: modules of which another
 * one reads what they decode, and not their register alone. `read`: of which another one reads either.
 */
interface Asked extends Shown { run: string; kept: Eval[]; heard: ReadonlySet<string>; read: ReadonlySet<string> }

export function AskPolicy(props: Asked) {
  const dataset = useChosen('dataset');
  const [index] = parameter('episode');
  // the newest once there is one: later ones do not take its place while one looks
  const first = useRef({ dataset, n: '' as string | number });
  if (first.current.dataset !== dataset) first.current = { dataset, n: '' };
  const newest = useResource<Episodes>(dataset && !index && first.current.n === '' ? `/datasets/${dataset}/episodes${query({ limit: 1 })}` : null, { every: 5000 });
  if (first.current.n === '') first.current.n = newest.data?.columns.index[0] ?? '';
  const n = index || first.current.n;
  const episode = useResource<Episode>(dataset && n !== '' ? `/datasets/${dataset}/episodes/${n}` : null);
  if (!dataset) return <Panel title="Ask the policy"><Empty title="No dataset here whose pictures could be shown to it" /></Panel>;
  const problem = episode.error ?? (n === '' ? newest.error : undefined);
  if (problem && !episode.data) return <Panel title="Ask the policy"><Failed problem={problem} retry={() => { newest.reload(); episode.reload(); }} /></Panel>;
  if (newest.data && n === '') return <Panel title="Ask the policy"><Empty title="The dataset has no episode yet whose pictures could be shown to it" /></Panel>;
  return episode.data ? <Bench key={episode.data.index} {...props} episode={episode.data} /> : <Skeleton height={320} />;
}

/** A parameter of the address as a field. */
function useField(name: string, fallback = ''): Draft & { value: string } {
  const [value, set] = parameter(name);
  return { value, ...useDraft(value || fallback, (text) => set(text || null, true), 400, true) };
}

/** "TAR3D.position=[0.1, 0.3, 0.04]" in its parts, as `etude policy watch --say` has it. */
function saidIn(text: string): { module: string; quantity: string; value: string } | null {
  const found = /^([^.=]+)\.([^.=]+)=(.*)$/s.exec(text);
  return found && { module: found[1]!, quantity: found[2]!, value: found[3]! };
}

/** "LANG=push the coke" in its parts, as `etude policy watch --think` has it. */
function thoughtIn(text: string): { module: string; sentence: string } | null {
  const at = text.indexOf('=');
  return at > 0 ? { module: text.slice(0, at), sentence: text.slice(at + 1) } : null;
}

/** Numbers, or a name with or without quotes. */
function parsed(text: string): unknown {
  if (!text.trim()) return undefined;
  try {
    return JSON.parse(text) as unknown;
  } catch {
    return text.includes('[') ? undefined : text.trim();
  }
}

function questionOf(run: string, episode: Episode, fields: { picture: number; sentence: string; other: string; hidden: Rectangle[]; how: string; say: string; think: string; worth: boolean }): string {
  const said = saidIn(fields.say);
  const value = said ? parsed(said.value) : undefined;
  const thought = thoughtIn(fields.think);
  const what_if = {
    ...(fields.other ? { sentence: fields.other } : {}),
    ...(fields.hidden.length ? { [fields.how]: fields.hidden } : {}),
    ...(said && value !== undefined ? { say: { [said.module]: { [said.quantity]: value } } } : {}),
    ...(thought?.sentence.trim() ? { think: { [thought.module]: thought.sentence.trim() } } : {}),
    ...(fields.worth ? { worth: true } : {}),
  };
  return JSON.stringify({ run, source: { dataset: episode.dataset, episode: episode.index, picture: fields.picture }, ...(fields.sentence ? { sentence: fields.sentence } : {}), ...(Object.keys(what_if).length ? { what_if } : {}) });
}

function Bench(props: Asked & { episode: Episode }) {
  const { episode, run } = props;
  const camera = episode.cameras[0];
  const pictureField = useField('picture');
  const most = Math.max(0, (camera?.frames ?? 1) - 1);
  const picture = Math.min(Number(pictureField.value) || 0, most);
  const sentence = useField('sentence', episode.instruction);
  const other = useField('other');
  const say = useField('say');
  const think = useField('think');
  const [hide, setHide] = parameter('hide');
  const [how, setHow] = parameter('how', 'hide');
  const [worth, setWorth] = parameter('worth', 'on');
  const [, go] = parameter('episode');
  const hidden = useMemo(() => readRectangles(hide), [hide]);
  const body = useMemo(() => questionOf(run, episode, { picture, sentence: sentence.value, other: other.value, hidden, how: how === 'look_away' ? 'look_away' : 'hide', say: say.value, think: think.value, worth: worth === 'on' }), [run, episode, picture, sentence.value, other.value, hidden, how, say.value, think.value, worth]);
  const answer = useResource<Insight>(camera ? body : null, {
    // one question at a time is asked: the one before, of a slider that was dragged on, may still be
    load: (path, signal) => patiently(() => postJson<Insight>('/insight', JSON.parse(path), signal), signal),
  });
  const data = answer.data;
  useEffect(() => props.tell(data), [data]);
  useEffect(() => () => props.tell(undefined), []);
  useKeys([
    { keys: 'm', does: 'brush that hides a part of the picture', run: () => focusOn('.hide-brush') },
    { keys: 'o', does: 'what a module says instead', run: () => focusOn('[data-instead] select') },
  ]);
  if (!camera) return <Panel title="Ask the policy"><Empty title="This episode has no pictures" /></Panel>;
  return (
    <Panel title="Ask the policy" aside={data && <span class="small muted" data-insight-step={data.checkpoint_step}>step {count(data.checkpoint_step)} of {data.run} answers; no robot hears it</span>}>
      <div class={`columns main-side even${answer.pending && data ? ' stale' : ''}`}>
        <div class="stack">
          <Seen episode={episode} picture={picture} module={props.module} of={data}>
            {(marks) => <Mask width={camera.width_px} height={camera.height_px} view={data?.view} hidden={hidden} change={(all) => setHide(writeRectangles(all) || null, true)}>{marks}</Mask>}
          </Seen>
          <label class="row"><span class="nowrap">picture</span><input class="grow" type="range" min={0} max={most} value={Math.min(Number(pictureField.shown) || 0, most)} aria-label="Picture of the episode" onInput={(event) => pictureField.change(event.currentTarget.value)} /><span class="num">{Math.min(Number(pictureField.shown) || 0, most) + 1}/{camera.frames}</span></label>
          <p class="row"><span class="muted small">episode {episode.index}</span>
            {episode.previous !== null && <button type="button" class="button" onClick={() => go(String(episode.previous))}>before</button>}
            {episode.next !== null && <button type="button" class="button" onClick={() => go(String(episode.next))}>after</button>}
            {hidden.length > 0 && <button type="button" class="button" onClick={() => setHide(null, true)}>show all again</button>}</p>
          {hidden.length > 0 && <Select label="what is marked" showLabel value={how === 'look_away' ? 'look_away' : 'hide'} options={[['hide', 'cannot be seen (grey)'], ['look_away', 'is seen, and no module attends to it']]} choose={(value) => setHow(value === 'hide' ? null : value, true)} />}
          {data && <Attends of={data} module={props.module} />}
        </div>
        <div class="stack">
          <label class="stack tight"><span class="small muted">sentence</span><input class="field" placeholder={episode.instruction} value={sentence.shown} maxLength={400} onInput={(event) => sentence.change(event.currentTarget.value)} /></label>
          <label class="stack tight"><span class="small muted">what if this had been said?</span><input class="field" placeholder="push the pepsi can" value={other.shown} maxLength={400} onInput={(event) => other.change(event.currentTarget.value)} /></label>
          <div class="stack" data-instead>
            <SayInstead of={data} heard={props.heard} field={say} />
            <ThinkInstead of={data} read={props.read} field={think} />
          </div>
          <p class="small muted">Drag over the picture to hide a part of it, or focus it: arrow keys move the brush, Shift and arrows size it, Enter hides. Where a module attends is not yet why it says so: hide that part and see what follows.</p>
          {answer.error && <><Failed problem={answer.error} retry={answer.reload} />{answer.error.status === 409 && <p class="row wrap"><ActionButton label="Serve this run" about="Starts a policy server that follows what the run publishes, or where nobody trains it, of its newest checkpoint." of={{ action: 'serve', run }} />
            {props.kept.map((one) => <a class="button" href={link('inside', { run, eval: one.id })}>What was kept of {one.name}</a>)}</p>}</>}
        </div>
      </div>
      {data && <div class={answer.pending ? 'stale' : ''}><Said of={data} module={props.module} planner={props.planner} /></div>}
      {data && <Planned episode={episode} of={data} worth={worth === 'on'} setWorth={(on) => setWorth(on ? 'on' : 'off', true)} />}
    </Panel>
  );
}

/** What is said in place of a value: of a pose where it is, its rotation stays. */
function prefilled(module: Insight['modules'][string] | undefined): string {
  const value = module?.value ?? '';
  return JSON.stringify(module?.quantity === 'pose' && Array.isArray(value) ? value.slice(0, 3) : value);
}

/** Offered of those modules alone that something follows from. */
function SayInstead(props: { of: Insight | undefined; heard: ReadonlySet<string>; field: Draft & { value: string } }) {
  const said = saidIn(props.field.shown);
  const [, set] = parameter('say');
  const modules = props.of?.modules ?? {};
  const replaceable = Object.entries(modules).filter(([name, one]) => props.heard.has(name) && one.quantity !== undefined && one.value !== undefined).map(([name, one]) => [`${name}.${one.quantity}`, name] as const);
  const chosenOne = said ? `${said.module}.${said.quantity}` : '';
  if (props.of && !replaceable.length && !said) return <p class="small muted">No module here reads what another one says, only its register: saying something else in its place would change nothing. Ask another sentence, or hide a part of the picture.</p>;
  // what stands in the question, not what is being typed
  const asked = saidIn(props.field.value)?.value.trim();
  const unread = asked !== undefined && asked !== '' && parsed(asked) === undefined;
  const options = said && !replaceable.some(([name]) => name === chosenOne) ? [[chosenOne, said.module] as const, ...replaceable] : replaceable;
  return (
    <div class="row">
      <Select label="what if a module said something else?" showLabel value={chosenOne} options={[['', 'none'], ...options]} choose={(name) => set(name ? `${name}=${prefilled(modules[name.split('.')[0]!])}` : null, true)} />
      {said && <input class="field" aria-label={`what ${chosenOne} says instead`} value={said.value} onInput={(event) => props.field.change(`${chosenOne}=${event.currentTarget.value}`)} />}
      {unread && <span class="small bad" role="alert" data-unread>not read: numbers are written as [0.1, 0.3, 0.04]</span>}
    </div>
  );
}

/** A module whose register is of another sentence, or empty: what the policy has of it alone shows in what follows. */
function ThinkInstead(props: { of: Insight | undefined; read: ReadonlySet<string>; field: Draft }) {
  const thought = thoughtIn(props.field.shown);
  const [, set] = parameter('think');
  const modules = Object.keys(props.of?.modules ?? {}).filter((name) => props.read.has(name));
  const options = thought && !modules.includes(thought.module) ? [thought.module, ...modules] : modules;
  if (!options.length) return null;
  return (
    <div class="row">
      <Select label="what if a module thought of another sentence?" showLabel value={thought?.module ?? ''} options={[['', 'none'], ...options.map((name) => [name, name] as const)]} choose={(name) => set(name ? `${name}=${thought?.sentence || 'zero'}` : null, true)} />
      {thought && <input class="field" aria-label={`the sentence that ${thought.module} thinks of, or zero`} placeholder="a sentence, or zero" value={thought.sentence} maxLength={400} onInput={(event) => props.field.change(`${thought.module}=${event.currentTarget.value}`)} />}
    </div>
  );
}

/** In space, and what moves it. */
function Planned(props: { episode: Episode; of: Insight; worth: boolean; setWorth: (on: boolean) => void }) {
  return (
    <div class="columns main-side even">
      <PlanInSpace episode={props.episode} of={props.of} />
      <div class="stack">
        <label class="row"><input type="checkbox" checked={props.worth} onChange={(event) => props.setWorth(event.currentTarget.checked)} /><span class="grow">what each word and joint is worth: how far the waypoints move without it</span></label>
        {props.worth && <Worth of={props.of} />}
        <Joints of={props.of} />
      </div>
    </div>
  );
}
