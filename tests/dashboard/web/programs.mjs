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

/** A program that runs, and what it has said. */
export class Program {
  said = '';
  #name;
  #child;
  #code;
  #waiting = new Set();
  /** Its exit code, or the signal that ended it. */
  ended;

  constructor(program, args) {
    this.#name = [program.split('/').pop(), ...args].join(' ');
    this.#child = spawn(program, args, { cwd: root, stdio: ['ignore', 'pipe', 'pipe'] });
    running.add(this.#child);
    for (const stream of [this.#child.stdout, this.#child.stderr]) {
      stream.on('data', (bytes) => {
        this.said = (this.said + bytes).slice(-20000);
        this.#look();
      });
    }
    this.ended = new Promise((done) => {
      // its pipes may still hold its last words when it has exited
      this.#child.on('close', (code, signal) => this.#end(code ?? signal, done));
      this.#child.on('error', (error) => { this.said += String(error); this.#end(-1, done); });
    });
  }

  /** The match of what it says with a pattern; an error with its last words when it ends, or `limit` ms are over, without. */
  says(pattern, limit) {
    return new Promise((found, failed) => {
      const fail = (what) => settle(failed, new Error(`${this.#name} ${what} ${pattern}: ${this.said.slice(-2000)}`));
      const timer = setTimeout(() => fail(`did not say within ${limit} ms`), limit);
      const look = () => {
        const match = pattern.exec(this.said);
        if (match) settle(found, match);
        else if (this.#code !== undefined) fail(`ended with ${this.#code} and never said`);
      };
      const settle = (answer, value) => {
        clearTimeout(timer);
        this.#waiting.delete(look);
        answer(value);
      };
      this.#waiting.add(look);
      look();
    });
  }

  async stop(signal = 'SIGTERM') {
    if (this.#code === undefined) this.#child.kill(signal);
    return this.ended;
  }

  #look() {
    for (const look of [...this.#waiting]) look();
  }
  #end(code, done) {
    if (this.#code !== undefined) return;
    this.#code = code;
    running.delete(this.#child);
    done(code);
    this.#look();
  }
}

export const startEtude = (...args) => new Program(join(bin, 'etude'), [...args, ...onDomain]);

/** Runs it to its end, which has to be good. */
export async function etude(...args) {
  const program = startEtude(...args);
  const code = await program.ended;
  if (code !== 0) throw new Error(`etude ${args.join(' ')} ended with ${code}: ${program.said.slice(-3000)}`);
}
