// SPDX-License-Identifier: Apache-2.0
// The gateway's token: the field for it, and the page in place of all others where reading needs it, too.
import { useState } from 'preact/hooks';
import { postJson, problemOf, type Problem } from '../core/api';
import { Failed } from './basics';

export function TokenField(props: { value: string; change: (value: string) => void }) {
  return <input class="field" type="password" autocomplete="current-password" aria-label="Token" placeholder="token of this gateway" value={props.value} onInput={(event) => props.change(event.currentTarget.value)} />;
}

/**
 * For what needs the token: where the gateway asks for it (`asks`: before the first act, too, until `lock` says otherwise)
 * `field` is where it is given, and the next act brings it along.
 */
export function useToken(asks = false) {
  const [token, setToken] = useState('');
  const [locked, lock] = useState(asks);
  const act = async <T,>(what: () => Promise<T>): Promise<T> => {
    try {
      if (locked) await postJson('/session', { token });
      lock(false);
      setToken('');
      return await what();
    } catch (error) {
      if (problemOf(error).status === 401) lock(true);
      throw error;
    }
  };
  return { act, lock, ready: !locked || token !== '', field: locked ? <TokenField value={token} change={setToken} /> : null };
}

export function SignIn() {
  const [token, setToken] = useState('');
  const [problem, setProblem] = useState<Problem | null>(null);
  const enter = async () => {
    try {
      await postJson('/session', { token });
      window.location.reload();
    } catch (error) {
      setProblem(problemOf(error));
    }
  };
  return (
    <main id="main" class="sign-in stack">
      <h1>Sign in</h1>
      <p class="secondary">This gateway answers other machines, and only to those who know its token: the content of the file that it was started with (--token-file).</p>
      {problem && <Failed problem={problem} />}
      <form class="row" data-sign-in onSubmit={(event) => { event.preventDefault(); void enter(); }}>
        <TokenField value={token} change={setToken} />
        <button type="submit" class="button" disabled={!token}>Sign in</button>
      </form>
    </main>
  );
}
