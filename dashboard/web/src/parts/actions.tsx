// SPDX-License-Identifier: Apache-2.0
// What changes something: a button that shows the etude command for copying and, with the token, runs it as a job.
import { useEffect, useRef, useState } from 'preact/hooks';
import { getJob, getJson, jobGone, postJson, problemOf, reasonOf, type Problem } from '../core/api';
import { home } from '../core/sources';
import type { Job } from '../core/types';
import { Chip, Command, Failed, Select } from './basics';
import { StopJob } from './jobs';
import { useToken } from './sign_in';

type Arguments = { action: string } & Record<string, string | number>;

/** An argument that is chosen in the dialog; `none`: what it means to leave it out. */
export interface Choice { argument: string; label: string; none: string; values: () => Promise<string[]> }

/** `done` is called when the job that it started has ended well. */
export function ActionButton(props: { label: string; about: string; of: Arguments; choice?: Choice; disabled?: boolean; done?: () => void }) {
  const [open, setOpen] = useState(false);
  return (
    <>
      <button type="button" class="button" data-action={props.of.action} disabled={props.disabled} onClick={() => setOpen(true)}>{props.label}</button>
      {open && <Confirm {...props} close={() => setOpen(false)} />}
    </>
  );
}

function Confirm(props: { label: string; about: string; of: Arguments; choice?: Choice; close: () => void; done?: () => void }) {
  const dialog = useRef<HTMLDialogElement>(null);
  // what is run is what is shown, whatever the page behind it goes on to
  const [given] = useState(props.of);
  const [picked, setPicked] = useState('');
  const [values, setValues] = useState<string[]>([]);
  const [missing, miss] = useState('');
  const of: Arguments = picked && props.choice ? { ...given, [props.choice.argument]: picked } : given;
  const [command, setCommand] = useState('');
  const [problem, setProblem] = useState<Problem | null>(null);
  const [busy, setBusy] = useState(false);
  const access = useToken(true);
  const [job, setJob] = useState<Job | null>(null);
  const [gone, setGone] = useState(false);
  useEffect(() => {
    dialog.current?.showModal();
    getJson<{ authorized: boolean }>('/session').then((answer) => access.lock(!answer.authorized)).catch(() => undefined);
    props.choice?.values().then(setValues).catch((error: unknown) => miss(reasonOf(error)));
  }, []);
  useEffect(() => {
    let current = true;
    setCommand('');
    setProblem(null);
    const show = (text: string, failed: Problem | null) => { if (current) setCommand(text), setProblem(failed); };
    postJson<{ command: string }>('/actions', { ...of, dry_run: true }).then((answer) => show(answer.command, null)).catch((error: unknown) => show('', problemOf(error)));
    return () => { current = false; };
  }, [picked]);
  useEffect(() => {
    if (job?.state === 'done') props.done?.();
    if (job?.state !== 'running' || gone) return;
    const timer = window.setInterval(() => { getJob(job.id).then((next) => (next ? setJob(next) : setGone(true))).catch(() => undefined); }, 1000);
    return () => window.clearInterval(timer);
  }, [job?.id, job?.state, gone]);
  const run = async () => {
    if (busy) return;
    setBusy(true);
    setProblem(null);
    try {
      const { job: id, command: ran } = await access.act(() => postJson<{ job: string; command: string }>('/actions', of));
      setCommand(ran);
      setJob(await getJson<Job>(`/jobs/${id}`));
    } catch (error) {
      setProblem(problemOf(error));
    } finally {
      setBusy(false);
    }
  };
  return (
    <dialog ref={dialog} onClose={props.close} aria-label={props.label}>
      <div class="stack">
        <div class="row apart"><h2 class="figure">{props.label}</h2><button type="button" class="button" onClick={() => dialog.current?.close()}>Close</button></div>
        <p class="secondary">{props.about}</p>
        {props.choice && values.length > 0 && !job && <Select showLabel label={props.choice.label} value={picked} options={[['', props.choice.none], ...values.map((one) => [one, one] as const)]} choose={setPicked} />}
        {missing && !job && <p class="small bad" role="alert">{`What could be chosen did not come: ${missing}`}</p>}
        {command && <Command text={command} />}
        {problem && <Failed problem={problem} />}
        {!home.value?.actions && <p class="small muted">This gateway was started without --token-file: it changes nothing. Copy the command.</p>}
        {home.value?.actions && command && !job && (
          <form class="row" onSubmit={(event) => { event.preventDefault(); void run(); }}>
            {access.field}
            <button type="submit" class="button" disabled={!access.ready || busy}>Run it</button>
          </form>
        )}
        {gone ? <Failed problem={jobGone} /> : job && <Progress of={job} />}
      </div>
    </dialog>
  );
}

function Progress(props: { of: Job }) {
  const { of } = props;
  return (
    <>
      <p class="row"><Chip tone={of.state === 'done' ? 'good' : of.state === 'failed' ? 'bad' : ''}>{of.state}</Chip>{of.state === 'running' && <StopJob id={of.id} label="Stop it" stopping={of.stopping} />}</p>
      {of.log.length > 0 && <pre class="job-log" tabIndex={0} role="group" aria-label="Its output">{of.log.slice(-12).join('\n')}</pre>}
    </>
  );
}
