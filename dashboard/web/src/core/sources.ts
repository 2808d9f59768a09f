// SPDX-License-Identifier: Apache-2.0
// What there is to look at, and which of it this page shows: the address says, else the newest of its kind.
import { signal } from '@preact/signals';
import type { Home, Source } from './types';
import { link, location } from './router';

/** The newest /home, kept by the shell. */
export const home = signal<Home | undefined>(undefined);

export type Kind = 'dataset' | 'run' | 'eval';

export function sourcesOf(kind: Kind, rollouts = false): Source[] {
  const all = home.value?.sources ?? [];
  return all.filter((one) => one.kind === kind && (kind !== 'dataset' || rollouts || one.role !== 'rollouts'));
}

/** The source of this kind that the page shows; null where there is none. */
export function chosen(kind: Kind): string | null {
  return location.value.query.get(kind) ?? sourcesOf(kind)[0]?.id ?? null;
}

/** All of this kind that the page shows, in the order picked (colours follow it). */
export function chosenAll(kind: Kind): string[] {
  const text = chosen(kind);
  return text ? text.split(',').filter(Boolean) : [];
}

export function nameOf(id: string | null): string {
  return home.value?.sources.find((one) => one.id === id)?.name ?? id ?? '–';
}

/** Link to an episode's page. */
export function episodeLink(dataset: string, index: number, query: Record<string, string | number | null> = {}): string {
  return link(`episode/${dataset}/${index}`, query);
}
