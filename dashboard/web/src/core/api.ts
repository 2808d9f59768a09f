// SPDX-License-Identifier: Apache-2.0
// Questions to the gateway. An answer that does not come leaves the old data standing beside the reason.
import { useEffect, useRef, useState } from 'preact/hooks';
import { denied, epoch, heard, lost } from './connection';
import type { Job } from './types';

export interface Problem { title: string; status: number; detail?: string; hint?: string }

export class RequestError extends Error {
  constructor(readonly problem: Problem) {
    super(problem.title);
  }
}

export const root = '/api/v1';

async function request(path: string, signal?: AbortSignal, init: RequestInit = {}): Promise<Response> {
  let response: Response;
  try {
    response = await fetch(root + path, { ...init, signal: signal ?? null, credentials: 'same-origin' });
  } catch (error) {
    if (signal?.aborted) throw error;
    lost();
    throw new RequestError({ title: 'The gateway does not answer', status: 0, detail: `${init.method ?? 'GET'} ${root}${path}` });
  }
  heard();
  if (response.ok) return response;
  // who may not read has to sign in; an action asks for the token where it stands
  if (response.status === 401 && !init.method) denied();
  let problem: Problem = { title: `${response.status} ${response.statusText}`, status: response.status };
  if (response.headers.get('content-type')?.includes('json')) problem = { ...problem, ...(await response.json() as Problem) };
  throw new RequestError(problem);
}

export async function getJson<T>(path: string, signal?: AbortSignal): Promise<T> {
  return (await request(path, signal)).json() as Promise<T>;
}

/** An answer without a body is undefined. */
export async function postJson<T>(path: string, body: unknown, signal?: AbortSignal): Promise<T> {
  const response = await request(path, signal, { method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify(body) });
  return (response.status === 204 ? undefined : await response.json()) as T;
}

export function problemOf(error: unknown): Problem {
  return error instanceof RequestError ? error.problem : { title: 'It could not be done', status: 0, detail: String(error) };
}

/** Asks again while the gateway says that it cannot answer now (503), for up to `for_ms`. */
export async function patiently<T>(ask: () => Promise<T>, signal: AbortSignal, for_ms = 8000): Promise<T> {
  for (const until = performance.now() + for_ms; ;) {
    try {
      return await ask();
    } catch (error) {
      if (signal.aborted || problemOf(error).status !== 503 || performance.now() >= until) throw error;
    }
    await new Promise((go) => setTimeout(go, 500));
    if (signal.aborted) throw new RequestError({ title: 'Nobody waits for the answer any more', status: 0 });
  }
}

/** In a few words why something was not done. */
export function reasonOf(error: unknown): string {
  const problem = problemOf(error);
  return problem.detail ?? problem.title;
}

/** Null: the gateway knows no such job, as after it was started again. */
export async function getJob(id: string, signal?: AbortSignal): Promise<Job | null> {
  try {
    return await getJson<Job>(`/jobs/${id}`, signal);
  } catch (error) {
    if (problemOf(error).status === 404) return null;
    throw error;
  }
}

/** Of a job that getJob() does not find. */
export const jobGone: Problem = { title: 'The gateway does not know this job any more', status: 404, detail: 'It was started again meanwhile, which ends its jobs. What the job had done stands.' };

export async function stopJob(id: string): Promise<void> {
  await request(`/jobs/${id}`, undefined, { method: 'DELETE' });
}

export async function getBytes(path: string, signal?: AbortSignal): Promise<ArrayBuffer> {
  return (await request(path, signal)).arrayBuffer();
}

export interface Resource<T> {
  data: T | undefined;
  /** The data is that of an earlier path or moment, and the newer one is under way. */
  pending: boolean;
  error: Problem | undefined;
  reload: () => void;
}

/** Loads `path` (null: nothing), again every `every` ms where given, when `round` changes, and after the gateway has come back. */
export function useResource<T>(path: string | null, options: { every?: number; round?: unknown; load?: (path: string, signal: AbortSignal) => Promise<T> } = {}): Resource<T> {
  const [state, setState] = useState<{ data?: T; error?: Problem; path?: string | null }>({});
  const [round, setRound] = useState(0);
  const load = useRef(options.load ?? getJson<T>);
  const generation = epoch.value;
  useEffect(() => {
    if (path === null) {
      setState({});
      return;
    }
    const abort = new AbortController();
    let timer = 0;
    const ask = async () => {
      try {
        const data = await load.current(path, abort.signal);
        setState({ data, path });
      } catch (error) {
        if (abort.signal.aborted) return;
        const problem = error instanceof RequestError ? error.problem : { title: 'The answer could not be read', status: 0, detail: String(error) };
        setState((old) => ({ ...(old.data !== undefined && old.path === path ? { data: old.data } : {}), error: problem, path }));
      }
      if (options.every) timer = window.setTimeout(ask, document.hidden ? Math.max(5000, options.every) : options.every);
    };
    void ask();
    return () => {
      abort.abort();
      window.clearTimeout(timer);
    };
  }, [path, round, generation, options.round]);
  return {
    data: path === null ? undefined : state.data,
    pending: path !== null && state.path !== path,
    error: state.path === path ? state.error : undefined,
    reload: () => setRound(round + 1),
  };
}

/** Query text of an API address: repeated for arrays, nothing for what is empty. */
export function query(values: Record<string, string | number | readonly string[] | null | undefined>): string {
  const parts = new URLSearchParams();
  for (const [name, value] of Object.entries(values)) {
    if (Array.isArray(value)) value.forEach((one) => parts.append(name, one));
    else if (value !== null && value !== undefined && value !== '') parts.set(name, String(value));
  }
  const text = parts.toString();
  return text ? `?${text}` : '';
}
