// SPDX-License-Identifier: Apache-2.0
// Positions on the table, as the camera sees it: world -x to the right, the robot at the top.
import { useState } from 'preact/hooks';
import { beside } from '../core/beside';
import type { Summary } from '../core/types';
import { navigate } from '../core/router';
import { episodeLink } from '../core/sources';

const glyphs = ['M-3 2.5 L0 -3 L3 2.5Z', 'M-2.5 -3 L3 0 L-2.5 3Z', 'M-3 -2.5 L0 3 L3 -2.5Z', 'M-3 0 A3 3 0 1 1 3 0 A3 3 0 1 1 -3 0Z', 'M-2.5 -2.5H2.5V2.5H-2.5Z', 'M0 -3.4 L3.4 0 L0 3.4 L-3.4 0Z'];
const tokens = ['target', 'hand', 'language', 'reference', 'obstacle', 'others'];

const ways: Record<string, readonly [number, number]> = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

/** What of the table the picture shows, and where a place of it is. */
function frameOf(x_m: number[], y_m: number[]) {
  const left = Math.max(...x_m) + 0.04;
  const right = Math.min(...x_m) - 0.04;
  const near = Math.max(...y_m) + 0.04;
  const far = Math.min(...y_m) - 0.04;
  const width = 400;
  const height = Math.min(400, (width * (near - far)) / (left - right));
  const px = (x: number) => (width * (left - x)) / (left - right);
  const py = (y: number) => (height * (y - far)) / (near - far);
  return { left, right, near, far, width, height, px, py };
}

type Frame = ReturnType<typeof frameOf>;

/** Lines every 10 cm. */
function Decimetres(props: { of: Frame }) {
  const { left, right, near, far, width, height, px, py } = props.of;
  const lines: number[] = [];
  for (let at = Math.ceil(right * 10) / 10; at <= left; at += 0.1) lines.push(at);
  const rows: number[] = [];
  for (let at = Math.ceil(far * 10) / 10; at <= near; at += 0.1) rows.push(at);
  return (
    <>
      {lines.map((at) => <line x1={px(at)} x2={px(at)} y1="0" y2={height} stroke="var(--line)" />)}
      {rows.map((at) => <line x1="0" x2={width} y1={py(at)} y2={py(at)} stroke="var(--line)" />)}
      {lines.map((at) => <text x={px(at) + 3} y={height - 4} font-size="10" fill="var(--muted)">{Math.abs(at) < 0.05 ? '0' : at.toFixed(1)}</text>)}
    </>
  );
}

export function Places(props: { of: Summary['places']; dataset: string }) {
  const { x_m, y_m, task, index } = props.of;
  const [cursor, setCursor] = useState<number | null>(null);
  if (!x_m.length) return <p class="muted">Not read yet.</p>;
  const open = (at: number) => navigate(episodeLink(props.dataset, index[at]!));
  const at = cursor === null ? null : Math.min(cursor, x_m.length - 1);
  const press = (event: KeyboardEvent) => {
    const way = ways[event.key];
    if (way) setCursor(beside(x_m, y_m, at ?? 0, way));
    else if (event.key === 'Home' || event.key === 'End') setCursor(event.key === 'Home' ? 0 : x_m.length - 1);
    else if (event.key === 'Enter' || event.key === ' ') open(at ?? 0);
    else return;
    event.preventDefault();
  };
  const tasks = [...new Set(task)];
  const frame = frameOf(x_m, y_m);
  const { left, right, near, far, width, height, px, py } = frame;
  return (
    <figure class="chart" data-places={x_m.length}>
      <div class="places" role="group" tabIndex={0} data-arrows aria-label="Places: arrow keys go from one to the next, Enter opens its episode" onKeyDown={press} onFocus={(event) => { if (event.currentTarget.matches(':focus-visible')) setCursor(cursor ?? 0); }} onBlur={() => setCursor(null)}>
      <svg viewBox={`0 0 ${width} ${height}`} width="100%" role="img" aria-label={`${x_m.length} places of targets, x ${right.toFixed(2)} to ${left.toFixed(2)} m, y ${far.toFixed(2)} to ${near.toFixed(2)} m`}>
        <Decimetres of={frame} />
        {x_m.map((x, i) => {
          const kind = tasks.indexOf(task[i]!);
          return <path d={glyphs[kind % glyphs.length]!} transform={`translate(${px(x).toFixed(1)} ${py(y_m[i]!).toFixed(1)})`} fill={`var(--${tokens[kind % tokens.length]})`} opacity="0.75" onClick={() => open(i)} />;
        })}
        {at !== null && <circle cx={px(x_m[at]!)} cy={py(y_m[at]!)} r="6" fill="none" stroke="var(--text)" stroke-width="2" data-place={index[at]} />}
      </svg>
      </div>
      <p class="small secondary" role="status" data-place-at>{at === null ? '' : `#${index[at]}: ${task[at]} at x ${x_m[at]!.toFixed(2)}, y ${y_m[at]!.toFixed(2)} m`}</p>
      <p class="row small">{tasks.map((name, i) => <span class="row"><svg width="12" height="12" viewBox="-6 -6 12 12" aria-hidden="true"><path d={glyphs[i % glyphs.length]!} fill={`var(--${tokens[i % tokens.length]})`} transform="scale(1.4)" /></svg>{name}</span>)}</p>
    </figure>
  );
}
