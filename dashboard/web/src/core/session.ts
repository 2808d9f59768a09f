// SPDX-License-Identifier: Apache-2.0
// What is shown of a play session's policy, as what is shown of one that was asked about a recorded picture.
import type { Insight, PlayInsight, PlaySession } from './types';

/** Nothing is known there that it could be held against; undefined: nothing came yet. */
export function insightOf(seen: PlayInsight | undefined, session: PlaySession): Insight | undefined {
  if (!seen || seen.number === 0) return undefined;
  return {
    run: session.run, checkpoint_step: seen.checkpoint_step, sentence: session.sentence, modules: seen.modules, what_if: null, attention: seen.attention, view: seen.view,
    waypoints: session.waypoints.map((one) => [...one.slice(0, 3), one[one.length - 1] ?? 0]), what_if_waypoints: [], words: [], joints: [],
    truth: { target: '', reference: null, instruction: session.sentence, pixels: {}, positions: {}, waypoints: [], waypoints_error_m: null, errors: {} },
  };
}

/** Whether a session's policy ("NAME@ID", an id may be cut) is that of the run with this identity. */
export function isOf(session: Pick<PlaySession, 'run'>, identity: string | null): boolean {
  const id = session.run.split('@')[1] ?? '';
  return id !== '' && identity !== null && identity.startsWith(id);
}
