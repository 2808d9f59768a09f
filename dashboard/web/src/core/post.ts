// SPDX-License-Identifier: Apache-2.0
// What changes something: sent as JSON, with the cookie that signing in has set.
import { RequestError, root, type Problem } from './api';

export async function postJson<T>(path: string, body: unknown): Promise<T> {
  const response = await fetch(root + path, { method: 'POST', credentials: 'same-origin', headers: { 'content-type': 'application/json' }, body: JSON.stringify(body) });
  if (response.status === 204) return undefined as T;
  const answer = await response.json() as unknown;
  if (response.ok) return answer as T;
  throw new RequestError({ title: `${response.status} ${response.statusText}`, ...(answer as Partial<Problem>), status: response.status });
}

/** In a few words why something was not done. */
export function reasonOf(error: unknown): string {
  if (error instanceof RequestError) return error.problem.detail ?? error.problem.title;
  return String(error);
}
