// SPDX-License-Identifier: Apache-2.0
// Proportions as dots on a line with their Wilson interval, k of n beside; never a bar from zero.
import { axisStart } from '../core/stats';
import { percent } from '../core/format';

export interface Proportion { name: string; n: number; k: number; share: number; low: number; high: number; token?: string; link?: string }

export function Dots(props: { rows: Proportion[]; label: string }) {
  const start = axisStart(props.rows.filter((one) => one.n > 0).map((one) => one.low));
  const at = (share: number) => `${(100 * (share - start)) / (1 - start)}%`;
  return (
    <div class="dots" role="list" aria-label={props.label}>
      {props.rows.map((one) => (
        <div class="dot-row" role="listitem">
          <span class="name" title={one.name}>{one.link ? <a href={one.link}>{one.name}</a> : one.name}</span>
          <span class="n num muted">{one.n}</span>
          <span class="track">
            <svg height="20" aria-hidden="true">
              <line x1="0" x2="100%" y1="10" y2="10" stroke="var(--line)" />
              {one.n > 0 && (
                <>
                  <line x1={at(one.low)} x2={at(one.high)} y1="10" y2="10" stroke={`var(--${one.token ?? 'text'})`} stroke-width="2" />
                  <line x1={at(one.low)} x2={at(one.low)} y1="6" y2="14" stroke={`var(--${one.token ?? 'text'})`} stroke-width="2" />
                  <line x1={at(one.high)} x2={at(one.high)} y1="6" y2="14" stroke={`var(--${one.token ?? 'text'})`} stroke-width="2" />
                  <circle cx={at(one.share)} cy="10" r="4.5" stroke={`var(--${one.token ?? 'text'})`} stroke-width="2"
                    fill={one.n < 20 ? 'var(--panel)' : `var(--${one.token ?? 'text'})`} />
                </>
              )}
            </svg>
          </span>
          <span class="num nowrap">
            {one.n > 0 ? <><b class="strong">{percent(one.share)}</b> <span class="muted small">[{(100 * one.low).toFixed(1)} {(100 * one.high).toFixed(1)}]</span></> : <span class="muted">none yet</span>}
            <span class="sr">, {one.k} of {one.n}, 95 % interval</span>
          </span>
        </div>
      ))}
      <div class="axis" aria-hidden="true"><span /><span class="num">n</span><span class="scale"><span>{percent(start)}</span><span>100 %</span></span><span class="num">95 % Wilson</span></div>
    </div>
  );
}

/** A difference with its interval around zero, in points. */
export function Difference(props: { value: number; low: number; high: number }) {
  const reach = Math.max(0.01, Math.abs(props.low), Math.abs(props.high)) * 1.15;
  const at = (value: number) => `${50 + (50 * value) / reach}%`;
  return (
    <svg height="36" width="100%" role="img" aria-label={`difference ${(100 * props.value).toFixed(1)} points, from ${(100 * props.low).toFixed(1)} to ${(100 * props.high).toFixed(1)}`}>
      <line x1="0" x2="100%" y1="12" y2="12" stroke="var(--line)" />
      <line x1="50%" x2="50%" y1="2" y2="22" stroke="var(--edge)" stroke-dasharray="2 2" />
      <line x1={at(props.low)} x2={at(props.high)} y1="12" y2="12" stroke="var(--text)" stroke-width="2" />
      <circle cx={at(props.value)} cy="12" r="4.5" fill="var(--text)" />
      <text x="0" y="34" font-size="12" fill="var(--muted)">B better</text>
      <text x="50%" y="34" font-size="12" fill="var(--muted)" text-anchor="middle">0</text>
      <text x="100%" y="34" font-size="12" fill="var(--muted)" text-anchor="end">A better</text>
    </svg>
  );
}
