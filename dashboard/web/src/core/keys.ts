// SPDX-License-Identifier: Apache-2.0
// The keyboard: `g` and a letter goes to a page, single keys act on the page. None act while one types.
import { signal } from '@preact/signals';
import { useEffect, useRef } from 'preact/hooks';
import { keep, kept } from './kept';

/** `when`: whether it acts now; always, where it is left out. */
export interface Binding { keys: string; does: string; run: (event: KeyboardEvent) => void; when?: () => boolean }

const layers = new Set<{ current: Binding[] }>();
const slot = 'etude.keys';
export const enabled = signal(kept(slot) !== 'off');
let waiting = 0;

export function setEnabled(on: boolean): void {
  enabled.value = on;
  keep(slot, on ? null : 'off');
}

export function start(): void {
  document.addEventListener('keydown', (event) => {
    if (!enabled.value || event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey || typing(event)) return;
    // the page behind an open dialog is not what one sees
    if (document.querySelector('dialog[open]')) return;
    const prefix = waiting && Date.now() - waiting < 1200 ? 'g ' : '';
    waiting = 0;
    if (!prefix && event.key === 'g') {
      waiting = Date.now();
      return;
    }
    const name = prefix + (event.key === ' ' ? 'Space' : event.shiftKey && event.key.length > 1 ? `Shift+${event.key}` : event.key);
    for (const layer of [...layers].reverse()) {
      const found = layer.current.find((one) => one.keys === name && (one.when?.() ?? true));
      if (!found) continue;
      event.preventDefault();
      found.run(event);
      return;
    }
  });
}

function typing(event: KeyboardEvent): boolean {
  const target = event.target as HTMLElement | null;
  if (!target) return false;
  if (target.tagName === 'SELECT' || target.tagName === 'TEXTAREA') return true;
  if (target instanceof HTMLInputElement) return !['checkbox', 'range', 'button'].includes(target.type);
  // a focused button, link or summary keeps its own keys, so does a chart its arrows
  if (['BUTTON', 'A', 'SUMMARY'].includes(target.tagName) && (event.key === ' ' || event.key === 'Enter')) return true;
  return target.isContentEditable || (target.dataset['arrows'] !== undefined && event.key.startsWith('Arrow'));
}

export function useKeys(bindings: Binding[]): void {
  const layer = useRef(bindings);
  layer.current = bindings;
  useEffect(() => {
    layers.add(layer);
    return () => { layers.delete(layer); };
  }, []);
}

/** Leads the keyboard to what the selector finds. */
export function focusOn(selector: string): void {
  document.querySelector<HTMLElement>(selector)?.focus();
}

export function active(): Binding[] {
  return [...layers].flatMap((layer) => layer.current);
}
