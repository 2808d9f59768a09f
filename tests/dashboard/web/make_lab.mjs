// SPDX-License-Identifier: Apache-2.0
// A small lab, made by the programs as anybody would make one: demonstrations, a run with checkpoints, two evaluations of
// the same scenes.
//   node make_lab.mjs FOLDER     (minutes; ETUDE_BIN, ETUDE_DOMAIN)
import { appendFileSync, mkdtempSync, readdirSync, rmSync } from 'node:fs';
import { join, resolve } from 'node:path';
import { readJson } from './files.mjs';
import { Program, bin, etude } from './programs.mjs';

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

/** The expert fails in one of some hundred attempts: what a collector notes of one is written here, for the pages to show. */
async function noteAFailure(index, attempt) {
  say(`notes a failure of attempt ${attempt} at episode ${index}`);
  const work = mkdtempSync(at('attempt-'));
  const made = new Program(join(bin, 'etude'), ['attempt', 'replay', at('data'), '--index', String(index), '--attempt', String(attempt), '--out', join(work, 'out')]);
  if (await made.ended !== 0) throw new Error(`the attempt cannot be made: ${made.said}`);
  const { seed } = readJson(join(work, 'out', 'plan.json'));
  rmSync(work, { recursive: true });
  const details = { reason: 'grasp: step 212: nothing in the hand', stage: 'grasp', pair: 'right_finger–world', t: Date.now() / 1000, worker: 'lab-w0', plan_s: 0.21, step_s: 1.4, render_s: 0.3, deflate_s: 0.02 };
  // the seed is larger than what a number holds
  appendFileSync(at('data', 'attempts.jsonl'), `{"index":${index},"attempt":${attempt},"seed":${seed},"outcome":"grasp_missed","details":${JSON.stringify(details)}}\n`);
}

say('collects 32 demonstrations');
await etude('collect', campaign, '--out', at('data'), '--episodes', '32', '--seed', '5', '--workers', '2', ...set('name=lab', 'split={train: 26, valid: 6, test: 0}'));
await noteAFailure(1, 1);
say('trains 300 steps');
await etude('train', '--data', at('data'), '--config', 'compact', '--out', at('run'), '--name', 'lab', '--steps', '300', '--seed', '3',
  ...set('data.batch=16', 'data.sentences=2', 'data.min_episodes=12', 'data.min_valid=1', 'eval.every_steps=60', 'eval.frames=48', 'checkpoint.every_steps=150'));
const checkpoints = readdirSync(at('run', 'checkpoints')).filter((name) => /^\d+\.safetensors$/.test(name)).sort();
const evaluate = (name, checkpoint) => etude('eval', '--checkpoint', at('run', 'checkpoints', checkpoint), '--scenes', campaign, '--out', at(name), '--episodes', '4', '--videos', '2', '--insight',
  '--workers', '1', '--seed', '7', ...set('rollout.max_steps=240'));
for (const [name, checkpoint] of [['eval', checkpoints.at(-1)], ['eval_before', checkpoints.at(-2) ?? checkpoints[0]]]) {
  say(`evaluates ${checkpoint} in 4 scenes`);
  await evaluate(name, checkpoint);
}
say('the lab is made');
