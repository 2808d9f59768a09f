// SPDX-License-Identifier: Apache-2.0
// The policy that serves a run, asked about a recorded picture: what each module says and looks at, and what would
// follow from another sentence, a hidden part, or a module that says something else. Nothing of it reaches a robot.
import { useMemo, useRef, useState } from 'preact/hooks';
import { postJson, query, root, useResource } from '../core/api';
import { count, none, number } from '../core/format';
import { link, parameter } from '../core/router';
import { chosen } from '../core/sources';
import { moduleColor } from '../core/theme';
import type { Episode, Episodes, Insight, ModuleSays } from '../core/types';
import { ActionButton } from '../parts/actions';
import { Empty, Failed, Panel, Select, Skeleton } from '../parts/basics';
import { PixelMark } from '../parts/mark';
import { Spotlight } from '../parts/spotlight';

type Rectangle = [number, number, number, number];

export function AskPolicy(props: { run: string; module: string }) {
  const dataset = chosen('dataset');
  const [index] = parameter('episode');
  const newest = useResource<Episodes>(dataset && !index ? `/datasets/${dataset}/episodes${query({ limit: 1 })}` : null);
  const n = index || (newest.data?.columns.index[0] ?? '');
  const episode = useResource<Episode>(dataset && n !== '' ? `/datasets/${dataset}/episodes/${n}` : null);
  if (!dataset) return <Panel title="Ask the policy"><Empty title="No dataset here whose pictures could be shown to it" /></Panel>;
  if (episode.error && !episode.data) return <Panel title="Ask the policy"><Failed problem={episode.error} /></Panel>;
  return episode.data ? <Bench key={episode.data.index} run={props.run} module={props.module} episode={episode.data} /> : <Skeleton height={320} />;
}

/** Texts of a field that are answered after a pause in typing. */
function useField(name: string): [string, (value: string) => void] {
  const [value, set] = parameter(name);
  const timer = useRef(0);
  return [value, (text) => {
    window.clearTimeout(timer.current);
    timer.current = window.setTimeout(() => set(text || null, true), 400);
  }];
}

function Bench(props: { run: string; module: string; episode: Episode }) {
  const { episode, run } = props;
  const camera = episode.cameras[0];
  const [pictureText, setPicture] = useField('picture');
  const picture = Math.min(Number(pictureText) || 0, Math.max(0, (camera?.frames ?? 1) - 1));
  const [sentence, setSentence] = useField('sentence');
  const [other, setOther] = useField('other');
  const [hidden, setHidden] = useState<Rectangle[]>([]);
  const [said, setSaid] = useState<{ module: string; text: string }>({ module: '', text: '' });
  const [, go] = parameter('episode');
  const body = useMemo(() => {
    const say = parsed(said.text);
    const what_if = {
      ...(other ? { sentence: other } : {}),
      ...(hidden.length ? { hide: hidden } : {}),
      ...(said.module && say !== undefined ? { say: { [said.module.split('.')[0]!]: { [said.module.split('.')[1]!]: say } } } : {}),
    };
    return JSON.stringify({ run, source: { dataset: episode.dataset, episode: episode.index, picture }, ...(sentence ? { sentence } : {}), ...(Object.keys(what_if).length ? { what_if } : {}) });
  }, [run, episode, picture, sentence, other, hidden, said]);
  const answer = useResource<Insight>(camera ? body : null, { load: (path, signal) => postJson<Insight>('/insight', JSON.parse(path), signal) });
  if (!camera) return <Panel title="Ask the policy"><Empty title="This episode has no pictures" /></Panel>;
  const data = answer.data;
  const modules = Object.entries(data?.modules ?? {});
  const replaceable = modules.filter(([, one]) => one.quantity !== undefined && one.value !== undefined);
  return (
    <Panel title="Ask the policy" aside={data && <span class="small muted" data-insight-step={data.checkpoint_step}>step {count(data.checkpoint_step)} of {data.run} answers; no robot hears it</span>}>
      <div class={`columns main-side even${answer.pending && data ? ' stale' : ''}`}>
        <div class="stack">
          <Seen episode={episode} picture={picture} module={props.module} of={data} hidden={hidden} hide={(one) => setHidden([...hidden, one].slice(-8))} />
          <label class="row"><span class="nowrap">picture</span><input class="grow" type="range" min={0} max={camera.frames - 1} value={picture} aria-label="Picture of the episode" onInput={(event) => setPicture(event.currentTarget.value)} /><span class="num">{picture + 1}/{camera.frames}</span></label>
          <p class="row"><span class="muted small">episode {episode.index}</span>
            {episode.previous !== null && <button type="button" class="button" onClick={() => go(String(episode.previous))}>before</button>}
            {episode.next !== null && <button type="button" class="button" onClick={() => go(String(episode.next))}>after</button>}
            {hidden.length > 0 && <button type="button" class="button" onClick={() => setHidden([])}>show all again</button>}</p>
        </div>
        <div class="stack">
          <label class="stack tight"><span class="small muted">sentence</span><input class="field" value={sentence || episode.instruction} maxLength={400} onInput={(event) => setSentence(event.currentTarget.value)} /></label>
          <label class="stack tight"><span class="small muted">what if this had been said?</span><input class="field" placeholder="push the pepsi can" value={other} maxLength={400} onInput={(event) => setOther(event.currentTarget.value)} /></label>
          <div class="row">
            <Select label="what if a module said something else?" showLabel value={said.module} options={[['', 'none'], ...replaceable.map(([name, one]) => [`${name}.${one.quantity}`, name] as const)]} choose={(module) => setSaid({ module, text: module ? JSON.stringify(data?.modules[module.split('.')[0]!]?.value ?? '') : '' })} />
            {said.module && <input class="field" aria-label={`what ${said.module} says instead`} value={said.text} onInput={(event) => setSaid({ ...said, text: event.currentTarget.value })} />}
          </div>
          <p class="small muted">Drag over the picture to hide a part of it. Where a module attends is not yet why it says so: hide that part and see what follows.</p>
          {answer.error && <><Failed problem={answer.error} retry={answer.reload} />{answer.error.status === 409 && <p class="row"><ActionButton label="Serve this run" about="Starts a policy server that follows what the run publishes." of={{ action: 'serve', run }} /></p>}</>}
          {data && <Said of={data} run={run} module={props.module} />}
        </div>
      </div>
    </Panel>
  );
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

function Seen(props: { episode: Episode; picture: number; module: string; of: Insight | undefined; hidden: Rectangle[]; hide: (one: Rectangle) => void }) {
  const { episode, of } = props;
  const camera = episode.cameras[0]!;
  const [drag, setDrag] = useState<{ from: [number, number]; to: [number, number] } | null>(null);
  const svg = useRef<SVGSVGElement>(null);
  const at = (event: PointerEvent): [number, number] => {
    const box = svg.current!.getBoundingClientRect();
    return [((event.clientX - box.left) / box.width) * camera.width_px, ((event.clientY - box.top) / box.height) * camera.height_px];
  };
  const rectangle = ({ from, to }: { from: [number, number]; to: [number, number] }): Rectangle => [Math.round(Math.min(from[0], to[0])), Math.round(Math.min(from[1], to[1])), Math.round(Math.abs(from[0] - to[0])), Math.round(Math.abs(from[1] - to[1]))];
  const attention = of?.attention[props.module];
  const truth = of ? of.truth.pixels[of.truth.target] : undefined;
  const pixel = of?.modules[props.module]?.soft_argmax;
  return (
    <div class="picture" style={{ aspectRatio: `${camera.width_px} / ${camera.height_px}` }}>
      <img src={`${root}/datasets/${episode.dataset}/episodes/${episode.index}/pictures/${encodeURIComponent(camera.name)}/${props.picture}.png`} alt={`Picture ${props.picture + 1} of episode ${episode.index}`} draggable={false} />
      {of && attention && <Spotlight module={props.module} attention={attention} view={of.view} width={camera.width_px} height={camera.height_px} />}
      <svg ref={svg} viewBox={`0 0 ${camera.width_px} ${camera.height_px}`} class="hide-brush"
        onPointerDown={(event) => { event.currentTarget.setPointerCapture(event.pointerId); setDrag({ from: at(event), to: at(event) }); }}
        onPointerMove={(event) => { if (drag) setDrag({ ...drag, to: at(event) }); }}
        onPointerUp={() => { if (drag) { const one = rectangle(drag); if (one[2] > 2 && one[3] > 2) props.hide(one); } setDrag(null); }}>
        {[...props.hidden, ...(drag ? [rectangle(drag)] : [])].map(([x, y, width, height]) => <rect x={x} y={y} width={width} height={height} fill="#808080" stroke="#fff" stroke-width="1" />)}
        {truth && <PixelMark token="target" glyph="ring" at={truth} />}
        {pixel && <PixelMark token="hand" glyph="cross" at={pixel} />}
      </svg>
    </div>
  );
}

/** What a module says, in words and units. */
function words(one: ModuleSays | undefined): string {
  if (!one || one.value === undefined) return none;
  const value = one.value;
  if (typeof value === 'string') return `${value}${one.probability !== undefined ? ` ${number(one.probability, 2)}` : ''}`;
  if (Array.isArray(value)) return `(${value.map((part) => number(part as number, 3)).join(', ')}) ${one.unit ?? ''}`;
  return JSON.stringify(value);
}

/** How far two answers of a module are apart. */
function difference(a: ModuleSays | undefined, b: ModuleSays | undefined): string {
  if (!a || !b || a.value === undefined || b.value === undefined) return none;
  if (Array.isArray(a.value) && Array.isArray(b.value)) {
    const far = Math.hypot(...a.value.map((part, i) => (part as number) - ((b.value as number[])[i] ?? 0)));
    return a.unit === 'm' ? `${number(100 * far, 2)} cm` : `${number(far, 2)} ${a.unit ?? ''}`;
  }
  return a.value === b.value ? 'same' : 'another';
}

function Said(props: { of: Insight; run: string; module: string }) {
  const { of } = props;
  return (
    <div class="scroll-x" tabIndex={0} role="group" aria-label="What the modules say">
      <table class="plain" data-said>
        <thead><tr><th>module</th><th>says</th>{of.what_if && <><th>would say</th><th class="num">Δ</th></>}<th class="num">looks at picture</th></tr></thead>
        <tbody>{Object.entries(of.modules).map(([name, one]) => (
          <tr data-module={name} {...(name === props.module ? { 'aria-selected': 'true' as const } : {})}>
            <td class="nowrap"><a href={link('inside', { run: props.run, module: name })}><span class="swatch" style={{ background: `var(--${moduleColor(name)})` }} /> {name}</a></td>
            <td>{words(one)}</td>
            {of.what_if && <><td>{words(of.what_if[name])}</td><td class="num">{difference(one, of.what_if[name])}</td></>}
            <td class="num">{of.attention[name] ? number(of.attention[name]!.share, 2) : none}</td>
          </tr>))}
        </tbody>
      </table>
    </div>
  );
}
