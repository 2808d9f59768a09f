// SPDX-License-Identifier: Apache-2.0
// What a module attends to: the picture as a whole, the words, the joints and other modules; of one of its heads, or the
// mean of them all.
import { percent } from '../core/format';
import { focusOn, useKeys } from '../core/keys';
import type { ModuleAttention } from '../core/types';
import { Bars, Select } from './basics';

/** Of one head, or the mean. */
export interface Look { rows: number; columns: number; weights: number[]; key_weights: number[] }

/** `head`: its number from 1 on; anything else means the mean of all. */
export function lookOf(attention: ModuleAttention, head: string): Look {
  const one = attention.heads?.[Number(head) - 1] ?? attention;
  return { rows: attention.rows, columns: attention.columns, weights: one.weights, key_weights: one.key_weights };
}

export function HeadSelect(props: { attention: ModuleAttention; head: string; choose: (head: string) => void }) {
  const heads = (props.attention.heads ?? []).map((_one, i) => [String(i + 1), `head ${i + 1}`] as const);
  const known = heads.some(([number]) => number === props.head);
  useKeys([{ keys: 'h', does: 'heads of the attention', run: () => focusOn('[data-heads] select') }]);
  return <span data-heads><Select label="attention of" showLabel value={known ? props.head : ''} options={[['', 'all heads, mean'], ...heads]} choose={props.choose} /></span>;
}

const names: Record<string, string> = { language: 'words', joints: 'joints', self: 'itself' };

/** Shares of 1, the picture's first; a row of a module leads to it. */
export function AttentionBars(props: { module: string; attention: ModuleAttention; head: string; linkTo: (module: string) => string }) {
  const { attention } = props;
  const look = lookOf(attention, props.head);
  const picture = attention.rows > 0 ? [{ name: 'picture', value: look.weights.reduce((sum, one) => sum + one, 0) }] : [];
  const others = attention.keys.map((key, i) => ({ name: names[key] ?? key, value: look.key_weights[i] ?? 0, link: names[key] ? undefined : props.linkTo(key) }));
  return <div data-attends={props.module}><Bars label={`What ${props.module} attends to`} rows={[...picture, ...others]} limit={64} text={(value) => percent(value, 0)} /></div>;
}
