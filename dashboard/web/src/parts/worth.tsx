// SPDX-License-Identifier: Apache-2.0
// What each word of a sentence and each joint is worth to a plan: how far its waypoints move without it, in cm.
import { fixed, number } from '../core/format';
import type { Insight } from '../core/types';
import { Bars } from './basics';

const text = (cm: number) => `${number(cm, 2)} cm`;

export function Worth(props: { of: Insight }) {
  const { words, joints } = props.of;
  const known = joints.filter((one) => one.moves_m !== null);
  if (!words.length && !known.length) return <p class="small muted">Nothing is planned here that words and joints could move.</p>;
  const wordRows = words.map((one) => ({ name: one.word, value: 100 * one.moves_m }));
  const jointRows = known.map((one) => ({ name: one.name, value: 100 * (one.moves_m ?? 0) }));
  // one scale for both: a word and a joint are worth the same where their bars are as long
  const full = Math.max(0.1, ...[...wordRows, ...jointRows].map((one) => one.value));
  return (
    <div class="grid narrow" data-worth>
      <div><h3>Words</h3><Bars label="What each word is worth" rows={wordRows} limit={64} text={text} full={full} /></div>
      <div><h3>Joints</h3><Bars label="What each joint is worth" rows={jointRows} limit={64} text={text} full={full} /></div>
    </div>
  );
}

/** The joints as the policy was told them. */
export function Joints(props: { of: Insight }) {
  return (
    <table class="plain" data-joints>
      <thead><tr><th>joint</th><th class="num">stands at</th><th>unit</th></tr></thead>
      <tbody>{props.of.joints.map((one) => <tr data-joint={one.name}><td>{one.name}</td><td class="num">{fixed(one.value, 3)}</td><td class="muted">{one.unit}</td></tr>)}</tbody>
    </table>
  );
}
