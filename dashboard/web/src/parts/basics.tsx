// SPDX-License-Identifier: Apache-2.0
// Small pieces that every page is made of: panels, figures, chips, commands, and the states of what is not there.
import type { ComponentChildren } from 'preact';
import { useEffect, useRef, useState } from 'preact/hooks';
import type { Problem, Resource } from '../core/api';
import type { State } from '../core/types';
import { now } from '../core/connection';
import { copyText, selectAll } from '../core/copy';
import { useDraft } from '../core/draft';
import { age } from '../core/format';

export function Panel(props: { title?: string; aside?: ComponentChildren; flush?: boolean; class?: string; children: ComponentChildren; label?: string }) {
  return (
    <section class={`panel${props.flush ? ' flush' : ''} ${props.class ?? ''}`} aria-label={props.label ?? props.title}>
      {(props.title || props.aside) && <header>{props.title && <h2>{props.title}</h2>}<span class="fill" />{props.aside}</header>}
      {props.children}
    </section>
  );
}

const states: Record<State, [string, string]> = {
  running: ['▶', 'good'], finished: ['✓', 'good'], silent: ['◌', 'warn'], stopped: ['■', ''], failed: ['✕', 'bad'], unknown: ['?', ''],
};

/** State as shape and word first, colour second. */
export function StateChip(props: { state: State | null | undefined }) {
  if (!props.state) return null;
  const [glyph, tone] = states[props.state] ?? ['?', ''];
  return <span class={`chip ${tone}`}><span aria-hidden="true">{glyph}</span>{props.state}</span>;
}

export function Chip(props: { tone?: 'good' | 'warn' | 'bad' | ''; title?: string; children: ComponentChildren }) {
  return <span class={`chip ${props.tone ?? ''}`} title={props.title}><span class="text">{props.children}</span></span>;
}

/** A figure whose change is underlined for a moment, at most every two seconds. */
export function Figure(props: { value: string; unit?: string; large?: boolean; label?: string }) {
  const element = useRef<HTMLSpanElement>(null);
  const before = useRef({ value: props.value, at: 0 });
  const timer = useRef(0);
  useEffect(() => () => window.clearTimeout(timer.current), []);
  useEffect(() => {
    const old = before.current;
    if (old.value === props.value) return;
    const at = Date.now();
    const show = at - old.at > 2000;
    before.current = { value: props.value, at: show ? at : old.at };
    if (!show) return;
    element.current?.classList.add('changed');
    // a change within that time does not take its end away
    window.clearTimeout(timer.current);
    timer.current = window.setTimeout(() => element.current?.classList.remove('changed'), 600);
  }, [props.value]);
  return (
    <p class={`figure${props.large ? ' large' : ''}`}>
      <span ref={element} data-figure={props.label}>{props.value}</span>
      {props.unit && <span class="unit">{props.unit}</span>}
    </p>
  );
}

/** How old something is, muted after 3 s where it should be live. */
export function Age(props: { ms: number | null | undefined; at: number }) {
  if (props.ms === null || props.ms === undefined) return <span class="muted">–</span>;
  const total = props.ms + Math.max(0, now.value - props.at);
  return <span class={total > 10000 ? 'warn' : total > 3000 ? 'muted' : ''}>{age(total)}</span>;
}

export function Command(props: { text: string }) {
  const [said, say] = useState('copy');
  const box = useRef<HTMLDivElement>(null);
  const code = useRef<HTMLElement>(null);
  const copy = async () => {
    const done = await copyText(props.text, box.current!);
    if (!done) selectAll(code.current!);
    say(done ? 'copied' : 'press Ctrl-C');
    window.setTimeout(() => say('copy'), done ? 1500 : 6000);
  };
  return (
    <div class="command" ref={box}>
      <code ref={code} tabIndex={0} role="group" aria-label="command">{props.text}</code>
      <button type="button" class="button plain" onClick={() => { void copy(); }} data-copy>{said}</button>
    </div>
  );
}

export function Empty(props: { title: string; children?: ComponentChildren; command?: string }) {
  return (
    <div class="empty">
      <h2>{props.title}</h2>
      {props.children && <p>{props.children}</p>}
      {props.command && <Command text={props.command} />}
    </div>
  );
}

/** Of what is known from the bus alone. */
export function elsewhere(what: string): string {
  return `The files of this ${what} are not below the folders of this gateway: what stands here is what the bus says.`;
}

export function Failed(props: { problem: Problem; retry?: () => void }) {
  return (
    <div class="problem" role="alert">
      <h2>{props.problem.title}</h2>
      {props.problem.detail && <p>{props.problem.detail}</p>}
      {props.problem.hint && <p class="secondary">{props.problem.hint}</p>}
      {props.retry && <button type="button" class="button" onClick={props.retry}>Try again</button>}
    </div>
  );
}

export function Skeleton(props: { height: number }) {
  return <div class="skeleton" style={{ height: `${props.height}px` }} aria-hidden="true" />;
}

/** What a resource is while it is not there, and its content when it is; old data stays below a reason. */
export function Loaded<T>(props: { of: Resource<T>; height?: number; children: (data: T) => ComponentChildren }) {
  const { data, error, pending, reload } = props.of;
  return (
    <>
      {error && <Failed problem={error} retry={reload} />}
      {data !== undefined ? <div class={`stack${pending ? ' stale' : ''}`}>{props.children(data)}</div> : !error && <Skeleton height={props.height ?? 240} />}
    </>
  );
}

export function Facts(props: { rows: [string, ComponentChildren][]; two?: boolean }) {
  return <dl class={`facts${props.two ? ' two' : ''}`}>{props.rows.map(([name, value]) => [<dt>{name}</dt>, <dd>{value}</dd>])}</dl>;
}

/** Which of how many are shown, and to the ones before and after. */
export function Pager(props: { from: number; shown: number; total: number; size: number; what: string; go: (from: number) => void }) {
  const { from, shown, total, size } = props;
  if (total <= size && !from) return null;
  return (
    <nav class="more" aria-label={`Pages of ${props.what}`}>
      <button type="button" class="button" disabled={!from} onClick={() => props.go(Math.max(0, from - size))}>Before</button>
      <span class="small muted num" data-page>{props.what} {(from + 1).toLocaleString('en-US')} to {(from + shown).toLocaleString('en-US')} of {total.toLocaleString('en-US')}</span>
      <button type="button" class="button" disabled={from + shown >= total} onClick={() => props.go(from + size)}>After</button>
    </nav>
  );
}

export function Segments<T extends string>(props: { label: string; value: T; options: readonly (readonly [T, string])[]; choose: (value: T) => void }) {
  return (
    <div class="segments" role="group" aria-label={props.label}>
      {props.options.map(([value, text]) => (
        <button type="button" class="button" aria-pressed={value === props.value} onClick={() => props.choose(value)}>{text}</button>
      ))}
    </div>
  );
}

export function Select(props: { label: string; value: string; options: (readonly [string, string])[]; choose: (value: string) => void; showLabel?: boolean }) {
  return (
    <label class="inline">
      <span class={props.showLabel ? '' : 'sr'}>{props.label}</span>
      <select class="field" value={props.value} onChange={(event) => props.choose(event.currentTarget.value)}>
        {props.options.map(([value, text]) => <option value={value} selected={value === props.value}>{text}</option>)}
      </select>
    </label>
  );
}

/** A text field that answers after a pause in typing. */
export function Search(props: { label: string; value: string; change: (value: string) => void; width?: number }) {
  const draft = useDraft(props.value, props.change, 250);
  return (
    <input class="field" type="search" data-filter aria-label={props.label} placeholder={props.label} value={draft.shown} style={{ width: `${props.width ?? 20}ch` }}
      onInput={(event) => draft.change(event.currentTarget.value)} />
  );
}

/** Labelled bars of one hue: counts by name, or what `text` makes of the values. `full`: the least that a full bar means. */
export function Bars(props: { rows: { name: string; value: number; link?: string | undefined }[]; limit?: number; label: string; text?: (value: number) => string; full?: number }) {
  const most = Math.max(props.full ?? 1, ...props.rows.map((one) => one.value));
  return (
    <ul aria-label={props.label}>
      {props.rows.slice(0, props.limit ?? 12).map((one) => (
        <li class="hbar">
          <span class="name">{one.link ? <a href={one.link}>{one.name}</a> : one.name}</span>
          <span class="track" aria-hidden="true"><div style={{ width: `${(100 * one.value) / most}%` }} /></span>
          <span class="num">{props.text ? props.text(one.value) : one.value.toLocaleString('en-US')}</span>
        </li>
      ))}
    </ul>
  );
}
