// SPDX-License-Identifier: Apache-2.0
// The address is the state: page, sources, filters, selection. Everything that can be pointed at has a link.
import { computed, signal } from '@preact/signals';
import { partsOf } from './address';

export interface Location { path: string[]; query: URLSearchParams }

const current = signal(read());
export const location = computed(() => current.value);

function read(): Location {
  const url = window.location;
  return { path: partsOf(url.pathname), query: new URLSearchParams(url.search) };
}

export function start(): void {
  window.addEventListener('popstate', () => { current.value = read(); });
  document.addEventListener('click', (event) => {
    if (event.defaultPrevented || event.button !== 0 || event.metaKey || event.ctrlKey || event.shiftKey || event.altKey) return;
    const link = (event.target as Element | null)?.closest?.('a');
    if (!link || link.target || link.hasAttribute('download') || link.origin !== window.location.origin) return;
    if (link.pathname.startsWith('/api/') || link.pathname === '/metrics') return;
    event.preventDefault();
    navigate(link.pathname + link.search);
  });
}

export function navigate(address: string, replace = false): void {
  const here = window.location.pathname + window.location.search;
  if (address === here) return;
  const samePage = address.split('?')[0] === window.location.pathname;
  window.history[replace ? 'replaceState' : 'pushState'](null, '', address);
  current.value = read();
  if (!samePage) window.scrollTo(0, 0);
}

/** An address below the root with a query; parameters that are empty or absent are left out. */
export function link(path: string, query: Record<string, string | number | null | undefined> = {}): string {
  const parts = new URLSearchParams();
  for (const [name, value] of Object.entries(query)) {
    if (value !== null && value !== undefined && value !== '') parts.set(name, String(value));
  }
  const text = parts.toString();
  return `/${path.split('/').filter(Boolean).map(encodeURIComponent).join('/')}${text ? `?${text}` : ''}`;
}

/** One parameter of this page's address and how to set it; `replace` leaves no entry in the history. */
export function parameter(name: string, fallback = ''): [string, (value: string | number | null, replace?: boolean) => void] {
  return [current.value.query.get(name) ?? fallback, (value, replace = false) => setParameters({ [name]: value === fallback ? null : value }, replace)];
}

export function setParameters(values: Record<string, string | number | null>, replace = false): void {
  navigate(linkHere(values), replace);
}

/** This page's address with these parameters; those that are empty leave it, all others stay. */
export function linkHere(values: Record<string, string | number | null>): string {
  const query = new URLSearchParams(current.value.query);
  for (const [name, value] of Object.entries(values)) {
    if (value === null || value === '') query.delete(name);
    else query.set(name, String(value));
  }
  const text = query.toString();
  return window.location.pathname + (text ? `?${text}` : '');
}
