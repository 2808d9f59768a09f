// SPDX-License-Identifier: Apache-2.0
// A small lab, made by the programs as anybody would make one: demonstrations, a run with checkpoints, two evaluations of
// the same scenes.
//   node make_lab.mjs FOLDER     (minutes; ETUDE_BIN, ETUDE_DOMAIN)
import { readdirSync } from 'node:fs';
import { join, resolve } from 'node:path';
import { etude } from './programs.mjs';

const campaign = 'deploy/campaigns/quickstart.yaml';
const set = (...values) => values.flatMap((one) => ['--set', one]);

const folder = process.argv[2] && resolve(process.argv[2]);
if (!folder) {
  console.error('make_lab: node make_lab.mjs FOLDER');
  process.exit(2);
}
const at = (...parts) => join(folder, ...parts);
const began = Date.now();
const say = (what) => console.log(`${((Date.now() - began) / 1000).toFixed(0).padStart(4)} s  ${what}`);

say('collects 32 demonstrations');
await etude('collect', campaign, '--out', at('data'), '--episodes', '32', '--seed', '5', '--workers', '2', ...set('name=lab', 'split={train: 26, valid: 6, test: 0}'));
say('trains 300 steps');
await etude('train', '--data', at('data'), '--config', 'compact', '--out', at('run'), '--name', 'lab', '--steps', '300', '--seed', '3',
  ...set('data.batch=16', 'data.sentences=2', 'data.min_episodes=12', 'data.min_valid=1', 'eval.every_steps=60', 'eval.frames=48', 'checkpoint.every_steps=150'));
const checkpoints = readdirSync(at('run', 'checkpoints')).filter((name) => /^\d+\.safetensors$/.test(name)).sort();
const evaluate = (name, checkpoint) => etude('eval', '--checkpoint', at('run', 'checkpoints', checkpoint), '--scenes', campaign, '--out', at(name), '--episodes', '4', '--videos', '2',
  '--workers', '1', '--seed', '7', ...set('rollout.max_steps=240'));
for (const [name, checkpoint] of [['eval', checkpoints.at(-1)], ['eval_before', checkpoints.at(-2) ?? checkpoints[0]]]) {
  say(`evaluates ${checkpoint} in 4 scenes`);
  await evaluate(name, checkpoint);
}
say('the lab is made');
