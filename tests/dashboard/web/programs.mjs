// SPDX-License-Identifier: Apache-2.0
// The project's programs as the tests run them. ETUDE_BIN: their folder. ETUDE_DOMAIN: the DDS domain they meet on.
import { spawn } from 'node:child_process';
import { dirname, join } from 'node:path';
import { fileURLToPath } from 'node:url';

export const root = join(dirname(fileURLToPath(import.meta.url)), '../../..');
export const bin = process.env.ETUDE_BIN ?? join(root, 'build/bin');
export const onDomain = process.env.ETUDE_DOMAIN ? ['--domain', process.env.ETUDE_DOMAIN] : [];

const running = new Set();
process.on('exit', () => { for (const child of running) child.kill('SIGKILL'); });

/** Starts a program. `says` waits for a text of it, `ended` for its exit code; who waits for a program that ends without it is told its last words. */
export function start(program, args) {
  const child = spawn(program, args, { cwd: root, stdio: ['ignore', 'pipe', 'pipe'] });
  const waiting = new Set();
  let said = '';
  let code;
  const look = () => { for (const one of waiting) one(); };
  const hear = (bytes) => {
    said = (said + bytes).slice(-20000);
    look();
  };
  child.stdout.on('data', hear);
  child.stderr.on('data', hear);
  running.add(child);
  const ended = new Promise((done) => {
    const end = (value) => {
      if (code !== undefined) return;
      code = value;
      running.delete(child);
      done(value);
      look();
    };
    // its pipes may still hold its last words when it has exited
    child.on('close', (value, signal) => end(value ?? signal));
    child.on('error', (error) => { said += String(error); end(-1); });
  });
  const name = () => [program.split('/').pop(), ...args].join(' ');
  const says = (pattern, limit) => new Promise((found, failed) => {
    const settle = (answer, value) => {
      clearTimeout(timer);
      waiting.delete(check);
      answer(value);
    };
    const check = () => {
      const match = pattern.exec(said);
      if (match) settle(found, match);
      else if (code !== undefined) settle(failed, new Error(`${name()} ended with ${code} and never said ${pattern}: ${said.slice(-2000)}`));
    };
    const timer = setTimeout(() => settle(failed, new Error(`${name()} did not say ${pattern} within ${limit} ms: ${said.slice(-2000)}`)), limit);
    waiting.add(check);
    check();
  });
  const stop = async (signal = 'SIGTERM') => {
    if (code === undefined) child.kill(signal);
    return ended;
  };
  return { says, ended, stop, said: () => said };
}

export const startEtude = (...args) => start(join(bin, 'etude'), [...args, ...onDomain]);

/** Runs it to its end, which has to be good. */
export async function etude(...args) {
  const process = startEtude(...args);
  const code = await process.ended;
  if (code !== 0) throw new Error(`etude ${args.join(' ')} ended with ${code}: ${process.said().slice(-3000)}`);
}
