// SPDX-License-Identifier: Apache-2.0
// The real gateway over given folders: started, killed and started again by the tests.
import { join } from 'node:path';
import { Program, bin, root } from './programs.mjs';

const program = process.env.ETUDE_GATEWAY ?? join(bin, 'etude-gateway');

/** Starts it and waits for its address; port 0 is any free one, `options` go to the program. The pages are this tree's. */
export async function startGateway(dirs, port = 0, options = []) {
  const pages = ['--web', join(root, 'dashboard/web/dist')];
  const gateway = new Program(program, [...dirs.flatMap((dir) => ['--dir', dir]), '--port', String(port), ...pages, ...options]);
  const [address] = await gateway.says(/http:\/\/(?:127\.0\.0\.1|localhost):\d+/, 30000);
  return { address, stop: (signal) => gateway.stop(signal) };
}
