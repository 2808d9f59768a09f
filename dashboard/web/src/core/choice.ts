// SPDX-License-Identifier: Apache-2.0
// Which sources a page can show, and which of them it shows by itself.
import type { Source } from './types';

/** 'campaign': a dataset that is being made or was, or a campaign of which this disk has nothing. */
export type Kind = 'campaign' | 'dataset' | 'run' | 'eval';

/** The parameter of the address that names it. */
export function parameterOf(kind: Kind): string {
  return kind === 'campaign' ? 'dataset' : kind;
}

export function ofKind(all: readonly Source[], kind: Kind, rollouts = false): Source[] {
  return all.filter((one) => {
    if (kind === 'campaign') return (one.kind === 'campaign' || one.kind === 'dataset') && one.role !== 'rollouts';
    return one.kind === kind && (kind !== 'dataset' || rollouts || one.role !== 'rollouts');
  });
}

/** The first; of runs the first with files, since most pages of a run show what is in them. */
export function defaultOf(all: readonly Source[], kind: Kind): Source | undefined {
  const some = ofKind(all, kind);
  return (kind === 'run' ? some.find((one) => one.folder !== null) : undefined) ?? some[0];
}

/** Whether a page of this kind can show the source that is named; of one that is not known it may. */
export function canShow(all: readonly Source[], kind: Kind, id: string): boolean {
  return kind !== 'dataset' || all.find((one) => one.id === id)?.kind !== 'campaign';
}

/** What people tell it by: its name, with its folder where another of these has the same. */
export function labelOf(among: readonly Source[], of: Source): string {
  return among.some((one) => one.id !== of.id && one.name === of.name) ? `${of.name} (${of.folder ?? of.id})` : of.name;
}
