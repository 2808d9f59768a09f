// SPDX-License-Identifier: Apache-2.0
// The real gateway over given folders: started, killed and started again by the tests.
import { spawn } from 'node:child_process';
import { dirname, join } from 'node:path';
import { fileURLToPath } from 'node:url';

const root = join(dirname(fileURLToPath(import.meta.url)), '../../..');
const program = process.env.ETUDE_GATEWAY ?? join(root, 'build/bin/etude-gateway');

/** Starts it and waits for its address; port 0 is any free one, `options` go to the program. */
export async function startGateway(dirs, port = 0, options = []) {
  const child = spawn(program, [...dirs.flatMap((dir) => ['--dir', dir]), '--port', String(port), ...options], { stdio: ['ignore', 'pipe', 'pipe'] });
  let said = '';
  const address = await new Promise((found, failed) => {
    const read = (bytes) => {
      said += bytes;
      const match = /http:\/\/(?:127\.0\.0\.1|localhost):\d+/.exec(said);
      if (match) found(match[0]);
    };
    child.stdout.on('data', read);
    child.stderr.on('data', read);
    child.on('error', failed);
    child.on('exit', (code) => failed(new Error(`${program} ended with ${code} before it said its address: ${said}`)));
    setTimeout(() => failed(new Error(`${program} said no address within 30 s: ${said}`)), 30000).unref();
  });
  const ended = new Promise((done) => child.on('exit', done));
  return { address, stop: async (signal = 'SIGTERM') => { child.kill(signal); await ended; } };
}
