// SPDX-License-Identifier: Apache-2.0
// What there is to look at, and which of it this page shows: the address says, else the newest of its kind.
import { signal } from '@preact/signals';
import { useEffect } from 'preact/hooks';
import { withSource } from './address';
import { defaultOf, labelOf, ofKind, parameterOf, type Kind } from './choice';
import type { Home, Source } from './types';
import { link, location, navigate, setParameters } from './router';

export type { Kind } from './choice';

/** The newest /home, kept by the shell. */
export const home = signal<Home | undefined>(undefined);

export function sourcesOf(kind: Kind, rollouts = false): Source[] {
  return ofKind(home.value?.sources ?? [], kind, rollouts);
}

/** The source of this kind that the page shows; null where there is none. */
export function chosen(kind: Kind): string | null {
  return location.value.query.get(parameterOf(kind)) ?? defaultOf(home.value?.sources ?? [], kind)?.id ?? null;
}

/**
 * As chosen(). What nobody chose goes into the address, so that the page stays with it when another one becomes the
 * newest, and a link of the page shows it to others. `hold` false: only looked up.
 */
export function useChosen(kind: Kind, hold = true): string | null {
  const id = chosen(kind);
  const named = location.value.query.has(parameterOf(kind));
  useEffect(() => { if (hold && id !== null && !named) setParameters({ [parameterOf(kind)]: id }, true); }, [id, named, hold]);
  return id;
}

/** Shows another source of this kind on this page. */
export function choose(kind: Kind, id: string): void {
  navigate(`${window.location.pathname}?${withSource(location.value.query, parameterOf(kind), id).toString()}`);
}

/** All of a text that names several, in the order picked (colours follow it). */
export function listed(text: string | null): string[] {
  return text ? text.split(',').filter(Boolean) : [];
}

/** Null: not known. */
export function sourceOf(id: string | null): Source | null {
  return home.value?.sources.find((one) => one.id === id) ?? null;
}

export function nameOf(id: string | null): string {
  const of = sourceOf(id);
  return of ? labelOf((home.value?.sources ?? []).filter((one) => one.kind === of.kind), of) : id ?? '–';
}

/** When what is read of these is asked for again: each ten seconds while one of them runs, and when one has changed. */
export function refreshed(of: readonly Source[]): { round: string; every?: number } {
  const running = of.some((one) => one.state === 'running');
  // of what runs the time changes all the while
  return { round: of.map((one) => `${one.id} ${one.state} ${one.state === 'running' ? '' : one.updated ?? ''}`).join(), ...(running ? { every: 10000 } : {}) };
}

/** Link to an episode's page. */
export function episodeLink(dataset: string, index: number, query: Record<string, string | number | null> = {}): string {
  return link(`episode/${dataset}/${index}`, query);
}
