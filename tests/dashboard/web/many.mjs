// SPDX-License-Identifier: Apache-2.0
// A dataset of many episodes out of a small one: rows of the journal, over hard links to one file.
import { copyFileSync, linkSync, mkdirSync, readFileSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { episodeFiles, readLines } from './files.mjs';

/** Makes `folder`; nothing where the dataset has no journal. */
export function makeMany(dataset, folder, episodes) {
  const rows = readLines(join(dataset, 'commits.jsonl'));
  if (!rows.length) return null;
  mkdirSync(folder, { recursive: true });
  // text, not JSON: seeds are larger than what a number holds
  const description = readFileSync(join(dataset, 'dataset.json'), 'utf8');
  writeFileSync(join(folder, 'dataset.json'), description.replace(/"episodes":\s*\d+/g, `"episodes": ${episodes}`));
  const first = episodeFiles(dataset)[0];
  const file = join(folder, 'one');
  copyFileSync(join(dataset, 'episodes', first.slice(0, 3), first), file);
  const lines = [];
  for (let index = 0; index < episodes; index++) {
    const name = String(index).padStart(6, '0');
    const part = join(folder, 'episodes', name.slice(0, 3));
    if (index % 1000 === 0) mkdirSync(part, { recursive: true });
    linkSync(file, join(part, `${name}.hdf5`));
    lines.push(JSON.stringify({ ...rows[index % rows.length], index, t: rows[0].t + index }));
  }
  writeFileSync(join(folder, 'commits.jsonl'), `${lines.join('\n')}\n`);
  return folder;
}
