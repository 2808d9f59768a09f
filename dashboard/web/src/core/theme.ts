// SPDX-License-Identifier: Apache-2.0
// Light or dark: the system's unless chosen here. Canvases ask for colours by name and are told when they change.
import { signal } from '@preact/signals';
import { keep, kept } from './kept';

export type Theme = 'system' | 'light' | 'dark';
const slot = 'etude.theme';

export const theme = signal<Theme>('system');
/** Grows when colours change. */
export const paints = signal(0);

export function start(): void {
  const before = kept(slot);
  if (before === 'light' || before === 'dark') choose(before);
  window.matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => { repaint(); });
}

export function choose(next: Theme): void {
  theme.value = next;
  if (next === 'system') {
    delete document.documentElement.dataset['theme'];
    keep(slot, null);
  } else {
    document.documentElement.dataset['theme'] = next;
    keep(slot, next);
  }
  repaint();
}

const resolved = new Map<string, string>();
let probe: HTMLElement | null = null;

function repaint(): void {
  resolved.clear();
  paints.value++;
}

/** A token's colour as the browser computes it, for canvases: color('accent') → rgb(…). */
export function color(token: string): string {
  const known = resolved.get(token);
  if (known) return known;
  if (!probe) {
    probe = document.createElement('span');
    probe.hidden = true;
    document.body.append(probe);
  }
  probe.style.color = `var(--${token})`;
  const value = getComputedStyle(probe).color;
  resolved.set(token, value);
  return value;
}

/** Colours of entities in a fixed order, also used for runs (with a shape each: parts/marker.tsx). */
export const hues = ['target', 'hand', 'language', 'reference', 'obstacle', 'others'] as const;

/** What a module is about decides its colour: language, hand, target, reference, obstacle, else motion. */
export function moduleColor(name: string): string {
  if (/^(LANG|TASK)/.test(name)) return 'language';
  if (/^EE/.test(name)) return 'hand';
  if (/^TAR/.test(name)) return 'target';
  if (/^REF/.test(name)) return 'reference';
  if (/^OBS/.test(name)) return 'obstacle';
  return 'motion';
}
