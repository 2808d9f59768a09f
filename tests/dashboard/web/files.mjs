// SPDX-License-Identifier: Apache-2.0
// What the folders hold, read without the gateway: the oracle of the page tests.
import { createHash } from 'node:crypto';
import { existsSync, lstatSync, readFileSync, readdirSync } from 'node:fs';
import { join } from 'node:path';
import { inflateSync } from 'node:zlib';

/** Folders below these that have `name`, at most six levels down. */
export function foldersWith(dirs, name, depth = 6) {
  const found = [];
  const look = (folder, left) => {
    if (existsSync(join(folder, name))) found.push(folder);
    if (left === 0) return;
    for (const entry of readdirSync(folder, { withFileTypes: true })) {
      if (entry.isDirectory() && !['episodes', 'checkpoints', 'videos'].includes(entry.name)) look(join(folder, entry.name), left - 1);
    }
  };
  for (const dir of dirs) look(dir, depth);
  return found;
}

/** u64 beyond 2^53 as text, which JSON.parse alone would round. */
export function parse(text) {
  return JSON.parse(text.replace(/"seed":\s*(\d+)/g, '"seed":"$1"'));
}

export const readJson = (path) => parse(readFileSync(path, 'utf8'));

/** Whole lines; a torn last one is left out. */
export function readLines(path) {
  if (!existsSync(path)) return [];
  const text = readFileSync(path, 'utf8');
  return text.slice(0, text.lastIndexOf('\n') + 1).split('\n').filter(Boolean).map(parse);
}

/** Lines of a kind; a step that goes back supersedes what an older life wrote from there on. */
export function linesOf(folder, kind) {
  let lines = [];
  for (const line of readLines(join(folder, 'metrics.jsonl'))) {
    if (line.kind !== kind) continue;
    if (lines.length && line.step <= lines[lines.length - 1].step) lines = lines.filter((one) => one.step < line.step);
    lines.push(line);
  }
  return lines;
}

/** What there is to say of a series. */
export function series(folder, kind, key) {
  const points = linesOf(folder, kind).filter((line) => key in line).map((line) => line[key]);
  const values = points.filter((one) => one !== null);
  return { n: values.length, min: Math.min(...values), max: Math.max(...values), last: values[values.length - 1], missing: points.length - values.length };
}

export function episodeFiles(folder) {
  const episodes = join(folder, 'episodes');
  if (!existsSync(episodes)) return [];
  return readdirSync(episodes).flatMap((part) => readdirSync(join(episodes, part)).filter((name) => name.endsWith('.hdf5'))).sort();
}

export function checkpoints(run) {
  const folder = join(run, 'checkpoints');
  if (!existsSync(folder)) return [];
  return readdirSync(folder).filter((name) => /^\d+\.safetensors$/.test(name) && !lstatSync(join(folder, name)).isSymbolicLink())
    .map((name) => ({ name, sha256: createHash('sha256').update(readFileSync(join(folder, name))).digest('hex') })).sort((a, b) => b.name.localeCompare(a.name));
}

/** What the newest checkpoint of a run says of itself, all texts; its weights are not read. */
export function checkpointHeader(run) {
  const newest = checkpoints(run)[0];
  if (!newest) return undefined;
  const bytes = readFileSync(join(run, 'checkpoints', newest.name));
  return JSON.parse(bytes.subarray(8, 8 + Number(bytes.readBigUInt64LE(0))).toString()).__metadata__;
}

/** Decisions of a file of `etude eval --insight`; of those that have nothing, the step alone. */
export function insights(file) {
  const bytes = readFileSync(file);
  let at = bytes.indexOf('\n') + 1;
  return JSON.parse(bytes.subarray(0, at).toString()).decisions.map((one) => {
    const block = one.size ? inflateSync(bytes.subarray(at, at + one.bytes)) : null;
    at += one.bytes;
    return { step: one.step, ...(block ? JSON.parse(block.subarray(0, block.indexOf('\n')).toString()) : {}) };
  });
}
