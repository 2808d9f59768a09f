// SPDX-License-Identifier: Apache-2.0
// Pages follow what is written into the folders of a lab: while they are open, and while their gateway is away. Nothing is
// on the bus; every figure is compared with the files.
// ETUDE_LAB: what make_lab.mjs made; a copy of it grows. ETUDE_DOMAIN: a DDS domain of its own.
import assert from 'node:assert/strict';
import { appendFileSync, cpSync, mkdtempSync, readFileSync, renameSync, rmSync, writeFileSync } from 'node:fs';
import { after, before, test } from 'node:test';
import { tmpdir } from 'node:os';
import { join, resolve } from 'node:path';
import { addresses, launch } from './browser.mjs';
import { checkpointHeader, checkpoints, episodeFiles, linesOf, readJson, readLines, series } from './files.mjs';
import { startGateway } from './gateway.mjs';
import { onDomain } from './programs.mjs';
import { cameBack, closeAll, openAll, restart, shown, shows } from './shown.mjs';

const work = mkdtempSync(join(tmpdir(), `etude-test-${process.pid}-`));
const lab = join(work, 'lab');
const [data, run, evaluation] = ['data', 'run', 'eval'].map((name) => join(lab, name));
const log = join(data, 'noted.log');
let gateway;
let browser;
let pages;
// what the page Checkpoints shows without being told which: the newest when it was opened
let looked;

before(async () => {
  // links stay what they are, and times: a channel names a file beside it, and what has ended has not just changed
  cpSync(resolve(process.env.ETUDE_LAB ?? '.'), lab, { recursive: true, verbatimSymlinks: true, preserveTimestamps: true });
  note();
  looked = checkpoints(run)[0].name;
  gateway = await startGateway([lab], 0, onDomain);
  browser = await launch();
  const { sources } = await (await fetch(`${gateway.address}/api/v1/home`)).json();
  const [first, other] = ['eval', 'eval_before'].map((name) => sources.find((one) => one.kind === 'eval' && one.name === name).id);
  pages = { ...(await addresses(gateway.address)), evaluation: `/evaluation?eval=${first}`, compare: `/evaluation?eval=${first}&vs=${other}` };
});

after(async () => {
  await browser?.close();
  await gateway?.stop();
  rmSync(work, { recursive: true, force: true });
});

/** A line of now: those of all programs are sorted by their time. */
function note() {
  appendFileSync(log, `${new Date().toTimeString().slice(0, 8)} info etude-test: line ${readLogLines().length + 1}\n`);
}

function readLogLines() {
  try {
    return readFileSync(log, 'utf8').split('\n').filter(Boolean);
  } catch {
    return [];
  }
}

function trainOn() {
  const last = linesOf(run, 'train').at(-1);
  appendFileSync(join(run, 'metrics.jsonl'), `${JSON.stringify({ ...last, step: last.step + 50, time: last.time + 1, loss: 0.75 * last.loss })}\n`);
}

/** The newest attempt of the journal once more: its seed is larger than what a number holds, so its line stays text. */
function failAgain() {
  const file = join(data, 'attempts.jsonl');
  const last = readFileSync(file, 'utf8').trimEnd().split('\n').at(-1);
  appendFileSync(file, `${last.replace(/"attempt":(\d+)/, (_all, attempt) => `"attempt":${Number(attempt) + 1}`)}\n`);
}

function writeWhole(file, content) {
  writeFileSync(`${file}.new`, content);
  renameSync(`${file}.new`, file);
}

/** One rollout more, as an evaluation that goes on writes its report anew. */
function rollOut() {
  const report = readJson(join(evaluation, 'eval.json'));
  const last = report.per_episode.at(-1);
  const row = { ...last, index: last.index + 1, success: !last.success };
  report.per_episode.push(row);
  report.done = report.per_episode.length;
  report.episodes = Math.max(report.episodes, report.done);
  report.overall.n++;
  report.overall.success.successes += row.success ? 1 : 0;
  writeWhole(join(evaluation, 'eval.json'), JSON.stringify(report).replace(/"seed":"(\d+)"/g, '"seed":$1'));
}

/** The newest weights as those of 50 steps later: the header says so in as many letters. */
function save() {
  const folder = join(run, 'checkpoints');
  const newest = checkpoints(run)[0].name;
  const bytes = readFileSync(join(folder, newest));
  const size = Number(bytes.readBigUInt64LE(0));
  const header = bytes.subarray(8, 8 + size).toString();
  const later = header.replace(/("step":\s*")(\d+)"/, (_all, key, step) => `${key}${Number(step) + 50}"`);
  assert.ok(later !== header && Buffer.byteLength(later) === size, 'the header of a checkpoint is another than it was');
  bytes.write(later, 8);
  const digits = newest.indexOf('.');
  writeWhole(join(folder, `${String(Number.parseInt(newest, 10) + 50).padStart(digits, '0')}.safetensors`), bytes);
}

function grow() {
  for (const one of [note, trainOn, failAgain, rollOut, save]) one();
}

/** What the files say that a page shows, in the order of shown.mjs. */
function inTheFiles() {
  const [committed, failed] = [episodeFiles(data).length, readLines(join(data, 'attempts.jsonl')).filter((one) => one.outcome !== 'success').length];
  const { step } = linesOf(run, 'train').at(-1);
  const loss = series(run, 'train', 'loss');
  const saved = checkpoints(run);
  const report = readJson(join(evaluation, 'eval.json'));
  const made = new Map();
  for (const { worker } of readLines(join(data, 'commits.jsonl'))) if (worker) made.set(worker, (made.get(worker) ?? 0) + 1);
  for (const { details } of readLines(join(data, 'attempts.jsonl'))) if (details?.worker && !made.has(details.worker)) made.set(details.worker, 0);
  return {
    overview: [committed, step, Number(checkpointHeader(run).step)],
    fleet: [...made].sort(),
    generation: [committed + failed, committed, failed, failed],
    training: [step, loss.n, loss.min, loss.max, loss.last],
    checkpoints: [...saved.map((one) => one.name), saved.find((one) => one.name === looked).sha256],
    evaluation: [report.overall.success.successes, report.per_episode.length],
    logs: [readLogLines().at(-1)],
  };
}

const follow = ['overview', 'generation', 'training', 'checkpoints', 'evaluation', 'logs'];

test('pages follow the files, and show the right figures when their gateway has come back', { timeout: 600000 }, async () => {
  const opened = await openAll(browser, gateway, pages);
  const show = async (wanted) => { for (const { name, page } of opened) if (wanted[name]) await shows(name, page, wanted[name]); };
  try {
    const first = inTheFiles();
    await show(first);
    grow();
    const second = inTheFiles();
    for (const name of follow) assert.notDeepEqual(second[name], first[name], `nothing that ${name} shows has grown`);
    await show(second);
    for (const { name, wrong } of opened) assert.deepEqual(wrong, [], name);
    // those of which nothing has grown
    const stay = {};
    for (const { name, page } of opened) if (!second[name]) stay[name] = await shown(name, page);
    gateway = await restart(gateway, opened, (port) => {
      grow();
      return startGateway([lab], port, onDomain);
    });
    await cameBack(opened);
    await show({ ...stay, ...inTheFiles() });
  } finally {
    await closeAll(opened);
  }
});
