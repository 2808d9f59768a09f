// SPDX-License-Identifier: Apache-2.0
// One WebSocket to the gateway for all channels, and what is known about whether the gateway is there.
import { signal } from '@preact/signals';
import { useEffect, useState } from 'preact/hooks';

export type Connection = 'wait' | 'live' | 'lost' | 'denied';

/** Whether the gateway answers; `wait` before the first answer, `denied` while it answers only to those with its token. */
export const connection = signal<Connection>('wait');
/** When it was heard last, ms since 1970. */
export const lastHeard = signal(0);
/** Grows each time the gateway comes back: whoever shows its data asks again. */
export const epoch = signal(0);
/** ms without a message after which an open socket is held for dead: `home` is told twice a second. */
const silence = 20000;
/** Ticks twice a second for ages; slower in a hidden tab. */
export const now = signal(Date.now());

export function heard(): void {
  lastHeard.value = Date.now();
  // one question that failed is not the gateway's end while its messages come
  if (connection.value === 'wait' || (connection.value === 'lost' && socket?.readyState === WebSocket.OPEN)) connection.value = 'live';
}

export function lost(): void {
  connection.value = 'lost';
  if (!socket) schedule(250);
}

/** The gateway wants its token, which was never given, has expired or is another one now. */
export function denied(): void {
  connection.value = 'denied';
}

/** A socket that is refused does not say why; a question does. */
async function askWhy(): Promise<void> {
  const answer = await fetch('/api/v1/home', { credentials: 'same-origin' }).catch(() => null);
  if (socket?.readyState !== WebSocket.OPEN) connection.value = answer?.status === 401 ? 'denied' : 'lost';
}

interface Subscription { id: string; ch: string; args: unknown; hz: number; listeners: Set<(data: unknown) => void>; last?: unknown; refusal?: unknown }
interface Message { ch: string; id: string; seq: number; t: string; data?: unknown; error?: unknown }

const subscriptions = new Map<string, Subscription>();
let socket: WebSocket | null = null;
let pause = 250;
let lastMessage = 0;
let timer = 0;
let began = false;

export function start(): void {
  began = true;
  window.setInterval(() => {
    if (!document.hidden || Date.now() - now.value > 5000) now.value = Date.now();
    if (!document.hidden) abandonSilent();
  }, 500);
  document.addEventListener('visibilitychange', () => {
    // what came while it was hidden came seldom
    lastMessage = Date.now();
    for (const one of subscriptions.values()) send(one);
  });
  open();
}

/** A network that went away without a word leaves a socket that looks open for ever. */
function abandonSilent(): void {
  if (socket?.readyState !== WebSocket.OPEN || !subscriptions.size || Date.now() - lastMessage < silence) return;
  const dead = socket;
  socket = null;
  dead.close();
  connection.value = 'lost';
  schedule(0);
}

function open(): void {
  timer = 0;
  const address = `${window.location.protocol === 'https:' ? 'wss' : 'ws'}://${window.location.host}/api/v1/live`;
  const opening = new WebSocket(address);
  socket = opening;
  opening.onopen = () => {
    pause = 250;
    const back = connection.value === 'lost' || connection.value === 'denied';
    connection.value = 'live';
    lastHeard.value = lastMessage = Date.now();
    for (const one of subscriptions.values()) send(one);
    if (back) epoch.value++;
  };
  opening.onmessage = (event) => {
    if (socket !== opening) return;
    lastMessage = Date.now();
    heard();
    if (typeof event.data === 'string') receive(JSON.parse(event.data) as Message);
  };
  opening.onclose = () => {
    if (socket !== opening) return;
    socket = null;
    if (connection.value !== 'denied') connection.value = 'lost';
    void askWhy();
    schedule(pause);
    pause = Math.min(5000, pause * 2);
  };
}

function schedule(wait: number): void {
  if (began && !timer) timer = window.setTimeout(open, wait);
}

function key(ch: string, args: unknown): string {
  return ch + JSON.stringify(args ?? {});
}

function send(one: Subscription): void {
  if (socket?.readyState !== WebSocket.OPEN) return;
  socket.send(JSON.stringify({ op: 'sub', ch: one.ch, id: one.id, args: one.args ?? {}, hz: document.hidden ? 0.2 : one.hz }));
}

function receive(message: Message): void {
  const one = subscriptions.get(message.id);
  if (one && message.error !== undefined && one.refusal !== message.error) {
    // the page goes on with what it has; said once
    one.refusal = message.error;
    console.warn(`channel ${message.ch}: ${String(message.error)}`);
  }
  if (!one || message.data === undefined) return;
  delete one.refusal;
  one.last = message.data;
  for (const listener of one.listeners) listener(message.data);
}

/** The newest data of a channel with these arguments, undefined until the first of them. */
export function useLive<T>(ch: string | null, args: Record<string, unknown> = {}, hz = 2): T | undefined {
  const id = ch === null ? '' : key(ch, args);
  const [heardOf, hear] = useState<{ id: string; data: T | undefined }>(() => ({ id, data: subscriptions.get(id)?.last as T | undefined }));
  useEffect(() => {
    if (ch === null) return;
    let one = subscriptions.get(id);
    if (!one) {
      one = { id, ch, args, hz, listeners: new Set() };
      subscriptions.set(id, one);
      send(one);
    }
    const listener = (value: unknown) => hear({ id, data: value as T });
    one.listeners.add(listener);
    if (one.last !== undefined) listener(one.last);
    return () => {
      one.listeners.delete(listener);
      if (one.listeners.size) return;
      subscriptions.delete(id);
      if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ op: 'unsub', ch, id }));
    };
  }, [id]);
  // what was told of other arguments is no answer to these
  return heardOf.id === id ? heardOf.data : undefined;
}
