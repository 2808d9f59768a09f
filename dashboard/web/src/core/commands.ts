// SPDX-License-Identifier: Apache-2.0
// What stands in commands to copy.

/** `path`: absolute; `folder`: for people, from the folders that the gateway was given. */
interface Placed { path?: string | null; folder?: string | null }

/** Where a command finds it, whichever folder it is run in; `fallback` where nothing is known of it. */
export function folderIn(of: Placed | null | undefined, fallback: string): string {
  const text = of?.path || of?.folder;
  if (!text) return fallback;
  return /^[\w@%+=:,./~-]+$/.test(text) ? text : `'${text.replaceAll("'", String.raw`'\''`)}'`;
}

/** Another checkpoint in the scenes of an evaluation, whose rollouts are a dataset that says robots, tasks, objects and camera. */
export function evaluateInScenesOf(of: Placed & { dataset: string | null; episodes: number }): string {
  const scenes = of.dataset ? ` --scenes ${folderIn(of, 'EVAL')}/rollouts` : '';
  return `etude eval --checkpoint OTHER.safetensors${scenes} --episodes ${of.episodes} --seed SEED --out eval-b`;
}
