// SPDX-License-Identifier: Apache-2.0
// An attempt that is made again: whether it was, the job that makes it, and what it left for the view in space.
import { useEffect, useState } from 'preact/hooks';
import { getBytes, getJob, getJson, jobGone, postJson, problemOf, query, useResource, type Problem, type Resource } from '../core/api';
import { home } from '../core/sources';
import type { Job, Replay, ReplayGeometry, ReplayPlan } from '../core/types';
import { Chip, Command, Failed } from './basics';
import { StopJob } from './jobs';
import { TokenField } from './sign_in';

export interface Remake {
  of: Replay | undefined;
  job: Job | null;
  problem: Problem | null;
  /** The token was given before; undefined: not known yet. */
  authorized: boolean | undefined;
  start: (token?: string) => Promise<void>;
}

/** Asks for the replay of an attempt (null: of none), and follows its job. `auto`: makes it where nobody has to sign in. */
export function useRemake(of: { dataset: string; index: number; attempt: number } | null, auto: boolean): Remake {
  const address = of && `/datasets/${of.dataset}/episodes/${of.index}/replay${query({ attempt: of.attempt })}`;
  const replay = useResource<Replay>(address);
  const [job, setJob] = useState<Job | null>(null);
  const [problem, setProblem] = useState<Problem | null>(null);
  const [authorized, setAuthorized] = useState<boolean | undefined>(undefined);
  const [started, setStarted] = useState('');
  const id = started || replay.data?.job || '';
  const fail = (error: unknown) => {
    const told = problemOf(error);
    // what was given has expired, or is not the token any more: it is asked for again
    if (told.status === 401) setAuthorized(false);
    setProblem(told);
  };
  useEffect(() => { getJson<{ authorized: boolean }>('/session').then((answer) => setAuthorized(answer.authorized)).catch(() => setAuthorized(false)); }, []);
  useEffect(() => {
    if (!id) return;
    let timer = 0;
    let gone = false;
    const askIn = (milliseconds: number) => { if (!gone) timer = window.setTimeout(ask, milliseconds); };
    const ask = () => {
      getJob(id).then((next) => {
        setJob(next);
        setProblem(next ? null : jobGone);
        if (next?.state === 'running') askIn(500);
        else replay.reload();
      }).catch((error: unknown) => {
        // a gateway that is busy, or a connection that was lost, is no end of the job
        fail(error);
        askIn(2000);
      });
    };
    ask();
    return () => {
      gone = true;
      window.clearTimeout(timer);
    };
  }, [id]);
  const start = async (token?: string) => {
    if (!of) return;
    setProblem(null);
    setJob(null);
    try {
      if (token) await postJson('/session', { token });
      const answer = await postJson<{ job?: string }>('/actions', { action: 'replay', dataset: of.dataset, index: of.index, attempt: of.attempt });
      setAuthorized(true);
      if (answer.job) setStarted(answer.job);
      else replay.reload();
    } catch (error) {
      fail(error);
    }
  };
  const none = replay.data?.state === 'none';
  useEffect(() => {
    if (auto && none && !job && authorized && home.value?.actions) void start();
  }, [auto, none, authorized]);
  return { of: replay.data, job, problem: problem ?? replay.error ?? null, authorized, start };
}

/** How far it is, or the button that makes it; `command`: for copying, where this gateway starts nothing. */
export function MakeReplay(props: { of: Remake; label: string; command?: string }) {
  const { of } = props;
  const [token, setToken] = useState('');
  if (of.job?.state === 'running') {
    return (
      <div class="stack tight" role="status" data-replay="running">
        <p class="row"><Chip>running</Chip>The attempt is being made again.<StopJob id={of.job.id} label="Stop it" stopping={of.job.stopping} /></p>
        {of.job.log.length > 0 && <p class="small mono secondary">{of.job.log[of.job.log.length - 1]}</p>}
      </div>
    );
  }
  if (of.of?.state === 'impossible') return <p class="small muted">{of.of.why_not}</p>;
  if (of.of?.state !== 'none') return of.problem ? <Failed problem={of.problem} /> : null;
  return (
    <div class="stack tight" data-replay={of.job?.state ?? 'none'}>
      {of.problem && <Failed problem={of.problem} />}
      {of.job?.state === 'failed' && <Failed problem={{ title: 'It could not be made again', status: 0, detail: of.job.log.slice(-3).join('\n') }} />}
      {home.value?.actions
        ? (
          <form class="row" onSubmit={(event) => { event.preventDefault(); void of.start(of.authorized ? undefined : token); }}>
            {of.authorized === false && <TokenField value={token} change={setToken} />}
            <button type="submit" class="button" disabled={!of.authorized && !token}>{props.label}</button>
          </form>)
        : <><p class="small muted">This gateway was started without --token-file: it makes no replay. Copy the command.</p>{props.command && <Command text={props.command} />}</>}
    </div>
  );
}

/** What a replay left. */
export interface ReplayFiles { plan: ReplayPlan; geometry: ReplayGeometry; poses: Float32Array }

export function useReplayFiles(id: string | null): Resource<ReplayFiles> {
  return useResource<ReplayFiles>(id && `/replays/${id}`, {
    load: async (path, signal) => {
      const [plan, geometry, poses] = await Promise.all([getJson<ReplayPlan>(`${path}/plan.json`, signal), getJson<ReplayGeometry>(`${path}/geometry.json`, signal), getBytes(`${path}/poses.f32`, signal)]);
      return { plan, geometry, poses: new Float32Array(poses) };
    },
  });
}

/** Where a body was at a step: x y z, then the quaternion w x y z. Undefined: there is no such body or step. */
export function poseOf(files: ReplayFiles, body: string, step: number): Float32Array | undefined {
  const at = files.geometry.bodies.indexOf(body);
  const begin = 7 * (step * files.geometry.bodies.length + at);
  return at < 0 || step < 0 || begin + 7 > files.poses.length ? undefined : files.poses.subarray(begin, begin + 7);
}

/** The nearest pair at a step: it was measured every so many. */
export function nearestAt(plan: ReplayPlan, step: number): ReplayPlan['nearest'][number] | undefined {
  let found: ReplayPlan['nearest'][number] | undefined;
  for (const one of plan.nearest) {
    if (one.step > step) break;
    found = one;
  }
  return found;
}

/** In millimetres and words. */
export function nearestText(one: ReplayPlan['nearest'][number]): string {
  return one.distance_m > 0 ? `${(1000 * one.distance_m).toFixed(1)} mm` : 'touching';
}
